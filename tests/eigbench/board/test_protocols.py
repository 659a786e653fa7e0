"""Protocols that ask for generalisation: labels, a training at a time, and their section."""

import contextlib
import copy
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from eigbench.board import answer_figure, generalisation, leaderboard, page, ranking
from eigbench.errors import EigbenchError, PredictorError, ResultError
from eigbench.results import submission
from eigbench.running.evaluate import Options, alone, evaluate
from eigbench.running.process import PredictorProcess
from eigbench.scoring import scores, training, truth

from tests.eigbench.conftest import ONES, changed

MESH = "## synthNet 2.0-mini: shapes unlike those of training, against the mesh"
TRAINED = """
import numpy as np

class Trained:
    def __init__(self, training):
        self.number = float(training.partition("/")[2])

    def predict(self, meshes):
        return np.full((len(meshes), 10), self.number)

def load(device, seed, training):
    return Trained(training)
"""
UNTRAINED = "META = {'kind': 'KIND'}\n" + ONES
README = "<!-- begin leaderboard --><!-- end leaderboard -->"


@pytest.fixture(scope="module")
def parts():
    return {p: truth.load("2.0-mini", "test", p) for p in ("grouped", "family", "genus")}


def test_each_shape_of_the_test_split_is_under_one_training_of_family(parts):
    whole, family = parts["grouped"], parts["family"]
    assert whole.ids == family.ids
    assert whole.digest == family.digest
    assert set(whole.trainings) == {"2.0/grouped"}  # the subset's test is in the full one's
    assert family.trainings.tolist() == [f"2.0/family/{name}" for name in family.families]


def test_a_training_may_see_all_but_what_is_tested(parts):
    genus = parts["genus"]
    seen = truth.load("2.0-mini", "train", "genus")
    assert set(genus.families) == {"twisted_torus", "knotted_tube", "pretzel"}
    assert not set(seen.families) & set(genus.families)
    assert set(seen.shapes) < set(truth.load("2.0-mini", "train").shapes)


def test_labels_of_an_import_are_pinned_and_trained_on_is_the_whole_version():
    real = truth.load("2.0", "test", "imported/real-28")
    assert (len(real.ids), real.ids[0]) == (28, "clean-00000/0")
    assert set(real.trainings) == {"2.0/grouped"} == {training.training_set("2.0", real.protocol)}


@pytest.mark.parametrize(
    ("question", "message"),
    [
        (("2.0", "test", "imported"), "protocol imported: say which, imported/NAME"),
        (("2.0", "train", "imported/real-28"), "has a test split only: train on grouped"),
        (("2.0", "test", "imported/none"), "no import none here, and its labels are not pinned"),
        (("2.0", "test", "imported/1.0"), r"1\.0 is a version, not an imported dataset"),
        (("1.0", "test", "imported/real-28"), r"1\.0 has no protocol imported"),
    ],
)
def test_an_import_that_cannot_be_tested_is_refused(question, message):
    with pytest.raises(EigbenchError, match=message):
        truth.load(*question)


def folded(labels):
    """The first instances, every third of another training."""
    labels = labels.head(12)
    names = np.array([f"1.0-mini/{1 + i % 3}" for i in range(12)])
    return replace(labels, trainings=names)


@pytest.mark.slow
def test_every_instance_is_predicted_by_the_training_it_asks_for(
    predictor_file, mini_truth, mini_meshes, tmp_path, monkeypatch
):
    started = []
    enter = PredictorProcess.__enter__
    monkeypatch.setattr(
        PredictorProcess, "__enter__", lambda self: started.append(self.job) or enter(self)
    )
    labels = folded(mini_truth)
    code, options = predictor_file(TRAINED), Options(seeds=2, batch_size=2)
    evaluation = evaluate(code, labels, mini_meshes, options, tmp_path / "parts")
    np.testing.assert_array_equal(
        evaluation.predictions[:, :, 0], [[1 + i % 3 for i in range(12)]] * 2
    )
    assert evaluation.sizes.sum() == 24
    asked = [(job.seed, job.training) for job in started]
    assert asked == [(seed, f"1.0-mini/{1 + i}") for seed in range(2) for i in range(3)]
    again = evaluate(code, labels, mini_meshes, replace(options, resume=True), tmp_path / "parts")
    np.testing.assert_array_equal(again.predictions, evaluation.predictions)
    np.testing.assert_array_equal(again.seconds, evaluation.seconds)  # kept, not run again
    assert (again.status, again.loaded) == (evaluation.status, evaluation.loaded)
    assert len(started) == 6  # the resumed run trains nothing


