"""The rows of the leaderboard: which are marked, and what is run for them."""

import json
import shutil
from pathlib import Path

import pytest

from baselines import rows

ROOT = Path(__file__).parents[2]


@pytest.fixture
def checkout(tmp_path, monkeypatch):
    """A checkout with a predictor and its results on three boards; what is run is kept instead."""
    monkeypatch.setattr(rows, "ROOT", tmp_path)
    (tmp_path / "baselines").mkdir()
    shutil.copy(ROOT / "baselines" / "mean.py", tmp_path / "baselines")
    for name in ("results/1.0-test-grouped", "results/2.0-test-family", "scaling"):
        (tmp_path / "benchmark" / name).mkdir(parents=True)
        file = f"{name}/mean-training-spectrum.json"
        shutil.copy(ROOT / "benchmark" / file, tmp_path / "benchmark" / file)
    commands = []

    def run(*arguments):
        commands.append(arguments)
        if arguments[0] == "evaluate":
            out = Path(arguments[arguments.index("--out") + 1])
            model = {"name": "Mean training spectrum", "code": "mean.py", "sources": {}}
            options = ("--batch-size", "--seeds")
            batch, seeds = (int(arguments[arguments.index(name) + 1]) for name in options)
            counts = {"cost": {"batch_size": batch}, "predictions": {"seeds": seeds}}
            out.write_text(json.dumps({"model": model, **counts}))
        return 0

    monkeypatch.setattr(rows, "eigbench", run)
    return tmp_path, commands


def change(root):
    path = root / "baselines" / "mean.py"
    path.write_text(path.read_text() + "\nCHANGED = True\n")


def test_comment_marks_no_row(checkout, capsys):
    root, commands = checkout
    path = root / "baselines" / "mean.py"
    path.write_text(path.read_text().replace('"""', '"""Says: ', 1) + "\n# a comment\n")
    assert rows.main(["--marked"]) == 0
    assert commands == []
    out = capsys.readouterr().out
    assert "0 of 207 rows are marked" in out
    assert out.count("as the code is") == 3
    assert out.count("not run") == 204


def test_marked_rows_are_listed_and_nothing_is_run(checkout, capsys):
    root, commands = checkout
    change(root)
    assert rows.main([]) == 0
    out = capsys.readouterr().out
    assert commands == []
    assert "3 of 207 rows are marked" in out
    marked = [line.split()[:2] for line in out.splitlines() if "made by an earlier" in line]
    assert marked == [["1.0/grouped", "mean"], ["2.0/family", "mean"], ["scaling", "mean"]]


def test_one_command_runs_and_submits_what_is_marked(checkout):
    root, commands = checkout
    change(root)
    assert rows.main(["--marked"]) == 0
    done = [command[0] for command in commands]
    assert done == ["evaluate", "submit", "evaluate", "submit", "scale", "submit", "leaderboard"]
    grouped, family, scaling = (commands[i] for i in (0, 2, 4))
    assert str(root / "baselines" / "mean.py") in grouped
    assert "--no-reference" not in grouped
    assert "--no-reference" in family
    assert family[family.index("--protocol") + 1] == "family"
    assert scaling[scaling.index("--time-limit") + 1] == "600"
    assert all("--replace" in command for command in commands if command[0] == "submit")


def test_what_is_finished_is_kept_until_the_code_changes(checkout):
    root, commands = checkout
    options = ["--run", "mean", "--board", "1.0/grouped", "--results", str(root / "runs")]
    assert rows.main(options) == 0
    assert rows.main(options) == 0
    assert [command[0] for command in commands].count("evaluate") == 1
    out = root / "runs" / "1.0-grouped" / "mean.json"
    older = {"name": "Mean training spectrum", "code": "mean.py", "sources": {"mean.py": "0" * 64}}
    out.write_text(json.dumps({"model": older}))
    assert rows.main(options) == 0
    assert [command[0] for command in commands].count("evaluate") == 2


def test_row_that_fails_stops_the_run(checkout, monkeypatch):
    _, commands = checkout
    monkeypatch.setattr(rows, "eigbench", lambda *arguments: commands.append(arguments) or 2)
    assert rows.main(["--run", "mean", "exact"]) == 2
    assert len(commands) == 1


def test_seeds_are_those_of_the_row_or_fewer(checkout):
    root, commands = checkout
    for seeds, expected in (("5", "3"), ("2", "2")):
        commands.clear()
        folder = str(root / f"seeds-{seeds}")
        options = ["--run", "ritz_mlp", "--seeds", seeds, "--results", folder]
        assert rows.main(options) == 0
        assert commands[0][commands[0].index("--seeds") + 1] == expected


def test_a_result_with_other_seeds_or_batches_is_made_anew(checkout, monkeypatch):
    root, commands = checkout
    options = ["--run", "ritz_mlp", "--results", str(root / "runs"), "--seeds"]

    def asked(seeds):
        commands.clear()
        assert rows.main([*options, seeds]) == 0
        return [c[c.index("--seeds") + 1] for c in commands if c[0] == "evaluate"]

    assert [asked(seeds) for seeds in "1133"] == [["1"], [], ["3"], []]
    monkeypatch.setitem(rows.BATCH, "1.0", 100)
    assert asked("3") == ["3"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--run", "nobody"], "there is no row 'nobody'"),
        (["--board", "3.0/grouped"], "there is no board '3.0/grouped'"),
        (["--board", "1.0/paper"], "keep no numbers of the test shapes' copies"),
        (["--run", "--marked"], "not allowed with"),
    ],
)
def test_what_is_not_there_is_refused(capsys, arguments, message):
    with pytest.raises(SystemExit, match="2"):
        rows.main(arguments)
    assert message in capsys.readouterr().err


def test_every_row_is_a_file_and_every_board_has_its_rows():
    for name in rows.SEEDS:
        assert (ROOT / "baselines" / rows.code(name).partition(":")[0]).is_file()
    there = {(row.name, row.board) for row in rows.rows(rows.BOARDS) if row.result is not None}
    usual = {(name, board) for board in rows.BOARDS for name in rows.usual(board)}
    not_run = {(name, board) for board, names in rows.NOT_RUN.items() for name in names}
    assert there <= usual
    assert usual - there == not_run  # what has been run leaves the list


def test_what_was_not_run_has_a_reason_on_the_board():
    reasons = json.loads((ROOT / "benchmark" / "not-run.json").read_text())["reasons"]
    known = {
        (name, f"{entry['version']}/{protocol}")
        for entry in reasons
        for name in entry["models"]
        for protocol in entry["protocols"]
    }
    result_of = {(row.name, row.board): row.result for row in rows.rows(rows.BOARDS)}
    for board, names in rows.NOT_RUN.items():
        for name in names if board != rows.SCALING else ():
            grouped = result_of[name, f"{board.partition('/')[0]}/grouped"]
            assert (grouped["model"]["name"], board) in known
