"""The figures of a board, error against time and by protocol, and what all figures share."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eigbench import results
from eigbench.board.generalisation import Board, title
from eigbench.board.ranking import RANKED_BY
from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS
from synthnet import recipe
from synthnet.errors import needed_by
from synthnet.store.files import write_atomically

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

# Okabe and Ito: colour-blind readers can distinguish them; in print the markers do.
KINDS = {"trivial": ("#999999", "s"), "classical": ("#0072B2", "o"), "learned": ("#D55E00", "^")}
TRUE, PREDICTED = "#000000", "#0072B2"
FLOOR = 1e-3  # smaller errors are drawn at the lower edge: an exact solver's would be 1e-11
FASTEST = 0.1  # ms; faster models are drawn at the left edge
PROTOCOL_MARKS = (  # Okabe and Ito again, and a marker each
    ("s", "#E69F00"),
    ("^", "#56B4E9"),
    ("D", "#009E73"),
    ("v", "#D55E00"),
    ("P", "#CC79A7"),
    ("X", "#0072B2"),
)


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
    """Return an SVG of mean error against milliseconds a mesh, both logarithmic.

    Results of several hardware labels get a panel each, with one scale of errors: times are not
    compared across.
    """
    means = (submission.scores["overall"][key]["mean"] for submission in submissions)
    errors = [max(mean, FLOOR) for mean in means if mean is not None] or [1.0]
    limits = min(errors) / 1.8, max(errors) * 2.5
    by_label: dict[str, list[Submission]] = {}
    for submission in submissions:
        by_label.setdefault(results.setting(submission.result), []).append(submission)
    with style() as new_figure:
        # Positions are fixed: those of an automatic layout depend on the version of FreeType
        figure = new_figure(figsize=(7.2, 4.4 * len(by_label)))
        panels = np.ravel(figure.subplots(len(by_label), squeeze=False))
        figure.subplots_adjust(0.1, 0.5 / (4.4 * len(by_label)), 0.97, 0.93, hspace=0.35)
        for axes, label in zip(panels, sorted(by_label), strict=True):
            axes.set_ylim(limits)
            _scatter(axes, by_label[label], key)
            axes.set_title(escaped(label), fontsize=9, loc="left")
        return as_svg(figure)


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
        If a value is not finite: because a prediction is not, or because the measure is infinite
        for a finite one, as PSNR for an exact prediction and InvLap for a prediction of 0.
    """
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


def _scatter(axes: mpl.axes.Axes, submissions: Sequence[Submission], key: str) -> None:
    """Draw error against time of one hardware label, a named mark for each model."""
    points, notes = [], []
    for submission in sorted(submissions, key=lambda s: s.slug):
        mean = submission.scores["overall"][key]["mean"]
        time = submission.result["cost"]["ms_per_mesh"]
        if mean is None:
            continue
        note = escaped(submission.name)
        note += f" ({mean:.0e})" if mean < FLOOR else ""
        note += f" ({time:.0e} ms)" if time < FASTEST else ""
        colour, marker = KINDS[submission.result["model"]["kind"]]
        points.append((max(time, FASTEST), max(mean, FLOOR)))
        notes.append(note)
        axes.plot(*points[-1], marker, color=colour, ms=6)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("ms a mesh, median")
    axes.set_ylabel(f"mean {METRICS[key].heading}")
    axes.grid(alpha=0.25)
    if not points:
        return
    x = np.array(points)[:, 0]
    axes.set_xlim(x.min() / 1.8, x.max() * 4)
    offsets = label_offsets(axes, points, notes)
    for note, (dx, dy, side), point in zip(notes, offsets, points, strict=True):
        axes.annotate(
            note, point, (dx, dy), textcoords="offset points", ha=side, va="center", fontsize=8
        )
    kinds = [kind for kind in KINDS if any(s.result["model"]["kind"] == kind for s in submissions)]
    handles = [
        axes.plot([], [], KINDS[kind][1], color=KINDS[kind][0], label=kind)[0] for kind in kinds
    ]
    axes.legend(handles=handles, loc="lower left", fancybox=False, edgecolor="0.8", fontsize=8)


