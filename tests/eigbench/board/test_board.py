"""Submissions, ranks, LEADERBOARD.md and its check, compare and plot."""

import copy
import json
import re
import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import partial
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from eigbench import results
from eigbench.board import error_figures, figures, generalisation, leaderboard, ranking
from eigbench.board.tables import family_title
from eigbench.errors import EigbenchError, PredictionsError, ResultError
from eigbench.results import submission
from eigbench.results.sources import outdated
from eigbench.running.machine import hardware
from eigbench.scaling import results as scaling_results
from eigbench.scoring import targets
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.names import slug
from matplotlib.colors import to_rgba

from synthnet.families import FAMILIES
from synthnet.store import pins
from synthnet.store.files import sha256
from tests.datasets import contents
from tests.eigbench.conftest import ONES, changed

BOARD = "1.0-mini-test-grouped"
RESULTS = Path("benchmark", "results", BOARD)
PREDICTIONS = Path("benchmark", "predictions", BOARD)
CHECKOUT = Path(__file__).parents[3]
slow = partial(pytest.param, marks=pytest.mark.slow)


@pytest.fixture(scope="session")
def made(make_submission, mini_truth):
    """Results of predictors that are 1 or 3 % (on other shapes), 20 % and 300 % off."""
    g = mini_truth.eigenvalues
    _, shape = np.unique(mini_truth.shapes, return_inverse=True)
    odd = (shape % 2).astype(bool)[:, None]
    ones, others = g * np.where(odd, 1.01, 1.03), g * np.where(odd, 1.03, 1.01)
    return {
        "one": make_submission("One percent", ones, kind="classical"),
        "other": make_submission("Other percent", others, kind="learned", parameters=12),
        "twenty": make_submission("Twenty | <percent>", np.stack([g * 1.2, g * 1.21])),
        "far": make_submission("Far", g * 4, training_cost="a day"),
    }


@pytest.fixture(scope="session")
def read(made):
    return {key: submission.read(path) for key, path in made.items()}


@pytest.fixture(scope="session")
def generated(made, tmp_path_factory):
    """A board of the four, generated. Read only."""
    root = tmp_path_factory.mktemp("board")
    for path in made.values():
        leaderboard.add(submission.read(path), root)
    for path, text in leaderboard.generate(leaderboard.read(root), []).items():
        (root / path).parent.mkdir(parents=True, exist_ok=True)
        (root / path).write_text(text)
    return root


@pytest.fixture
def board(generated, tmp_path):
    """A copy of that board, which a test may change."""
    shutil.copytree(generated, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_rows_of_other_metrics_are_named_and_scored_anew(board, printed):
    path = next((board / leaderboard.RESULTS).glob("*/*.json"))
    whole = json.loads(path.read_text())
    older = copy.deepcopy(whole) | {"metric_version": 1}
    for scored in older["scores"].values():
        del scored["overall"]["l2"]
        scored["families"] = {
            name: {key: value for key, value in family.items() if key != "l2"}
            for name, family in scored["families"].items()
        }
        scored["overall"]["rpd"]["mean"] = 0.5
    path.write_text(json.dumps(older))
    with pytest.raises(ResultError, match=r"of metric version 1, .* leaderboard --rescore"):
        leaderboard.read(board)
    assert "rows: 4 on boards" in printed("leaderboard", "--rescore", "--board", board)
    assert json.loads(path.read_text()) == whole
    assert leaderboard.rescore(board) == []
    assert len(leaderboard.read(board)) == 4


def test_answers_that_are_not_those_of_a_row_give_it_no_scores(board):
    first, second = sorted((board / leaderboard.PREDICTIONS).glob("*/*.parquet"))[:2]
    shutil.copyfile(first, second)
    with pytest.raises(ResultError, match=r"is not the file that .* was made with"):
        leaderboard.rescore(board)


# --- reading a submission ----------------------------------------------------------------


def test_evaluated_result_is_borne_out_by_its_predictions(weyl, mini_truth):
    row = submission.read(weyl.out)
    assert row.truth.digest == mini_truth.digest
    assert (row.name, row.slug, row.board) == ("Weyl", "weyl", BOARD)
    assert row.predictions.shape == (1, 306, 10)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.update(metric_version=1), r"of metric version 1, these are version 2"),
        (lambda r: r["dataset"].update(split_digest="0" * 64), r"its split_digest is 0{16}, that"),
        (lambda r: r["dataset"].update(shapes=35), r"its shapes is 35, that of 1.0-mini here is"),
        (lambda r: r["dataset"].update(shapes=33), r"the families have 34 shapes of 33"),
        (lambda r: r["dataset"].update(version="9.9"), r"9.9, which is no version of synthNet"),
        (lambda r: r["predictions"].update(sha256="0" * 64), r"is not the file that .* made with"),
        (lambda r: r["predictions"].update(seeds=2), r"has 1 seeds, .* names 2"),
        (
            lambda r: r["scores"]["mesh"]["overall"]["rpd"].update(low=0.5),
            r"scores/mesh/overall/rpd/low is 0.5, its predictions give",
        ),
        (
            lambda r: r["scores"]["surface"]["per_index"][3].update(median=None),
            r"scores/surface/per_index/3/median is None, its predictions give",
        ),
    ],
)
def test_result_that_its_labels_or_predictions_do_not_bear_out_is_refused(
    made, tmp_path, change, message
):
    result = json.loads(made["one"].read_text())
    change(result)
    (tmp_path / "r.json").write_text(json.dumps(result))
    with pytest.raises(ResultError, match=message):
        submission.read(tmp_path / "r.json", made["one"].with_suffix(".parquet"))


def test_result_without_predictions_is_refused(made, tmp_path):
    shutil.copy(made["one"], tmp_path / "r.json")
    with pytest.raises(ResultError, match=r"no predictions at .*r\.parquet: put them there"):
        submission.read(tmp_path / "r.json")


@pytest.mark.parametrize(
    ("name", "expected"),
    [("A  b", "a-b"), ("Weyl's law", "weyl-s-law"), ("../x", "x"), ("É, ℓ²", "e-l2")],
)
def test_slug_is_a_file_name(name, expected):
    assert slug(name) == expected


# --- ranks -------------------------------------------------------------------------------


def ranks(rows):
    return {row.submission.name: row.ranks for row in ranking.ranked(rows)}


def test_ranks_are_intervals(read):
    assert ranks(list(read.values())) == {
        "One percent": (1, 2),
        "Other percent": (1, 2),
        "Twenty | <percent>": (3, 3),
        "Far": (4, 4),
    }


