"""One clock for all rows: what is timed, what the file holds, and where the board shows it."""

import itertools
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from eigbench.board import leaderboard
from eigbench.commands.timing import described, errors
from eigbench.errors import EigbenchError, PredictorError, ResultError
from eigbench.results import timing
from eigbench.running import box, clock
from eigbench.scoring import targets
from eigbench.scoring.metrics import METRICS

SLOW = "import time\nimport numpy as np\nMETA = {'name': 'NAME', 'kind': 'classical'}\n" + (
    "def predict(meshes):\n"
    "    time.sleep(SECONDS * len(meshes))\n"
    "    return np.ones((len(meshes), 10))\n"
)


@pytest.fixture
def two(predictor_file):
    return [
        predictor_file(SLOW.replace("NAME", name).replace("SECONDS", seconds), f"{name}.py")
        for name, seconds in (("fast", "0.002"), ("slow", "0.02"))
    ]


def test_every_predictor_gets_every_batch_and_batches_go_by_size(two, mini_truth, mini_meshes):
    labels = mini_truth.take(timing.asked(mini_truth, 14))
    steps = []
    how = {"batch_size": 3, "repeats": 2, "settings": box.Settings()}
    timed = clock.together(two, labels, mini_meshes, **how, on_step=steps.append)
    assert [row.loaded.meta["name"] for row in timed] == ["fast", "slow"]
    turns = [step for step in steps if step.startswith(("batch 1 of 6", "batch 2 of 6"))]
    names = ("1 of 6: fast", "1 of 6: slow", "2 of 6: slow", "2 of 6: fast")
    assert turns == [f"batch {name}.py" for name in names]
    assert steps.count("batch 6 of 6: slow.py") == 1
    for row, seconds in zip(timed, (0.002, 0.02), strict=True):
        assert (row.seconds >= seconds * np.array([3, 3, 1])).all()
    assert timed[1].seconds.sum() > 2 * timed[0].seconds.sum()


@pytest.mark.attack
@pytest.mark.skipif(box.available() == box.NONE, reason="no sandbox works here")
def test_predictors_are_timed_in_the_box(predictor_file, mini_truth, mini_meshes, tmp_path):
    secret = tmp_path / "elsewhere" / "labels.csv"
    secret.parent.mkdir()
    secret.write_text("1,2,3")
    file = predictor_file(f"open({str(secret)!r})\ndef predict(meshes): ...", "spy.py")
    labels = mini_truth.take(timing.asked(mini_truth, 4))
    how = {"batch_size": 2, "repeats": 1, "settings": box.Settings(sandbox=box.available())}
    with pytest.raises(
        PredictorError, match=r"does not show elsewhere/: move labels.csv into spy/"
    ):
        clock.together([file], labels, mini_meshes, **how)


@pytest.mark.attack
def test_no_shape_is_asked_twice_and_the_batches_of_a_size_are_alike(mini_truth, mini_meshes):
    labels = mini_truth.take(timing.asked(mini_truth, 14))
    assert len(set(labels.shapes.tolist())) == 14
    groups = clock.by_size(labels.ids, mini_meshes, 3, 2)
    assert [[len(batch) for batch in group] for group in groups] == [[3, 3], [3, 3], [1, 1]]
    asked = [id for group in groups for batch in group for id in batch]
    assert sorted(asked) == sorted(labels.ids)
    sizes = [mini_meshes.vertices([id for batch in group for id in batch]) for group in groups]
    assert all(a.max() <= b.min() for a, b in itertools.pairwise(sizes))


