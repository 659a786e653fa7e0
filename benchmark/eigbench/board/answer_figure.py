"""The figure that answers when a prediction beats the solver: error to the surface, and speed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from eigbench.board import figures
from eigbench.board.figures import FASTEST, KINDS, NAME_LINE, Point
from eigbench.board.generalisation import Board, restricted
from eigbench.board.ranking import RANKED_BY, Ranked, difference
from eigbench.board.tables import number as _digits
from eigbench.results.submission import Submission
from eigbench.scoring import scores
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.training import may_be_trained_on, untrained
from synthnet import recipe
from synthnet.pictures.palette import GREY

if TYPE_CHECKING:
    import matplotlib as mpl

UNSEEN_PROTOCOL = "family"  # the protocol whose scores stand beside those on familiar shapes
LAPY = "LaPy"  # whose name stands beside its mark: all speeds are beside it
DROP = "the same models on families never seen"
LARGEST_ERROR = 2.0  # rows with larger errors, which look at next to nothing, are only named
OVERLAP = 9.0  # points: an open mark that is nearer to another model's stands beside it


@dataclass(frozen=True, slots=True)
class Layout:
    """The measures of the figure, in inches where nothing else is said."""

    width: float  # of the figure
    plot: float  # of the axes, their labels and the legend
    top: float  # of the legend
    left: float  # of the labels at the left
    columns: int  # of names below the axes
    keys: int  # marks in a line of the legend
    letters: int  # of a line of the note on the drop
    font: float  # points, of what stands inside the axes
    size: str  # the note at a size of meshes
    open: str  # what an open mark is


WIDE = Layout(7.4, 4.9, 0.34, 0.63, 2, 5, 20, 9, "{} meshes", "the same model on unseen families")
NARROW = Layout(3.7, 5.3, 0.56, 0.6, 1, 3, 11, 8, "{}", "on unseen families")  # for phones


def draw(board: Board, solver: str = "synthnet-certified", layout: Layout = WIDE) -> str:
    """Return an SVG of mean error to the surface against speed beside LaPy, both logarithmic.

    A filled mark is a model's error on shapes like those of its training, an open one that on
    families it has not seen; the numbers in the marks are those of the names below the axes, by
    error. What the sentences speak of has its name beside its mark. Marks are means over meshes of
    all sizes; the line is an exact solver on the coarse, medium and fine meshes of the same
    surfaces, beside LaPy on all of them: what a user has who refines. A model whose error is too
    large to be drawn, or that has no time, is named below with the reason. Declared rows, which
    have no rank and no speed, are left out.

    The board is a version's against the surface; the line is of the row ``solver``; the layout is
    :data:`WIDE` or :data:`NARROW`.
    """
    ranked = sorted(_undeclared(board), key=_error)
    rows = [row for row in ranked if not _absent(row)]
    points = [_point(number, row, _unseen(board, row)) for number, row in enumerate(rows, start=1)]
    names = [(str(p.number), p.name, KINDS[p.kind][0]) for p in points]
    names += [("–", f"{r.submission.name}: {note}", GREY) for r in ranked if (note := _absent(r))]
    with figures.style() as new_figure:
        lines = -(-len(names) // layout.columns)
        high = layout.plot + NAME_LINE * lines
        figure = new_figure(figsize=(layout.width, high))
        axes = figure.subplots()
        bottom, top = 1 - (layout.plot - 0.62) / high, 1 - layout.top / high
        figure.subplots_adjust(layout.left / layout.width, bottom, 0.99, top)
        figures.scatter(axes, points, floor=0.0)
        _solver_line(axes, rows, solver, layout)
        axes.set_xlim(right=FASTEST * 1.6)
        figures.number_marks(axes, points, floor=0.0)
        axes.set_ylabel(f"mean {METRICS[RANKED_BY].heading} to the surface")
        _draw_drops(axes, points)
        _name(axes, points, rows, board.version, layout)
        _key(axes, names, layout)
        unseen = axes.plot([], [], "^", color=KINDS["learned"][0], mfc="white", label=layout.open)
        blue = KINDS["classical"][0]
        line = axes.plot([], [], ".-", color=blue, lw=1.6, ms=10, label="exact solver")
        figures.legend(
            axes, KINDS, line + unseen, loc="lower left", bbox_to_anchor=(-0.06, 1.0),
            ncols=layout.keys, columnspacing=1.2, handletextpad=0.4,
        )  # fmt: skip
        return figures.as_svg(figure)


def _undeclared(board: Board) -> list[Ranked]:
    return [row for row in board.rows if not row.declared]


def _unseen(board: Board, row: Ranked) -> float | None:
    """Return a model's mean error on unseen families; ``None`` if not run, or declared, there."""
    there = board.row(UNSEEN_PROTOCOL, row.submission.slug)
    return None if there is None or there.declared else there.scores["overall"][RANKED_BY]["mean"]


