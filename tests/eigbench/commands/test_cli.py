"""The command line: help, check, score; what the tables say."""

import dataclasses
import json
import re

import numpy as np
import pytest
from eigbench.board import foreseen, tables
from eigbench.commands import check
from eigbench.commands.score import EXPLAINED
from eigbench.results import SCHEMA_VERSION, predictions
from eigbench.results.sources import digest
from eigbench.running import box
from eigbench.scoring import physics
from eigbench.scoring.metrics import METRICS

from synthnet import store
from tests.eigbench.conftest import ONES, WEYL, WEYL_TO_CHANGE

BOARD = "1.0-mini-test-grouped"


@pytest.fixture
def on_mini(mini_home, tmp_path):
    """The options of an evaluation on 1.0-mini, whose result is r.json."""
    return ["--dataset", "1.0-mini", "--root", mini_home, "--out", tmp_path / "r.json"]


@pytest.mark.parametrize(
    ("command", "words"),
    [
        *((command, "runs the file's code") for command in ("check", "evaluate", "scale")),
        ("score", "no code is run"),
    ],
)
def test_help_says_plainly_whether_the_code_is_run(printed, command, words):
    assert words in " ".join(printed(command, "--help").split())


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
        (["evaluate", "m.py", "--seeds", "two"], "invalid seeds value: 'two'"),
        (["evaluate", "m.py", "--seeds", "21"], "there can be 20 at most, got 21"),
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
    printed, weyl, mini_truth, suffix, tmp_path
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
    scored = json.loads(printed("score", path, "--dataset", "1.0-mini", "--json"))
    assert scored["scores"] == weyl.result["scores"]


def test_score_prints_the_tables(printed, weyl):
    out = printed("score", weyl.predictions, "--dataset", "1.0-mini")
    assert "test split, protocol grouped: 34 shapes, 306 instances" in out
    assert all(f"{m.title} {'↑' if m.higher_is_better else '↓'}" in out for m in METRICS.values())
    assert "λ10" in out


def test_score_says_how_many_spectra_do_not_ascend(eigbench, mini_truth, tmp_path):
    answers = 1.01 * mini_truth.eigenvalues
    answers[3] = answers[3, ::-1]
    np.savez(tmp_path / "a.npz", ids=np.array(mini_truth.ids), eigenvalues=answers)
    code, _, stderr = eigbench("score", tmp_path / "a.npz", "--dataset", "1.0-mini")
    assert code == 0
    assert stderr.startswith("warning: 1 of 306 spectra does not ascend: ")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--dataset", "1.0"], "it is of 1.0-mini, test, grouped, not of 1.0, test, grouped"),
        (["--dataset", "1.0-mini", "--split", "train"], "not of 1.0-mini, train, grouped"),
        (["--dataset", "3.0"], "unknown version '3.0'"),
        (["--dataset", "scans", "--root", "."], "no import scans is in .: --root names another"),
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
    facts = [result["model"][key] for key in ("name", "kind", "parameters")]
    assert facts == ["Weyl", "trivial", None]
    assert result["predictions"]["seeds"] == 1
    assert result["cost"]["batch_size"] == 10
    beside = result["cost"]["reference"]
    assert beside["meshes"] == 24  # three batches of new shapes of four
    assert beside["ratio"] > 0
    low, high = result["cost"]["ms_per_mesh_quartiles"]
    assert 0 < low <= result["cost"]["ms_per_mesh"] <= high
    assert all(result["physics"][name] < 1e-9 for name in ("scale_2", "rotation", "permutation"))
    names = sorted(path.name for path in weyl.out.parent.iterdir() if path.suffix != ".pyc")
    assert names == ["result.json", "result.parquet", "weyl.py"]


def test_tables_show_what_is_not_finite():
    assert tables.number(None) == "∞/NaN"
    assert tables.number(0.12345, 3) == "0.123"
    contract = {**dict.fromkeys(physics.TITLES), "positive": 0.5}
    assert "not finite" in str(tables.physics(contract))
    assert "50 %" in str(tables.physics(contract))


def test_dataset_may_be_a_directory(printed, predictor_file, mini_home, tmp_path):
    where = ["--dataset", mini_home / "1.0-mini", "--limit", 5, "--out", tmp_path / "r.json"]
    printed("evaluate", predictor_file(WEYL), *where)


def test_dataset_of_another_recipe_is_refused(refused, predictor_file, mini_copy, on_mini):
    location = mini_copy / "1.0-mini"
    manifest = store.read_manifest(location)
    other = dataclasses.replace(manifest, recipe_digest=manifest.recipe_digest[::-1])
    store.write_manifest(location, other)
    err = refused("evaluate", predictor_file(WEYL), *on_mini, "--root", mini_copy)
    assert "was not built from the recipe of 1.0-mini" in err