def test_a_row_that_differs_surely_moves_the_others_by_its_place_alone(read, make_row, mini_truth):
    before = ranks(list(read.values()))
    g = mini_truth.eigenvalues
    best = make_row("Best", g * 1.001)
    last = make_row("Last", g * 9)
    assert ranks([*read.values(), last]) == {**before, "Last": (5, 5)}
    moved = {name: (low + 1, high + 1) for name, (low, high) in before.items()}
    assert ranks([*read.values(), best]) == {**moved, "Best": (1, 1)}


def test_exact_rows_are_first_and_ordered_by_their_speed_against_lapy(read, make_row, mini_truth):
    g = mini_truth.eigenvalues
    times = {"A slow": (1.0, 2.0), "Fast": (9.0, 5.0), "B untimed": (8.0, None), "Z": (7.0, None)}
    exact = [make_row(name, g * (1 + 5e-10)) for name in times]  # "Fast": on a slower machine
    for row, (ms, ratio) in zip(exact, times.values(), strict=True):
        reference = ratio and {**row.result["cost"]["reference"], "ratio": ratio}
        row.result["cost"] |= {"ms_per_mesh": ms, "reference": reference}
    nearly = make_row("Nearly", g * (1 + 1e-7))
    rows = ranking.ranked([nearly, *exact, read["one"]])
    assert [(r.submission.name, r.shown_rank) for r in rows] == [
        ("Fast", "exact"),
        ("A slow", "exact"),
        ("Z", "exact"),
        ("B untimed", "exact"),
        ("Nearly", "1"),
        ("One percent", "2"),
    ]


def test_seeds_that_differ_widen_the_ranks(make_row, mini_truth):
    g = mini_truth.eigenvalues
    steady = make_row("Steady", np.stack([g * 1.05] * 3))
    spread = make_row("Spread", np.stack([g * f for f in (1.0, 1.06, 1.1)]))
    near = make_row("Near", np.stack([g * 1.0533] * 3))
    assert ranks([steady, near]) == {"Steady": (1, 1), "Near": (2, 2)}
    assert ranks([steady, spread]) == {"Steady": (1, 2), "Spread": (1, 2)}


def test_seeds_of_two_rows_are_drawn_apart(make_row, mini_truth):
    """Drawn together, seeds that happen to be alike would make a small difference sure."""
    g = mini_truth.eigenvalues
    spread = np.stack([g * f for f in (1.0, 1.05, 1.1)])
    nearer, farther = make_row("Nearer", spread * 1.01), make_row("Farther", spread * 1.02)
    assert ranking.difference(nearer, farther, "rpd").verdict == "tie"


@pytest.mark.parametrize("shapes", [1, 4, 5])
def test_a_board_of_few_shapes_decides_no_rank(read, mini_truth, shapes):
    groups = np.unique(mini_truth.groups)[:shapes]
    labels = mini_truth.take(np.isin(mini_truth.groups, groups))
    rows = [generalisation.restricted(read[name], labels) for name in ("one", "far")]
    assert list(ranks(rows).values()) == ([(1, 1), (2, 2)] if shapes == 5 else [(1, 2), (1, 2)])


@pytest.mark.parametrize("key", METRICS)
def test_a_predictor_ties_with_itself_and_loses_to_a_better_one(read, key):
    assert ranking.difference(read["one"], read["one"], key).verdict == "tie"
    better = ranking.difference(read["one"], read["far"], key)
    assert better.verdict == "a"
    assert ranking.difference(read["far"], read["one"], key).verdict == "b"
    assert better.low <= better.a - better.b <= better.high


def test_difference_is_that_of_the_means(read):
    d = ranking.difference(read["twenty"], read["far"], "invlap")
    # g / p - 1 is -1/6 and -21/121, and -3/4, ten times
    a = np.sqrt(10) * (0.2 / 1.2 + 0.21 / 1.21) / 2
    assert d.a == pytest.approx(a, rel=1e-12)
    assert d.b == pytest.approx(np.sqrt(10) * 0.75, rel=1e-12)
    seeds = np.sqrt(10) * (0.21 / 1.21 - 0.2 / 1.2)  # the same for every mesh: only seeds differ
    assert d.high - d.low == pytest.approx(np.sqrt(2) * seeds, rel=1e-6)
    assert d.low < d.a - d.b < d.high
    difference = ranking.difference(read["far"], read["far"], "invlap")
    assert (difference.low, difference.high) == (0, 0)


def test_difference_in_a_family_is_of_its_meshes(read, mini_truth):
    d = ranking.difference(read["one"], read["far"], "l1", "torus")
    mine = mini_truth.families == "torus"
    assert d.b == pytest.approx(3 * mini_truth.eigenvalues[mine].sum(axis=1).mean())


def test_what_is_not_finite_is_last(make_row, read, mini_truth):
    values = mini_truth.eigenvalues.copy()
    values[7, 3] = np.nan
    bad = make_row("Bad", values)
    rows = ranking.ranked([bad, *read.values()])
    assert (rows[-1].submission.name, rows[-1].ranks) == ("Bad", (5, 5))
    assert ranking.difference(bad, read["far"], "rpd").verdict == "b"
    assert ranking.difference(read["far"], bad, "rpd").verdict == "a"
    assert ranking.difference(bad, bad, "rpd").verdict == "tie"
    page = leaderboard.generate([bad, read["far"]], [])[Path(leaderboard.PAGE)]
    assert page.count("| 2 | Bad | trivial | ∞/NaN | ∞/NaN |") == 2  # at both targets


def test_a_family_of_few_shapes_has_no_verdict_where_a_mean_is_not_finite(
    make_row, mini_truth, read
):
    counts = {f: len({*mini_truth.groups[mini_truth.families == f]}) for f in mini_truth.families}
    small, large = min(counts, key=counts.__getitem__), max(counts, key=counts.__getitem__)
    assert counts[small] < 5 <= counts[large]
    bad = make_row("Bad", np.full(mini_truth.eigenvalues.shape, np.nan))
    few = ranking.difference(read["far"], bad, "rpd", small)
    assert (few.verdict, few.why) == ("tie", "few shapes")
    assert ranking.difference(read["far"], bad, "rpd", large).verdict == "a"


