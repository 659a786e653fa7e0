"""The command line: help, check, score; what the tables say."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
from eigbench.board import foreseen, tables
from eigbench.commands import check
from eigbench.commands.score import EXPLAINED
from eigbench.results import predictions
from eigbench.scoring import physics
from eigbench.scoring.metrics import METRICS

from synthnet import store

WEYL = """
import numpy as np

def one(mesh):
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return 4 * np.pi * np.arange(1, 11) / area

"""


@pytest.mark.parametrize("command", ["check", "evaluate", "scale"])
def test_help_says_plainly_that_the_code_is_run(eigbench, command):
    assert "runs the file's code" in " ".join(eigbench(command, "--help")[1].split())


def test_help_of_score_says_plainly_that_no_code_is_run(eigbench):
    assert "no code is run" in " ".join(eigbench("score", "--help")[1].split())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["guess"], "invalid choice: 'guess'"),
        (["evaluate"], "the following arguments are required: FILE"),
        (["evaluate", "m.py", "--split", "exam"], "invalid choice: 'exam'"),
        (["compare", "a", "b", "--target", "surfase"], "did you mean surface?"),
        (["evalute", "m.py"], "did you mean evaluate? (`eigbench --help` shows how)"),
        (["evaluate", "--datset", "1.0"], "did you mean --dataset? (`eigbench evaluate --help`"),
        (
            ["evaluate", "m.py", "--version", "1.0"],
            "unrecognized arguments: --version; did you mean --dataset?",
        ),
        (["evaluate", "m.py", "--batch-size", "0"], "must be at least 1, got 0"),
        (["evaluate", "m.py", "--limit", "-1"], "must be at least 1, got -1"),
        (["evaluate", "m.py", "--seeds", "two"], "invalid positive value: 'two'"),
        (["evaluate", "m.py", "--device", "cdua"], "must be one of cpu, cuda, gpu"),
        (["evaluate", "m.py", "--device", "cuda:"], "with a number if need be (cuda:1), got"),
    ],
)
def test_wrong_arguments_exit_with_2(refused, arguments, message):
    assert message in refused(*arguments)


# --- score -----------------------------------------------------------------------------


def test_score_of_the_file_written_by_evaluate_gives_the_very_numbers(eigbench, weyl):
    code, out, err = eigbench("score", weyl.predictions, "--dataset", "1.0-mini", "--json")
    assert (code, err) == (0, "")
    scored = json.loads(out)
    assert scored["scores"] == weyl.result["scores"]
    assert scored["dataset"] == weyl.result["dataset"]


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_score_of_another_format_gives_the_very_numbers(
    eigbench, weyl, mini_truth, suffix, tmp_path
):
    values = predictions.read(weyl.predictions, mini_truth)[0][::-1]
    ids = mini_truth.ids[::-1]
    path = tmp_path / f"p{suffix}"
    if suffix == ".npz":
        np.savez(path, ids=np.array(ids), eigenvalues=values)
    else:
        head = ",".join(["id", *(f"lambda_{i}" for i in range(1, 11))])
        rows = [
            ",".join([id, *map(repr, row.tolist())]) for id, row in zip(ids, values, strict=True)
        ]
        path.write_text("\n".join([head, *rows]) + "\n")
    code, out, _ = eigbench("score", path, "--dataset", "1.0-mini", "--json")
    assert code == 0
    assert json.loads(out)["scores"] == weyl.result["scores"]


def test_score_prints_the_tables(eigbench, weyl):
    code, out, _ = eigbench("score", weyl.predictions, "--dataset", "1.0-mini")
    assert code == 0
    assert "test split, protocol grouped: 34 shapes, 306 instances" in out
    assert all(f"{m.title} {'↑' if m.higher_is_better else '↓'}" in out for m in METRICS.values())
    assert "λ10" in out


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--dataset", "1.0"], "it is of 1.0-mini, test, grouped, not of 1.0, test, grouped"),
        (["--dataset", "1.0-mini", "--split", "train"], "not of 1.0-mini, train, grouped"),
        (["--dataset", "3.0"], "unknown version '3.0'"),
        (["--dataset", "1.0-mni"], "did you mean 1.0-mini?"),
        (["--dataset", "no/where"], "no/where holds no dataset (no manifest)"),
        (["--protocol", "gruoped"], "did you mean grouped?"),
    ],
)
def test_score_against_another_split_is_refused(refused, weyl, more, message):
    err = refused("score", weyl.predictions, *more)
    assert message in err
    assert len(err.splitlines()) == 1


# --- evaluate --------------------------------------------------------------------------


def test_result_of_a_whole_split_says_what_was_done(weyl):
    result = weyl.result
    assert result["partial"] is False
    assert result["model"]["name"] == "Weyl"
    assert result["model"]["kind"] == "trivial"
    assert result["model"]["parameters"] is None
    assert result["predictions"]["seeds"] == 1
    assert result["cost"]["batch_size"] == 10
    beside = result["cost"]["reference"]
    assert beside["meshes"] == 24  # three batches of new shapes of four
    assert beside["ratio"] > 0
    low, high = result["cost"]["ms_per_mesh_quartiles"]
    assert 0 < low <= result["cost"]["ms_per_mesh"] <= high
    assert all(result["physics"][name] < 1e-9 for name in ("scale_2", "rotation", "permutation"))
    assert sorted(path.name for path in weyl.out.parent.iterdir() if path.suffix != ".pyc") == [
        "result.json",
        "result.parquet",
        "weyl.py",
    ]


def test_tables_show_what_is_not_finite():
    assert tables.number(None) == "∞/NaN"
    assert tables.number(0.12345, 3) == "0.123"
    contract = {**dict.fromkeys(physics.TITLES), "positive": 0.5}
    assert "not finite" in str(tables.physics(contract))
    assert "50 %" in str(tables.physics(contract))


def test_dataset_may_be_a_directory(eigbench, predictor_file, mini_home, tmp_path):
    path = predictor_file(WEYL + "def predict(meshes): return [one(mesh) for mesh in meshes]\n")
    out = tmp_path / "r.json"
    code, _, _ = eigbench(
        "evaluate", path, "--dataset", mini_home / "1.0-mini", "--limit", 5, "--out", out
    )
    assert code == 0


def test_dataset_of_another_recipe_is_refused(refused, predictor_file, mini_home, tmp_path):
    location = tmp_path / "home" / "1.0-mini"
    shutil.copytree(mini_home / "1.0-mini", location)
    manifest = store.read_manifest(location)
    other = dataclasses.replace(manifest, recipe_digest=manifest.recipe_digest[::-1])
    store.write_manifest(location, other)
    err = refused(
        *("evaluate", predictor_file(WEYL), "--dataset", "1.0-mini"),
        *("--root", tmp_path / "home", "--out", tmp_path / "r.json"),
    )
    assert "was not built from the recipe of 1.0-mini" in err


def test_version_is_a_version_even_where_a_directory_has_its_name(
    eigbench, weyl, tmp_path, monkeypatch
):
    (tmp_path / "1.0-mini").mkdir()
    monkeypatch.chdir(tmp_path)
    assert eigbench("score", weyl.predictions, "--dataset", "1.0-mini")[0] == 0


def test_dataset_that_is_not_built_is_refused(refused, predictor_file, tmp_path):
    err = refused(
        *("evaluate", predictor_file(WEYL), "--dataset", "1.0-mini"),
        *("--root", tmp_path / "nowhere", "--out", tmp_path / "r.json"),
    )
    assert "no finished dataset in" in err
    assert "synthnet build 1.0-mini" in err


@pytest.mark.parametrize(
    "more", [["--out", "r.parquet"], ["--predictions", "p.csv"]], ids=["out", "predictions"]
)
def test_files_are_never_written_under_a_name_that_belongs_to_another_format(
    refused, predictor_file, mini_home, tmp_path, monkeypatch, more
):
    monkeypatch.chdir(tmp_path)
    path = predictor_file(WEYL + "def predict(meshes): return [one(mesh) for mesh in meshes]\n")
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--limit", 5]
    err = refused("evaluate", path, *where, *more)
    assert len(err.splitlines()) == 1


# --- check -----------------------------------------------------------------------------


def test_check_passes_a_good_predictor(eigbench, weyl):
    code, out, _ = eigbench("check", weyl.code)
    assert code == 0
    assert "loads and answers in shape; it can be evaluated" in out
    assert "100 %" in out


def test_check_names_a_file_that_is_missing_before_it_makes_a_sandbox(refused, tmp_path):
    err = refused("check", tmp_path / "none.py")  # nor is any other file there
    assert err.splitlines()[-1] == f"eigbench: there is no file {tmp_path / 'none.py'}"


BATCH = """
def predict(meshes):
    spectra = np.array([one(mesh) for mesh in meshes])
    return spectra * (1 + 1e-3 * spectra / spectra.mean(axis=0))
