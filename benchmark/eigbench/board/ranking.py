"""Which of several predictors is better, and which are statistically tied.

Two predictors tie in a metric if the 95 % paired bootstrap interval of their difference
includes zero (too few shapes), or if their difference is below the noise floor of the metric
(labels too coarse), see :mod:`eigbench.scoring.noise`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring import noise, scores
from eigbench.scoring.metrics import METRICS

RANKED_BY = "rpd"  # bounded, free of scale, and no share that saturates


@dataclass(frozen=True, slots=True)
class Difference:
    """The paired difference of two predictors in one metric.

    Parameters
    ----------
    a, b : float
        Their means.
    low, high : float
        95 % percentile-bootstrap interval over shapes of the mean of a − b; NaN where a
        value is not finite.
    floor : float or None
        Noise floor of the metric; None where there is none.
    verdict : str
        ``a``, ``b`` or ``tie``: which is better.
    why : str
        What makes a tie, else empty: ``equal`` values, the ``interval``, the ``floor``, or ``not
        finite`` where both have such values.
    """

    a: float
    b: float
    low: float
    high: float
    floor: float | None
    verdict: str
    why: str


@dataclass(frozen=True, slots=True)
class Ranked:
    """A submission and its rank: one in a group of 2 shares its rank with another."""

    submission: Submission
    rank: int
    group: int

    @property
    def shown_rank(self) -> str:
        """The rank as it is shown: ``3``, or ``3=`` where it is shared."""
        return f"{self.rank}{'=' if self.group > 1 else ''}"


def per_mesh(submission: Submission, key: str) -> NDArray[np.float64]:
    """Return a metric of each instance, mean over seeds, shape (n,)."""
    table = scores.of_metric(submission.truth, submission.predictions, key)
    return np.asarray(table.mean(axis=0))


def at_quantile(errors: NDArray[np.float64], quantile: float) -> int:
    """Return where a quantile of errors is reached; of equal ones the first.

    Examples
    --------
    >>> at_quantile(np.array([0.3, 0.1, 0.9]), 1.0), at_quantile(np.array([0.3, 0.1, 0.9]), 0.5)
    (2, 0)
    """
    ordered = np.argsort(errors, kind="stable")
    return int(ordered[round(quantile * (len(errors) - 1))])


def difference(a: Submission, b: Submission, key: str, family: str | None = None) -> Difference:
    """Return the paired difference a − b of a metric, over all or in one family.

    Raises
    ------
    EigbenchError
        If the two do not predict the same instances.
    """
    if a.truth.digest != b.truth.digest:
        raise EigbenchError(
            f"{a.result_path} and {b.result_path} predict other instances: compare results of "
            "one dataset, split and protocol"
        )
    truth = a.truth if family is None else a.truth.take(a.truth.families == family)
    chosen = slice(None) if family is None else a.truth.families == family
    x, y = per_mesh(a, key)[chosen], per_mesh(b, key)[chosen]
    low, high = scores.paired_interval(x, y, truth, scores.bootstrap_weights(truth))
    floor = noise.floor(truth, key)
    verdict, why = _verdict(x, y, (low, high), floor, key)
    return Difference(float(x.mean()), float(y.mean()), low, high, floor, verdict, why)


def _verdict(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    interval: tuple[float, float],
    floor: float | None,
    key: str,
) -> tuple[str, str]:
    """Return which is better, and what makes a tie."""
    bad_x, bad_y = not np.isfinite(x).all(), not np.isfinite(y).all()
    if bad_x or bad_y:  # what is not finite is worse than what is
        return ("tie", "not finite") if bad_x and bad_y else ("b" if bad_x else "a", "")
    if np.array_equal(x, y):
        return "tie", "equal"
    low, high = interval
    if low <= 0 <= high:
        return "tie", "interval"
    if abs(x.mean() - y.mean()) < (floor or 0):
        return "tie", "floor"
    return ("a" if (low > 0) == METRICS[key].higher_is_better else "b"), ""


def ranked(submissions: Sequence[Submission], key: str = RANKED_BY) -> list[Ranked]:
    """Return the submissions best first, in tie groups.

    Each group runs, in order of the mean, until a row differs from its best. The order of the
    input does not matter.
    """
    sign = -1 if METRICS[key].higher_is_better else 1

    def order(submission: Submission) -> tuple[float, str]:
        mean = submission.result["scores"]["overall"][key]["mean"]
        return (np.inf if mean is None else sign * mean), submission.slug

    left = sorted(submissions, key=order)
    rows: list[Ranked] = []
    while left:
        first = left[0]
        size = 1
        while size < len(left) and difference(first, left[size], key).verdict == "tie":
            size += 1
        rank = len(rows) + 1
        rows += [Ranked(submission, rank, size) for submission in left[:size]]
        left = left[size:]
    return rows
