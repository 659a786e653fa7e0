"""Pictures of results: error against time, spectra, errors by family."""

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
from eigbench.board import ranking
from eigbench.board.generalisation import Board, title
from eigbench.board.ranking import RANKED_BY
from eigbench.board.tables import family_title, in_order
from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS, psnr
from synthnet import recipe
from synthnet.errors import needed_by
from synthnet.store.files import write_atomically

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

# Okabe and Ito: told apart by colour-blind readers; the markers tell kinds apart in print.
KINDS = {"trivial": ("#999999", "s"), "classical": ("#0072B2", "o"), "learned": ("#D55E00", "^")}
TRUE, PREDICTED = "#000000", "#0072B2"
FLOOR = 1e-3  # errors below are drawn at the lower edge: the exact solver's would be 1e-11
FASTEST = 0.1  # ms; what is faster is drawn at the left edge
PROTOCOL_MARKS = (  # Okabe and Ito again, and a marker each
    ("s", "#E69F00"),
    ("^", "#56B4E9"),
    ("D", "#009E73"),
    ("v", "#D55E00"),
    ("P", "#CC79A7"),
    ("X", "#0072B2"),
)
QUANTILES = {"best": 0.0, "median": 0.5, "worst": 1.0}


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
    means = (one.result["scores"]["overall"][key]["mean"] for one in submissions)
    errors = [max(mean, FLOOR) for mean in means if mean is not None] or [1.0]
    limits = min(errors) / 1.8, max(errors) * 2.5
    by_label: dict[str, list[Submission]] = {}
    for one in submissions:
        by_label.setdefault(results.setting(one.result), []).append(one)
    with style() as blank:
        # Places by hand: those of an automatic layout depend on the version of FreeType
        figure = blank(figsize=(7.2, 4.4 * len(by_label)))
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


def dataset_of(one: Submission) -> str:
    """Return what a submission predicts, in short: ``synthNet 1.0, test, grouped``."""
    facts = one.result["dataset"]
    return f"{recipe.title(facts['version'])}, {facts['split']}, {facts['protocol']}"


def check_finite(one: Submission, values: NDArray[np.float64], title: str) -> None:
    """Raise if values of a submission's instances, a row or a number each, cannot be drawn.

    Raises
    ------
    EigbenchError
        If a value is not finite: a prediction is not, or the measure has no number for one that
        is, as PSNR for an exact prediction and InvLap for one of 0.
    """
    finite = np.isfinite(values)
    if finite.all():
        return
    if not np.isfinite(one.predictions).all():
        raise EigbenchError(f"{one.result_path} has predictions that are not finite: no picture")
    count = int((~finite.reshape(len(values), -1).all(axis=1)).sum())
    raise EigbenchError(
        f"{one.result_path}: {title} is infinite on {count:,} of {len(values):,} instances, though "
        "the predictions are finite (PSNR of an exact one, InvLap of a 0): choose another --metric"
    )


def _scatter(axes: mpl.axes.Axes, submissions: Sequence[Submission], key: str) -> None:
    metric = METRICS[key]
    points, notes = [], []
    for one in sorted(submissions, key=lambda s: s.slug):
        mean = one.result["scores"]["overall"][key]["mean"]
        time = one.result["cost"]["ms_per_mesh"]
        if mean is None:
            continue
        note = escaped(one.name)
        note += f" ({mean:.0e})" if mean < FLOOR else ""
        note += f" ({time:.0e} ms)" if time < FASTEST else ""
        colour, marker = KINDS[one.result["model"]["kind"]]
        points.append((max(time, FASTEST), max(mean, FLOOR)))
        notes.append(note)
        axes.plot(*points[-1], marker, color=colour, ms=6)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("ms a mesh, median")
    axes.set_ylabel(f"mean {metric.heading}")
    axes.grid(alpha=0.25)
    if not points:
        return
    x = np.array(points)[:, 0]
    axes.set_xlim(x.min() / 1.8, x.max() * 4)
    for note, (dx, dy, side), point in zip(
        notes, _label_places(axes, points, notes), points, strict=True
    ):
        axes.annotate(
            note, point, (dx, dy), textcoords="offset points", ha=side, va="center", fontsize=8
        )
    kinds = [kind for kind in KINDS if any(s.result["model"]["kind"] == kind for s in submissions)]
    handles = [
        axes.plot([], [], KINDS[kind][1], color=KINDS[kind][0], label=kind)[0] for kind in kinds
    ]
    axes.legend(handles=handles, loc="lower left", fancybox=False, edgecolor="0.8", fontsize=8)