def test_an_infinite_psnr_is_the_best(printed, make_submission, made, mini_truth):
    g = mini_truth.eigenvalues
    exact, bad = g * 1.001, g * 1.001
    exact[:3], bad[:2] = g[:3], [g[0], np.inf * g[1]]
    exact, bad = make_submission("Exact on three", exact), make_submission("Bad", bad)
    mesh = ["--target", "mesh"]
    orders = [(exact, made["one"], "a"), (made["one"], exact, "b"), (exact, exact, "tie")]
    for a, b, verdict in [*orders, (exact, bad, "a"), (bad, made["one"], "b")]:
        psnr = json.loads(printed("compare", a, b, *mesh, "--json"))["overall"]["psnr"]
        assert psnr["verdict"] == verdict
        assert psnr["why"] == ("not finite" if verdict == "tie" else "")
    (line,) = re.findall("^PSNR  .*$", printed("compare", exact, made["one"], *mesh), flags=re.M)
    assert line.endswith("A is better")


def test_a_difference_whose_interval_covers_zero_is_a_tie(make_row, mini_truth):
    rng = np.random.default_rng(0)
    g = mini_truth.eigenvalues
    noisy = [(1 + 0.05 * rng.standard_normal(g.shape)) * g for _ in range(2)]
    row, other = (make_row(f"noisy {i}", values) for i, values in enumerate(noisy))
    difference = ranking.difference(row, other, "rpd")
    assert difference.low < 0 < difference.high
    assert (difference.verdict, difference.why) == ("tie", "interval")


def test_results_of_two_splits_are_not_compared(read):
    other = replace(read["one"], truth=read["one"].truth.head(10))
    with pytest.raises(EigbenchError, match="predict other instances"):
        ranking.difference(other, read["far"], "rpd")


# --- the page ----------------------------------------------------------------------------


def test_page_is_the_same_to_the_byte_for_shuffled_input(board):
    rows = leaderboard.read(board)
    reported = [{"source": s, "setting": "", "tables": [], "notes": []} for s in "ab"]
    assert leaderboard.generate(rows, reported) == leaderboard.generate(rows[::-1], reported[::-1])


def test_page_and_figure_do_not_depend_on_the_style_of_the_user(board):
    plain = leaderboard.generate(leaderboard.read(board), [])
    with mpl.rc_context({"font.size": 20, "svg.hashsalt": None, "axes.grid": True}):
        assert leaderboard.generate(leaderboard.read(board), []) == plain


def test_page_says_what_every_row_is(board):
    page = (board / "LEADERBOARD.md").read_text()
    assert page.startswith("<!-- Generated by `eigbench leaderboard`. Do not edit")
    assert re.findall(r"^## synthNet.*$", page, flags=re.M) == [
        "## synthNet 1.0-mini, test split, protocol grouped, against the surface",
        "## synthNet 1.0-mini, test split, protocol grouped, against the mesh",
    ]
    mesh = page.partition("against the mesh\n")[2]
    (row,) = re.findall(r"^\| 3 \|.*$", mesh, flags=re.M)
    assert row.startswith("| 3 | Twenty \\| &lt;percent> | trivial | ")
    assert row.endswith("| 2 |")
    assert re.search(r"^\| 1–2 \| Other percent \| learned \|", mesh, flags=re.M)
    links = re.findall(r"\]\((benchmark/.+?)\)", page)
    assert len(links) == 6
    assert all((board / link).is_file() for link in links)


def test_a_boards_own_page_has_every_metric_and_its_cost(board):
    page = (board / leaderboard.BOARDS / f"{BOARD}-mesh.md").read_text()
    for metric in METRICS.values():
        assert f"{metric.title} {'↑' if metric.higher_is_better else '↓'}" in page
    assert re.search(r"^\| 1–2 \| Other percent \| learned \|.*\| 12 \|", page, flags=re.M)
    assert "a day" in page
    assert "**Floor**" in page


def test_json_of_a_board_has_its_scores_ranks_and_digests(board):
    for target in ("surface", "mesh"):
        board_json = json.loads((board / leaderboard.BOARDS / f"{BOARD}-{target}.json").read_text())
        assert (board_json["board"], board_json["target"]) == (BOARD, target)
        assert [row["name"] for row in board_json["rows"]][-1] == "Far"
        assert len(board_json["rows"]) == 4
        for row in board_json["rows"]:
            result = board / RESULTS / f"{row['slug']}.json"
            answers = board / PREDICTIONS / f"{row['slug']}.parquet"
            assert row["sha256"] == {"result": sha256(result), "predictions": sha256(answers)}
            assert row["scores"] == json.loads(result.read_text())["scores"][target]


def test_export_writes_a_line_an_eigenvalue_with_both_targets(printed, board, mini_truth):
    out = board / "tables"
    assert f"{BOARD}.parquet" in printed("export", "--board", board, "--out", out)
    table = pd.read_parquet(out / f"{BOARD}.parquet")
    assert len(table) == 306 * 10 * 5  # four rows, one of them of two seeds
    lines = table[(table["row"] == "one-percent") & (table["index"] == 4)]
    np.testing.assert_array_equal(lines["mesh"], mini_truth.eigenvalues[:, 3])
    surface = targets.at(mini_truth, "surface")
    np.testing.assert_array_equal(lines["surface"], surface.eigenvalues[:, 3])
    np.testing.assert_array_equal(lines["surface_bar"], surface.tolerance[:, 3])
    assert list(lines["group"]) == list(mini_truth.groups)
    ids = [f"{s}/{i}" for s, i in zip(lines["shape"], lines["instance"], strict=True)]
    assert ids == list(mini_truth.ids)
    assert lines["prediction"].between(1.009 * lines["mesh"], 1.031 * lines["mesh"]).all()
    as_text = pd.read_csv(out / f"{BOARD}.csv")
    assert len(as_text) == len(table)
    assert list(as_text) == list(table)


def test_export_writes_the_boards_and_formats_that_are_asked_for(printed, eigbench, board):
    out = board / "some"
    options = ("export", "--board", board, "--out", out)
    said = printed(*options, "--only", BOARD, "--format", "parquet")
    assert f"{BOARD}.parquet" in said
    assert [path.name for path in out.iterdir()] == [f"{BOARD}.parquet"]
    code, _, err = eigbench(*options, "--only", "3.0-test-grouped")
    assert code == 2
    assert f"has no board '3.0-test-grouped'; there is {BOARD}" in err


def test_page_shows_the_papers_numbers_as_reported_and_not_run():
    reported = leaderboard.read_reported(CHECKOUT)
    generated = leaderboard.generate([], reported)
    page = generated[Path("LEADERBOARD.md")]
    assert "No result has been submitted yet." in page
    assert "## Reported by the paper, not run here" in page
    assert "(benchmark/boards/reported.md)" in page
    page = generated[Path("benchmark/boards/reported.md")]
    assert "| GCN, RPDLoss | 0.2816 | 0.0370 | 0.3378 | 84.5% | 36.59 | 16.66 |" in page