def test_version_is_a_version_even_where_a_directory_has_its_name(
    printed, weyl, tmp_path, monkeypatch
):
    (tmp_path / "1.0-mini").mkdir()
    monkeypatch.chdir(tmp_path)
    printed("score", weyl.predictions, "--dataset", "1.0-mini")


def test_dataset_that_is_not_built_is_refused(refused, predictor_file, on_mini, tmp_path):
    err = refused("evaluate", predictor_file(WEYL), *on_mini, "--root", tmp_path / "nowhere")
    assert "no finished dataset in" in err
    assert "synthnet build 1.0-mini" in err


@pytest.mark.parametrize(
    "more", [["--out", "r.parquet"], ["--predictions", "p.csv"]], ids=["out", "predictions"]
)
def test_files_are_never_written_under_a_name_that_belongs_to_another_format(
    refused, predictor_file, mini_home, tmp_path, monkeypatch, more
):
    monkeypatch.chdir(tmp_path)
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--limit", 5]
    err = refused("evaluate", predictor_file(WEYL), *where, *more)
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("my_model.2.0.parquet", ["evaluate", "--out", "my_model.2.0.json"]),
        ("my_model.json", ["evaluate", "--out", "my_model.json"]),
        ("p.parquet", ["evaluate", "--predictions", "p.parquet"]),
        ("my_model.parquet", ["predict", "--out", "my_model.parquet"]),
        ("my_model.json", ["time", "--out", "my_model.json"]),
        ("my_model.json", ["scale", "--resume", "--out", "my_model.json"]),
    ],
)
def test_nothing_but_an_output_is_overwritten_and_no_code_is_run(
    refused, predictor_file, tmp_path, monkeypatch, name, command
):
    monkeypatch.chdir(tmp_path)
    path = predictor_file("raise RuntimeError('run')")
    weights = b'{"layers": 3}' if name.endswith(".json") else b"PAR1 weights PAR1"
    (tmp_path / name).write_bytes(weights)
    lines = refused(command[0], path, *command[1:]).splitlines()
    option = "--predictions" if command[0] == "evaluate" and ".parquet" in name else "--out"
    said = f"is there, and no output of eigbench: give another {option}, or move it away"
    assert lines == [f"eigbench: {name} {said}"]
    assert (tmp_path / name).read_bytes() == weights
    assert not list(tmp_path.glob(".*.parts"))


def test_times_replace_no_other_result(refused, weyl, weyl_copy):
    err = refused("time", weyl.code, "--out", weyl_copy)
    assert err == f"eigbench: {weyl_copy} holds no times of `eigbench time`: give another --out\n"


# --- check -----------------------------------------------------------------------------


def test_check_passes_a_good_predictor(printed, weyl):
    out = printed("check", weyl.code)
    assert "loads and answers in shape; it can be evaluated" in out
    assert "100 %" in out


def test_check_names_a_file_that_is_missing_before_it_makes_a_sandbox(refused, tmp_path):
    err = refused("check", tmp_path / "none.py")  # nor is any other file there
    assert err.splitlines()[-1] == f"eigbench: there is no file {tmp_path / 'none.py'}"


BATCH = """
def predict(meshes):
    spectra = weyl(meshes)
    return spectra * (1 + 1e-3 * spectra / spectra.mean(axis=0))
"""
ORDER = """
def predict(meshes):
    return weyl(meshes) * (1 + 1e-3 * np.arange(len(meshes)))[:, None]
"""


@pytest.mark.parametrize("code", [BATCH, ORDER], ids=["batch", "order"])
def test_check_finds_a_predictor_that_depends_on_its_batch(eigbench, predictor_file, code):
    returned, out, _ = eigbench("check", predictor_file(WEYL_TO_CHANGE + code), "--json")
    assert returned == 1
    findings = json.loads(out)["findings"]
    assert any("other answers for one mesh at a time" in finding for finding in findings)
    if code is ORDER:
        assert any("other answers for shuffled order" in finding for finding in findings)


@pytest.mark.parametrize(
    ("answer", "finding"),
    [
        ("np.full((len(meshes), 10), np.inf)", "answers that are not finite, first for "),
        ("-weyl(meshes)", "answers that are not positive, first for "),
        ("1e41 * weyl(meshes)", "answers that are not from 1e-30 to 1e+30, first for "),
        ("weyl(meshes)[:, ::-1]", "not ascend"),
    ],
)
def test_check_finds_what_a_board_does_not_take_or_no_spectrum_does(
    eigbench, predictor_file, answer, finding
):
    path = predictor_file(f"{WEYL_TO_CHANGE}\ndef predict(meshes): return {answer}\n")
    code, out, err = eigbench("check", path)
    assert code == 1
    assert finding in out
    assert "Warning" not in err


