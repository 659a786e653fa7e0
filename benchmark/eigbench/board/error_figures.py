"""Figures of single results: spectra, and errors by family, by index and over the meshes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eigbench.board import figures, ranking
from eigbench.board.figures import FLOOR, KINDS, PREDICTED, TRUE
from eigbench.board.ranking import RANKED_BY
from eigbench.board.tables import family_title, in_order
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS, psnr
from synthnet.pictures.palette import INK

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

LEAST = 1e-6  # relative error; a smaller one is drawn at the lower edge
BINS = 40
LINES, MARKERS = ("-", "--", ":", "-."), ("o", "s", "^", "D", "v", "P", "X")
QUANTILES = {"best": 0.0, "median": 0.5, "worst": 1.0}


def spectra(submission: Submission) -> Figure:
    """Draw predicted against true spectra, as the paper's Figure 6.

    A row for each family shows its instances with the least, the median and the largest RPD, with
    their PSNR and Inverse Laplacian.
    """
    families = in_order(submission.truth.families.tolist())
    errors = ranking.per_mesh(submission, RANKED_BY)
    figures.check_finite(submission, errors, METRICS[RANKED_BY].title)
    with figures.style() as new_figure:
        figure = new_figure(figsize=(7.2, 1.7 * len(families) + 0.6), layout="constrained")
        panels = figure.subplots(len(families), len(QUANTILES), squeeze=False)
        for row, family in zip(panels, families, strict=True):
            mine = np.flatnonzero(submission.truth.families == family)
            for axes, (name, quantile) in zip(row, QUANTILES.items(), strict=True):
                _spectrum(
                    axes, submission, int(mine[ranking.at_quantile(errors[mine], quantile)]), name
                )
            row[0].set_ylabel(family_title(family))
        panels[0][0].legend(frameon=False, fontsize=7)
        for axes in panels[-1]:
            axes.set_xlabel("index", fontsize=7)
        figure.suptitle(
            f"{figures.escaped(submission.name)}: true and predicted eigenvalues\n"
            f"best, median and worst by {METRICS[RANKED_BY].title}",
            fontsize=10,
        )
    return figure


def _spectrum(axes: mpl.axes.Axes, submission: Submission, i: int, name: str) -> None:
    label, predicted = submission.truth.eigenvalues[i], submission.predictions[0, i]
    index = np.arange(1, len(label) + 1)
    axes.plot(index, label, "o", color=TRUE, ms=3.5, fillstyle="none", label="true")
    axes.plot(index, predicted, "x", color=PREDICTED, ms=4, label="predicted")
    decibels = psnr(predicted[None], label[None])[0]
    error = METRICS["invlap"].function(predicted[None], label[None])[0]
    axes.set_title(
        f"{name}: {submission.truth.ids[i]}\nPSNR {decibels:.1f} dB, InvLap {error:.3g}",
        fontsize=6.5,
    )
    axes.set_ylim(bottom=0)
    axes.set_xticks(index[::3])
    axes.tick_params(labelsize=6)


def families(submissions: Sequence[Submission], key: str = RANKED_BY) -> Figure:
    """Draw the distribution of a metric by family: a box of quartiles, whiskers 5 to 95 %.

    A box has the colour of its model's kind, and where there are several its number.
    """
    names = in_order(submissions[0].truth.families.tolist())
    several = len(submissions) > 1
    with figures.style() as new_figure:
        height = 0.35 * len(names) * max(1.0, 0.4 * len(submissions)) + 1.2
        figure = new_figure(figsize=(7.2, height), layout="constrained")
        axes = figure.subplots()
        width = 0.8 / len(submissions)
        for number, submission in enumerate(submissions, start=1):
            values = ranking.per_mesh(submission, key)
            figures.check_finite(submission, values, METRICS[key].title)
            values = np.maximum(values, FLOOR / 10)
            name = figures.escaped(submission.name)
            positions = np.arange(len(names)) + (number - (len(submissions) + 1) / 2) * width
            boxes = axes.boxplot(
                [values[submission.truth.families == family] for family in names],
                positions=positions,
                widths=0.85 * width,
                orientation="horizontal",
                whis=(5, 95),
                showfliers=False,
                patch_artist=True,
                manage_ticks=False,
                medianprops={"color": INK},
                label=f"{number}  {name}" if several else name,
            )
            for box in boxes["boxes"]:
                box.set(facecolor=_colour(submission), alpha=0.7)
            for whisker in boxes["whiskers"][1::2] if several else ():
                (_, end), (_, position) = whisker.get_xdata(), whisker.get_ydata()
                axes.annotate(
                    str(number), (end, position), (3, 0), textcoords="offset points",
                    va="center_baseline", fontsize=6, color=_colour(submission),
                )  # fmt: skip
        axes.set_yticks(range(len(names)), [family_title(name) for name in names])
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_xscale("log")
        axes.set_xlabel(
            f"{METRICS[key].title}: quartiles, whiskers 5 to 95 %; below {FLOOR / 10:g} at the edge"
        )
        axes.grid(axis="x", alpha=0.25)
        _name(figure, axes, submissions)
    return figure


def by_index(submissions: Sequence[Submission]) -> Figure:
    """Draw the relative error of each eigenvalue: its median over the meshes, one line per model.

    A line has the colour of its model's kind; marker and dashes tell models of a kind apart. Where
    there is one model only, bands hold half and nine tenths of the meshes.

    Raises
    ------
    EigbenchError
        If a prediction is not finite.
    """
    with figures.style() as new_figure:
        figure = new_figure(figsize=(7.2, 3.6 + 0.09 * len(submissions)), layout="constrained")
        axes = figure.subplots()
        lines = {kind: _lines(marker) for kind, (_, marker) in KINDS.items()}
        for submission in submissions:
            errors = np.maximum(_relative(submission), LEAST)
            index = np.arange(1, errors.shape[1] + 1)
            colour = _colour(submission)
            if len(submissions) == 1:
                for share, alpha in ((5, 0.15), (25, 0.25)):
                    low, high = np.percentile(errors, (share, 100 - share), axis=0)
                    band = f"{100 - 2 * share} % of the meshes"
                    axes.fill_between(index, low, high, color=colour, alpha=alpha, lw=0, label=band)
            line, marker = next(lines[submission.result["model"]["kind"]])
            median, name = np.median(errors, axis=0), figures.escaped(submission.name)
            axes.plot(index, median, line, marker=marker, ms=4, color=colour, label=name)
        axes.set_yscale("log")
        axes.set_xticks(index)
        axes.set_xlabel("index of the eigenvalue")
        axes.set_ylabel(f"relative error, median; below {LEAST:g} at the edge")
        axes.grid(alpha=0.25)
        _name(figure, axes, submissions)
    return figure


def _colour(submission: Submission) -> str:
    """Return the colour of a model's kind."""
    return KINDS[submission.result["model"]["kind"]][0]


