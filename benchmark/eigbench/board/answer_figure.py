"""The figure that answers when a prediction beats the solver: error to the surface against time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from eigbench.board.figures import KINDS, as_svg, escaped, style
from eigbench.board.generalisation import Board, HeldOut
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.board.tables import number as _digits
from eigbench.results.submission import Submission
from eigbench.scoring import scores
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.training import untrained
from synthnet import recipe

if TYPE_CHECKING:
    import matplotlib as mpl

UNSEEN = "family"  # the protocol whose scores stand beside those on familiar shapes
SIZES = {"o": 12, "s": 11, "^": 15}  # of marks, in points: a number is inside
LARGEST_ERROR = 2.0  # rows with larger errors, which look at next to nothing, are left out


def draw(board: Board, solver: str = "synthnet-certified") -> str:
    """Return an SVG of mean error to the surface against ms a mesh, both logarithmic.

    A filled mark is a model's error on shapes like those of its training, an open one that on
    families it has not seen; the numbers in the marks are those of the names beside the axes, by
    error. The line is an exact solver of the meshes, on the coarse, medium and
    fine ones of the same surfaces: what a user has who refines.

    Parameters
    ----------
    board : Board
        A version's rows and protocols against the surface.
    solver : str
        The row that the line is of.
    """
    rows = sorted((row for row in board.rows if _error(row) <= LARGEST_ERROR), key=_error)
    with style() as new_figure:
        figure = new_figure(figsize=(9.0, 4.8))
        axes = figure.subplots()
        figure.subplots_adjust(0.075, 0.1, 0.6, 0.98)
        times = _solver_line(axes, board, solver)
        for number, row in enumerate(rows, start=1):
            times.append(_mark(axes, number, row, board.scored(row.submission, UNSEEN, RANKED_BY)))
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlim(min(times) / 2, max(times) * 2)
        axes.set_xlabel("ms a mesh, from raw vertices and faces, one thread")
        axes.set_ylabel(f"mean {METRICS[RANKED_BY].heading} to the spectrum of the surface")
        axes.grid(alpha=0.25)
        _key(axes, rows)
        _legend(axes)
        return as_svg(figure)


def sentences(board: Board, solver: str = "lapy") -> str:
    """Return the figure in three sentences; empty where the solver or trained models are missing.

    Parameters
    ----------
    board : Board
        A version's rows and protocols against the surface.
    solver : str
        The row that predictions are compared with.
    """
    exact = [row for row in board.rows if row.submission.slug == solver]
    trained = [row for row in board.rows if not untrained(row.submission.result["model"])]
    unseen = {
        row.submission.name: error
        for row in trained
        if (error := board.scored(row.submission, UNSEEN, RANKED_BY).score) is not None
    }
    if not exact or not unseen:
        return ""
    least, name = _error(exact[0]), exact[0].submission.name
    nearer = [row for row in trained if _surely_nearer(row, solver)]
    told = [
        f"On the test shapes of synthNet {board.version} {name}, an exact solver of the mesh, "
        f"misses the spectrum of the surface by a mean RPD of {_digits(least)}: what the "
        "triangles leave out."
    ]
    of = f"{len(nearer)} of {len(trained)} trained models are surely nearer"
    if nearer:
        best = min(nearer, key=_error)
        ratio = best.submission.result["cost"]["reference"]["ratio"]
        times = f"{least / _error(best):.2g} times as near"
        of += f"; the best, *{best.submission.name}*, is {times}, at {ratio:.2g} times its speed"
    told.append(f"On shapes like those of their training {of}.")
    still = {model: error for model, error in unseen.items() if error < least}
    names = ", ".join(f"*{model}* ({_digits(error)})" for model, error in still.items())
    told.append(
        f"On families that none of them has seen {len(still)} of {len(unseen)} still are"
        f"{f', {names},' if still else ''} and the median model is off by an RPD of "
        f"{_digits(float(np.median(list(unseen.values()))))}."
    )
    return "\n".join(told)


def _surely_nearer(row: Ranked, solver: str) -> bool:
    return any(one.slug == solver and one.sure and one.mean > 0 for one in row.apart)


def _mark(axes: mpl.axes.Axes, number: int, row: Ranked, held_out: HeldOut) -> float:
    """Draw a row's mark with its number inside, and one for families unseen; return its time."""
    time = float(row.submission.result["cost"]["ms_per_mesh_mean"])
    colour, marker = KINDS[row.submission.result["model"]["kind"]]
    known, unseen = _error(row), held_out.score
    if unseen is not None and unseen > 1.02 * known:
        axes.plot([time, time], [known, unseen], color=colour, lw=0.8, zorder=1)
        axes.plot(time, unseen, marker, color=colour, mfc="white", ms=6, zorder=3)
    above = 4 - number / 1000  # the better of two that overlap
    axes.plot(
        time, known, marker, color=colour, mec="white", mew=0.7, ms=SIZES[marker], zorder=above
    )
    low = -1.8 if marker == "^" else -0.2  # where a triangle is wide
    axes.annotate(
        str(number), (time, known), (0, low), textcoords="offset points", ha="center",
        va="center", fontsize=6, color="white", weight="bold", zorder=above,
    )  # fmt: skip
    return time