@pytest.mark.parametrize(
    ("answer", "hint"),
    [
        ("meshes.vertices", "; predict gets a sequence of meshes, and answers a row for each"),
        ("np.ones((len(meshes), 11))", ", it must be (133, 10), on the batch"),
        ("np.arange(11) * np.ones((len(meshes), 1))", "must be (133, 10): leave the zero out, on"),
        ("(meshes[0].vertices, 0).detach()", "'tuple' object has no attribute 'detach' ("),
        ("{}", "an array of shape (B, k): k eigenvalues for each of B meshes"),
    ],
)
def test_check_says_what_to_do_about_a_usual_mistake(refused, predictor_file, answer, hint):
    path = predictor_file(f"{WEYL_TO_CHANGE}\ndef predict(meshes): return {answer}\n")
    assert hint in refused("check", path)


def test_check_tells_random_answers_from_those_that_depend_on_the_batch(eigbench, predictor_file):
    path = predictor_file(
        f"{WEYL_TO_CHANGE}\nfactor = 1 + np.random.default_rng().random()\n"
        "def predict(meshes): return factor * weyl(meshes)\n"
    )
    code, out, _ = eigbench("check", path, "--json")
    findings = json.loads(out)["findings"]
    assert code == 1
    assert len(findings) == 1
    assert findings[0].startswith("other answers for the same call: up to ")
    assert findings[0].endswith("; load weights, or set a seed")


@pytest.mark.skipif(box.available() == box.NONE, reason="no sandbox works here")
def test_weights_that_the_sandbox_hides_are_said_to_be_there(refused, predictor_file):
    path = predictor_file(
        "import numpy as np\nfrom pathlib import Path\n"
        "path = Path(__file__).with_name('w.npy')\nw = np.load(path)\ndef predict(meshes): ...\n"
    )
    hidden = path.with_name("w.npy")
    np.save(hidden, np.ones(3))
    err = refused("check", path)
    hint = f"does not show w.npy: name it {path.stem}.w.npy, or add --readable {hidden})"
    assert hint in err.splitlines()[-1]


def test_an_answer_that_is_a_number_in_one_batch_only_is_found():
    whole, singly = np.ones((2, 10)), np.ones((2, 10))
    singly[1, 3] = np.nan
    (difference,) = check._differences("one mesh at a time", ["a", "b"], whole, singly)
    assert difference == "other answers for one mesh at a time: up to inf relative, first for b"
    for same in (singly, np.zeros((2, 10))):
        assert check._differences("shuffled order", ["a", "b"], same, same) == []


SLOW_TO_LOAD = """
import time

class Loaded:
    def predict(self, meshes):
        return weyl(meshes)

def load(device, seed):
    time.sleep(1.5)
    return Loaded()
"""


@pytest.mark.slow
def test_the_time_foretold_counts_processes_that_start_later(
    eigbench, predictor_file, on_mini, tmp_path, monkeypatch
):
    monkeypatch.setattr(foreseen, "about", lambda seconds: f"{seconds:.1f} s")
    code = predictor_file(WEYL_TO_CHANGE + SLOW_TO_LOAD)
    how = ["--out", tmp_path / "p.parquet", "--seeds", 3, "--batch-size", 100]
    status, _, err = eigbench("predict", code, *on_mini, *how)
    assert status == 0, err
    first = re.search(r"^predicting 918 meshes: ([\d.]+) s more$", err, flags=re.M)
    assert 3 <= float(first[1]) < 30  # two are to be loaded yet


def test_predictions_in_place_of_a_result_are_said(eigbench, weyl):
    code, _, err = eigbench("compare", weyl.predictions, weyl.out)
    line = f"{weyl.predictions} has predictions: give the result, the .json beside it"
    assert (code, err) == (2, f"eigbench: {line}\n")


def test_evaluate_says_what_it_will_cost_and_where_the_columns_are_explained(
    eigbench, refused, predictor_file, on_mini, tmp_path
):
    path = predictor_file(WEYL)
    out = tmp_path / "not" / "there" / "r.json"
    how = [*on_mini, "--out", out, "--no-reference"]
    code, printed, err = eigbench("evaluate", path, *how)
    assert code == 0
    assert "warning: LaPy is not timed (--no-reference): the speed column stays empty" in err
    lines = err.splitlines()
    foreseen = next(i for i, line in enumerate(lines) if line.startswith("306 meshes to predict: "))
    assert "LaPy took less than a minute for as many on the board (" in lines[foreseen]  # of 1.0
    assert foreseen < lines.index("predicting 306 meshes: less than a minute more")
    assert printed.endswith("predictions {}; {}\n".format(out.with_suffix(".parquet"), EXPLAINED))

    path.write_text("META = {'name': 'Another'}\n" + path.read_text())
    before = out.read_bytes()
    err = refused("evaluate", path, *how)
    assert f"{out} is the result of the model my_model: give Another another --out" in err
    assert out.read_bytes() == before

    result = json.loads(before)
    result["model"]["name"] = "Another"
    out.write_text(json.dumps({**result, "schema_version": 1, "metric_version": 1}))
    code, _, _ = eigbench("evaluate", path, *how)  # as an error about such a result advises
    assert code == 0
    assert json.loads(out.read_text())["schema_version"] == SCHEMA_VERSION