def label_offsets(
    axes: mpl.axes.Axes, points: Sequence[tuple[float, float]], notes: Sequence[str]
) -> list[tuple[float, float, str]]:
    """Return for each note an offset in points and a side, so that few notes overlap.

    By arithmetic on the lengths of the notes: a measured text would depend on the fonts.
    """
    width, height = np.array([axes.bbox.width, axes.bbox.height]) * 72 / axes.figure.dpi
    limits = np.log10([axes.get_xlim(), axes.get_ylim()])
    size = np.array([width, height])
    at = (np.log10(points) - limits[:, 0]) / (limits[:, 1] - limits[:, 0]) * size
    taken = [(x - 4, y - 4, x + 4, y + 4) for x, y in at]
    offsets = []
    for (x, y), note in zip(at, notes, strict=True):
        long = 4.6 * len(note)
        options = {}
        for dy in (0.0, 9.0, -9.0, 14.0, -14.0):
            for dx, side, left in ((7.0, "left", x + 7), (-7.0, "right", x - 7 - long)):
                here = (left, y + dy - 5, left + long, y + dy + 5)
                outside = max(0.0, -here[0]) + max(0.0, here[2] - width)
                overlap = sum(_overlap(here, other) for other in taken)
                options[(dx, dy, side)] = (overlap + 10 * outside, here)
        best = min(options, key=lambda offset: options[offset][0])
        taken.append(options[best][1])
        offsets.append(best)
    return offsets


def _overlap(a: Sequence[float], b: Sequence[float]) -> float:
    wide, high = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    return max(0.0, wide) * max(0.0, high)


def generalisation(board: Board, key: str = RANKED_BY) -> str:
    """Return an SVG of each model's mean error i.i.d. and under each protocol, a line a model."""
    metric = METRICS[key]
    with style() as new_figure:
        high = 0.3 * len(board.rows) + 1.3
        figure = new_figure(figsize=(7.2, high))
        axes = figure.subplots()
        figure.subplots_adjust(0.36, 0.45 / high, 0.98, 1 - 0.75 / high)
        columns = [("i.i.d.", "o", TRUE)]
        columns += [
            (title(name), marker, colour)
            for name, (marker, colour) in zip(board.protocols, cycle(PROTOCOL_MARKS), strict=False)
        ]
        for line, row in enumerate(board.rows):
            model = row.submission
            means = [model.scores["overall"][key]["mean"]]
            means += [board.scored(model, name, key).score for name in board.protocols]
            known = [max(value, FLOOR) for value in means if value is not None]
            axes.plot([min(known), max(known)], [line, line], color="#cccccc", lw=1, zorder=1)
            for value, (_, marker, colour) in zip(means, columns, strict=True):
                if value is not None:
                    x = max(value, FLOOR)
                    axes.plot(x, line, marker, color=colour, ms=5.5, alpha=0.85, zorder=2)
        names = [escaped(row.submission.name) for row in board.rows]
        axes.set_yticks(range(len(names)), names, fontsize=8)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xscale("log")
        axes.set_xlabel(f"mean {metric.heading}; below {FLOOR:g} at the edge")
        axes.grid(axis="x", alpha=0.25)
        handles = [
            axes.plot([], [], marker, color=colour, label=escaped(name))[0]
            for name, marker, colour in columns
        ]
        figure.legend(handles=handles, loc="upper center", frameon=False, fontsize=7.5, ncols=3)
        return as_svg(figure)


def save(path: Path, figure: Figure) -> None:
    """Write a figure; the suffix says as what. An SVG is the same to the byte at each run."""
    kind = path.suffix[1:]
    metadata = {"Date": None, "Creator": None} if kind == "svg" else None

    def write(to: Path) -> None:
        figure.savefig(to, format=kind, dpi=160, metadata=metadata)

    with style():
        write_atomically(path, write)
