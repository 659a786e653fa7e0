"""Croissant metadata: a validator accepts it, and the records it loads are the stored ones."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import mlcroissant
import numpy as np
import pytest

from synthnet import recipe, store
from synthnet.errors import StoreError
from synthnet.loaders import croissant
from synthnet.store.files import sha256
from synthnet.types import SPLITS

VERSION = "1.0-mini"
COMMAND = "from mlcroissant.scripts.cli import main; main()"  # that of `mlcroissant`
pytestmark = [  # of mlcroissant's own parser and reader
    pytest.mark.filterwarnings("ignore:ConjunctiveGraph is deprecated:DeprecationWarning"),
    pytest.mark.filterwarnings("ignore:The inplace keyword in DataFrame.reset_index:Warning"),
]


@pytest.fixture(scope="module")
def described(mini_home, tmp_path_factory):
    """The metadata of a copy of 1.0-mini."""
    home = tmp_path_factory.mktemp("croissant")
    shutil.copytree(mini_home / VERSION, home / VERSION)
    return croissant.write(store.open_dataset(VERSION, home))


def plain(value):
    return value.decode() if isinstance(value, bytes) else value


def test_the_validator_accepts_it_without_a_word(described):
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, "validate", "--jsonld", str(described)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Done." in done.stderr
    assert "warning" not in done.stderr.lower()
    issues = mlcroissant.Dataset(str(described)).metadata.ctx.issues
    assert (set(issues.errors), set(issues.warnings)) == (set(), set())


def test_the_validator_finds_faults(described, tmp_path):
    broken = json.loads(described.read_text())
    broken["recordSet"][1]["field"][0]["source"]["fileSet"]["@id"] = "nowhere"
    (tmp_path / "broken.json").write_text(json.dumps(broken))
    with pytest.raises(mlcroissant.ValidationError, match="nowhere"):
        mlcroissant.Dataset(str(tmp_path / "broken.json"))


@pytest.mark.slow
def test_records_load_equal_to_the_stored_ones(described):
    loaded = mlcroissant.Dataset(str(described)).records("shapes")
    stored = store.open_dataset(VERSION, described.parents[1]).samples()
    # mlcroissant reads in the order of the shards' names.
    samples = sorted(stored, key=lambda sample: (sample.spec.family, sample.spec.index))
    assert len(samples) == 335
    for sample, record in zip(samples, loaded, strict=True):
        row = {key.removeprefix("shapes/"): value for key, value in record.items()}
        assert list(row) == store.SCHEMA.names
        assert plain(row["id"]) == sample.spec.id
        assert plain(row["split"]) == sample.split
        assert tuple(map(plain, row["paper_splits"])) == sample.paper_splits
        assert json.loads(row["parameters"]) == dict(sample.spec.parameters)
        for name in ("count", "shift", "residual"):
            assert row[name] == getattr(sample.certificate, name)
        for name, expected in (
            ("eigenvalues", sample.eigenvalues),
            ("vertices", sample.mesh.vertices),
            ("faces", sample.mesh.faces),
            ("isometries", sample.isometries.reshape(-1, 9)),
        ):
            array = np.array(row[name])
            assert array.dtype == expected.dtype
            np.testing.assert_array_equal(array, expected)


def test_labels_load_without_the_meshes(described):
    loaded = list(mlcroissant.Dataset(str(described)).records("labels"))
    samples = {s.spec.id: s for s in store.open_dataset(VERSION, described.parents[1]).samples()}
    assert len(loaded) == len(samples) == 335
    for record in loaded:
        sample = samples[plain(record["labels/id"])]
        assert record["labels/eigenvalues"] == sample.eigenvalues.tolist()
        assert plain(record["labels/family"]) == sample.spec.family
    assert "labels/vertices" not in loaded[0]


def test_splits_are_named_and_are_those_of_the_records(described):
    dataset = mlcroissant.Dataset(str(described))
    assert tuple(row["splits/name"] for row in dataset.records("splits")) == SPLITS
    names = {plain(record["labels/split"]) for record in dataset.records("labels")}
    assert names == set(SPLITS)


def test_every_file_has_its_digest_and_size(described):
    files = {
        entry["contentUrl"]: entry
        for entry in json.loads(described.read_text())["distribution"]
        if entry["@type"] == "cr:FileObject"
    }
    directory = described.parent
    shards = {f"shards/{path.name}" for path in (directory / "shards").iterdir()}
    assert set(files) == shards | {"manifest.json"}
    for name, entry in files.items():
        assert entry["sha256"] == sha256(directory / name)
        assert entry["contentSize"] == f"{(directory / name).stat().st_size} B"


def test_columns_are_those_of_the_store_with_their_types():
    numbers = {"int32": "cr:Int32", "double": "cr:Float64", "float": "cr:Float32"}
    kinds = {"string": "sc:Text", **numbers}
    assert list(croissant.COLUMNS) == store.SCHEMA.names
    for field in store.SCHEMA:
        kind = field.type
        while hasattr(kind, "value_type"):
            kind = kind.value_type
        assert croissant.COLUMNS[field.name][0] == kinds[str(kind)], field.name


@pytest.mark.parametrize("version", [*recipe.available(), "1.0-x100"])
def test_every_version_has_words_of_its_own(version):
    about, expected = croissant._about(version)
    assert about == croissant.ABOUT[version[:3]]
    assert about.semantic == f"{version[:3]}.0"
    assert (croissant._part(expected) == "") == (version in croissant.ABOUT)


def test_a_version_without_words_of_its_own_is_refused(monkeypatch, mini_home):
    monkeypatch.delitem(croissant.ABOUT, "1.0")
    file = "synthnet/loaders/croissant.py"
    with pytest.raises(
        StoreError, match=rf"^1\.0 has no words of its own: add .* ABOUT in .*{file}$"
    ):
        croissant.metadata(store.open_dataset(VERSION, mini_home))


def test_a_sealed_set_is_refused(sealed_set):
    dataset = store.open_dataset(sealed_set.seal.dataset, sealed_set.home)
    with pytest.raises(StoreError, match="is no version of synthNet: an import, a sealed set"):
        croissant.write(dataset)


def test_command_writes_beside_the_manifest(run, mini_copy):
    location = mini_copy / VERSION / "croissant.json"
    where = ["--version", VERSION, "--out", mini_copy]
    assert run("croissant", *where) == (0, f"{location}\n", "")
    code, out, _ = run("croissant", *where, "--json")
    assert (code, json.loads(out)) == (0, {"croissant": str(location)})
    assert json.loads(location.read_text())["name"] == "synthNet 1.0-mini"
    assert run("verify", *where, "--files")[0] == 0


def test_it_says_what_the_licence_says():
    assert (Path(__file__).parents[2] / "LICENSE").read_text().startswith("MIT License")
    assert croissant.LICENCE.endswith("/MIT.html")