def test_what_is_not_trained_is_run_once_and_a_model_trained_for_itself_refused(
    predictor_file, mini_truth, mini_meshes, tmp_path
):
    labels = folded(mini_truth)
    code = predictor_file(UNTRAINED.replace("KIND", "classical"))
    assert (evaluate(code, labels, mini_meshes, Options(), tmp_path / "a").predictions == 1).all()
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["seed-0"]
    code = predictor_file(UNTRAINED.replace("KIND", "learned"))
    message = (
        "the protocol grouped asks for a training of its own, 1.0-mini/1.* is learned, trained on "
        "an unknown set: define load.*, or say .kind.: .classical. and .training_data.: .none. if"
    )
    with pytest.raises(PredictorError, match=message):
        evaluate(code, labels, mini_meshes, Options(), tmp_path / "b")


def test_a_run_leaves_the_answers_of_another_alone(eigbench, predictor_file, mini_home, tmp_path):
    code = predictor_file(UNTRAINED.replace("KIND", "classical"))
    parts = tmp_path / ".p.parquet.parts"
    kept = parts / "seed-0" / "000000.npz"
    command = ["predict", code, "--dataset", "1.0-mini", "--root", mini_home]
    with contextlib.suppress(KeyError), alone(parts):
        kept.parent.mkdir()
        kept.write_bytes(b"of another run")
        status, _, err = eigbench(*command, "--out", tmp_path / "p.parquet")
        assert status == 2
        assert re.search(r"another run keeps its answers in \S+parts \(process \d+\): wait", err)
        assert kept.read_bytes() == b"of another run"
        raise KeyError  # the run ends early
    assert kept.exists()
    assert eigbench(*command, "--out", tmp_path / "p.parquet")[0] == 0
    assert not parts.exists()  # all was answered and written
    with pytest.raises(KeyError), alone(parts):
        raise KeyError
    assert not parts.exists()  # nothing was answered


@pytest.fixture(scope="session")
def row_of(of_protocol):
    """Return a function that makes a row on 2.0-mini, off the labels by a factor."""
    return lambda *given, **model: submission.read(of_protocol(*given, **model))


@pytest.fixture(scope="module")
def held_out(held_out_submissions):
    """Three rows trained on everything, or on nothing; one where genus was held out."""
    *whole, model = map(submission.read, held_out_submissions)
    return whole, model


@pytest.fixture(scope="module")
def unseen_families(row_of):
    """The model where each family was held out."""
    return row_of("Model", "family", 1.05, kind="learned", training_data="the training split")


def narrow(text):
    """Return a page with ± 0 where an interval is as wide as rounding makes it."""
    return re.sub(r"± (?:0\.0000|(?:<|&lt;) 0\.0001)", "± 0", text)


def placed(rows, board):
    """Place rows on a board, and return those that are read from it."""
    for row in rows:
        leaderboard.add(row, board)
    return leaderboard.read(board)


def test_the_drop_is_against_the_same_shapes_and_nothing_that_is_untrained_has_one(held_out):
    whole, model = held_out
    board = generalisation.Board(ranking.ranked(whole), {"genus": [model]})
    solver, trained, lazy = whole
    cell = board.scored(trained, "genus", "rpd")
    assert cell.score == pytest.approx(10 * 0.05 / 2.05)
    assert cell.drop == pytest.approx(10 * (0.05 / 2.05 - 0.01 / 2.01))
    assert board.scored(solver, "genus", "rpd").drop is None
    assert board.scored(solver, "genus", "rpd").score == pytest.approx(10 * 0.001 / 2.001)
    assert board.scored(lazy, "genus", "rpd") == generalisation.HeldOut(None)
    assert board.scored(trained, "boundary", "rpd") == generalisation.HeldOut(None)
    assert board.protocols == ["family", "resolution", "genus", "boundary"]