"""
ORDER = """
def predict(meshes):
    return np.array([one(mesh) * (1 + 1e-3 * i) for i, mesh in enumerate(meshes)])
"""


@pytest.mark.parametrize("code", [BATCH, ORDER], ids=["batch", "order"])
def test_check_finds_a_predictor_that_depends_on_its_batch(eigbench, predictor_file, code):
    returned, out, _ = eigbench("check", predictor_file(WEYL + code), "--json")
    assert returned == 1
    findings = json.loads(out)["findings"]
    assert any("other answers for one mesh at a time" in finding for finding in findings)
    if code is ORDER:
        assert any("other answers for shuffled order" in finding for finding in findings)


@pytest.mark.parametrize(
    ("answer", "finding"),
    [
        ("np.full(10, np.inf)", "answers that are not finite, first for "),
        ("-one(mesh)", "answers that are not positive, first for "),
        ("one(mesh)[::-1]", "not ascend"),
    ],
)
def test_check_finds_what_a_board_does_not_take_or_no_spectrum_does(
    eigbench, predictor_file, answer, finding
):
    code = f"def predict(meshes): return np.array([{answer} for mesh in meshes])\n"
    code, out, err = eigbench("check", predictor_file(WEYL + code))
    assert code == 1
    assert finding in out
    assert "Warning" not in err


def test_an_answer_that_is_a_number_in_one_batch_only_is_found():
    whole, singly = np.ones((2, 10)), np.ones((2, 10))
    singly[1, 3] = np.nan
    (difference,) = check._differences("one mesh at a time", ["a", "b"], whole, singly)
    assert difference == "other answers for one mesh at a time: up to inf relative, first for b"
    assert check._differences("shuffled order", ["a", "b"], singly, singly) == []


SLOW_TO_LOAD = """
import time

