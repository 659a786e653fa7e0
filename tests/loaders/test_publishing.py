"""What is published with a version: each file by the schema of its reader, and true."""

import json
import subprocess
from functools import partial

import jsonschema
import pytest
import yaml
from huggingface_hub import DatasetCard

from synthnet import store
from synthnet.errors import StoreError
from synthnet.loaders import publishing
from synthnet.store.files import sha256

VERSION = "1.0-mini"
TEXT = {"type": "string", "minLength": 1}
# Of https://developers.zenodo.org, "Deposit metadata", the fields that a dataset has.
ZENODO = {
    "type": "object",
    "additionalProperties": False,
    "required": ["title", "upload_type", "description", "creators", "access_right", "license"],
    "properties": {
        "title": TEXT,
        "upload_type": {"const": "dataset"},
        "description": TEXT,
        "creators": {
            "type": "array",
            "minItems": 1,
            "items": {"type": "object", "required": ["name"], "properties": {"name": TEXT}},
        },
        "access_right": {"enum": ["open", "embargoed", "restricted", "closed"]},
        "license": {"const": "MIT"},
        "version": {"type": "string", "pattern": r"^\d+\.\d+\.\d+$"},
        "publication_date": {"type": "string", "pattern": r"^\d{4}-\d{2}-\d{2}$"},
        "language": {"type": "string", "pattern": "^[a-z]{2,3}$"},
        "keywords": {"type": "array", "uniqueItems": True, "items": TEXT},
        "related_identifiers": {
            "type": "array",
            "items": {
                "type": "object",
                "additionalProperties": False,
                "required": ["identifier", "relation"],
                "properties": {
                    "identifier": {"type": "string", "pattern": "^https://"},
                    "relation": {"enum": ["isDerivedFrom", "isSupplementTo", "cites"]},
                    "scheme": {"enum": ["url", "doi"]},
                },
            },
        },
        "notes": TEXT,
    },
}
# Of https://huggingface.co/docs/hub/eval-results, "Registering a benchmark".
EVALUATION = {
    "type": "object",
    "additionalProperties": False,
    "required": ["name", "description", "evaluation_framework", "tasks"],
    "properties": {
        "name": TEXT,
        "description": TEXT,
        "evaluation_framework": {"type": "string", "pattern": "^[a-z-]+$"},
        "tasks": {
            "type": "array",
            "minItems": 1,
            "items": {
                "type": "object",
                "additionalProperties": False,
                "required": ["id", "config", "split"],
                "properties": dict.fromkeys(("id", "config", "split"), TEXT),
            },
        },
    },
}


@pytest.fixture
def exported(mini_copy, run):
    code, out, err = run("export", VERSION, "--out", mini_copy, "--json")
    assert (code, err) == (0, "")
    directory = mini_copy / VERSION
    names = ["croissant.json", "zenodo.json", "README.md", "eval.yaml", "SHA256SUMS"]
    assert json.loads(out) == {"files": [str(directory / name) for name in names]}
    return directory


def test_zenodo_takes_its_metadata(exported):
    metadata = json.loads((exported / "zenodo.json").read_text())
    jsonschema.validate(metadata, ZENODO)
    manifest = store.open_dataset(VERSION, exported.parent).manifest
    assert manifest.recipe_digest in metadata["description"]
    assert f"{manifest.rows} meshes" in metadata["description"]
    assert (metadata["version"], metadata["publication_date"]) == ("1.0.0", "2026-11-21")


def test_the_hub_takes_card_and_benchmark(exported):
    card = DatasetCard.load(exported / "README.md")
    facts = card.data.to_dict()
    assert facts["license"] == "mit"
    assert facts["size_categories"] == ["n<1K"]
    (config,) = facts["configs"]
    (files,) = config["data_files"]
    assert sorted(exported.glob(files["path"])) == sorted((exported / "shards").iterdir())
    assert "| torus | " in card.text
    benchmark = yaml.safe_load((exported / "eval.yaml").read_text())
    jsonschema.validate(benchmark, EVALUATION)
    assert benchmark["tasks"][0]["config"] == config["config_name"]
    assert benchmark["tasks"][0]["split"] == files["split"]


def test_every_file_has_its_digest(exported):
    command = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    check = partial(subprocess.run, command, cwd=exported, capture_output=True, text=True)
    done = check()
    assert done.returncode == 0, done.stdout
    listed = {line.split("  ")[1] for line in (exported / "SHA256SUMS").read_text().splitlines()}
    there = {p.relative_to(exported).as_posix() for p in exported.rglob("*") if p.is_file()}
    assert listed == there - {".lock", "SHA256SUMS"}
    first = next(path for path in (exported / "shards").iterdir())
    first.write_bytes(first.read_bytes()[:-1])
    again = check()
    assert again.returncode == 1
    assert f"shards/{first.name}: FAILED" in again.stdout


def test_the_same_dataset_gives_the_same_bytes(exported):
    dataset = store.open_dataset(VERSION, exported.parent)
    first, second = ([sha256(path) for path in publishing.write(dataset)] for _ in range(2))
    assert first == second


def test_what_has_authors_of_its_own_is_refused(sealed_set):
    dataset = store.open_dataset(sealed_set.seal.dataset, sealed_set.home)
    with pytest.raises(StoreError, match="is no version of synthNet"):
        publishing.write(dataset)
    assert not (dataset.directory / "zenodo.json").exists()
