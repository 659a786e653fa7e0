"""The page of the paper's tables, and the module that trains their rows."""

from __future__ import annotations

import functools
import json
import re
import shutil
from pathlib import Path

import pytest
from eigbench.results import submission

from baselines import train_reproduction
from baselines.gcn import weights
from baselines.gcn.configs import CONFIGS, PAPER
from evidence import reproduction

ROOT = Path(__file__).parents[3]


@pytest.fixture
def directory(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A directory of their own, in which training and page read and write."""
    baselines = tmp_path / "baselines"
    baselines.mkdir()
    (baselines / "gcn").symlink_to(ROOT / "baselines" / "gcn")
    shutil.copy(ROOT / "baselines" / "reproduction.py", baselines)
    monkeypatch.setattr(train_reproduction, "LOADER", baselines / "reproduction.py")
    for module in (train_reproduction, reproduction):
        monkeypatch.setattr(module, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(reproduction, "PAGE", tmp_path / "reproduction.md")
    for cached in (reproduction.read, reproduction.record):
        monkeypatch.setattr(reproduction, cached.__name__, functools.cache(cached.__wrapped__))
    return tmp_path


def rows_of(page: str, first: str) -> list[list[str]]:
    """Return the cells of the lines of tables that begin with a word."""
    lines = [line for line in page.splitlines() if re.match(rf"\| {re.escape(first)} +\|", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_page_of_this_repository_is_up_to_date() -> None:
    assert reproduction.main(["--check"]) == 0
    text = reproduction.PAGE.read_text()
    assert len(re.findall(r"!\[\w+\]\([\w.-]+\)", text)) == 3


def test_what_was_not_run_says_so(directory: Path) -> None:
    page = reproduction.page(reproduction.pictures())
    for config in PAPER:
        assert rows_of(page, config)[0].count("not run") == 7
    ours = [line for line in page.splitlines() if "| ours, " in line]
    assert len(ours) == 2 * (3 + 5 + 8 + 3)
    assert not any(re.search(r"\d", line.partition("| ours, ")[2]) for line in ours)
    assert page.count("\nNot run.\n") == 2  # the losses and the spectra
    assert "| reported " in page


@pytest.mark.parametrize(
    ("better", "worse", "verdict"),
    [(1.01, 4.0, "yes"), (4.0, 1.01, "no, the reverse"), (1.01, 1.01, "a tie")],
)
def test_findings_are_judged_by_paired_intervals(
    directory, make_submission, mini_truth, monkeypatch, better, worse, verdict
):
    made = {
        config: submission.read(make_submission(config, mini_truth.eigenvalues * factor))
        for config, factor in (("table1-rpd", better), ("table1-polar", worse))
    }
    monkeypatch.setattr(
        reproduction, "read", lambda config, protocol: made.get(config) if protocol else None
    )
    (found,) = [
        row
        for row in rows_of(reproduction.findings(), "RPDLoss beats PolarLoss")
        if "not" not in row
    ]
    assert found[2] == "the paper's"
    assert found[-1] == verdict
    shares = ["100.00%" if factor < 2 else "0.00%" for factor in (better, worse)]
    assert found[3] == " against ".join(shares)


@pytest.mark.parametrize(("steps", "told"), [(5, "more than 5.0% of its steps"), (100, "")])
def test_page_says_how_far_the_papers_schedule_went(directory, monkeypatch, steps, told):
    monkeypatch.setattr(
        reproduction, "read", lambda config, protocol: config == "table1-rpd" or None
    )
    monkeypatch.setattr(
        reproduction, "record", lambda config, protocol: {"steps": steps, "of": 100}
    )
    found = reproduction.how_far()
    assert told in found
    assert bool(found) == bool(told)


@pytest.mark.slow
def test_row_is_trained_and_scored_once_and_stands_on_the_page(
    directory, mini_home, tmp_path, monkeypatch
):
    monkeypatch.setenv("SYNTHNET_HOME", str(mini_home))
    options = ["--minutes", "0.03", "--runs", str(tmp_path / "runs"), "--version", "1.0-mini"]
    options += ["--protocols", "grouped", "--configs", "table1-rpd-modern", "--epochs", "3=1"]
    assert train_reproduction.main(options) == 0
    row = train_reproduction.weights_of("table1-rpd-modern", "grouped")
    record = weights.read(row)[1]
    assert record["config"]["epochs"] == 1
    assert record["version"] == "1.0-mini"
    assert 0 < record["steps"] <= record["of"]
    result = json.loads(
        (train_reproduction.RESULTS / "grouped" / "table1-rpd-modern.json").read_text()
    )
    assert result["partial"] is False
    assert result["model"]["parameters"] == 198_794
    assert result["model"]["code"] == "reproduction.py:table1_rpd_modern"
    assert "reproduction/table1_rpd_modern.safetensors" in result["model"]["sources"]

    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*") if path.is_file()}
    assert train_reproduction.main(options) == 0
    assert before == {path: path.stat().st_mtime_ns for path in before}

    assert reproduction.main([]) == 0
    assert reproduction.main(["--check"]) == 0
    page = reproduction.PAGE.read_text()
    (run,) = rows_of(page, "table1-rpd-modern")[:1]
    assert run[3:6] == ["1.0-mini", str(record["steps"]), str(record["of"])]
    score = result["scores"]["mesh"]["families"]["cone"]["invlap"]["mean"]
    assert any(f"{score:.4f}" in row for row in rows_of(page, "table1-rpd-modern"))
    reproduction.PAGE.write_text(page.replace(f"{score:.4f}", "0.1234"))
    assert reproduction.main(["--check"]) == 1
    assert reproduction.main([]) == 0
    picture = reproduction.PAGE.with_name("reproduction-times.svg")
    picture.write_text(picture.read_text().replace("seconds", "minutes"))
    assert reproduction.main(["--check"]) == 1
    picture.unlink()
    assert reproduction.main(["--check"]) == 1


@pytest.mark.slow
def test_training_that_fails_is_told_and_writes_no_row(directory, tmp_path, capfd):
    options = ["--minutes", "1", "--runs", str(tmp_path / "runs"), "--configs", "table1-rpd"]
    assert train_reproduction.main([*options, "--protocols", "paper", "--version", "none"]) == 1
    assert "failed: table1-rpd, paper: training" in capfd.readouterr().err
    assert not list((directory / "baselines" / "reproduction").iterdir())


@pytest.mark.parametrize(
    ("epochs", "told"), [("3=0", "must be like 3=5"), ("3", "like 3=5"), ("5=2", "has 5 blocks")]
)
def test_epochs_that_would_do_nothing_are_refused(directory, tmp_path, capsys, epochs, told):
    options = ["--minutes", "1", "--runs", str(tmp_path), "--configs", "table1-rpd"]
    with pytest.raises(SystemExit, match="2"):
        train_reproduction.main([*options, "--epochs", epochs])
    assert told in capsys.readouterr().err


def test_every_table_of_the_paper_has_a_configuration_a_row() -> None:
    given = reproduction.REPORTED["tables"]
    assert [len(table["rows"]) for table in given[:4]] == [3, 5, 8, 3]
    assert {config for table in reproduction.TABLES for config in table} == set(PAPER)
    pairs = {config for f in reproduction.FINDINGS for config in (f.better, f.worse)}
    assert pairs <= set(PAPER)
    assert all(f"{config}-modern" in CONFIGS for config in PAPER)
