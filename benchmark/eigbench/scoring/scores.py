"""From predictions and labels to the numbers of a result: means, medians, intervals."""

from __future__ import annotations

import random
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.scoring.metrics import METRICS
from eigbench.scoring.truth import Truth

RESAMPLES = 1000
COVERAGE = 0.95
BOOTSTRAP_SEED = 0


def per_mesh(truth: Truth, predictions: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return every metric of every prediction, shape (seeds, n), by the metric's key."""
    return {key: of_metric(truth, predictions, key) for key in METRICS}


def of_metric(truth: Truth, predictions: NDArray[np.float64], key: str) -> NDArray[np.float64]:
    """Return one metric of every prediction, shape (seeds, n)."""
    return np.stack([METRICS[key].function(p, truth.eigenvalues) for p in predictions])


def score(truth: Truth, predictions: NDArray[np.float64]) -> dict[str, Any]:
    """Score predictions of shape (seeds, n, k) against the labels.

    Returns
    -------
    dict
        ``overall``: for each metric the mean over meshes and seeds, the median, a 95 %
        percentile-bootstrap interval of the mean over shapes, and the standard deviation
        of the mean over seeds. ``families``: count, mean and median for each family.
        ``per_index``: mean and median relative error of each eigenvalue. Numbers that are
        not finite are ``None``; nothing is left out of a mean.

    Examples
    --------
    >>> from eigbench.scoring import truth
    >>> labels = truth.load("1.0-mini")
    >>> scores = score(labels, 1.1 * labels.eigenvalues[None])  # one seed, 10 % too large
    >>> round(scores["overall"]["rpd"]["mean"], 4), round(scores["per_index"][0]["mean"], 4)
    (0.4762, 0.1)
    """
    values = per_mesh(truth, predictions)
    weights = bootstrap_weights(truth)
    overall = {}
    for key, table in values.items():
        low, high = interval(table.mean(axis=0), truth, weights)
        means = table.mean(axis=1)
        overall[key] = {
            "mean": _number(means.mean()),
            "median": _number(np.median(table)),
            "low": _number(low),
            "high": _number(high),
            "seed_std": _spread(means),
        }
    families = {}
    for family in sorted(set(truth.families.tolist())):
        mine = truth.families == family
        families[family] = {
            "count": int(mine.sum()),
            **{
                key: {
                    "mean": _number(table[:, mine].mean()),
                    "median": _number(np.median(table[:, mine])),
                }
                for key, table in values.items()
            },
        }
    with np.errstate(invalid="ignore", over="ignore"):
        relative = np.abs(predictions - truth.eigenvalues) / truth.eigenvalues
    per_index = [
        {"mean": _number(relative[..., i].mean()), "median": _number(np.median(relative[..., i]))}
        for i in range(relative.shape[-1])
    ]
    return {"overall": overall, "families": families, "per_index": per_index}


def bootstrap_weights(truth: Truth) -> NDArray[np.float64]:
    """Draw how often each shape is taken in each resample, shape (resamples, shapes).

    Shapes are resampled, not instances: the copies of a shape are not independent. Two draws
    of one shape (a group) count as one.
    """
    return _weights(len(np.unique(truth.groups)))


@lru_cache(maxsize=32)
def _weights(count: int) -> NDArray[np.float64]:
    # Python's own generator: its stream is the same in every version, NumPy's need not be
    draw = random.Random(BOOTSTRAP_SEED).random
    drawn = np.array([draw() for _ in range(RESAMPLES * count)]).reshape(RESAMPLES, count)
    taken = (drawn * count).astype(np.int64)
    return np.array([np.bincount(row, minlength=count) for row in taken], dtype=np.float64)


def interval(
    values: NDArray[np.float64], truth: Truth, weights: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the percentile-bootstrap interval of the mean of ``values``, shape (n,)."""
    if not np.isfinite(values).all():
        return float("nan"), float("nan")
    _, shape = np.unique(truth.groups, return_inverse=True)
    sums = np.bincount(shape, weights=values)
    counts = np.bincount(shape).astype(np.float64)
    means = (weights @ sums) / (weights @ counts)
    tail = 50 * (1 - COVERAGE)
    low, high = np.percentile(means, [tail, 100 - tail])
    return float(low), float(high)


def paired_interval(
    a: NDArray[np.float64], b: NDArray[np.float64], truth: Truth, weights: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the interval of the mean difference a − b; a tie if it includes zero."""
    with np.errstate(invalid="ignore"):
        return interval(a - b, truth, weights)


def _spread(means: NDArray[np.float64]) -> float | None:
    if len(means) < 2 or not np.isfinite(means).all():
        return None
    return float(means.std(ddof=1))


def _number(value: Any) -> float | None:
    number = float(value)
    return number if np.isfinite(number) else None
