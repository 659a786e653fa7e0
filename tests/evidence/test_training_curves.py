"""Curves of trainings as the paper says: a checkpoint is enough, and without one nothing stands."""

import functools

import pytest
import torch

from baselines.gcn import queue, weights
from evidence import reproduction, training_curves

NAMES = reproduction.TRAINED_BY
REPORTED = reproduction.RPD_REPORTED
STEPS, OF = (100, 200, 400, 800), 80_000


@pytest.fixture(autouse=True)
def directory(tmp_path, monkeypatch):
    """A directory of their own for the trainings, of which nothing was read before."""
    monkeypatch.setattr(queue, "LOADER", tmp_path / "reproduction.py")
    monkeypatch.setattr(queue, "RESULTS", tmp_path)
    fresh = functools.cache(training_curves.kept.__wrapped__)
    monkeypatch.setattr(training_curves, "kept", fresh)


def checkpoint(path, errors):
    """Write a checkpoint whose validation RPD is ``errors`` after ``STEPS``."""
    rows = zip(STEPS, errors, strict=True)
    log = [
        {"steps": n, "minutes": n / 100, "loss": e, "validation_rpd": e, "validation_psnr20": 0.25}
        for n, e in rows
    ]
    record = {"steps": STEPS[-1], "of": OF, "minutes": 8.0, "log": log}
    path.parent.mkdir(parents=True, exist_ok=True)
    weights.write(path, {"model.a": torch.zeros(1)}, record)


def test_a_checkpoint_is_continued_by_its_power_law():
    checkpoint(queue.Training("table1-rpd").unfinished(), [9.0, 8.0, 4.0, 2.0])
    ours = queue.Training("table1-rpd-scale-free").weights()
    checkpoint(ours, [3.0, 1.9, 1.0, 0.5])
    _, _, *rows = training_curves.table(NAMES, REPORTED).splitlines()
    cells = [[cell.strip() for cell in row.strip("|").split("|")] for row in rows]
    assert [row[0] for row in cells] == NAMES
    began = cells[NAMES.index("RPDLoss")]
    # It halves as the steps double from step 400 on: a hundredth at a hundred times the steps.
    assert began[1:] == ["800", "1.0%", "8", "2", "25.0%", "200 steps, 2 min", "0.02", "0.3378"]
    assert [row[1] for row in cells].count("not run") == len(NAMES) - 1
    figure = training_curves.as_the_paper_says(NAMES, REPORTED)
    left, right = figure.axes
    assert [len(axes.lines) for axes in (left, right)] == [4, 2]
    assert right.get_legend_handles_labels()[1] == ["RPDLoss"]


def test_nothing_is_shown_where_no_training_has_begun():
    one = {"steps": 100, "of": OF, "minutes": 1.0, "log": [{"steps": 100, "validation_rpd": 2.0}]}
    path = queue.Training("table1-rpd").unfinished()
    path.parent.mkdir(parents=True)
    weights.write(path, {"model.a": torch.zeros(1)}, one)  # too short a training to be continued
    assert training_curves.table(NAMES, REPORTED) == ""
    assert training_curves.as_the_paper_says(NAMES, REPORTED) is None
    assert training_curves.losses(NAMES) is None
    assert reproduction.as_printed([]) == []
