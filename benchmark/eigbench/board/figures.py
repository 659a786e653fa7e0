"""Error against speed beside LaPy, a numbered mark a model; and what all figures share."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eigbench.board.ranking import RANKED_BY
from eigbench.board.tables import times_faster
from eigbench.errors import EigbenchError
from eigbench.results import predictions
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS
from synthnet import recipe
from synthnet.errors import needed_by
from synthnet.pictures.palette import BLUE, GREY, INK, PALE, VERMILION
from synthnet.store.files import write_atomically

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

# Of a model's kind, on every chart of every page; in print the markers tell them apart.
KINDS = {"trivial": (GREY, "s"), "classical": (BLUE, "o"), "learned": (VERMILION, "^")}
TRUE, PREDICTED = INK, BLUE
FLOOR = 1e-3  # smaller errors are drawn at the lower edge: an exact solver's would be 1e-11
FASTEST = 100.0  # times LaPy; faster models are drawn at the right edge
SIZES = {"o": 12, "s": 11, "^": 17}  # of marks, in points: a number is inside
COVERS = 8.0  # points: a mark that is so near covers the number in another
BESIDE = [(12.0, 0.0), (-12.0, 0.0), (0.0, -11.0), (0.0, 11.0)]  # points: where it stands then
SPEED = "times as fast as LaPy →"
NAME_LINE, LEGEND = 0.185, 0.7  # inches of a name in the key, and of the kinds below


@dataclass(frozen=True, slots=True)
class Point:
    """A model on a chart of error against speed."""

    number: int  #: stands in its mark, and before its name in the key
    name: str
    kind: str
    speed: float  #: how many times as fast as LaPy it is
    error: float  #: what the chart is of
    unseen: float | None = None  #: the same error on what the training held out
    whole: bool = True  #: whether it answered every mesh; else its mark is open


@contextmanager
def style() -> Iterator[type[Figure]]:
    """Give Matplotlib's figures: with plain axes, and SVG that is the same to the byte each run."""
    with needed_by("drawing"):
        import matplotlib as mpl
        from matplotlib.figure import Figure
    settings: Any = {  # matplotlib's type of keys is a list of 300 literals
        "font.size": 9,
        "font.family": "DejaVu Sans",
        "axes.spines.top": False,
        "axes.spines.right": False,
        "svg.hashsalt": "eigbench",
        "svg.fonttype": "none",
        "path.simplify": False,
    }
    with mpl.rc_context():
        mpl.rcdefaults()  # a user's own style would change the bytes
        mpl.rcParams.update(settings)
        yield Figure


def error_against_time(submissions: Sequence[Submission], key: str = RANKED_BY) -> str:
    """Return an SVG of mean error against time, as the speed beside LaPy in the same run.

    The ratio may be compared between machines, so all rows stand in one panel. Those that were not
    timed beside LaPy are named in the key, without a number.
    """
    points, absent = _points(submissions, key)
    with style() as new_figure:
        high = max(4.4, NAME_LINE * (len(points) + len(absent)) + LEGEND + 0.6)
        figure = new_figure(figsize=(9.0, high))
        axes = figure.subplots()
        # Positions are fixed: those of an automatic layout depend on the version of FreeType
        figure.subplots_adjust(0.075, 0.48 / high, 0.6, 1 - 0.1 / high)
        scatter(axes, points, floor=FLOOR)
        number_marks(axes, points, floor=FLOOR)
        axes.set_ylabel(f"mean {METRICS[key].heading}; below {FLOOR:g} at the edge")
        beside = [
            (str(p.number), f"{p.name}{_beyond(p, key)}", KINDS[p.kind][0])
            for p in sorted(points, key=lambda p: p.number)
        ]
        name_key(axes, [*beside, *(("–", name, PALE) for name in absent)])
        legend(axes, dict.fromkeys(p.kind for p in points))
        return as_svg(figure)


def _points(submissions: Sequence[Submission], key: str) -> tuple[list[Point], list[str]]:
    """Return the models that have a mean and a speed, the best first; and why the others do not."""
    models, absent = [], []
    for submission in sorted(submissions, key=lambda s: s.slug):
        mean = submission.scores["overall"][key]["mean"]
        reference = submission.result["cost"].get("reference")
        if mean is None or reference is None:
            absent.append(f"{submission.name}: not {'finite' if mean is None else 'timed'}")
        else:
            kind = submission.result["model"]["kind"]
            models.append((mean, submission.name, kind, reference["ratio"]))
    sign = -1 if METRICS[key].higher_is_better else 1
    models.sort(key=lambda model: sign * model[0])
    return [Point(i, n, k, s, e) for i, (e, n, k, s) in enumerate(models, start=1)], absent


def _beyond(point: Point, key: str) -> str:
    """Return what the edges of the chart hide of a point."""
    notes = ["exact"] if point.error < 1e-9 and not METRICS[key].higher_is_better else []
    notes += [times_faster({"ratio": point.speed})] if point.speed > FASTEST else []
    return f" ({', '.join(notes)})" if notes else ""


def scatter(
    axes: mpl.axes.Axes, points: Sequence[Point], *, floor: float, fastest: float = FASTEST
) -> None:
    """Draw error against speed, both logarithmic: one mark per model, without its number."""
    for point in points:
        _mark(axes, point, min(point.speed, fastest), max(point.error, floor))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(SPEED)
    axes.grid(alpha=0.25)