@pytest.mark.slow
def test_section_shows_scores_beside_the_iid_column_with_the_drop(held_out, tmp_path):
    whole, model = held_out
    pages = leaderboard.generate(placed([*whole, model], tmp_path), [])
    assert pages == leaderboard.generate([model, *whole[::-1]], [])
    text = pages[Path(leaderboard.PAGE)]
    assert "protocol genus" not in text  # no section of its own
    assert text.index("unlike those of training, against the surface") < text.index(MESH)
    text = narrow(text.partition(MESH)[2])
    heads, _, counts = text.partition("| rank, each family unseen | ")[2].splitlines()[:3]
    assert heads.split(" | ")[4] == "genus 1 and more unseen"
    assert re.fullmatch(r"9 \(\d+ %\)", counts.split(" | ")[5])
    assert counts.startswith("|  | test meshes (share with a training shape within 1 %) |")
    zero = " ± 0"
    of_model = f"0.0498{zero} | not run | not run | 0.2439{zero} (+0.1942) | not run | 1 |"
    assert f"|  | Model | {of_model}" in text
    assert f"|  | Lazy | 0.0990{zero} | not run | not run | not run | not run |  |" in text
    assert f"| 1 | Solver{5 * f' | 0.0050{zero}'} | 1 |" in text
    details = narrow(pages[leaderboard.BOARDS / "2.0-mini-generalisation-mesh.md"])
    bound = r"100 % \(≥ \d+\.\d\d %\)"
    few = r"100 % \(0 % to 100 %\)"  # of three surfaces
    of_model = rf"{bound} \| not run \| not run \| {few} \(\+0\.00\) \| not run \| 1 \|"
    assert re.search(rf"^\|  \| Model \| {of_model}$", details, re.M)
    assert re.findall(r"^## .*", details, re.M)[2] == "## Genus 1 and more unseen"
    genus = details.partition("## Genus 1 and more unseen")[2].partition("## ")[0]
    assert genus.startswith("\n\n9 meshes, ")
    assert re.search(
        rf"^\| 1–2 \| Solver \| classical \| 0\.0050{zero} \| none \| none", genus, re.M
    )
    of_model = rf"0\.2439{zero} \| 0\.0498 \| \+0\.1942 \| {few} \| 1 \|"
    assert re.search(rf"^\| 1–2 \| Model \| learned \| {of_model}$", genus, re.M)
    assert "Lazy" not in genus
    scored = json.loads(pages[leaderboard.BOARDS / "2.0-mini-generalisation-mesh.json"])
    assert scored["protocols"]["genus"]["meshes"] == 9
    (there,) = (row for row in scored["rows"] if row["name"] == "Model")
    genus, family = there["protocols"]["genus"], there["protocols"]["family"]
    mean = 10 * 0.05 / 2.05
    expected = {"score": mean, "low": mean, "high": mean, "drop": mean - 10 * 0.01 / 2.01}
    assert genus["rpd"].pop("seed_std") is None
    assert genus["rpd"] == pytest.approx(expected, rel=1e-5)
    assert (genus["rank"], genus["exact"], genus["seeds"]) == ([1, 2], False, 1)
    assert set(family["rpd"].values()) == {None} == {family["rank"], family["seeds"]}
    lines = details.partition("## How near training comes")[2].splitlines()
    near = {line.split(" | ")[0][2:]: line.split(" | ")[1] for line in lines if line[:1] == "|"}
    assert (near["genus 1 and more unseen"], near["familiar shapes"]) == ("9", "75")


def test_section_says_whether_the_rows_of_a_protocol_are_verified(held_out):
    whole, model = held_out
    said = replace(model, result={**model.result, "verified": {}})
    again = "All rows of models trained for a protocol are verified. [PSNR>20"
    for held, there in ((model, False), (said, True)):
        rows = {"genus": [held], "imported/real-28": [model]}  # nobody can verify the latter
        board = generalisation.Board(ranking.ranked(whole), rows)
        section = "".join(page.generalised(board, Path("page"), Path("numbers"), {}))
        assert (again in section) == there
        assert ("verified" in section) == there


