"""The page of the paper's tables, and a training of the queue that makes its rows."""

import functools
import json
import re
import shutil
from pathlib import Path

import pytest

from baselines.gcn import queue, weights
from baselines.gcn.configs import CONFIGS, PAPER
from evidence import __main__ as evidence
from evidence import reproduction, training_curves
from tests.baselines.gcn.conftest import set_apart

ROOT = Path(__file__).parents[3]
BY_CLOCK = queue.Training("table1-rpd")  # by which its training ends


@pytest.fixture
def directory(monkeypatch, tmp_path):
    """A directory of their own, in which training and page read and write."""
    baselines = tmp_path / "baselines"
    shutil.copytree(ROOT / "baselines" / "gcn", baselines / "gcn")
    shutil.copy(ROOT / "baselines" / "reproduction.py", baselines)
    set_apart(monkeypatch, tmp_path)
    monkeypatch.setattr(reproduction, "PAGE", tmp_path / "reproduction.md")
    cached = {reproduction: ("read", "record"), training_curves: ("kept",)}
    for module, names in cached.items():
        for name in names:
            fresh = functools.cache(getattr(module, name).__wrapped__)
            monkeypatch.setattr(module, name, fresh)
    return tmp_path


def rows_of(page, first):
    """Return the cells of the lines of tables that begin with a word."""
    lines = [line for line in page.splitlines() if re.match(rf"\| {re.escape(first)} +\|", line)]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


@pytest.mark.parametrize(
    ("converged", "said"), [(True, "has converged at"), (False, "has not converged, and is at")]
)
def test_rows_that_stay_below_the_paper_s_best_are_named(
    make_row, mini_truth, monkeypatch, converged, said
):
    factors = {"table1-rpd-scale-free": 1.01, "table2-a-scale-free": 4.0}
    made = {name: make_row(name, mini_truth.eigenvalues * f) for name, f in factors.items()}
    monkeypatch.setattr(reproduction, "read", lambda config, protocol: made.get(config))
    monkeypatch.setattr(reproduction, "record", lambda *_: {"converged": converged})
    assert reproduction.passed() == (
        "Of the 2 rows of Tables 1 to 3 trained in the form that learns, 1 have more PSNR>20 than "
        f"the paper's best row, 86.84%. `table2-a-scale-free` {said} 0.00%."
    )


@pytest.mark.slow
def test_page_of_this_repository_is_up_to_date():
    assert reproduction.fill(check=True) == []
    text = reproduction.PAGE.read_text()
    shown = re.findall(r"!\[[^\]]+\]\([\w.-]+\)", text)
    assert len(shown) == len(reproduction.pictures()) > 0


def test_what_was_not_run_says_so(directory):
    page = reproduction.page(reproduction.pictures())
    for config in PAPER:
        assert rows_of(page, f"{config}-scale-free")[0].count("not run") == 6
    ours = [line for line in page.splitlines() if "| ours, " in line]
    assert len(ours) == (3 + 3 + 3) + (5 + 3) + (8 + 3) + (3 + 3 + 3)
    assert not any(re.search(r"\d", line.partition("| ours, ")[2]) for line in ours)
    assert page.count("\nNot run.\n") == 2  # the losses and the spectra
    assert "| reported " in page


@pytest.mark.parametrize(
    ("better", "worse", "verdict"),
    [(1.01, 4.0, "yes"), (4.0, 1.01, "no, the reverse"), (1.01, 1.01, "not decided")],
)
def test_findings_are_judged_by_paired_intervals(
    directory, make_row, mini_truth, monkeypatch, better, worse, verdict
):
    factors = {"table1-rpd-scale-free": better, "table1-polar-scale-free": worse}
    made = {name: make_row(name, mini_truth.eigenvalues * f) for name, f in factors.items()}
    monkeypatch.setattr(
        reproduction, "read", lambda config, protocol: made.get(config) if protocol else None
    )
    record = {"converged": True}
    monkeypatch.setattr(reproduction, "record", lambda config, protocol: record)

    def finding():
        rows = rows_of(reproduction.findings(), "RPDLoss beats PolarLoss")
        (run,) = (row for row in rows if "not run" not in row)
        return run

    assert finding()[-1] == verdict
    shares = ["100.00%" if factor < 2 else "0.00%" for factor in (better, worse)]
    assert finding()[2] == " against ".join(shares)

    record["converged"] = False  # nothing is concluded from runs that are not
    assert finding()[2] == " against ".join(shares)
    assert finding()[3::2] == ["not converged", "not converged"]


@pytest.fixture
def rows_with(make_row, mini_truth, monkeypatch):
    """Return a function that puts rows in the place of those read: factors of the labels."""

    def put(factors):
        made = {of: make_row(of[0], mini_truth.eigenvalues * f) for of, f in factors.items()}
        monkeypatch.setattr(
            reproduction, "read", lambda config, protocol: made.get((config, protocol))
        )
        monkeypatch.setattr(reproduction, "record", lambda config, protocol: {"converged": True})

    return put