class Loaded:
    def predict(self, meshes):
        return [one(mesh) for mesh in meshes]

def load(device, seed):
    time.sleep(1.5)
    return Loaded()
"""


@pytest.mark.slow
def test_the_time_foretold_counts_processes_that_start_later(
    eigbench, predictor_file, mini_home, tmp_path, monkeypatch
):
    monkeypatch.setattr(foreseen, "about", lambda seconds: f"{seconds:.1f} s")
    code = predictor_file(WEYL + SLOW_TO_LOAD)
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", tmp_path / "p.parquet"]
    status, _, err = eigbench("predict", code, *where, "--seeds", 3, "--batch-size", 100)
    assert status == 0, err
    first = re.search(r"^predicting 918 meshes: ([\d.]+) s more$", err, flags=re.M)
    assert 3 <= float(first[1]) < 30  # two are to be loaded yet


def test_predictions_in_place_of_a_result_are_said(eigbench, weyl):
    code, _, err = eigbench("compare", weyl.predictions, weyl.out)
    line = f"{weyl.predictions} has predictions: give the result, the .json beside it"
    assert (code, err) == (2, f"eigbench: {line}\n")


def test_whole_result_is_not_replaced_by_a_partial_one(refused, weyl, mini_home, tmp_path):
    out = tmp_path / "r.json"
    shutil.copy(weyl.out, out)
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", out, "--limit", 5]
    assert "is a whole result: give --limit another --out" in refused("evaluate", weyl.code, *where)
    assert out.read_bytes() == weyl.out.read_bytes()


def test_evaluate_says_what_it_will_cost_and_where_the_columns_are_explained(
    eigbench, refused, predictor_file, mini_home, tmp_path
):
    path = predictor_file(WEYL + "def predict(meshes): return [one(mesh) for mesh in meshes]\n")
    out = tmp_path / "not" / "there" / "r.json"
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", out, "--no-reference"]
    code, printed, err = eigbench("evaluate", path, *where)
    assert code == 0
    assert "warning: LaPy is not timed (--no-reference): the speed column stays empty" in err
    lines = err.splitlines()
    foreseen = next(i for i, line in enumerate(lines) if line.startswith("306 meshes to predict: "))
    assert "LaPy took less than a minute for as many on the board (" in lines[foreseen]  # of 1.0
    assert foreseen < lines.index("predicting 306 meshes: less than a minute more")
    assert printed.endswith("predictions {}; {}\n".format(out.with_suffix(".parquet"), EXPLAINED))

    path.write_text("META = {'name': 'Another'}\n" + path.read_text())
    before = out.read_bytes()
    err = refused("evaluate", path, *where)
    assert f"{out} is the result of the model my_model: give Another another --out" in err
    assert out.read_bytes() == before


def test_what_a_run_costs_is_foreseen_by_its_own_row_or_by_lapys(
    make_submission, mini_truth, tmp_path
):
    def put(name, board, ms, **model):
        result = json.loads(make_submission(name, mini_truth.eigenvalues, **model).read_text())
        result["cost"] |= {"ms_per_mesh_mean": ms, "reference": None}
        folder = tmp_path / "benchmark" / "results" / board
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.json").write_text(json.dumps(result))

    def line(seeds=1):
        return foreseen.line(tmp_path, mini_truth, "mine.py", seeds)

    assert line().startswith("306 meshes to predict; no result of them is recorded here")
    put("Other", "1.0-mini-test-grouped", 9_999.0)
    put("LaPy", "1.0-test-grouped", 1_000.0)
    assert line().startswith(
        "306 meshes to predict: LaPy took about 5 min for as many on the board"
    )
    put("LaPy", "1.0-mini-test-grouped", 10.0)
    assert line().startswith("306 meshes to predict: LaPy took less than a minute")
    put("Mine", "1.0-mini-test-grouped", 2_000.0, code="mine.py")
    (tmp_path / "benchmark" / "results" / "1.0-mini-test-grouped" / "half.json").write_text("{}")
    assert line(3).startswith("918 meshes to predict: the row of mine.py took about 31 min")


def test_a_result_on_another_dataset_is_not_replaced(refused, weyl, mini_home, tmp_path):
    out = tmp_path / "r.json"
    result = json.loads(weyl.out.read_text())
    result["dataset"]["version"] = "2.0-mini"
    out.write_text(json.dumps(result))
    before = out.read_bytes()
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", out]
    err = refused("evaluate", weyl.code, *where)
    assert f"{out} is a result on 2.0-mini, protocol grouped: give another --out" in err
    assert out.read_bytes() == before


def test_results_on_two_datasets_cannot_be_compared(refused, weyl, tmp_path):
    other = tmp_path / "other.json"
    result = json.loads(weyl.out.read_text())
    result["dataset"]["version"] = "2.0-mini"
    other.write_text(json.dumps(result))
    err = refused("compare", weyl.out, other)
    assert "cannot be compared: their version is 1.0-mini and 2.0-mini" in err


def test_another_models_result_is_not_replaced(refused, weyl, mini_home, predictor_file, tmp_path):
    out = tmp_path / "r.json"
    shutil.copy(weyl.out, out)
    other = predictor_file(WEYL)
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", out]
    err = refused("evaluate", other, *where)
    name = weyl.code.name
    assert f"{out} is the result of {name}: give {other.name} another --out" in err
    assert out.read_bytes() == weyl.out.read_bytes()


def test_check_of_a_bad_predictor_exits_with_2(refused, predictor_file):
    err = refused("check", predictor_file("def predict(meshes): return [[1.0]]"))
    assert err.startswith("eigbench: the answer has shape (1, 1)")
    assert len(err.splitlines()) == 1


def test_zeros_agree_with_zeros():
    zeros = np.zeros((2, 10))
    assert check._differences("shuffled order", ["a", "b"], zeros, zeros) == []


def test_traceback_shows_the_lines_of_the_predictors_process(eigbench, predictor_file):
    path = predictor_file("def predict(meshes):\n    return 1 / 0\n")
    code, out, err = eigbench("check", path)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "(my_model.py:2: in predict: return 1 / 0)" in err
    traced = eigbench("check", path, "--traceback")[2]
    assert traced.startswith("Traceback (most recent call last):\n")
    assert f'File "{path}", line 2, in predict' in traced
    assert traced.endswith(err)