def test_readme_shows_what_the_first_rows_lose(held_out):
    whole, model = held_out
    text = leaderboard.generate([*whole, model], [], (), README)[Path("README.md")]
    assert "held out of training, synthNet 2.0-mini, against the surface" in text
    score = r"0\.\d+ ± [&lt; ]*0\.\d+"
    cells = rf"not run \| not run \| {score} \(\+0\.\d+\) \| not run"
    assert re.search(rf"^\|  \| Model \| {score} \| {cells} \|$", text, flags=re.M)
    board = generalisation.Board(ranking.ranked(whole), {"genus": [model]})
    best = page.generalised_top(board, 1)
    first_cells = [line.split(" | ")[1] for line in best.splitlines()[2:]]
    assert first_cells == ["model (mean RPD ↓)", "---", "Solver"]
    other = page.generalised_best(board, Path("of/mesh.md"))
    assert other in text.replace("benchmark/boards/2.0-mini-generalisation-mesh.md", "of/mesh.md")
    said = "the first trained model is *Model*: genus 1 and more unseen 0.2439 ± 0 (+0.1942). "
    assert f"{said}[All rows against the mesh](of/mesh.md).\n" in narrow(other)
    untrained = generalisation.Board(board.rows[:1], {})
    assert page.generalised_best(untrained, Path("x")) == "[All rows against the mesh](x).\n"


def test_scores_and_ranks_under_a_protocol_are_of_its_shapes_alone(parts, make_row):
    whole, genus = parts["grouped"], parts["genus"]
    rng = np.random.default_rng(0)
    untrained = {"kind": "classical", "training_data": "none"}
    factors = 1 + 0.02 * rng.random((len(whole.ids), 1))
    rows = [
        make_row("Noisy", whole.eigenvalues * factors, whole, **untrained),
        make_row("Twice", whole.eigenvalues * factors * factors, whole, **untrained),
    ]
    several = 1 + np.array([0.001, 0.002, 0.003])[:, None, None]
    trained = [
        make_row("Trained", labels.eigenvalues * seeds, labels, kind="learned")
        for labels, seeds in ((whole, several[:1]), (genus, several))
    ]
    board = generalisation.Board(ranking.ranked([*rows, trained[0]]), {"genus": [trained[1]]})
    there = board.under["genus"]
    ranks = [(name, row.ranks) for name, row in there.items()]
    assert ranks == [(name, (1, 3)) for name in ("trained", "noisy", "twice")]  # of three shapes
    of_genus = [whole.ids.index(id) for id in genus.ids]
    expected = scores.score(genus, rows[0].predictions[:, of_genus])["overall"]["rpd"]
    assert there["noisy"].scores["overall"]["rpd"] == expected
    group = generalisation.table(board, "rpd", {})
    (column,) = (column for column in group.columns if column.key == "rpd-genus")
    half = (expected["high"] - expected["low"]) / 2
    assert half > 1e-3
    assert column.cell(board.rows[1])[0] == f"{expected['mean']:.4f} ± {half:.4f}"
    seeds = generalisation.seeds(board)
    assert [seeds.cell(row)[0] for row in board.rows] == ["3", "1", "1"]


def test_rows_are_in_the_order_of_the_first_protocol_and_say_so(held_out, row_of):
    whole, model = held_out
    family = row_of("Model", "family", 1.0005, kind="learned", training_data="the training split")
    board = generalisation.Board(ranking.ranked(whole), {"family": [family], "genus": [model]})
    names = [row.submission.name for row in board.rows]
    assert names == ["Solver", "Model", "Lazy"]
    assert [row.submission.name for row in board.models] == ["Model", "Solver", "Lazy"]
    rank = generalisation.rank(board)
    assert rank.title == "rank, each family unseen"
    assert [rank.cell(row)[0] for row in board.models] == ["1", "2", ""]