def _lines(marker: str) -> Iterator[tuple[str, str]]:
    """Return dashes and marker of each model of a kind in turn; the first has the kind's marker."""
    markers = [marker, *(other for other in MARKERS if other != marker)]
    return cycle((line, other) for line in LINES for other in markers)


def _name(figure: Figure, axes: mpl.axes.Axes, submissions: Sequence[Submission]) -> None:
    """Name the dataset above, the models below."""
    axes.set_title(figures.dataset_of(submissions[0]), fontsize=9, loc="left")
    figure.legend(frameon=False, fontsize=7, loc="outside lower center", ncols=2)


def histogram(submissions: Sequence[Submission], key: str = RANKED_BY) -> Figure:
    """Draw how a metric is distributed over the meshes, one panel per model, on common axes.

    Raises
    ------
    EigbenchError
        If a value is not finite.
    """
    metric = METRICS[key]
    least = FLOOR / 10
    every = [ranking.per_mesh(submission, key) for submission in submissions]
    for submission, values in zip(submissions, every, strict=True):
        figures.check_finite(submission, values, metric.title)
    medians = [f"{np.median(values):.3g}" for values in every]
    if not metric.higher_is_better:
        every = [np.maximum(values, least) for values in every]
    low, high = min(v.min() for v in every), max(v.max() for v in every)
    space = np.linspace if metric.higher_is_better else np.geomspace
    edges = space(low, high if high > low else 1.1 * low + 1e-9, BINS + 1)
    with figures.style() as new_figure:
        tall = 2.4 if len(every) == 1 else 0.85
        figure = new_figure(figsize=(7.2, tall * len(every) + 0.9), layout="constrained")
        panels = np.ravel(figure.subplots(len(every), sharex=True, squeeze=False))
        for axes, submission, values, median in zip(
            panels, submissions, every, medians, strict=True
        ):
            weights = np.full(len(values), 100 / len(values))
            axes.hist(values, edges, weights=weights, color=_colour(submission))
            axes.axvline(np.median(values), color=INK, lw=1.2)
            axes.set_title(
                f"{figures.escaped(submission.name)}: median {median}", fontsize=8, loc="left"
            )
            axes.set_ylabel("% of meshes", fontsize=7)
            axes.tick_params(labelsize=7)
            axes.grid(axis="x", alpha=0.25)
        if not metric.higher_is_better:
            panels[-1].set_xscale("log")
        edge = "" if metric.higher_is_better else f"; below {least:g} at the edge"
        unit = f" ({metric.unit})" if metric.unit else ""
        panels[-1].set_xlabel(f"{metric.title}{unit}; line: median{edge}")
        figure.suptitle(figures.dataset_of(submissions[0]), fontsize=9, x=0.01, ha="left")
    return figure


@np.errstate(over="ignore", invalid="ignore")  # of predictions near the ends of float64
def _relative(submission: Submission) -> NDArray[np.float64]:
    """Return the relative error of each instance and eigenvalue, mean over seeds, shape (n, k)."""
    labels = submission.truth.eigenvalues
    values = np.mean(np.abs(submission.predictions - labels) / labels, axis=0)
    figures.check_finite(submission, values, "the relative error")
    return np.asarray(values)