def test_every_reported_row_has_a_cell_for_each_column():
    reported = leaderboard.read_reported(CHECKOUT)
    assert reported
    for paper in reported:
        assert paper["tables"]
        for table in paper["tables"]:
            assert {len(row) for row in table["rows"]} == {len(table["columns"])}


def test_every_row_of_every_table_has_the_cells_of_its_head(board):
    pages = [board / "LEADERBOARD.md", *sorted(board.glob("benchmark/boards/*.md"))]
    page = "\n".join(path.read_text() for path in pages).replace("\\|", "")
    tables = re.findall(r"(?:^\|.*\n)+", page, flags=re.M)
    assert len(tables) == 2 + 2 * 9
    for table in tables:
        assert len({line.count("|") for line in table.splitlines()}) == 1, table


def test_figure_names_every_row_and_has_no_date(board):
    path, _ = board.glob("benchmark/figures/*.svg")
    text = path.read_text()
    ET.fromstring(text)
    assert "<dc:date>" not in text
    for name in ("One percent", "Other percent", "Far"):
        assert name in text


def test_exact_is_who_has_no_error_not_who_has_no_share(read):
    worst = figures.error_against_time([read["far"]], "psnr20")
    assert "Far" in worst
    assert "exact" not in worst


# --- the check ---------------------------------------------------------------------------


def flip(path, position):
    data = bytearray(path.read_bytes())
    data[position] ^= 1
    path.write_bytes(bytes(data))


def test_check_passes_what_was_generated_and_generating_again_changes_nothing(printed, board):
    out = printed("leaderboard", "--check", "--board", board)
    assert "4 rows scored anew, every generated file is up to date" in out
    before = contents(board)
    assert "rows: 4 on boards, 0 on the scaling track; written: nothing new" in printed(
        "leaderboard", "--board", board
    )
    assert contents(board) == before


@pytest.mark.parametrize("share", [0.001, *map(slow, (0.1, 0.3, 0.7, 0.9)), 0.5, 0.999])
def test_one_changed_byte_of_predictions_fails_the_check(refused, board, share):
    path = board / PREDICTIONS / "one-percent.parquet"
    flip(path, int(share * path.stat().st_size))
    err = refused("leaderboard", "--check", "--board", board)
    assert str(path) in err.splitlines()[-1]


@pytest.mark.parametrize(
    "what",
    [
        *map(slow, ('"partial"', '"ms_per_mesh"', '"rotation"', '"python"')),
        '"mean"',
        '"hardware"',
        "\n}",
    ],
)
def test_one_changed_byte_of_a_result_fails_the_check(eigbench, board, what):
    path = board / RESULTS / "one-percent.json"
    text = path.read_text()
    flip(path, len(text[: text.rindex(what) + len(what) + 4].encode()) if what[0] == '"' else -1)
    code, _, err = eigbench("leaderboard", "--check", "--board", board)
    assert code in (1, 2)
    assert "one-percent" in err or "not up to date: run eigbench leaderboard" in err


@pytest.mark.parametrize("shape", [0, slow(1000), slow(-1)])
def test_one_changed_label_fails_the_check(refused, board, monkeypatch, shape):
    submission._pinned.cache_clear()
    pinned = dict(pins.read("1.0"))
    tested = sorted(
        {id.rpartition("/")[0] for id in submission._pinned("1.0-mini", "test", "grouped").ids}
    )
    id = tested[shape % len(tested)]
    label = pinned[id].eigenvalues.copy()
    label[4] = np.nextafter(label[4], np.inf)
    pinned[id] = replace(pinned[id], eigenvalues=label)
    monkeypatch.setattr(pins, "read", lambda version: pinned)
    submission._pinned.cache_clear()
    err = refused("leaderboard", "--check", "--board", board)
    submission._pinned.cache_clear()
    assert "was made with other labels: its split_digest is" in err


def test_edited_page_fails_the_check_and_the_difference_is_shown(eigbench, board):
    page = board / "LEADERBOARD.md"
    page.write_text(page.read_text().replace("| 4 | Far |", "| 1 | Far |"))
    code, _, err = eigbench("leaderboard", "--check", "--board", board)
    assert code == 1
    assert "-| 1 | Far |" in err
    assert "+| 4 | Far |" in err
    assert f"run eigbench leaderboard --board {board}" in err
    assert "| 1 | Far |" in page.read_text()


def test_first_rows_stand_between_the_marks_of_the_readme(eigbench, board):
    readme = board / "README.md"
    readme.write_text("Mine\n<!-- begin leaderboard -->old<!-- end leaderboard -->\nend\n")
    code, _, err = eigbench("leaderboard", "--check", "--board", board)
    assert code == 1
    assert "README.md as generated" in err
    assert eigbench("leaderboard", "--board", board)[0] == 0
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 0
    lines = readme.read_text().splitlines()
    assert lines[:2] == ["Mine", "<!-- begin leaderboard -->"]
    assert lines[2] == (
        "synthNet 1.0-mini, test split, protocol grouped, against the surface, 4 rows. 34 shapes, "
        "306 instances. 53 % of the shapes have a training shape whose spectrum, scale removed, is "
        "within 1 %: a test of interpolation. "
        f"Timed on {hardware()}; cpu, 1 thread."
    )
    assert lines[-2:] == ["<!-- end leaderboard -->", "end"]
    assert [line.split(" | ")[0:2] for line in lines if re.match(r"\| \d", line)] == [
        ["| 1–2", "One percent"],
        ["| 1–2", "Other percent"],
        ["| 3", r"Twenty \| &lt;percent>"],
        ["| 4", "Far"],
    ]


def test_readme_shows_five_rows_of_a_board(read):
    rows = [read["one"]] * 7
    readme = "<!-- begin leaderboard --><!-- end leaderboard -->"
    text = leaderboard.generate(rows, [], (), readme)[Path("README.md")]
    assert text.count("One percent") == 5
    assert "7 rows. " in text


def test_readme_without_marks_is_left_alone(eigbench, board):
    (board / "README.md").write_text("mine")
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 0
    assert eigbench("leaderboard", "--board", board)[0] == 0
    assert (board / "README.md").read_text() == "mine"