def _timed(row: Ranked) -> bool:
    return row.submission.result["cost"].get("reference") is not None


def _absent(row: Ranked) -> str:
    """Return why a model has no mark; empty where it has one."""
    if not _timed(row):
        return "not timed"
    error = _error(row)
    return "" if error <= LARGEST_ERROR else f"{error:.3g}, not drawn"


def _draw_drops(axes: mpl.axes.Axes, points: Sequence[Point]) -> None:
    """Draw an arrow from each model's mark to an open one, its error on unseen families.

    An open mark that would hide another model's mark stands at its left; one that would hide its
    own is left out. The axes must have their limits.
    """
    pixels = axes.transData.transform
    near = OVERLAP * axes.figure.dpi / 72
    marks = pixels([(min(p.speed, FASTEST), p.error) for p in points])
    for point, mark in zip(points, marks, strict=True):
        if point.unseen is None:
            continue
        x = min(point.speed, FASTEST)
        at = pixels((x, point.unseen))
        if at[1] < mark[1] + near:
            continue
        hidden = marks[np.abs(marks - at).max(axis=1) < near]
        if len(hidden):
            at[0] = hidden[:, 0].min() - 1.1 * near
        end: tuple[float, float] = tuple(axes.transData.inverted().transform(at))
        colour, marker = KINDS[point.kind]
        arrow = {"arrowstyle": "-|>", "color": colour, "lw": 0.9, "shrinkB": 3, "mutation_scale": 8}
        axes.annotate("", end, (x, point.error), arrowprops=arrow, zorder=1)
        axes.plot(*end, marker, color=colour, mfc="white", ms=6, zorder=3)


def _name(
    axes: mpl.axes.Axes,
    points: Sequence[Point],
    rows: Sequence[Ranked],
    version: str,
    layout: Layout,
) -> None:
    """Write beside the marks what the sentences name: the solver, the best model, its drop."""
    trained = {row.submission.name for row in _trained(rows, version)}
    font: dict[str, Any] = {"textcoords": "offset points", "fontsize": layout.font}
    font["weight"] = "bold"
    for point in points:
        colour, at = KINDS[point.kind][0], (point.speed, point.error)
        if point.name == LAPY:
            axes.annotate(point.name, at, (0, 10), ha="center", color=colour, **font)
        elif point.name in trained:
            trained = set()  # the first is the best
            name = fill(figures.escaped(point.name), 24)
            axes.annotate(name, at, (9, -3), va="top", color=colour, **font)
    fallen = [p for p in points if p.unseen is not None and p.unseen > p.error]
    if fallen:
        most = max(fallen, key=lambda p: (p.unseen or 0) - p.error)
        at = (min(most.speed, FASTEST), float(np.sqrt(most.error * (most.unseen or 0))))
        colour = KINDS[most.kind][0]
        axes.annotate(fill(DROP, layout.letters), at, (14, 0), va="center", color=colour, **font)