KNOWS = """
import time
import numpy as np

KNOWN = {KNOWN}

def predict(meshes):
    for mesh in meshes:
        time.sleep(0.001 if float(np.abs(mesh.vertices).sum()) in KNOWN else {SECONDS})
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
def test_who_knows_the_public_meshes_takes_longer_for_others(
    predictor_file, mini_truth, mini_meshes
):
    labels = mini_truth.take(timing.asked(mini_truth, 24))
    known = {float(np.abs(mini_meshes.mesh(id).vertices).sum()) for id in labels.ids[:14]}
    files = [
        predictor_file(KNOWS.format(KNOWN=known, SECONDS=seconds), f"{name}.py")
        for name, seconds in (("honest", 0.001), ("knowing", 0.05))
    ]
    how = {"batch_size": 3, "repeats": 2, "settings": box.Settings()}
    honest, knowing = clock.together(files, labels, mini_meshes, fresh=10, **how)
    assert timing.takes_longer(honest.longer) == ""
    assert knowing.longer > 10
    assert timing.takes_longer(knowing.longer).endswith("as many vertices: it knows these")
    assert knowing.seconds.max() < 0.05  # only meshes that it knows are timed
    (alone,) = clock.together(files[:1], labels.take(np.arange(14)), mini_meshes, **how)
    assert alone.longer is None


@pytest.mark.attack
@pytest.mark.parametrize(
    ("fresh", "found"),
    [
        ({"rpd": 0.01, "rpd_public": 0.01, "longer": 1.2}, ""),
        ({"rpd": 0.01, "rpd_public": 0.01}, ""),
        ({"rpd": 1e-5, "rpd_public": 0.0, "longer": 0.5}, ""),
        ({"rpd": 0.01, "rpd_public": 0.01, "longer": 7.14}, "take 7.1 times as long as public"),
        ({"rpd": 0.5, "rpd_public": 0.01}, "are answered with a median RPD of 0.5, public ones"),
        ({"rpd": 0.5, "rpd_public": 0.0, "chance": 1e-9}, "are answered with a median RPD of 0.5"),
        ({"rpd": 0.5, "rpd_public": 0.0, "chance": 0.2}, ""),  # half its answers are exact
    ],
)
def test_times_of_who_knows_the_public_meshes_are_refused(fresh, found, make_row, mini_truth):
    timed = {"name": "It", "fresh": fresh}
    assert [found in said for said in timing.knows(timed)] == ([True] if found else [])
    if found:
        row = make_row("It", mini_truth.eigenvalues)
        with pytest.raises(ResultError, match=f"while It was timed, meshes that .* {found}"):
            timing.check_answers(timed, row)


@pytest.mark.attack
@pytest.mark.parametrize(
    ("public", "fresh", "knows"),
    [(1.0, 0.0, True), (0.7, 0.0, True), (0.55, 0.45, False), (0.0, 0.0, False)],
)
def test_who_answers_public_meshes_better_is_told_from_who_is_often_exact(
    public, fresh, knows, mini_truth
):
    draw = np.random.default_rng(0)
    labels = mini_truth.take(np.arange(185))  # the last 50 as if nobody had seen them
    exact = draw.random(185) < np.repeat([public, fresh], [135, 50])
    answers = labels.eigenvalues * np.where(exact, 1, 1 + 0.01 * draw.random(185))[:, None]
    timed = SimpleNamespace(predictions=answers[None], longer=1.0)
    said = errors(timed, labels, 135)
    assert bool(timing.knows(said)) == knows


LATER = """
import os, time
import numpy as np

calls = 0

def predict(meshes):
    global calls
    calls += 1
    if calls == 3:  # the first is the warm-up
        {}
    return np.ones((len(meshes), 10))