@pytest.mark.parametrize("text", ["<!-- begin leaderboard -->", "twice"])
def test_readme_with_half_a_mark_is_one_line(refused, board, text):
    marks = "<!-- begin leaderboard --><!-- end leaderboard -->"
    (board / "README.md").write_text(2 * marks if text == "twice" else text)
    assert "README.md has the marks of leaderboard" in refused("leaderboard", "--board", board)


def test_stray_files_fail_the_check(eigbench, refused, board):
    stray = board / "benchmark" / "figures" / "old.svg"
    stray.write_text("")
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 1
    eigbench("leaderboard", "--board", board)
    assert not stray.exists()
    stray = board / PREDICTIONS / "lost.parquet"
    shutil.copy(stray.with_name("far.parquet"), stray)
    assert "lost.parquet belongs to no row" in refused("leaderboard", "--check", "--board", board)
    stray.rename(board / "benchmark" / "results" / "readme.txt")
    assert "readme.txt belongs to no row" in eigbench("leaderboard", "--board", board)[2]


def test_result_under_another_name_fails_the_check(refused, board):
    for path in (board / RESULTS / "far.json", board / PREDICTIONS / "far.parquet"):
        path.rename(path.with_stem("near"))
    err = refused("leaderboard", "--check", "--board", board)
    assert f"belongs at benchmark/results/{BOARD}/far.json" in err


def test_partial_result_on_the_board_fails_the_check(board):
    path = board / RESULTS / "far.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "partial": True}))
    with pytest.raises(ResultError, match="is partial"):
        leaderboard.read(board)


def test_nothing_is_put_where_a_link_lies(board, tmp_path):
    source = tmp_path / "new.json"
    source.write_text("{}")
    target = board / RESULTS / "linked.json"
    target.symlink_to("/dev/zero")
    with pytest.raises(EigbenchError, match="is no regular file: remove it"):
        results.put([source], [target], board, replace=True)


def test_missing_predictions_fail_the_check(board):
    (board / PREDICTIONS / "far.parquet").unlink()
    with pytest.raises(PredictionsError, match="there is no file"):
        leaderboard.read(board)