def _label_places(
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
    places = []
    for (x, y), note in zip(at, notes, strict=True):
        long = 4.6 * len(note)
        options = {}
        for dy in (0.0, 9.0, -9.0, 14.0, -14.0):
            for dx, side, left in ((7.0, "left", x + 7), (-7.0, "right", x - 7 - long)):
                here = (left, y + dy - 5, left + long, y + dy + 5)
                outside = max(0.0, -here[0]) + max(0.0, here[2] - width)
                overlap = sum(_overlap(here, other) for other in taken)
                options[(dx, dy, side)] = (overlap + 10 * outside, here)
        best = min(options, key=lambda place: options[place][0])
        taken.append(options[best][1])
        places.append(best)
    return places


def _overlap(a: Sequence[float], b: Sequence[float]) -> float:
    wide, high = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
    return max(0.0, wide) * max(0.0, high)


def generalisation(board: Board, key: str = RANKED_BY) -> str:
    """Return an SVG of each model's mean error i.i.d. and under each protocol, a line a model."""
    metric = METRICS[key]
    with style() as blank:
        figure = blank(figsize=(7.2, 0.3 * len(board.rows) + 1.3))
        axes = figure.subplots()
        high = 0.3 * len(board.rows) + 1.3
        figure.subplots_adjust(0.36, 0.45 / high, 0.98, 1 - 0.75 / high)
        columns = [("i.i.d.", "o", TRUE)]
        columns += [
            (title(name), marker, colour)
            for name, (marker, colour) in zip(board.protocols, cycle(PROTOCOL_MARKS), strict=False)
        ]
        for line, row in enumerate(board.rows):
            model = row.submission
            found = [model.result["scores"]["overall"][key]["mean"]]
            found += [board.cell(model, name, key).score for name in board.protocols]
            known = [max(value, FLOOR) for value in found if value is not None]
            axes.plot([min(known), max(known)], [line, line], color="#cccccc", lw=1, zorder=1)
            for value, (_, marker, colour) in zip(found, columns, strict=True):
                if value is not None:
                    place = max(value, FLOOR)
                    axes.plot(place, line, marker, color=colour, ms=5.5, alpha=0.85, zorder=2)
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


def spectra(one: Submission) -> Figure:
    """Draw predicted against true spectra, as the paper's Figure 6.

    A row for each family: of its instances the one with the least, the median and the
    largest RPD, with its PSNR and Inverse Laplacian.
    """
    families = in_order(one.truth.families.tolist())
    errors = ranking.per_mesh(one, RANKED_BY)
    check_finite(one, errors, METRICS[RANKED_BY].title)
    with style() as blank:
        figure = blank(figsize=(7.2, 1.7 * len(families) + 0.6), layout="constrained")
        panels = figure.subplots(len(families), len(QUANTILES), squeeze=False)
        for row, family in zip(panels, families, strict=True):
            mine = np.flatnonzero(one.truth.families == family)
            for axes, (name, quantile) in zip(row, QUANTILES.items(), strict=True):
                _spectrum(axes, one, int(mine[ranking.at_quantile(errors[mine], quantile)]), name)
            row[0].set_ylabel(family_title(family))
        panels[0][0].legend(frameon=False, fontsize=7)
        for axes in panels[-1]:
            axes.set_xlabel("index", fontsize=7)
        figure.suptitle(
            f"{escaped(one.name)}: true and predicted eigenvalues\nbest, median and worst by "
            f"{METRICS[RANKED_BY].title}",
            fontsize=10,
        )
    return figure


def _spectrum(axes: mpl.axes.Axes, one: Submission, i: int, name: str) -> None:
    label, predicted = one.truth.eigenvalues[i], one.predictions[0, i]
    index = np.arange(1, len(label) + 1)
    axes.plot(index, label, "o", color=TRUE, ms=3.5, fillstyle="none", label="true")
    axes.plot(index, predicted, "x", color=PREDICTED, ms=4, label="predicted")
    decibels = psnr(predicted[None], label[None])[0]
    error = METRICS["invlap"].function(predicted[None], label[None])[0]
    axes.set_title(
        f"{name}: {one.truth.ids[i]}\nPSNR {decibels:.1f} dB, InvLap {error:.3g}", fontsize=6.5
    )
    axes.set_ylim(bottom=0)
    axes.set_xticks(index[::3])
    axes.tick_params(labelsize=6)


def families(submissions: Sequence[Submission], key: str = RANKED_BY) -> Figure:
    """Draw the distribution of a metric by family: a box of quartiles, whiskers 5 to 95 %."""
    names = in_order(submissions[0].truth.families.tolist())
    with style() as blank:
        height = 0.35 * len(names) * max(1.0, 0.4 * len(submissions)) + 1.2
        figure = blank(figsize=(7.2, height), layout="constrained")
        axes = figure.subplots()
        width = 0.8 / len(submissions)
        from matplotlib import colormaps

        palette = colormaps["viridis"](np.linspace(0.3, 1, len(submissions)))
        for number, (one, colour) in enumerate(zip(submissions, palette, strict=True)):
            values = ranking.per_mesh(one, key)
            check_finite(one, values, METRICS[key].title)
            values = np.maximum(values, FLOOR / 10)
            boxes = axes.boxplot(
                [values[one.truth.families == name] for name in names],
                positions=np.arange(len(names)) + (number - (len(submissions) - 1) / 2) * width,
                widths=0.85 * width,
                orientation="horizontal",
                whis=(5, 95),
                showfliers=False,
                patch_artist=True,
                manage_ticks=False,
                medianprops={"color": "#D55E00"},
                label=escaped(one.name),
            )
            for box in boxes["boxes"]:
                box.set(facecolor=colour, alpha=0.7)
        axes.set_yticks(range(len(names)), [family_title(name) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xscale("log")
        axes.set_xlabel(
            f"{METRICS[key].title}: quartiles, whiskers 5 to 95 %; below {FLOOR / 10:g} at the edge"
        )
        axes.grid(axis="x", alpha=0.25)
        axes.set_title(dataset_of(submissions[0]), fontsize=9, loc="left")
        figure.legend(frameon=False, fontsize=7, loc="outside lower center", ncols=2)
    return figure


def save(path: Path, figure: Figure) -> None:
    """Write a figure; the suffix says as what. An SVG is the same to the byte at each run."""
    kind = path.suffix[1:]
    metadata = {"Date": None, "Creator": None} if kind == "svg" else None

    def write(to: Path) -> None:
        figure.savefig(to, format=kind, dpi=160, metadata=metadata)

    with style():
        write_atomically(path, write)