@pytest.mark.parametrize(
    ("longer", "verdict"),
    [
        (None, "no, the reverse"),
        (3.0, "no, the reverse"),
        (1.01, "no, the reverse; trained longer: not decided"),
        (1.001, "no, the reverse; trained longer: yes"),
    ],
)
def test_a_verdict_that_a_longer_training_changes_says_so(rows_with, longer, verdict):
    factors = {("table2-alg-virtual-scale-free", "grouped"): 4.0}
    factors["table2-alg-scale-free", "grouped"] = 1.01
    if longer:
        factors["table2-alg-virtual-long", "grouped"] = longer
    rows_with(factors)
    (row,) = rows_of(reproduction.findings(), "With all encodings a virtual node helps")
    assert row[-1] == verdict
    assert (reproduction.BOTH in reproduction.findings()) == ("longer" in verdict)
    assert reproduction.ONE_SEED in reproduction.findings()


def test_networks_under_both_protocols_stand_beside_each_other(rows_with):
    rows_with({("table1-rpd-scale-free", "grouped"): 1.01})
    assert reproduction.both_protocols() == ""
    factors = {"grouped": 1.01, "paper": 4.0}
    rows_with({("table1-rpd-scale-free", protocol): f for protocol, f in factors.items()})
    (row,) = rows_of(reproduction.both_protocols(), "table1-rpd-scale-free")
    assert row[1:3] == ["100.00%", "0.00%"]
    assert float(row[3]) == pytest.approx(10 * 0.01 / 2.01, abs=1e-4)
    assert float(row[4]) == pytest.approx(10 * 3 / 5, abs=1e-4)


@pytest.fixture
def short(directory, mini_home, monkeypatch):
    """The options of a queue of one short training on 1.0-mini."""
    monkeypatch.setenv("SYNTHNET_HOME", str(mini_home))
    runs = ["--runs", str(directory / "runs"), "--version", "1.0-mini", "--only", "table1-rpd"]
    return ["--run", *runs]


@pytest.mark.slow
def test_a_training_of_the_queue_goes_on_and_stands_on_the_page(
    directory, short, capsys, monkeypatch
):
    assert queue.main([*short, "--minutes", "0.001"]) == 0
    assert "the time is up" in capsys.readouterr().out
    checkpoint = queue.folder(BY_CLOCK, directory / "runs") / queue.CHECKPOINT
    begun = weights.read(checkpoint)[1]
    assert not BY_CLOCK.weights().exists()
    monkeypatch.setattr(queue, "LONGEST", begun["minutes"] + 0.05)

    assert queue.main(short) == 0
    record = weights.read(BY_CLOCK.weights())[1]
    assert record["steps"] > begun["steps"]
    assert len(record["sessions"]) == 2
    assert not record["converged"]
    result = json.loads(BY_CLOCK.result().read_text())
    assert result["partial"] is False
    assert result["model"]["parameters"] == 198_794
    assert result["model"]["code"] == "reproduction.py:table1_rpd"
    assert "reproduction/table1_rpd.safetensors" in result["model"]["sources"]

    before = {path: path.stat().st_mtime_ns for path in directory.rglob("*") if path.is_file()}
    assert queue.main(short) == 0
    assert before == {path: path.stat().st_mtime_ns for path in before}
    assert queue.main(short[1:]) == 0
    assert re.search(r"table1-rpd +grouped +0 +is finished", capsys.readouterr().out)

    assert {"reproduction.md", "reproduction-times.svg"} <= {*reproduction.fill()}
    assert evidence.main(["fill", "reproduction", "--check"]) == 0
    page = reproduction.PAGE.read_text()
    (run,) = rows_of(page, "table1-rpd")[:1]
    assert run[3] == str(record["steps"])
    assert run[7] == "by the clock"
    score = result["scores"]["mesh"]["families"]["cone"]["invlap"]["mean"]
    assert f"{score:.4f}" in page
    reproduction.PAGE.write_text(page.replace(f"{score:.4f}", "0.1234"))
    assert evidence.main(["fill", "reproduction", "--check"]) == 1
    assert reproduction.fill() == ["reproduction.md"]
    picture = reproduction.PAGE.with_name("reproduction-times.svg")
    picture.write_text(picture.read_text().replace("seconds", "minutes"))
    assert reproduction.fill(check=True) == [picture.name]
    picture.unlink()
    assert reproduction.fill(check=True) == [picture.name]


@pytest.mark.slow
def test_a_training_that_fails_is_told_and_writes_no_row(directory, short, capfd):
    options = ["none" if option == "1.0-mini" else option for option in short]
    assert queue.main(options) == 1
    message = "table1-rpd, grouped, seed 0: baselines.gcn.train has ended with exit code 2"
    assert f"gcn.queue: {message}" in capfd.readouterr().err
    assert not list((directory / "baselines" / "reproduction").iterdir())


def test_every_table_of_the_paper_has_a_configuration_a_row():
    given = reproduction.REPORTED["tables"]
    assert [len(table["rows"]) for table in given[:4]] == [3, 5, 8, 3]
    assert {config for table in reproduction.TABLES for config in table} == set(PAPER)
    pairs = {config for f in reproduction.FINDINGS for config in (f.better, f.worse)}
    assert pairs <= set(PAPER)
    assert all(f"{config}-scale-free" in CONFIGS for config in PAPER)