def test_leaderboard_outside_a_checkout_says_what_to_do(refused, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    err = refused("leaderboard", "--check")
    assert "has no benchmark/results" in err
    assert "--board DIR" in err


# --- submit ------------------------------------------------------------------------------


def test_submit_places_both_files_unchanged(printed, made, tmp_path):
    trial = tmp_path / "trial"
    out = printed("submit", made["far"], "--board", trial)
    assert (trial / RESULTS / "far.json").read_bytes() == made["far"].read_bytes()
    kept = trial / PREDICTIONS / "far.parquet"
    assert kept.read_bytes() == made["far"].with_suffix(".parquet").read_bytes()
    assert f"now: eigbench leaderboard --board {trial}" in out


def test_submit_replaces_only_when_told(
    eigbench, refused, made, make_submission, mini_truth, tmp_path
):
    assert eigbench("submit", made["far"], "--board", tmp_path)[0] == 0
    assert eigbench("submit", made["far"], "--board", tmp_path)[0] == 0  # the very same
    nearer = make_submission("Far", 2 * mini_truth.eigenvalues)
    assert "is there already: give --replace" in refused("submit", nearer, "--board", tmp_path)
    placed = tmp_path / RESULTS / "far.json"
    assert submission.read(placed).name == "Far"
    assert eigbench("submit", nearer, "--board", tmp_path, "--replace")[0] == 0
    assert placed.read_bytes() == nearer.read_bytes()
    assert eigbench("submit", placed, "--board", tmp_path)[0] == 0  # onto itself


def test_a_dry_run_says_where_a_result_would_stand_and_writes_nothing(
    printed, make_submission, mini_truth, board
):
    between = make_submission("Between", 1.1 * mini_truth.eigenvalues)
    before = contents(board)
    command = ["submit", between, "--dry-run", "--board", board]
    mesh = json.loads(printed(*command, "--json"))["targets"]["mesh"]
    assert (mesh["rows"], mesh["rank"], mesh["exact"]) == (5, [3, 3], False)
    assert {*mesh["above"]} == {"One percent", "Other percent"}
    assert mesh["below"] == ["Twenty | <percent>", "Far"]
    out = printed(*command)
    assert "protocol grouped, against the mesh: Between would have rank 3 of 5\n" in out
    assert "protocol grouped, against the surface: Between would have rank " in out
    assert "| 3 | Between |" in out
    assert "--replace" not in out
    assert contents(board) == before


def test_a_dry_run_leaves_out_an_earlier_result_of_the_model(
    eigbench, make_submission, mini_truth, board
):
    better = make_submission("Far", 1.1 * mini_truth.eigenvalues)
    _, out, _ = eigbench("submit", better, "--dry-run", "--board", board, "--json")
    there = board / RESULTS / "far.json"
    assert json.loads(out)["targets"]["mesh"]["rows"] == 4
    assert json.loads(out)["replaces"] == str(there)
    taken = f"{there} has that name: `eigbench submit` needs --replace"
    command = ("submit", better, "--dry-run", "--board", board)
    assert eigbench(*command)[1].splitlines()[-1] == taken
    assert taken not in eigbench(*command, "--replace")[1]


def test_a_dry_run_refuses_what_submit_refuses(refused, made, tmp_path):
    err = refused("submit", made["far"], "--dry-run", "--board", tmp_path)
    assert "has no benchmark/results" in err


def test_submit_refuses_a_partial_result(eigbench, refused, predictor_file, mini_home, tmp_path):
    code = predictor_file(ONES)
    where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", tmp_path / "r.json"]
    assert eigbench("evaluate", code, *where, "--limit", 5, "--no-reference")[0] == 0
    err = refused("submit", tmp_path / "r.json", "--board", tmp_path)
    assert "is partial (made with --limit)" in err
    assert not (tmp_path / "benchmark").exists()


@pytest.mark.parametrize(
    ("part", "new", "message"),
    [
        ("cost", {"reference": None}, "was not timed beside LaPy: evaluate without --no-ref"),
        ("dataset", {"split": "train"}, "is of the split train: a board takes test only"),
    ],
)
def test_submit_refuses_what_is_not_timed_or_of_another_split(read, tmp_path, part, new, message):
    with pytest.raises(ResultError, match=message):
        leaderboard.add(changed(read["far"], part, **new), tmp_path)


def test_ratio_to_lapy_is_on_the_page(read):
    ratios = {
        "far": {"ratio": 12.34, "ms_per_mesh": 70.0, "meshes": 1, "solver": "LaPy"},
        "one": None,
    }
    rows = [changed(read[key], "cost", reference=ratios[key]) for key in ("one", "far")]
    text = leaderboard.generate(rows, [])[Path("LEADERBOARD.md")]
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert any("| Far |" in line and "| 12 × |" in line for line in lines)
    assert any("| One percent |" in line and "| not timed |" in line for line in lines)
    details = leaderboard.generate(rows, [])[leaderboard.BOARDS / f"{BOARD}-mesh.md"]
    assert "| 70.00 | 12 × |" in details


def test_ratios_to_all_peers_are_in_every_table_with_a_ratio_and_in_the_json(read):
    lapy = {"ratio": 12.34, "low": 11.6, "high": 13.1, "ms_per_mesh": 70.0, "meshes": 1}
    cholmod = {"ratio": 6.78, "low": 5.6, "high": 7.7}
    timed = {"reference": {**lapy, "solver": "LaPy"}, "peers": {"LaPy with CHOLMOD": cholmod}}
    rows = [changed(read["far"], "cost", **timed), changed(read["one"], "cost", reference=None)]
    marks = "<!-- begin leaderboard --><!-- end leaderboard -->"
    pages = leaderboard.generate(rows, [], (), marks)
    for path in (leaderboard.PAGE, leaderboard.README, leaderboard.BOARDS / f"{BOARD}-mesh.md"):
        text = pages[Path(path)]
        assert "| speed against LaPy | against LaPy with CHOLMOD |" in text, path
        assert re.search(r"^\| 2 \| Far .*\| 12 × \(12–13\) \| 6\.8 × \(5\.6–7\.7\) \|", text, re.M)
        assert re.search(r"^\| 1 \| One percent .*\| not timed \| not timed \|", text, re.M)
    one, far = json.loads(pages[leaderboard.BOARDS / f"{BOARD}-mesh.json"])["rows"]
    lapys_own = {key: lapy[key] for key in ("ratio", "low", "high")}
    assert far["speed_against"] == {"LaPy with CHOLMOD": cholmod, "LaPy": lapys_own}
    assert one["speed_against"] == {}


def test_where_all_succeed_the_readme_has_the_bound_of_the_board(make_row, mini_truth):
    marks = "<!-- begin leaderboard --><!-- end leaderboard -->"
    near = make_row("Near", targets.at(mini_truth, "surface").eigenvalues * 1.001)
    pages = leaderboard.generate([near], [], (), marks)
    bound = 1 - 3 / len(set(mini_truth.groups))
    for path in (leaderboard.README, leaderboard.PAGE):
        row, *_ = re.findall(r"^\| 1 \| Near .*", pages[Path(path)], re.M)  # against the surface
        assert f"| 100 % (≥ {100 * bound:.2f} %) |" in row


@pytest.mark.parametrize("value", [np.nan, -1.0, 0.0])
def test_submit_refuses_predictions_that_no_spectrum_has(
    refused, make_submission, mini_truth, tmp_path, value
):
    values = mini_truth.eigenvalues.copy()
    values[7, 3] = value
    err = refused("submit", make_submission("Bad", values), "--board", tmp_path)
    assert f"first ids: {mini_truth.ids[7]}" in err
    assert not (tmp_path / "benchmark").exists()


def test_submit_refuses_predictions_that_are_no_parquet(refused, made, mini_truth, tmp_path):
    row = submission.read(made["far"])
    kept = tmp_path / "p.npz"
    np.savez(kept, ids=np.array(mini_truth.ids), eigenvalues=row.predictions[0])
    result = json.loads(made["far"].read_text())
    result["predictions"]["sha256"] = sha256(kept)
    (tmp_path / "r.json").write_text(json.dumps(result))
    err = refused("submit", tmp_path / "r.json", "--predictions", kept, "--board", tmp_path)
    assert "must be the Parquet file of `eigbench evaluate`" in err


@pytest.mark.parametrize("name", ["Net $\\foo$", "a\\|b", "[x](y) `z` *w*", "<img>"])
def test_any_name_can_stand_on_the_page(make_row, mini_truth, name):
    entry = make_row(name, mini_truth.eigenvalues * 1.1)
    generated = leaderboard.generate([entry], [])
    page = generated[Path("LEADERBOARD.md")]
    assert "<img" not in page
    for row in re.findall(r"^\| 1 \|.*$", page, flags=re.M):
        assert len(re.findall(r"(?<!\\)(?:\\\\)*\|", row)) == 10
    ET.fromstring(generated[leaderboard.FIGURES / f"{BOARD}-mesh.svg"])


# --- compare and plot --------------------------------------------------------------------


def test_compare_tells_ties_from_differences(printed, made, mini_truth):
    out = printed("compare", made["one"], made["twenty"])
    shapes = {name: set() for name in mini_truth.families}
    for name, shape in zip(mini_truth.families, mini_truth.groups, strict=True):
        shapes[name].add(shape)
    few = [family_title(name) for name in FAMILIES if 0 < len(shapes.get(name, ())) < 5]
    assert 0 < len(few) < len(shapes)
    ties = re.findall(r"^(.+?)  .*none \((.+)\)$", out, flags=re.M)
    assert ties == [(title, "few shapes") for title in few]
    better = len(METRICS) + len(shapes) - len(few)
    assert out.count("A is better") == better
    assert printed("compare", made["twenty"], made["one"]).count("B is better") == better
    overall = json.loads(printed("compare", made["one"], made["one"], "--json"))["overall"]
    told = {(d["verdict"], d["why"], d["high"]) for d in overall.values()}
    assert told == {("tie", "equal", 0.0)}


def test_compare_takes_predictions_from_elsewhere(eigbench, made, tmp_path):
    paths = []
    for key in ("one", "far"):
        shutil.copy(made[key], tmp_path / f"{key}.json")
        paths.append(made[key].with_suffix(".parquet"))
    both = [tmp_path / "one.json", tmp_path / "far.json"]
    assert eigbench("compare", *both)[0] == 2
    assert eigbench("compare", *both, "--predictions", *paths)[0] == 0


def test_compare_reads_a_partial_result_of_a_directory(
    eigbench, refused, predictor_file, mini_home, tmp_path
):
    code = predictor_file(ONES)
    where = ["--dataset", mini_home / "1.0-mini", "--limit", 5, "--no-reference"]
    for name in "ab":
        eigbench("evaluate", code, *where, "--out", tmp_path / f"{name}.json")
    both = [tmp_path / "a.json", tmp_path / "b.json"]
    assert eigbench("compare", *both, "--dataset", mini_home / "1.0-mini")[0] == 0
    assert "holds no dataset" in refused("compare", *both, "--dataset", tmp_path)


@pytest.mark.slow
def test_plot_draws_every_picture(printed, made, tmp_path):
    out = printed("plot", made["one"], made["twenty"], "--out", tmp_path / "figures")
    names = {path.name for path in (tmp_path / "figures").iterdir()}
    assert names == {
        *("families.png", "index.png", "histogram.png", "error-time.svg"),
        *("spectra-one-percent.png", "spectra-twenty-percent.png"),
    }
    assert all(name in out for name in names)
    printed("plot", made["one"], made["one"], "--out", tmp_path / "twice")
    spectra = {path.name for path in (tmp_path / "twice").glob("spectra-*")}
    assert spectra == {"spectra-one-percent.png", "spectra-one-percent-2.png"}


def test_spectra_show_the_best_the_median_and_the_worst_of_each_family(read, mini_truth):
    figure = error_figures.spectra(read["one"])
    titles = [axes.get_title() for axes in figure.axes]
    assert len(titles) == 3 * len(set(mini_truth.families.tolist()))
    errors = ranking.per_mesh(read["one"], "rpd")
    for axes, title in zip(figure.axes, titles, strict=True):
        name, id = title.splitlines()[0].split(": ")
        i = mini_truth.ids.index(id)
        mine = errors[mini_truth.families == mini_truth.families[i]]
        middle = np.sort(mine)[round((len(mine) - 1) / 2)]
        assert errors[i] == {"best": mine.min(), "median": middle, "worst": mine.max()}[name]
        true, predicted = (line.get_ydata() for line in axes.get_lines())
        np.testing.assert_array_equal(true, mini_truth.eigenvalues[i])
        np.testing.assert_array_equal(predicted, read["one"].predictions[0, i])


def test_error_by_index_is_the_median_over_the_meshes(read, mini_truth):
    figure = error_figures.by_index([read["one"], read["twenty"]])
    (axes,) = figure.axes
    percent, twenty = axes.get_lines()
    known = np.abs(read["one"].predictions[0] / mini_truth.eigenvalues - 1)
    np.testing.assert_allclose(percent.get_ydata(), np.median(known, axis=0), rtol=1e-9)
    np.testing.assert_allclose(twenty.get_ydata(), 0.205, rtol=1e-9)  # the mean of two seeds
    kinds = [read[name].result["model"]["kind"] for name in ("one", "twenty")]
    assert [percent.get_color(), twenty.get_color()] == [figures.KINDS[kind][0] for kind in kinds]
    assert [percent.get_marker(), twenty.get_marker()] == [figures.KINDS[kind][1] for kind in kinds]
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == [read["one"].name, read["twenty"].name]


def test_error_by_index_of_one_model_has_bands(read):
    figure = error_figures.by_index([read["one"]])
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["90 % of the meshes", "50 % of the meshes", "One percent"]
    for band in figure.axes[0].collections:
        heights = band.get_paths()[0].vertices[:, 1]
        np.testing.assert_allclose((heights.min(), heights.max()), (0.01, 0.03), rtol=1e-6)


def test_figures_of_single_models_colour_by_kind_and_tell_models_of_a_kind_apart(read):
    colour, marker = figures.KINDS[read["one"].result["model"]["kind"]]
    twice = [read["one"], changed(read["one"], "model", name="Other")]
    (axes,) = error_figures.by_index(twice).axes
    assert {line.get_color() for line in axes.get_lines()} == {colour}
    looks = [(line.get_linestyle(), line.get_marker()) for line in axes.get_lines()]
    assert looks[0] == ("-", marker)
    assert looks[0] != looks[1]
    figure = error_figures.families(twice)
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["1  One percent", "2  Other"]
    (axes,) = figure.axes
    assert {box.get_facecolor() for box in axes.patches} == {to_rgba(colour, 0.7)}
    families = set(read["one"].truth.families.tolist())
    assert sorted(text.get_text() for text in axes.texts) == sorted("12" * len(families))
    (axes,) = error_figures.histogram([read["one"]]).axes
    assert {bar.get_facecolor() for bar in axes.patches} == {to_rgba(colour)}


def test_histogram_counts_every_mesh_once(read):
    assert METRICS
    for key in METRICS:
        figure = error_figures.histogram([read["one"], read["twenty"]], key)
        for axes, name in zip(figure.axes, ("one", "twenty"), strict=True):
            heights = [patch.get_height() for patch in axes.patches]
            assert sum(heights) == pytest.approx(100)
            median = np.median(ranking.per_mesh(read[name], key))
            np.testing.assert_allclose(axes.get_lines()[0].get_xdata(), median)


def test_an_exact_answer_is_drawn_at_the_edge(make_row, mini_truth):
    exact = make_row("Exact", mini_truth.eigenvalues, kind="classical")
    (line,) = error_figures.by_index([exact]).axes[0].get_lines()
    np.testing.assert_array_equal(line.get_ydata(), error_figures.LEAST)
    (axes,) = error_figures.histogram([exact]).axes
    assert axes.get_lines()[0].get_xdata()[0] == figures.FLOOR / 10
    assert axes.get_title(loc="left") == "Exact: median 0"


def test_plot_of_two_datasets_says_so(refused, made, tmp_path):
    other = CHECKOUT / "benchmark" / "results" / "2.0-test-grouped" / "weyl-s-law.json"
    err = refused("plot", made["one"], other, "--out", tmp_path)
    assert err.endswith("cannot be compared: their version is 1.0-mini and 2.0\n")


def test_plot_of_answers_that_are_not_finite_is_refused(
    eigbench, refused, make_submission, mini_truth, tmp_path
):
    bad = make_submission("Bad", np.full_like(mini_truth.eigenvalues, np.inf))
    err = refused("plot", bad, "--out", tmp_path)
    assert "has predictions that are not finite: no picture" in err
    assert eigbench("plot", bad, "--out", tmp_path, "--metric", "psnr")[2] == err


@pytest.mark.parametrize("value", [1.7e308, 5e-324])
def test_answers_at_the_ends_of_float64_are_refused_on_one_line(
    eigbench, refused, make_submission, mini_truth, tmp_path, value
):
    answers = mini_truth.eigenvalues.copy()
    answers[0, -1] = value
    one = make_submission("One", answers)
    all_ = make_submission("All", np.full_like(answers, value))
    for path, count in ((one, 1), (all_, len(answers))):
        err = refused("submit", path, "--dry-run")
        assert f"of {count} of {len(answers)} instances are not from 1e-30 to 1e+30" in err
        err = refused("plot", path, "--out", tmp_path)
        assert err.endswith("has predictions that are not from 1e-30 to 1e+30: no picture\n")
        assert len(err.splitlines()) == 1
    code, out, err = eigbench("compare", one, all_)
    assert (code, err) == (0, "")
    assert "rpd" in out.lower()


@pytest.mark.slow
def test_plot_of_a_metric_that_is_infinite_on_finite_answers_says_so(
    eigbench, refused, make_submission, mini_truth, tmp_path
):
    answers = 1.1 * mini_truth.eigenvalues
    answers[:3] = mini_truth.eigenvalues[:3]
    answers[3] = 0
    two = make_submission("Exact on three", answers)
    for key, message in (("psnr", "PSNR is infinite on 3 of"), ("invlap", "is infinite on 1 of")):
        options = ["--out", tmp_path, "--metric", key, "--target", "mesh"]
        err = refused("plot", two, *options)
        assert f"{message} {len(answers)} instances, though the predictions are finite" in err
        row = submission.read(two)
        for draw in (error_figures.histogram, error_figures.families):
            with pytest.raises(EigbenchError, match=message):
                draw([row], key)
    assert eigbench("plot", two, "--out", tmp_path, "--metric", "rpd")[0] == 0


# --- the board of this repository --------------------------------------------------------


@pytest.fixture(scope="session")
def real(tmp_path_factory):
    """A copy of this repository's board."""
    location = tmp_path_factory.mktemp("real")
    for name in (leaderboard.PAGE, leaderboard.README):
        shutil.copy(CHECKOUT / name, location)
    ignored = shutil.ignore_patterns("__pycache__", "node_modules", "dist")
    for name in ("benchmark", "baselines"):  # rows are marked if their sources are others by now
        shutil.copytree(CHECKOUT / name, location / name, ignore=ignored)
    return location


@pytest.mark.slow
def test_leaderboard_of_this_repository_is_up_to_date(printed, real):
    printed("leaderboard", "--check", "--board", real)


def test_every_first_row_is_on_the_board(real):
    names = {path.stem for path in (real / "benchmark/results/1.0-test-grouped").iterdir()}
    assert names >= {
        *("mean-training-spectrum", "weyl-s-law", "boosted-trees", "lumped-mass", "lapy"),
        *(f"rayleigh-ritz-degree-{d}" for d in (3, 5, 7)),
        *(f"decimation-to-{n}-lapy" for n in (300, 1000)),
    }


@pytest.fixture(scope="session")
def first_rows(real):
    """The results of the baselines of this repository."""
    names = {path.name for path in (CHECKOUT / "baselines").glob("*.py")}
    rows = [results.read(path) for path in (real / "benchmark/results").glob("*/*.json")]
    return [result for result in rows if result["model"]["code"].partition(":")[0] in names]


def test_first_rows_are_timed_on_lapys_machine_or_beside_it(first_rows):
    grouped = [row for row in first_rows if row["dataset"]["protocol"] == "grouped"]
    assert {row["dataset"]["version"] for row in grouped} == {"1.0", "2.0", "2.1"}
    lapy = {
        (row["dataset"]["version"], results.setting(row))
        for row in grouped
        if row["model"]["code"] == "exact.py"
    }
    for row in grouped:  # under the other protocols no times are shown
        same = (row["dataset"]["version"], results.setting(row)) in lapy
        assert same or row["cost"]["reference"], row["model"]["name"]


def test_first_rows_are_timed_on_one_thread(first_rows):
    assert {result["cost"]["threads"] for result in first_rows} == {1}
    costs = [result["cost"] for result in first_rows]
    # Of a batch that takes microseconds, reading the clocks is a part of it
    assert all(cost["cores_used"] < 1.1 for cost in costs if cost["ms_per_mesh"] > 0.01)


def test_first_rows_name_the_commit_and_the_files_of_their_code(first_rows):
    assert len(first_rows) > 10
    for result in first_rows:
        # A dirty checkout says nothing against a row whose code is that of this one
        assert not (result["checkout"]["dirty"] and outdated(result, CHECKOUT))
        assert result["model"]["code"].partition(":")[0] in result["model"]["sources"]


def test_row_whose_code_has_changed_is_marked_until_it_is_run_again(
    board, make_scaled, weyl, eigbench
):
    scaling_results.add(make_scaled("Slow", {1_000: (0.1, 1.0)}), board)
    mark = "This row was made by an earlier version of the model's code."

    def page():
        assert eigbench("leaderboard", "--board", board)[0] == 0
        return (board / leaderboard.PAGE).read_text()

    assert mark not in page()  # the code is not there
    code = board / "baselines" / "weyl.py"
    code.parent.mkdir()
    code.write_text(weyl.code.read_text() + "\n# One percent\n")
    assert mark not in page()
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 0
    code.write_text(weyl.code.read_text() + "\nCHANGED = 'One percent'\n")
    assert f"**One percent**: {mark}" in page()
    code.with_name("a.py").write_text("Slow, but no longer the same code")
    assert f"**Slow**: {mark}" in page()
    assert eigbench("leaderboard", "--check", "--board", board)[0] == 0


def test_what_lapy_misses_on_2_0_is_what_the_docs_say():
    benchmark, name = CHECKOUT / "benchmark", "2.0-test-grouped/lapy"
    lapy = submission.read(
        benchmark / "results" / f"{name}.json", benchmark / "predictions" / f"{name}.parquet"
    )
    error = np.abs(lapy.predictions[0] / lapy.truth.eigenvalues - 1)
    (wrong,) = np.flatnonzero((error > 1e-6).any(axis=1))
    assert lapy.truth.ids[wrong] == "twisted_torus-00540/1"
    assert np.flatnonzero(error[wrong] > 1e-6).tolist() == [9]
    label = lapy.truth.eigenvalues[wrong]
    assert label[8] == pytest.approx(label[9], rel=1e-6)
    assert len(lapy.truth.ids) == 1986


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["results", "predictions"])
def test_one_changed_byte_of_a_file_of_this_repository_fails_the_check(
    eigbench, real, folder, tmp_path
):
    shutil.copytree(real, tmp_path / "board")
    path = min((tmp_path / "board" / "benchmark" / folder).glob("1.0-test-grouped/*"))
    flip(path, path.stat().st_size // 2)
    assert eigbench("leaderboard", "--check", "--board", tmp_path / "board")[0] in (1, 2)