WHY = {
    "version": "2.0-mini",
    "protocols": ["family", "boundary"],
    "models": ["Model", "Lazy"],
    "reason": "too | slow",
}


def write_why(root, **changes):
    (root / "benchmark").mkdir(exist_ok=True)
    (root / leaderboard.WHY_NOT).write_text(json.dumps({"reasons": [{**WHY, **changes}]}))


def test_why_a_model_was_not_run_stands_below_the_table(held_out, tmp_path):
    whole, model = held_out
    rows = [*whole, model]
    assert leaderboard.read_not_run(tmp_path, rows) == []
    write_why(tmp_path)
    pages = leaderboard.generate(rows, [], (), README, leaderboard.read_not_run(tmp_path, rows))
    line = "\n\n¹ Model and Lazy, each family unseen, boundaries unseen: too \\| slow\n"
    for page_ in ("LEADERBOARD.md", "README.md"):
        text = pages[Path(page_)]
        assert line in text
        cells = r"not run ¹ \| not run \| 0\.\d+ ± 0\.\d+ \(\+0\.\d+\) \| not run ¹ \|"
        assert re.search(rf"^\|  \| Model \| 0\.\d+ ± 0\.\d+ \| {cells}", text, re.M)
    scored = json.loads(pages[leaderboard.BOARDS / "2.0-mini-generalisation-mesh.json"])
    (there,) = (row["protocols"] for row in scored["rows"] if row["name"] == "Model")
    assert there["boundary"]["not_run"] == "too | slow"
    assert "not_run" not in there["resolution"]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"protocols": ["genus"]},
            "Model has a row under genus of 2.0-mini, so there is no reason",
        ),
        ({"models": ["Nobody"]}, "Nobody has no row under grouped of 2.0-mini"),
        ({"protocols": ["genius"]}, "2.0-mini has no protocol genius"),
        ({"reason": ""}, "at reasons/0/reason"),
    ],
)
def test_a_reason_for_nothing_is_refused(held_out, tmp_path, changes, message):
    whole, model = held_out
    write_why(tmp_path, **changes)
    with pytest.raises(ResultError, match=message):
        leaderboard.read_not_run(tmp_path, [*whole, model])


def test_what_is_trained_on_another_version_has_no_drop(row_of):
    model = {"kind": "learned", "training_data": "synthNet 1.0-small train, grouped"}
    whole, genus = (row_of("M", protocol, 1.01, **model) for protocol in ("grouped", "genus"))
    board = generalisation.Board(ranking.ranked([whole]), {"genus": [genus]})
    cell = board.scored(whole, "genus", "rpd")
    assert cell.score == pytest.approx(10 * 0.01 / 2.01)
    assert cell.drop is None


@pytest.mark.slow
def test_a_remark_beside_a_result_stands_below_its_table(held_out, tmp_path):
    whole, model = held_out
    placed([*whole, model], tmp_path)
    results = tmp_path / leaderboard.RESULTS
    (results / model.board / "model.remark.txt").write_text("tuned\non these\n")
    (results / whole[0].board / "solver.remark.txt").write_text("a | b\n")
    pages = leaderboard.generate(leaderboard.read(tmp_path), [], (), README)
    for location in ("LEADERBOARD.md", "README.md"):
        text = pages[Path(location)]
        assert "\n\n**Solver**: a \\| b\n" in text
        assert "\n\n¹ Model, genus 1 and more unseen: tuned on these\n" in text
    held = narrow(pages[Path("LEADERBOARD.md")].partition(MESH)[2])
    zero = " ± 0"
    assert f"| 1 | Solver{5 * f' | 0.0050{zero}'} | 1 |" in held
    assert (
        f"| Model | 0.0498{zero} | not run | not run | 0.2439{zero} (+0.1942) ¹ | not run |" in held
    )


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("nobody", b"of no result", r"nobody\.remark\.txt belongs to no row"),
        ("solver", b" \n", r"solver\.remark\.txt is empty: write the remark into it, or remove"),
        ("solver", b"\xff\xfe", r"solver\.remark\.txt is not UTF-8 text: save it as that"),
    ],
)
def test_a_wrong_remark_is_one_line(name, content, message, held_out, tmp_path):
    solver = held_out[0][0]
    leaderboard.add(solver, tmp_path)
    location = tmp_path / leaderboard.RESULTS / solver.board / f"{name}.remark.txt"
    location.write_bytes(content)
    with pytest.raises(ResultError, match=message):
        leaderboard.read(tmp_path)