def test_what_a_run_costs_is_foreseen_by_its_own_row_or_by_lapys(
    make_submission, mini_truth, predictor_file, tmp_path
):
    mine = predictor_file(WEYL, "mine.py")

    def put(name, board, ms, **model):
        result = json.loads(make_submission(name, mini_truth.eigenvalues, **model).read_text())
        result["cost"] |= {"ms_per_mesh_mean": ms, "reference": None}
        folder = tmp_path / "benchmark" / "results" / board
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.json").write_text(json.dumps(result))

    def line(seeds=1):
        return foreseen.line(tmp_path, mini_truth, mine, seeds)

    assert line().startswith("306 meshes to predict; no result of them is recorded here")
    put("Other", BOARD, 9_999.0)
    put("LaPy", "1.0-test-grouped", 1_000.0)
    assert line().startswith(
        "306 meshes to predict: LaPy took about 5 min for as many on the board"
    )
    put("LaPy", BOARD, 10.0)
    assert line().startswith("306 meshes to predict: LaPy took less than a minute")
    put("Mine", BOARD, 2_000.0, code="mine.py", sources={"mine.py": digest(mine)})
    (tmp_path / "benchmark" / "results" / BOARD / "half.json").write_text("{}")
    assert line(3).startswith("918 meshes to predict: the row of mine.py took about 31 min")
    predictor_file(WEYL_TO_CHANGE, "mine.py")  # another's file may have that name
    assert line().startswith("306 meshes to predict: LaPy took less than a minute")


@pytest.mark.parametrize(
    ("version", "code", "more", "message"),
    [
        ("1.0-mini", "weyl.py", ["--limit", 5], "a whole result: give --limit another --out"),
        ("1.0-mini", "my_model.py", [], "the result of weyl.py: give my_model.py another --out"),
        (
            "2.0-mini",
            "weyl.py",
            [],
            "a result on 2.0-mini, protocol grouped: give another --out",
        ),
    ],
)
def test_a_result_of_something_else_is_not_replaced(
    refused, weyl, on_mini, predictor_file, tmp_path, version, code, more, message
):
    out = tmp_path / "r.json"
    result = {**weyl.result, "dataset": {**weyl.result["dataset"], "version": version}}
    out.write_text(json.dumps(result))
    before = out.read_bytes()
    path = weyl.code if code == weyl.code.name else predictor_file(WEYL, code)
    assert f"{out} is {message}" in refused("evaluate", path, *on_mini, *more)
    assert out.read_bytes() == before


def test_what_is_no_result_of_evaluate_is_not_replaced(refused, weyl, on_mini, tmp_path):
    out = tmp_path / "r.json"
    out.write_text(json.dumps({**weyl.result, "dataset": None}))
    err = refused("evaluate", weyl.code, *on_mini)
    assert err == f"eigbench: {out} is no result of `eigbench evaluate`: give another --out\n"


def test_results_on_two_datasets_cannot_be_compared(refused, weyl, tmp_path):
    other = tmp_path / "other.json"
    dataset = {**weyl.result["dataset"], "version": "2.0-mini"}
    other.write_text(json.dumps({**weyl.result, "dataset": dataset}))
    err = refused("compare", weyl.out, other)
    assert "cannot be compared: their version is 1.0-mini and 2.0-mini" in err


@pytest.mark.parametrize(
    ("verb", "out"), [("check", None), ("predict", "p.parquet"), ("evaluate", "r.json")]
)
def test_a_name_that_no_file_can_have_is_refused_before_any_work(
    refused, predictor_file, on_mini, tmp_path, verb, out
):
    path = predictor_file("META = {'name': 'Модель 5'}\n" + ONES)
    how = [] if out is None else [*on_mini, "--out", tmp_path / out]
    err = refused(verb, path, *how)
    assert "META name has the letter М (U+041C): a row's files have its name" in err
    assert list(tmp_path.iterdir()) == [path]


def test_traceback_shows_the_lines_of_the_predictors_process(eigbench, predictor_file):
    path = predictor_file("def predict(meshes):\n    return 1 / 0\n")
    code, out, err = eigbench("check", path)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "(my_model.py:2: in predict: return 1 / 0)" in err
    traced = eigbench("check", path, "--traceback")[2]
    assert traced.startswith("Traceback (most recent call last):\n")
    assert f'File "{path}", line 2, in predict' in traced
    assert traced.endswith(err)
