"""Result files: the schema, and the identities asserted when one is read."""

import copy
import json
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import pytest
from eigbench import results
from eigbench.errors import ResultError
from eigbench.results import submission
from eigbench.scoring import truth
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.names import TARGETS

HERE = Path("result.json")


@pytest.fixture
def result(weyl):
    return copy.deepcopy(weyl.result)


def at(thing, path):
    """Follow a path of keys; ``*`` is the first there is."""
    for key in filter(None, path.split("/")):
        if key == "*":
            thing = next(iter(thing.values())) if isinstance(thing, dict) else thing[0]
        else:
            thing = thing[key]
    return thing


def refuse(result, message):
    with pytest.raises(ResultError, match=message):
        results.validate(result, HERE)


def test_schema_is_a_schema():
    jsonschema.Draft202012Validator.check_schema(results.schema())


def test_schema_names_every_target():
    assert results.schema()["properties"]["scores"]["required"] == list(TARGETS)


@pytest.mark.parametrize("path", ["scores/mesh/overall", "scores/surface/families/*"])
def test_scores_of_more_or_fewer_metrics_are_refused(result, path):
    numbers = at(result, path)
    numbers["worst"] = numbers["rpd"]
    refuse(result, "does not have the metrics invlap, rpd, polar")
    del numbers["worst"], numbers["rpd"]
    refuse(result, "does not have the metrics invlap, rpd, polar")


def test_result_is_read_as_it_was_written(result, tmp_path):
    results.write(tmp_path / "a.json", result)
    assert results.read(tmp_path / "a.json") == result
    results.write(tmp_path / "b.json", results.read(tmp_path / "a.json"))
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


LEVELS = [
    *("", "model", "dataset", "predictions", "cost", "physics"),
    *("scores", "scores/surface", "scores/mesh"),
    *("scores/mesh/overall", "scores/mesh/overall/rpd", "scores/mesh/per_index/*"),
    *("scores/mesh/families/*", "scores/mesh/families/*/rpd"),
]


@pytest.mark.parametrize("path", LEVELS)
def test_unknown_key_is_refused(result, path):
    at(result, path)["surprise"] = 1
    refuse(result, r"result\.json is no result: at .*surprise")


# What a META leaves out, "reference" of rows older than it, and the sandbox of a run.
OPTIONAL = ("model", "cost", "")


@pytest.mark.parametrize("path", LEVELS)
def test_missing_key_is_refused(result, path):
    level = at(result, path)
    assert level
    for key in list(level):
        schema = results.schema()
        if path in OPTIONAL and key not in schema["properties"].get(path, schema)["required"]:
            continue
        kept = level.pop(key)
        message = "not have the metrics" if key in METRICS else f"'{key}' is a required property"
        refuse(result, message)
        level[key] = kept


@pytest.mark.parametrize(
    ("path", "key", "value"),
    [
        ("", "schema_version", "3"),
        ("", "metric_version", "1"),
        ("", "checkout", {"commit": "0" * 40}),
        ("", "checkout", {"commit": "main", "dirty": False, "branch": "main"}),
        ("", "partial", "no"),
        ("model", "name", 3),
        ("model", "name", ""),
        ("model", "kind", "magic"),
        ("model", "sources", {}),
        ("model", "parameters", -1),
        ("model", "parameters", 1.5),
        ("model", "training_data", "a set\n## a heading"),
        ("dataset", "split", "exam"),
        ("dataset", "protocol", "Random split"),
        ("dataset", "split_digest", "A" * 64),
        ("dataset", "instances", 0),
        ("predictions", "seeds", 0),
        ("predictions", "seeds", True),
        ("scores", "mesh", None),
        ("scores/mesh", "families", {}),
        ("scores/surface", "per_index", []),
        ("scores/surface", "exact", 1.5),
        ("scores/mesh/overall/rpd", "mean", "0.1"),
        ("scores/mesh/families/*", "count", 1.5),
        ("scores/mesh/per_index/*", "median", [0.1]),
        ("cost", "ms_per_mesh", -1),
        ("cost", "ms_per_mesh", 0),
        ("cost", "ms_per_mesh_mean", 0),
        ("cost", "ms_per_mesh_quartiles", [1.0]),
        ("cost", "batch_size", 0),
        ("cost", "hardware", "a machine\n## a heading"),
        ("physics", "rotation", "small"),
        ("environment", "python", 3.11),
    ],
)
def test_wrong_value_is_refused_and_its_place_named(result, path, key, value):
    at(result, path)[key] = value
    where = "/".join([path.replace("*", r"\w+"), key]).removeprefix("/")
    refuse(result, f"at {where}: ")


