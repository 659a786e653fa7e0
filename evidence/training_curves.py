"""Curves of trainings: Figure 5, and the rows of Table 1 as the paper says beside ours.

A training as the paper says that has not ended is shown as far as its checkpoint goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import matplotlib as mpl
import numpy as np
from eigbench.board import figures
from matplotlib.figure import Figure

from baselines.gcn import weights
from baselines.gcn.queue import TABLE_1, Training
from evidence import markdown
from synthnet.pictures.palette import BLUE, GREEN, VERMILION

LEARNS = "-scale-free"  # at the end of a configuration's name: the form that learns
COLOURS = (BLUE, VERMILION, GREEN)  # of the rows of Table 1
NOT_RUN = "not run"
ERRORS = (0.1, 0.2, 0.5, 1, 2, 5)  # at the axis
SCORED = "validation_rpd"
HEADERS = ("trained by", "steps", "of the paper's", "minutes", "validation RPD", "PSNR>20")
HEADERS += ("the form that learns had that RPD after",)
HEADERS += ("RPD at the paper's last step, if it goes on so", "RPD reported")


@cache
def kept(config: str, protocol: str = "grouped") -> dict[str, Any] | None:
    """Return what is known of the first seed's training, from its weights or its checkpoint."""
    training = Training(config, protocol)
    files = training.weights(), training.unfinished()
    path = next((path for path in files if path.exists()), None)
    return weights.read(path)[1] if path else None


def curve(config: str) -> dict[str, Any] | None:
    """Return what is known of a training that was validated more than once, or ``None``."""
    record = kept(config)
    return record if record and len(validated(record)) > 1 else None


def validated(training: dict[str, Any]) -> list[dict[str, float]]:
    """Return the rows of a training's log that have scores of the validation split."""
    return [row for row in training["log"] if SCORED in row]


def losses(names: Sequence[str]) -> Figure | None:
    """Draw Figure 5: the losses of Table 1 against steps, relative to where they begin."""
    configs = [f"{config}{LEARNS}" for config in TABLE_1]
    trainings = [curve(config) for config in configs if Training(config).scored()]
    if len(trainings) < len(configs) or not all(trainings):
        return None
    with figures.style():
        figure, (left, right) = two_panels()
        for training, name, colour in zip(trainings, names, COLOURS, strict=True):
            log = training["log"]
            relative = [row["loss"] / log[0]["loss"] for row in log]
            left.plot([row["steps"] for row in log], relative, color=colour, lw=0.8)
            right.plot(*points(training), color=colour, label=name)
        left.set_ylabel("loss over its first value")
        left.set_yscale("log")
        right.set_ylabel("validation RPD")
        right.set_ylim(bottom=0)
        right.legend(frameon=False, title="trained by")
    return figure


def as_the_paper_says(names: Sequence[str], reported: Sequence[float]) -> Figure | None:
    """Draw trainings of Table 1 as the paper says, beside the form that learns, in each panel."""
    begun = [curve(config) for config in TABLE_1]
    if not any(begun):
        return None
    with figures.style():
        figure, (left, right) = two_panels()
        rows = zip(TABLE_1, begun, names, reported, COLOURS, strict=True)
        for config, training, name, score, colour in rows:
            ours = curve(f"{config}{LEARNS}")
            for axes, key in ((left, SCORED), (right, "validation_psnr20")):
                if ours:
                    axes.plot(*points(ours, key), color=colour, lw=0.8, ls=(0, (1, 1)))
                if training:
                    axes.plot(*points(training, key), color=colour, label=name)
            if training:
                steps, errors = points(training)
                onwards = np.geomspace(steps[-1], training["of"], 2)
                left.plot(onwards, power_law(steps, errors, onwards), color=colour, ls="--", lw=0.8)
                left.plot(training["of"], score, "o", color=colour, mfc="white", ms=5)
        for axes in (left, right):
            axes.set_xscale("log")
        left.set_yscale("log", subs=[])
        left.set_yticks(ERRORS, map(str, ERRORS))
        left.set_ylabel("validation RPD")
        right.set_ylabel("validation PSNR>20")
        right.yaxis.set_major_formatter(mpl.ticker.PercentFormatter(1, decimals=0))
        right.set_ylim(0, 1)
        right.legend(frameon=False, title="as the paper says, by")
    return figure


def two_panels() -> tuple[Figure, Sequence[mpl.axes.Axes]]:
    """Return a figure of two panels against steps."""
    figure = Figure(figsize=(7.2, 2.6))
    figure.subplots_adjust(0.09, 0.17, 0.98, 0.92, wspace=0.25)
    panels = figure.subplots(1, 2)
    for axes in panels:
        axes.set_xlabel("steps")
    return figure, panels


def points(training: dict[str, Any], key: str = SCORED) -> tuple[list[float], list[float]]:
    """Return a training's steps and scores of the validation split."""
    rows = validated(training)
    return [row["steps"] for row in rows], [row[key] for row in rows]


def power_law(steps: Sequence[float], errors: Sequence[float], at: np.ndarray) -> np.ndarray:
    """Continue errors as the power of steps that fits their second half best, in logarithms.

    Examples
    --------
    >>> power_law([1, 2, 4, 8], [8.0, 4.0, 2.0, 1.0], np.array([80.0])).round(6)
    array([0.1])
    """
    half = np.asarray(steps) >= steps[-1] / 2
    slope, offset = np.polyfit(np.log(np.asarray(steps)[half]), np.log(np.asarray(errors)[half]), 1)
    return np.exp(offset + slope * np.log(at))


def table(names: Sequence[str], reported: Sequence[float]) -> str:
    """Return how far the trainings of Table 1 as the paper says have come; nothing if none began.

    Parameters
    ----------
    names
        What each row is trained by.
    reported
        RPD of the paper's test split, as the paper prints it.
    """
    rows = []
    for config, name, score in zip(TABLE_1, names, reported, strict=True):
        training = curve(config)
        if training is None:
            rows.append([name, NOT_RUN, *[""] * (len(HEADERS) - 3), f"{score:g}"])
            continue
        steps, errors = points(training)
        last = validated(training)[-1]
        then = power_law(steps, errors, np.array([float(training["of"])]))[0]
        cells = [f"{training['steps']:,}", f"{training['steps'] / training['of']:.1%}"]
        cells += [f"{training['minutes']:.0f}", f"{last[SCORED]:.3g}"]
        cells += [f"{last['validation_psnr20']:.1%}", passed_by(config, last[SCORED])]
        rows.append([name, *cells, f"{then:.2g}", f"{score:g}"])
    return markdown.table(HEADERS, rows, "lr") if any(map(curve, TABLE_1)) else ""


def passed_by(config: str, error: float) -> str:
    """Return after how many steps and minutes the form that learns had so small an error."""
    ours = curve(f"{config}{LEARNS}")
    rows = validated(ours) if ours else []
    first = next((row for row in rows if row[SCORED] <= error), None)
    return f"{first['steps']:,} steps, {first['minutes']:.0f} min" if first else "–"