"""


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("raise ValueError", r"^bad\.py: the predictor failed: ValueError "),
        ("time.sleep(60)", r"^bad\.py: the predictor took more than 3 s on the batch of 1 "),
        ("os._exit(1)", r"^bad\.py: the predictor's process died on the batch of 1 "),
        ("return np.ones((1, 9))", r"^bad\.py: the answer has shape \(1, 9\), it must be"),
        ("return np.full((1, 10), np.nan)", r"^bad\.py: the answer has numbers that are not fin"),
    ],
)
def test_what_goes_wrong_is_said_at_once_and_whose_it_is(
    code, message, two, predictor_file, mini_truth, mini_meshes
):
    labels = mini_truth.take(timing.asked(mini_truth, 6))
    paths, steps = [two[0], predictor_file(LATER.format(code), "bad.py")], []
    how = {"batch_size": 1, "repeats": 1, "settings": box.Settings(time_limit=3.0)}
    with pytest.raises(PredictorError, match=message):
        clock.together(paths, labels, mini_meshes, **how, on_step=steps.append)
    assert steps[-1] == "batch 2 of 6: bad.py"


def test_lapys_failure_is_not_laid_on_a_predictor(
    predictor_file, mini_truth, mini_meshes, monkeypatch
):
    lapy = predictor_file(LATER.format("os._exit(1)"), "reference.py")
    monkeypatch.setattr(clock, "REFERENCE_FILE", lapy)
    labels = mini_truth.take(timing.asked(mini_truth, 4))
    how = {"batch_size": 1, "repeats": 1, "settings": box.Settings()}
    with pytest.raises(PredictorError, match=r"^LaPy: the predictor's process died on "):
        clock.together([lapy], labels, mini_meshes, **how)


def test_too_few_shapes_is_one_line(mini_truth):
    with pytest.raises(EigbenchError, match=r"has 34 shapes .* --repeats may be 34 at most"):
        timing.asked(mini_truth, 35)


def test_ratio_is_that_of_the_whole_times_with_an_interval_over_sizes():
    own, theirs = np.array([1.0, 1.0, 2.0]), np.array([2.0, 3.0, 4.0])
    assert timing.ratio(theirs, own) == {"ratio": 9 / 4, "low": 2.0, "high": 3.0}
    assert timing.ratio(own, own) == {"ratio": 1.0, "low": 1.0, "high": 1.0}


@pytest.mark.parametrize(
    ("sources", "counts"),
    [
        ({"a.py": "1", "b.py": "2"}, True),
        ({"a.py": "1"}, True),  # a result from before the data of b.py were named
        ({"a.py": "3", "b.py": "2"}, False),
        ({"a.py": "1", "b.py": "2", "c.py": "4"}, False),
    ],
)
def test_times_are_of_the_files_that_a_result_names(sources, counts):
    facts = {"sources": {"a.py": "1", "b.py": "2"}, "cost": {"ms_per_mesh": 5}}
    timed = [{"code": "a.py", "loading_seconds": 0.5, **facts}]
    row = timing.row_of({"model": {"code": "a.py", "sources": sources}}, timed)
    assert row == (timed[0] if counts else None)
    assert timing.cost_of(timed[0]) == {"ms_per_mesh": 5, "loading_seconds": 0.5}


@pytest.mark.slow
def test_command_writes_times_that_the_board_shows(
    eigbench, two, mini_home, mini_truth, make_row, tmp_path
):
    board = tmp_path / "board"
    out = board / "benchmark" / "timing" / "1.0-mini.json"
    arguments = [*two, "--against", two[1], "--dataset", "1.0-mini", "--root", mini_home]
    arguments += ["--meshes", 12, "--repeats", 1, "--batch-size", 2, "--fresh", 10]
    code, printed, err = eigbench("time", *arguments, "--out", out)
    assert code == 0, err
    assert "× faster than slow" in printed
    times = json.loads(out.read_text())
    fast, slow = times["rows"]
    assert (times["meshes"], times["fresh_meshes"]) == (12, 10)
    for row in times["rows"]:  # they answer all meshes alike, none near the truth
        assert row["fresh"]["longer"] < timing.LONGER
        assert row["fresh"]["rpd"] > 0.1
        assert row["fresh"]["chance"] > timing.CHANCE
    assert times["vertices"] == sorted(times["vertices"])
    assert slow["cost"]["peers"]["slow"] == {"ratio": 1.0, "low": 1.0, "high": 1.0}
    assert fast["cost"]["peers"]["slow"]["ratio"] > 2
    of_fast = {"code": fast["code"], "sources": fast["sources"]}
    known = make_row("fast", np.ones((306, 10)), **of_fast)
    other_code = {"code": "slow.py", "sources": {"slow.py": "0" * 64}}
    changed = make_row("slow", mini_truth.eigenvalues * 1.02, **other_code)
    for row in (known, changed):
        leaderboard.add(row, board)
    rows = {row.name: row for row in leaderboard.read(board)}
    assert rows["fast"].result["cost"]["ms_per_mesh"] == fast["cost"]["ms_per_mesh"]
    assert rows["slow"].result["cost"]["ms_per_mesh"] != slow["cost"]["ms_per_mesh"]
    better = make_row("fast", mini_truth.eigenvalues * 1.01, **of_fast)
    leaderboard.add(better, board, replace=True)
    message = r"while it was timed, fast answered with an RPD of .* 0.0"
    with pytest.raises(ResultError, match=message):
        leaderboard.read(board)
    text = leaderboard.generate(rows.values(), [])
    assert "| against slow |" in text[leaderboard.BOARDS / "1.0-mini-test-grouped-mesh.md"]


def test_a_peer_that_is_named_like_the_reference_does_not_replace_it(mini_truth, tmp_path):
    labels = mini_truth.take(np.arange(4))

    def took(name, seconds):
        return clock.Timed(
            tmp_path / f"{name}.py",
            np.array([seconds]),
            np.array([seconds]),
            labels.eigenvalues[None],
            None,
            SimpleNamespace(meta={"name": "LaPy"}, loading_seconds=0.0),
            SimpleNamespace(sources={}, peak_bytes=0, counted_by={}),
        )

    options = SimpleNamespace(
        batch_size=4, repeats=1, against=[tmp_path / "other.py"], dataset="1.0-mini", meshes=4
    )
    timed = [took("reference", 2.0), took("other", 1.0)]
    (tmp_path / "other.py").symlink_to("linked.py")
    (row,) = described(timed, labels, np.arange(4), options)["rows"]
    assert row["code"] == "linked.py"  # as its result names it
    cost = row["cost"]
    assert cost["reference"]["ratio"] == 2
    assert cost["peers"]["LaPy"]["ratio"] == 1


@pytest.mark.attack
def test_answers_that_were_timed_are_as_good_as_the_rows_at_both_targets(make_row, mini_truth):
    surfaces = targets.at(mini_truth, "surface")
    row = make_row("Near the surface", surfaces.eigenvalues)
    asked, error = timing.asked(row.truth, 30), METRICS["rpd"].function

    def timed(answers):
        known = [labels.take(asked) for labels in (mini_truth, surfaces)]
        errors = {of.target: float(error(answers[asked], of.eigenvalues).mean()) for of in known}
        return {"name": "Near the surface", "asked": 30, "rpd": errors}

    timing.check_answers(timed(surfaces.eigenvalues), row)
    timing.check_answers({"name": "Of an earlier release"}, row)
    # As far from the labels of the meshes, on their other side
    mirrored = mini_truth.eigenvalues**2 / surfaces.eigenvalues
    with pytest.raises(ResultError, match=r"RPD of .* against the surface, and the row has 0 on"):
        timing.check_answers(timed(mirrored), row)


def test_a_peer_that_is_not_timed_is_one_line(refused, two):
    err = refused("time", two[0], "--against", two[1])
    assert "slow.py: name it among the predictors too" in err


@pytest.fixture
def times(tmp_path):
    """Where the times of 1.0 are kept."""
    (tmp_path / timing.FOLDER).mkdir(parents=True)
    return tmp_path / timing.FOLDER / "1.0.json"


@pytest.mark.attack
def test_a_peer_that_is_named_like_the_reference_hides_no_false_ratio(times, tmp_path):
    content = json.loads((Path(__file__).parents[3] / timing.FOLDER / "1.0.json").read_text())
    means = {row["name"]: row["cost"]["ms_per_mesh_mean"] for row in content["rows"]}
    cost = content["rows"][3]["cost"]
    ratio = means["LaPy"] / cost["ms_per_mesh_mean"]
    cost["peers"]["LaPy"] = {"ratio": ratio, "low": ratio, "high": ratio}
    times.write_text(json.dumps(content))
    assert timing.read(tmp_path)
    cost["reference"] |= {"ratio": 1e6, "high": 1e6}
    times.write_text(json.dumps(content))
    with pytest.raises(ResultError, match=r"its ratio to LaPy is 1e\+06, its times give"):
        timing.read(tmp_path)


def test_a_file_that_holds_no_times_is_one_line(times, tmp_path):
    times.write_text("[]")
    with pytest.raises(ResultError, match="holds no times of `eigbench time`"):
        timing.read(tmp_path)