def _key(axes: mpl.axes.Axes, rows: Sequence[Ranked]) -> None:
    """Name the rows by their numbers, beside the axes."""
    for number, row in enumerate(rows, start=1):
        colour = KINDS[row.submission.result["model"]["kind"]][0]
        height = 1 - (number - 0.5) / max(len(rows), 12)
        name = escaped(row.submission.name)
        where = axes.transAxes
        axes.text(
            1.06,
            height,
            str(number),
            transform=where,
            ha="right",
            va="center",
            fontsize=7.5,
            color=colour,
            weight="bold",
        )
        axes.text(1.075, height, name, transform=where, va="center", fontsize=7.5)


def _error(row: Ranked) -> float:
    mean = row.scores["overall"][RANKED_BY]["mean"]
    return np.inf if mean is None else float(mean)


def _solver_line(axes: mpl.axes.Axes, board: Board, slug: str) -> list[float]:
    """Draw errors and times of a solver by the size of the meshes; return the times, if known."""
    for row in board.rows:
        times = row.submission.result["cost"].get("ms_by_batch")
        if row.submission.slug != slug or times is None:
            continue
        errors = by_size(row.submission)
        means = [float(np.mean(part)) for part in np.array_split(np.array(times), len(errors))]
        axes.plot(means, list(errors.values()), "-", color=KINDS["classical"][0], lw=1.6, zorder=2)
        for time, (name, error) in zip(means, errors.items(), strict=True):
            axes.plot(time, error, ".", color=KINDS["classical"][0], ms=5, zorder=2)
            axes.annotate(
                f"{name} meshes", (time, error), (4, 6), textcoords="offset points", fontsize=7
            )
        return means
    return []


def by_size(submission: Submission) -> dict[str, float]:
    """Return the mean error over the instances of each size of mesh that a version makes."""
    wanted = recipe.load(submission.truth.version)
    values = scores.of_metric(submission.truth, submission.predictions, RANKED_BY).mean(axis=0)
    numbers = np.array([int(shape.rpartition("-")[2]) for shape in submission.truth.shapes])
    return {
        size.name: float(values[numbers % wanted.copies == i].mean())
        for i, size in enumerate(wanted.sizes or ())
    }


def _legend(axes: mpl.axes.Axes) -> None:
    handles = [
        axes.plot([], [], marker, color=colour, ls="", label=kind)[0]
        for kind, (colour, marker) in KINDS.items()
    ]
    blue = KINDS["classical"][0]
    handles += [
        axes.plot([], [], "o", color="0.4", mfc="white", ls="", label="on families unseen")[0],
        axes.plot([], [], "-", color=blue, lw=1.6, label="exact solver, by size of mesh")[0],
    ]
    axes.legend(handles=handles, loc="lower left", fancybox=False, edgecolor="0.8", fontsize=7.5)