def test_submit_says_that_a_remark_stays(held_out, printed, tmp_path):
    solver = held_out[0][0]
    arguments = ["submit", solver.result_path, "--board", tmp_path]
    assert "the remark on" not in printed(*arguments)
    location = tmp_path / leaderboard.RESULTS / solver.board / "solver.remark.txt"
    location.write_text("tuned")
    out = printed(*arguments, "--replace")
    assert f"the remark on the earlier result stays: {location}" in out


def test_a_board_wants_whole_protocols_and_a_result_to_compare_with(held_out, make_row, tmp_path):
    _, model = held_out
    with pytest.raises(ResultError, match="Model has a result under genus and none under grouped"):
        leaderboard.add(model, tmp_path)
    assert not list(tmp_path.rglob("*.json"))  # else the board could not be read from then on
    labels = truth.load("2.0-mini", "test", "family/pretzel")
    single = make_row("Model", labels.eigenvalues, labels)
    with pytest.raises(ResultError, match=r"is of family/pretzel alone: .* --protocol family"):
        leaderboard.add(single, tmp_path)


def test_a_model_that_says_nothing_of_its_training_is_not_taken_for_untrained(row_of):
    silent = row_of("Silent", "grouped", 1.01, kind="learned")
    silent.result["model"].pop("training_data", None)
    board = generalisation.Board(ranking.ranked([silent]), {})
    assert board.scored(silent, "genus", "rpd") == generalisation.HeldOut(None)


@pytest.mark.parametrize("longer", ["grouped", "genus"])
def test_the_drop_is_between_the_same_seeds(row_of, longer):
    several, one = (np.array(factors)[:, None, None] for factors in ([1.01, 1.5, 1.5], [1.01]))
    whole, held_out = (
        row_of("M", protocol, several if protocol == longer else one, kind="learned")
        for protocol in ("grouped", "genus")
    )
    board = generalisation.Board(ranking.ranked([whole]), {"genus": [held_out]})
    scored = board.scored(whole, "genus", "rpd")
    of_one, of_several = 10 * 0.01 / 2.01, 10 * (0.01 / 2.01 + 2 * 0.5 / 2.5) / 3
    assert scored.drop == pytest.approx(0)
    assert scored.before == pytest.approx(of_one)
    assert scored.score == pytest.approx(of_several if longer == "genus" else of_one)


@pytest.mark.parametrize(
    "change",
    [
        lambda files: dict.fromkeys(files, "0" * 64),
        lambda files: {"other.py": "0" * 64},
        lambda files: {**files, "a.safetensors": "0" * 64},  # while grouped names b.safetensors
    ],
    ids=["other digests", "no file in common", "other weights"],
)
def test_a_drop_between_two_codes_is_refused(held_out, row_of, tmp_path, change):
    files = held_out[1].result["model"]["sources"]
    of_whole = {**files, "b.safetensors": "1" * 64}
    rows = [
        row_of("Model", protocol, 1, kind="learned", sources=sources)
        for protocol, sources in (("grouped", of_whole), ("genus", change(files)))
    ]
    with pytest.raises(ResultError, match="are of other code, or other weights"):
        placed(rows, tmp_path)


def test_a_file_that_an_earlier_release_did_not_name_is_no_other_code(held_out, row_of, tmp_path):
    whole, model = held_out
    more = {**model.result["model"]["sources"], "features.parquet": "0" * 64}
    again = row_of("Model", "genus", 1, kind="learned", sources=more)
    assert len(placed([whole[1], again], tmp_path)) == 2


def test_a_solver_of_two_codes_is_shown_because_no_drop_is(held_out, row_of, tmp_path):
    untrained = {"kind": "classical", "training_data": "none"}
    again = row_of("Solver", "genus", 1, **untrained, sources={"solver.py": "0" * 64})
    assert len(placed([held_out[0][0], again], tmp_path)) == 2