@pytest.mark.parametrize(("version", "age"), [(2, "an earlier"), (4, "a later")])
def test_result_of_another_schema_says_by_which_eigbench_it_was_made(result, version, age):
    result["schema_version"] = version
    refuse(result, rf"made by {age} eigbench: evaluate its predictor again")


@pytest.mark.parametrize("broken", [[], 3, None, "result", {}])
def test_json_that_is_no_result_is_refused(tmp_path, broken):
    (tmp_path / "r.json").write_text(json.dumps(broken))
    with pytest.raises(ResultError, match="is no result: at the top"):
        results.read(tmp_path / "r.json")


@pytest.mark.parametrize("key", METRICS)
@pytest.mark.parametrize(
    ("path", "by"), [("scores/mesh/overall", 1e-6), ("scores/mesh/families/*", 1e-3)]
)
def test_means_of_families_that_do_not_give_the_overall_one_are_refused(result, path, by, key):
    at(result, path)[key]["mean"] += by
    refuse(result, f"means of {key} do not give the overall mean")


def test_counts_that_add_up_and_do_not_give_the_mean_are_refused(result):
    first, second = list(result["scores"]["mesh"]["families"].values())[:2]
    first["count"] += 1
    second["count"] -= 1
    refuse(result, "do not give the overall mean")


def test_mean_that_is_not_finite_must_be_so_in_a_family_too(result):
    result["scores"]["mesh"]["overall"]["rpd"]["mean"] = None
    refuse(result, "means of rpd")
    at(result, "scores/mesh/families/*")["rpd"]["mean"] = None
    results.validate(result, HERE)
    result["scores"]["mesh"]["overall"]["rpd"]["mean"] = 0.1
    refuse(result, "means of rpd")


def test_missing_result_is_refused(tmp_path):
    with pytest.raises(ResultError, match=r"there is no file .*none\.json"):
        results.read(tmp_path / "none.json")


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"{'a': 1}"])
def test_file_that_is_no_json_is_refused(tmp_path, content):
    (tmp_path / "r.json").write_bytes(content)
    with pytest.raises(ResultError, match=r"r\.json cannot be read"):
        results.read(tmp_path / "r.json")


def test_wrong_result_is_not_written(result, tmp_path):
    result["surprise"] = 1
    with pytest.raises(ResultError, match="surprise"):
        results.write(tmp_path / "r.json", result)
    assert list(tmp_path.iterdir()) == []


def test_schema_accepts_a_result_without_torch_installed(result):
    for name in ("torch", "torch-geometric"):
        result["environment"].pop(name, None)
    results.validate(result, HERE)


@pytest.mark.parametrize(
    ("version", "protocol", "named", "of"),
    [
        ("1.0-mini", "grouped", "scans", "1.0-mini"),
        ("1.0-mini", "grouped", "1.0", "1.0-mini"),
        ("scans", "grouped", "1.0-mini", "scans"),
        ("2.0", "imported/real-28", "scans", "real-28"),
        ("2.0", "imported/real-28", "1.0", "2.0"),
    ],
)
def test_a_result_of_another_dataset_than_the_one_named_is_refused(version, protocol, named, of):
    result = {"dataset": {"version": version, "protocol": protocol}}
    message = rf"^a\.json is of the dataset {of}, not of {named}: give --dataset {of}, or leave it"
    with pytest.raises(ResultError, match=message):
        submission.check_dataset(result, named, Path("a.json"))


@pytest.mark.parametrize("protocol", ["grouped", "imported/scans"])
def test_a_result_on_an_import_has_the_labels_of_that(protocol, monkeypatch):
    """Of the protocol that has its name too, which no dataset has by itself."""
    dataset = SimpleNamespace(manifest=SimpleNamespace(version="scans"))
    monkeypatch.setattr(truth, "of_import", lambda *given: given)
    monkeypatch.setattr(truth, "of_dataset", lambda *given: given)
    version = "scans" if protocol == "grouped" else "2.0"
    facts = {"version": version, "split": "test", "protocol": protocol}
    labels = submission._truth({"dataset": facts, "partial": False}, dataset, Path("a.json"))
    assert labels == ((dataset, "test", "grouped") if protocol == "grouped" else (dataset, version))