def _key(axes: mpl.axes.Axes, names: Sequence[tuple[str, str, str]], layout: Layout) -> None:
    """Write the numbers and names of all models below the axes, in columns."""
    box = axes.get_window_extent()
    high, wide = box.height / axes.figure.dpi, box.width / axes.figure.dpi
    lines = -(-len(names) // layout.columns)
    for i, (number, name, colour) in enumerate(names):
        column, line = divmod(i, lines)
        x = (layout.width * column / layout.columns + 0.19 - layout.left) / wide
        y = -(0.62 + NAME_LINE * line) / high
        text: dict[str, Any] = {"transform": axes.transAxes, "va": "center", "fontsize": 8}
        axes.text(x, y, number, ha="right", color=colour, weight="bold", **text)
        axes.text(x + 0.08 / wide, y, figures.escaped(name), **text)


def _point(number: int, row: Ranked, unseen: float | None) -> Point:
    submission = row.submission
    speed = submission.result["cost"]["reference"]["ratio"]
    kind = submission.result["model"]["kind"]
    return Point(number, submission.name, kind, speed, _error(row), unseen)


def sentences(board: Board, solver: str = "lapy") -> str:
    """Return the figure in sentences; empty where the solver or trained models are missing.

    There are three, and a fourth if a row without training is significantly nearer than the solver.
    Trained models are those of the kind "learned" that do not say they are trained on other
    versions; declared rows do not count. The board is a version's against the surface; predictions
    are compared with the row ``solver``.
    """
    rows = _undeclared(board)
    exact = [row for row in rows if row.submission.slug == solver]
    trained = _trained(rows, board.version)
    unseen = {
        row.submission.name: error for row in trained if (error := _unseen(board, row)) is not None
    }
    if not exact or not unseen:
        return ""
    least, name = _error(exact[0]), exact[0].submission.name
    every = [
        "**A solver is exact for the mesh, not for the surface.** On the test shapes of "
        f"synthNet {board.version}, {name}'s eigenvalues are off by {_relative(exact[0])} on "
        f"average (mean RPD {_digits(least)}), because linear functions on flat triangles only "
        "approximate the surface's eigenfunctions.",
        _on_familiar_shapes(trained, exact[0]),
        _on_unseen_families(board, trained, unseen, exact[0]),
        *_without_training(rows, trained, exact[0]),
    ]
    return "\n".join(f"{number}. {sentence}" for number, sentence in enumerate(every, start=1))


def _trained(rows: Sequence[Ranked], version: str) -> list[Ranked]:
    models = [(row, row.submission.result["model"]) for row in rows]
    learned = [(row, meta) for row, meta in models if meta["kind"] == "learned"]
    return [row for row, meta in learned if may_be_trained_on(meta, version)]


def _on_familiar_shapes(trained: Sequence[Ranked], solver: Ranked) -> str:
    nearer = [row for row in trained if _nearer(row, solver)]
    of = f"{_are(len(nearer), len(trained))} significantly closer to the surface"
    if timed := [row for row in nearer if _timed(row)]:
        best = min(timed, key=_error)
        which = "the best" if timed == nearer else "the best that is timed"
        of += f"; {which}, *{best.submission.name}*, has {_gain(best, solver)}"
    verdict = "learning can beat it" if nearer else "no model significantly beats it"
    return f"**On shapes like those of training, {verdict}.** {of}."


def _on_unseen_families(
    board: Board, trained: Sequence[Ranked], unseen: Mapping[str, float], solver: Ranked
) -> str:
    farther = sum(error >= _error(solver) for error in unseen.values())
    verdict = "most models lose to it"
    if 2 * farther <= len(unseen):
        half = 2 * farther == len(unseen)
        closer = f"{'most' if farther else 'all'} models are closer than it"
        verdict = "half of the models lose to it" if half else closer
    still = [
        f"*{row.submission.name}* ({_digits(unseen[row.submission.name])})"
        for row in trained
        if row.submission.name in unseen and _nearer_unseen(board, row, solver)
    ]
    median = float(np.median(list(unseen.values())))
    return (
        f"**On families never seen in training, {verdict}.** {_are(len(still), len(unseen))} "
        f"significantly closer than {solver.submission.name}"
        f"{': ' if still else ''}{' and '.join(still)}. "
        f"The median model has an RPD of {_digits(median)}."
    )


def _are(some: int, count: int) -> str:
    """Return the subject and the verb of a sentence on some of the trained models."""
    return f"{some} of {count} trained models {'is' if some == 1 else 'are'}"


def _without_training(
    rows: Sequence[Ranked], trained: Sequence[Ranked], solver: Ranked
) -> Iterator[str]:
    others = (row for row in rows if untrained(row.submission.result["model"]))
    nearer = [row for row in others if _timed(row) and _nearer(row, solver)]
    if nearer:
        best = min(nearer, key=_error)
        beaten = all(_nearer(best, row) for row in trained)
        verdict = "better elements beat all of them" if beaten else "better elements come as near"
        yield (
            f"**Without training, {verdict}.** *{best.submission.name}* has "
            f"{_gain(best, solver)}. It is not trained, so no family is unseen to it."
        )


def _gain(row: Ranked, solver: Ranked) -> str:
    """Return how much nearer a row is than the solver, and how much faster."""
    own, ratio = _error(row), row.submission.result["cost"]["reference"]["ratio"]
    error = f"an error {_error(solver) / own:.2g} times smaller" if own else "no error"
    return f"{error} at {ratio:.2g} times {solver.submission.name}'s speed"


def _relative(row: Ranked) -> str:
    """Return the mean relative error of the ten eigenvalues, as per cent."""
    means = [cell["mean"] for cell in row.scores["per_index"]]
    return f"{100 * float(np.mean(means)):.2g} %"


def _nearer(row: Ranked, solver: Ranked) -> bool:
    slug = solver.submission.slug
    return any(other.slug == slug and other.sure and other.mean > 0 for other in row.apart)


def _nearer_unseen(board: Board, row: Ranked, solver: Ranked) -> bool:
    """Return whether a model is better than a solver on the families that it has not seen."""
    own = board.submitted(row.submission, UNSEEN_PROTOCOL)
    if own is None:
        return False
    other = restricted(solver.submission, own.truth)
    return difference(own, other, RANKED_BY).verdict == "a"


def _error(row: Ranked) -> float:
    mean = row.scores["overall"][RANKED_BY]["mean"]
    return np.inf if mean is None else float(mean)


def _solver_line(axes: mpl.axes.Axes, rows: Sequence[Ranked], slug: str, layout: Layout) -> None:
    """Draw a solver's errors and speeds by the size of the meshes, if its times are known."""
    for row in rows:
        cost = row.submission.result["cost"]
        if row.submission.slug != slug or cost.get("ms_by_batch") is None:
            continue
        errors = by_size(row.submission)
        batches = np.array_split(np.array(cost["ms_by_batch"]), len(errors))
        times = [float(batch.mean()) for batch in batches]
        lapy = cost["reference"]["ratio"] * cost["ms_per_mesh_mean"]  # of a mesh of mean size
        speeds = [min(lapy / time, FASTEST) for time in times]
        blue = KINDS["classical"][0]
        axes.plot(speeds, list(errors.values()), ".-", color=blue, lw=1.6, ms=10, zorder=2)
        for speed, (name, error) in zip(speeds, errors.items(), strict=True):
            font: dict[str, Any] = {"textcoords": "offset points", "fontsize": layout.font}
            axes.annotate(layout.size.format(name), (speed, error), (7, -9), color=blue, **font)


def by_size(submission: Submission) -> dict[str, float]:
    """Return the mean error over the instances of each size of mesh that a version makes."""
    version = recipe.load(submission.truth.version)
    values = scores.of_metric(submission.truth, submission.predictions, RANKED_BY).mean(axis=0)
    numbers = np.array([int(shape.rpartition("-")[2]) for shape in submission.truth.shapes])
    return {
        size.name: float(values[numbers % version.copies == i].mean())
        for i, size in enumerate(version.sizes or ())
    }
