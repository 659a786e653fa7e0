"""The figure that answers when a prediction beats the solver: error to the surface, and speed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from eigbench.board.figures import (
    FASTEST,
    KINDS,
    LEGEND,
    NAME_LINE,
    Point,
    as_svg,
    legend,
    name_key,
    scatter,
    style,
)
from eigbench.board.generalisation import Board
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
LARGEST_ERROR = 2.0  # rows with larger errors, which look at next to nothing, are left out


def draw(board: Board, solver: str = "synthnet-certified") -> str:
    """Return an SVG of mean error to the surface against speed beside LaPy, both logarithmic.

    A filled mark is a model's error on shapes like those of its training, an open one that on
    families it has not seen; the numbers in the marks are those of the names beside the axes, by
    error. The line is an exact solver of the meshes, on the coarse, medium and fine ones of the
    same surfaces, beside LaPy on all of them: what a user has who refines.

    Parameters
    ----------
    board : Board
        A version's rows and protocols against the surface.
    solver : str
        The row that the line is of.
    """
    rows = sorted((row for row in board.rows if _error(row) <= LARGEST_ERROR), key=_error)
    points = [
        _point(number, row, board.scored(row.submission, UNSEEN, RANKED_BY).score)
        for number, row in enumerate(rows, start=1)
        if row.submission.result["cost"].get("reference") is not None
    ]
    with style() as new_figure:
        high = max(4.8, NAME_LINE * len(points) + LEGEND + 1.0)
        figure = new_figure(figsize=(9.0, high))
        axes = figure.subplots()
        figure.subplots_adjust(0.075, 0.48 / high, 0.6, 1 - 0.1 / high)
        scatter(axes, points, floor=0.0)
        _solver_line(axes, board, solver)
        axes.set_xlim(right=FASTEST * 1.6)
        axes.set_ylabel(f"mean {METRICS[RANKED_BY].heading} to the spectrum of the surface")
        name_key(axes, [(str(p.number), p.name, KINDS[p.kind][0]) for p in points])
        unseen = axes.plot([], [], "o", color="0.4", mfc="white", label="on families unseen")
        blue, name = KINDS["classical"][0], "exact solver, by size of mesh"
        more = unseen + axes.plot([], [], "-", color=blue, lw=1.6, label=name)
        legend(axes, KINDS, more)
        return as_svg(figure)


def _point(number: int, row: Ranked, unseen: float | None) -> Point:
    submission = row.submission
    speed = submission.result["cost"]["reference"]["ratio"]
    kind = submission.result["model"]["kind"]
    return Point(number, submission.name, kind, speed, _error(row), unseen)


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


def _error(row: Ranked) -> float:
    mean = row.scores["overall"][RANKED_BY]["mean"]
    return np.inf if mean is None else float(mean)


def _solver_line(axes: mpl.axes.Axes, board: Board, slug: str) -> None:
    """Draw a solver's errors and speeds by the size of the meshes, if its times are known."""
    for row in board.rows:
        cost = row.submission.result["cost"]
        if row.submission.slug != slug or cost.get("ms_by_batch") is None:
            continue
        errors = by_size(row.submission)
        batches = np.array_split(np.array(cost["ms_by_batch"]), len(errors))
        times = [float(batch.mean()) for batch in batches]
        lapy = cost["reference"]["ratio"] * cost["ms_per_mesh_mean"]  # of a mesh of mean size
        speeds = [lapy / time for time in times]
        blue = KINDS["classical"][0]
        axes.plot(speeds, list(errors.values()), ".-", color=blue, lw=1.6, ms=10, zorder=2)
        for speed, (name, error) in zip(speeds, errors.items(), strict=True):
            note = f"{name} meshes"
            axes.annotate(note, (speed, error), (5, 6), textcoords="offset points", fontsize=7)


def by_size(submission: Submission) -> dict[str, float]:
    """Return the mean error over the instances of each size of mesh that a version makes."""
    wanted = recipe.load(submission.truth.version)
    values = scores.of_metric(submission.truth, submission.predictions, RANKED_BY).mean(axis=0)
    numbers = np.array([int(shape.rpartition("-")[2]) for shape in submission.truth.shapes])
    return {
        size.name: float(values[numbers % wanted.copies == i].mean())
        for i, size in enumerate(wanted.sizes or ())
    }