def test_the_answer_has_every_row_and_the_solver_by_size(held_out):
    whole, model = held_out
    genus = model.at("surface")
    rows = [row.at("surface") for row in whole]
    rows[0].result["cost"]["ms_by_batch"] = [1.0, 2.0, 3.0, 4.0, 50.0, 60.0]
    board = generalisation.Board(ranking.ranked(rows), {"genus": [genus]})
    text = answer_figure.draw(board, solver="solver")
    del rows[0].result["cost"]["ms_by_batch"]
    for word in ("Solver", "Model", "Lazy", "coarse meshes", "medium meshes", "fine meshes"):
        assert f">{word}<" in text
    for number in ("1", "2", "3"):  # in its mark, and before its name
        assert text.count(f">{number}</text>") == 2
    assert "coarse meshes" not in answer_figure.draw(board, solver="solver")


@pytest.mark.parametrize("layout", [answer_figure.WIDE, answer_figure.NARROW])
def test_a_model_without_a_mark_is_named_with_the_reason(held_out, layout):
    whole, _ = copy.deepcopy(held_out)
    rows = [row.at("surface") for row in whole]
    rows[1].scores["overall"]["rpd"]["mean"] = 3.0669
    rows[2].result["cost"]["reference"] = None
    text = answer_figure.draw(generalisation.Board(ranking.ranked(rows), {}), layout=layout)
    far, untimed = rows[1].name, rows[2].name
    assert f">{far}: 3.07, not drawn<" in text
    assert f">{untimed}: not timed<" in text
    assert text.count(">1</text>") == 2
    assert ">2</text>" not in text


def test_the_answer_in_sentences_has_the_numbers_of_the_board(held_out, unseen_families, row_of):
    whole, model = held_out
    elsewhere = {"kind": "learned", "training_data": "synthNet 1.0 train"}  # not counted
    foreign = row_of("Foreign", "grouped", 1.005, **elsewhere)
    fitted = {"kind": "trivial", "training_data": "synthNet 2.0 train"}  # nor is this
    mean = row_of("Mean", "grouped", 1.005, **fitted)
    rows = ranking.ranked([row.at("surface") for row in [*whole, foreign, mean]])
    surface = unseen_families.at("surface")
    board = generalisation.Board(rows, {"family": [surface], "genus": [model.at("surface")]})
    means = {row.submission.name: row.scores["overall"]["rpd"]["mean"] for row in rows}
    trained = [row for row in rows if row.submission.name in ("Model", "Lazy")]
    nearer = [row for row in trained if means[row.submission.name] < means["Solver"]]
    first, second, third = answer_figure.sentences(board, solver="solver").splitlines()
    solver = whole[0].at("surface")
    relative = np.abs(solver.predictions / solver.truth.eigenvalues - 1).mean()
    assert f" off by {100 * relative:.2g} % on average (mean RPD {means['Solver']:.4f})" in first
    assert f" {len(nearer)} of {len(trained)} trained models are significantly closer" in second
    unseen = board.scored(surface, "family", "rpd").score
    other = generalisation.restricted(whole[0].at("surface"), surface.truth)
    closer = ranking.difference(surface, other.at("surface"), "rpd").verdict == "a"
    assert closer == (unseen < means["Solver"])
    some = "1 of 1 trained models is significantly closer than Solver: *Model*"
    none = "0 of 1 trained models are significantly closer than Solver."
    assert (some if closer else none) in third
    assert third.endswith(f"The median model has an RPD of {unseen:.4f}.")
    assert answer_figure.sentences(board, solver="nobody") == ""