def _mark(axes: mpl.axes.Axes, point: Point, x: float, y: float) -> None:
    colour, marker = KINDS[point.kind]
    above = 4 - point.number / 1000  # the better of two that overlap is above
    inside = "white" if not point.whole else colour
    edge, width = ("white", 0.7) if point.whole else (colour, 1.2)
    axes.plot(x, y, marker, mfc=inside, mec=edge, mew=width, ms=SIZES[marker], zorder=above)


def number_marks(
    axes: mpl.axes.Axes, points: Sequence[Point], *, floor: float, fastest: float = FASTEST
) -> None:
    """Write each model's number in its mark, or beside it where a better model's mark covers it.

    The axes must have their limits.
    """
    marks = [(min(p.speed, fastest), max(p.error, floor)) for p in points]
    pixels = axes.transData.transform(marks)
    for point, mark, here in zip(points, marks, pixels, strict=True):
        gaps = (pixels - here) * 72 / axes.figure.dpi
        covered = any(
            other.number < point.number and np.abs(gap).max() < COVERS
            for other, gap in zip(points, gaps, strict=True)
        )
        colour, marker = KINDS[point.kind]
        # A triangle is wide below its middle
        x, (y, size) = 0.0, (-2.8, 5.5) if marker == "^" else (-0.2, 6.0)
        if covered:
            room = [np.linalg.norm(gaps - side, axis=1).min() for side in BESIDE]
            x, y = BESIDE[int(np.argmax(room))]
        elif point.whole:
            colour = "white"
        above = 5 if covered else 4 - point.number / 1000
        axes.annotate(
            str(point.number), mark, (x, y), textcoords="offset points", ha="center", va="center",
            fontsize=size, color=colour, weight="bold", zorder=above,
        )  # fmt: skip


def name_key(axes: mpl.axes.Axes, entries: Sequence[tuple[str, str, str]]) -> None:
    """Write numbers, names and colours beside the axes, a line each, from the top."""
    high = axes.get_window_extent().height / axes.figure.dpi
    for line, (number, name, colour) in enumerate(entries):
        y = 1 - NAME_LINE * (line + 0.5) / high
        text: dict[str, Any] = {"transform": axes.transAxes, "va": "center", "fontsize": 7.5}
        axes.text(1.06, y, number, ha="right", color=colour, weight="bold", **text)
        axes.text(1.075, y, escaped(name), **text)


def legend(
    axes: mpl.axes.Axes, kinds: Iterable[str], more: Sequence[Any] = (), **placed: Any
) -> None:
    """Say what the marks mean, the kinds and more handles: at the bottom right, or where placed."""
    handles = [
        axes.plot([], [], KINDS[kind][1], color=KINDS[kind][0], ls="", label=kind)[0]
        for kind in KINDS
        if kind in set(kinds)
    ]
    beside = {"loc": "lower left", "bbox_to_anchor": (1.0, -0.03)}
    axes.legend(handles=[*handles, *more], frameon=False, fontsize=7.5, **(placed or beside))


def as_svg(figure: Figure) -> str:
    """Return a figure, drawn and saved within :func:`style`, as the text of an SVG."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return text.getvalue()


def escaped(text: str) -> str:
    """Return text in which no dollar sign begins a formula."""
    return text.replace("$", "\\$")


def dataset_of(submission: Submission) -> str:
    """Return what a submission predicts, in short: ``synthNet 1.0, test, grouped``."""
    facts = submission.result["dataset"]
    return f"{recipe.title(facts['version'])}, {facts['split']}, {facts['protocol']}"


def check_finite(submission: Submission, values: NDArray[np.float64], title: str) -> None:
    """Check that values of a submission's instances, a row or a number each, can be drawn.

    Raises
    ------
    EigbenchError
        If a prediction is far too large or small, or a value is not finite: because a prediction
        is not, or because the measure is infinite for a finite one, as PSNR for an exact
        prediction and InvLap for a prediction of 0.
    """
    if predictions.extreme(submission.predictions).any():
        raise EigbenchError(
            f"{submission.result_path} has predictions that are not from {predictions.LEAST:g} to "
            f"{predictions.MOST:g}: no picture"
        )
    finite = np.isfinite(values)
    if finite.all():
        return
    if not np.isfinite(submission.predictions).all():
        raise EigbenchError(
            f"{submission.result_path} has predictions that are not finite: no picture"
        )
    count = int((~finite.reshape(len(values), -1).all(axis=1)).sum())
    raise EigbenchError(
        f"{submission.result_path}: {title} is infinite on {count:,} of {len(values):,} instances, "
        "though the predictions are finite (PSNR of an exact one, InvLap of a 0): choose another "
        "--metric"
    )


def save(path: Path, figure: Figure) -> None:
    """Write a figure; the suffix says as what. An SVG is the same to the byte at each run."""
    kind = path.suffix[1:]
    metadata = {"Date": None, "Creator": None} if kind == "svg" else None
    with style():
        write = partial(figure.savefig, format=kind, dpi=160, metadata=metadata)
        write_atomically(path, write)
