"""Pictures of errors: their distribution over the meshes, and how they grow with the index."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from eigbench.board import ranking
from eigbench.board.figures import (
    FLOOR,
    PREDICTED,
    PROTOCOL_MARKS,
    check_finite,
    dataset_of,
    escaped,
    style,
)
from eigbench.board.ranking import RANKED_BY
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LEAST = 1e-6  # relative error; a smaller one is drawn at the lower edge
BINS = 40
LINES = ("-", "--", ":", "-.")


def by_index(submissions: Sequence[Submission]) -> Figure:
    """Draw the relative error of each eigenvalue: its median over the meshes, a line a model.

    Where there is one model only, bands hold half and nine tenths of the meshes.

    Raises
    ------
    EigbenchError
        If a prediction is not finite.
    """
    with style() as blank:
        figure = blank(figsize=(7.2, 3.6 + 0.09 * len(submissions)), layout="constrained")
        axes = figure.subplots()
        marks = cycle(PROTOCOL_MARKS)
        lines = np.repeat(LINES, len(PROTOCOL_MARKS))
        for one, (marker, colour), line in zip(submissions, marks, cycle(lines), strict=False):
            errors = np.maximum(_relative(one), LEAST)
            index = np.arange(1, errors.shape[1] + 1)
            if len(submissions) == 1:
                colour = PREDICTED
                for share, alpha in ((5, 0.15), (25, 0.25)):
                    low, high = np.percentile(errors, (share, 100 - share), axis=0)
                    told = f"{100 - 2 * share} % of the meshes"
                    axes.fill_between(index, low, high, color=colour, alpha=alpha, lw=0, label=told)
            median = np.median(errors, axis=0)
            name = escaped(one.name)
            axes.plot(index, median, line, marker=marker, ms=4, color=colour, label=name)
        axes.set_yscale("log")
        axes.set_xticks(index)
        axes.set_xlabel("index of the eigenvalue")
        axes.set_ylabel(f"relative error, median; below {LEAST:g} at the edge")
        axes.grid(alpha=0.25)
        axes.set_title(dataset_of(submissions[0]), fontsize=9, loc="left")
        figure.legend(frameon=False, fontsize=7, loc="outside lower center", ncols=2)
    return figure


def histogram(submissions: Sequence[Submission], key: str = RANKED_BY) -> Figure:
    """Draw how a metric is distributed over the meshes, a panel a model, on common axes.

    Raises
    ------
    EigbenchError
        If a value is not finite.
    """
    metric = METRICS[key]
    least = FLOOR / 10
    found = [ranking.per_mesh(one, key) for one in submissions]
    for one, values in zip(submissions, found, strict=True):
        check_finite(one, values, metric.title)
    medians = [f"{np.median(values):.3g}" for values in found]
    if not metric.higher_is_better:
        found = [np.maximum(values, least) for values in found]
    low, high = min(v.min() for v in found), max(v.max() for v in found)
    space = np.linspace if metric.higher_is_better else np.geomspace
    edges = space(low, high if high > low else 1.1 * low + 1e-9, BINS + 1)
    with style() as blank:
        tall = 2.4 if len(found) == 1 else 0.85
        figure = blank(figsize=(7.2, tall * len(found) + 0.9), layout="constrained")
        panels = np.ravel(figure.subplots(len(found), sharex=True, squeeze=False))
        for axes, one, values, told in zip(panels, submissions, found, medians, strict=True):
            axes.hist(
                values, edges, weights=np.full(len(values), 100 / len(values)), color=PREDICTED
            )
            axes.axvline(np.median(values), color="#D55E00", lw=1.2)
            axes.set_title(f"{escaped(one.name)}: median {told}", fontsize=8, loc="left")
            axes.set_ylabel("% of meshes", fontsize=7)
            axes.tick_params(labelsize=7)
            axes.grid(axis="x", alpha=0.25)
        if not metric.higher_is_better:
            panels[-1].set_xscale("log")
        edge = "" if metric.higher_is_better else f"; below {least:g} at the edge"
        unit = f" ({metric.unit})" if metric.unit else ""
        panels[-1].set_xlabel(f"{metric.title}{unit}; line: median{edge}")
        figure.suptitle(dataset_of(submissions[0]), fontsize=9, x=0.01, ha="left")
    return figure


def _relative(one: Submission) -> NDArray[np.float64]:
    """Return the relative error of each instance and eigenvalue, mean over seeds, shape (n, k)."""
    labels = one.truth.eigenvalues
    values = np.mean(np.abs(one.predictions - labels) / labels, axis=0)
    check_finite(one, values, "the relative error")
    return np.asarray(values)