@pytest.mark.parametrize(
    ("factor", "sentence"),
    [
        (1.0001, "4. **Without training, better elements beat all of them.** *Bent* has an error "),
        (1.0, "4. **Without training, better elements beat all of them.** *Bent* has no error at "),
        (1.02, None),  # farther than the solver
    ],
)
def test_a_nearer_row_without_training_has_a_sentence(
    held_out, unseen_families, parts, make_row, factor, sentence
):
    whole, _ = held_out
    labels = parts["grouped"]
    limits = make_row("Any", labels.eigenvalues, labels).at("surface").truth
    bent = make_row(
        "Bent", limits.eigenvalues * factor, labels, kind="classical", training_data="none"
    )
    rows = ranking.ranked([row.at("surface") for row in [*whole, bent]])
    board = generalisation.Board(rows, {"family": [unseen_families.at("surface")]})
    *_, last = answer_figure.sentences(board, solver="solver").splitlines()
    assert last.startswith(sentence or "3. ")


@pytest.mark.parametrize(
    ("factors", "verdict"),
    [
        ((1.01, 1.02), "most models lose to it"),
        ((1.0001, 1.02), "half of the models lose to it"),
        ((1.0001, 1.0002), "all models are closer than it"),
    ],
)
def test_what_most_models_do_on_unseen_families_is_counted(
    held_out, parts, make_row, factors, verdict
):
    whole, family = held_out[0], parts["family"]
    limits = whole[0].at("surface").truth.eigenvalues
    trained = {"kind": "learned", "training_data": "the training split"}
    unseen = [
        make_row(name, limits * factor, family, **trained).at("surface")
        for name, factor in zip(("Model", "Lazy"), factors, strict=True)
    ]
    rows = ranking.ranked([row.at("surface") for row in whole])
    board = generalisation.Board(rows, {"family": unseen})
    *_, third = answer_figure.sentences(board, solver="solver").splitlines()
    assert f"**On families never seen in training, {verdict}.** " in third


def test_declared_rows_are_neither_in_the_figure_nor_in_its_sentences(held_out, unseen_families):
    solver, model, lazy = (row.at("surface") for row in held_out[0])
    unseen = unseen_families.at("surface")
    verified = [replace(row, result={**row.result, "verified": {}}) for row in (solver, model)]
    again = replace(unseen, result={**unseen.result, "verified": {}})
    for whole, family, there in (
        (verified, again, True),
        (verified, unseen, False),
        ([verified[0], model], again, False),
        ([solver, verified[1]], again, False),
    ):
        board = generalisation.Board(ranking.ranked([*whole, lazy]), {"family": [family]})
        assert bool(answer_figure.sentences(board, solver="solver")) == there
        drawn = answer_figure.draw(board, solver="solver")
        for row in (*whole, lazy):
            assert (f">{row.name}<" in drawn) == ("verified" in row.result)


def test_a_row_that_is_not_timed_is_counted_and_not_named_as_the_best(
    held_out, unseen_families, parts, make_row
):
    labels = parts["grouped"]
    limits = held_out[0][0].at("surface").truth.eigenvalues
    trained = {"kind": "learned", "training_data": "the training split"}
    untrained = {"kind": "classical", "training_data": "none"}
    timed = make_row("Timed", limits * 1.0002, labels, **trained)
    untimed = [make_row("Untimed", limits * 1.0001, labels, **trained)]
    untimed += [make_row("Bent", limits, labels, **untrained)]
    rows = [*held_out[0], timed, *(changed(row, "cost", reference=None) for row in untimed)]
    board = generalisation.Board(
        ranking.ranked([row.at("surface") for row in rows]),
        {"family": [unseen_families.at("surface")]},
    )
    second = answer_figure.sentences(board, solver="solver").splitlines()[1]
    assert "2 of 4 trained models are significantly closer to the surface; the best" in second
    assert "; the best that is timed, *Timed*, has an error " in second


def test_errors_by_size_are_those_of_the_shapes_of_that_size(parts, make_row):
    labels = parts["grouped"]
    number = np.array([int(shape[-5:]) % 3 for shape in labels.shapes])
    values = labels.eigenvalues * (1.1 + 0.1 * number)[:, None]
    row = make_row("Sizes", values, labels)
    expected = [10 * share / (2 + share) for share in (0.1, 0.2, 0.3)]
    assert list(answer_figure.by_size(row)) == ["coarse", "medium", "fine"]
    np.testing.assert_allclose(list(answer_figure.by_size(row).values()), expected)
