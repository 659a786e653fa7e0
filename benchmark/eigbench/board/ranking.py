"""Which of several predictors is better, and between which ranks each of them is.

Two predictors differ in a metric if the 95 % bootstrap interval of their paired difference, by
shapes within families and by seeds, excludes zero by more than the bars of the target could make
(:mod:`eigbench.scoring.targets`). On a board each row is compared with every other ranked row, with
Holm's correction for their number: its rank is at least 1 + the number of rows that are
significantly better, and at most the number of rows that are not significantly worse. So the true
rank of a row is in its interval with a chance of 95 %. A row that is significantly better or worse
moves the others by one place, and makes Holm's correction of their comparisons a little stricter.
On a board of fewer than five shapes no difference is significant.

Rows all of whose answers are right within the bars are exact. Nothing but rounding tells them
apart: they stand above the ranking, the faster against LaPy first, and the others are ranked
from 1.

References
----------
M. Mogstad, J. P. Romano, A. M. Shaikh, D. Wilhelm, "Inference for Ranks with Applications to
Mobility across Neighbourhoods and Academic Achievement across Countries", Review of Economic
Studies 91 (2024).
"""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.results.verification import is_verified
from eigbench.scoring import bootstrap, scores, targets
from eigbench.scoring.bootstrap import FEWEST
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.truth import Truth

FEW = "few shapes"  # makes no verdict, which is not a tie
RANKED_BY = "rpd"  # bounded, free of scale, and no share that saturates


@dataclass(frozen=True, slots=True)
class Difference:
    """The paired difference of two predictors in one metric.

    From ``low`` to ``high`` is the 95 % percentile-bootstrap interval over shapes and seeds of the
    mean of a − b; both are NaN where a value is not finite.
    """

    a: float  #: mean of the one
    b: float  #: mean of the other
    low: float
    high: float
    #: What the bars of the target could make of a difference; None where not known (PSNR).
    floor: float | None
    verdict: str  #: which is better, ``a`` or ``b``, or else ``tie``
    #: What makes a tie, else empty. ``equal`` values, ``few shapes`` (fewer than five), the
    #: ``interval``, the ``floor``, or ``not finite`` where both have such values.
    why: str


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """How far another row of the board is from a row.

    From ``low`` to ``high`` is the 95 % percentile-bootstrap interval of the mean over shapes and
    seeds; both are NaN where a value is not finite.
    """

    slug: str  #: of the other row
    #: The other's mean minus that of the row; NaN or infinite where a value is not finite.
    mean: float
    low: float
    high: float
    #: Whether the two differ after Holm's correction: for a ranked row, its rank follows from this.
    #: Ranked rows are corrected among each other, rows without a rank among theirs.
    sure: bool


@dataclass(frozen=True, slots=True)
class Ranked:
    """A submission at a target, and between which ranks it is."""

    submission: Submission  #: with the truth of the target
    #: The first and the last of its interval, from 1; None where it is exact or declared.
    ranks: tuple[int, int] | None
    apart: Sequence[PairedDifference] = ()  #: every other row of the board, in the board's order
    exact: bool = False  #: whether every answer is right within the bars of the target
    #: Whether it is on its author's word, on a board that has verified rows. It stands below
    #: these, without a rank and a speed.
    declared: bool = False

    @property
    def scores(self) -> dict[str, Any]:
        """Its scores at the target."""
        return self.submission.scores

    @property
    def cost(self) -> dict[str, Any] | None:
        """What its run cost, as a result's ``cost``; None where it is declared."""
        return None if self.declared else self.submission.result["cost"]

    @property
    def shown_rank(self) -> str:
        """The rank as it is shown: ``exact``, ``3``, ``3–5``, or ``declared`` for none."""
        if self.declared:
            return "declared"
        if self.ranks is None:
            return "exact"
        return "–".join(str(rank) for rank in dict.fromkeys(self.ranks))


@np.errstate(over="ignore", invalid="ignore")  # of predictions near the ends of float64
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


@np.errstate(over="ignore", invalid="ignore")  # of predictions near the ends of float64
def difference(a: Submission, b: Submission, key: str, family: str | None = None) -> Difference:
    """Return the paired difference a − b of a metric, over all or in one family.

    Where a mean is not finite, the better mean is better, and NaN is the worst. An infinite PSNR,
    which one exact spectrum makes, is the best.

    Raises
    ------
    EigbenchError
        If the two do not predict the same instances at the same target.
    """
    if a.truth.digest != b.truth.digest:
        raise EigbenchError(
            f"{a.result_path} and {b.result_path} predict other instances: compare results of "
            "one dataset, split and protocol, whole or with the same --limit"
        )
    truth = a.truth if family is None else a.truth.take(a.truth.families == family)
    chosen = slice(None) if family is None else a.truth.families == family
    x, y = (
        scores.of_metric(submission.truth, submission.predictions, key)[:, chosen]
        for submission in (a, b)
    )
    floor = targets.floor(truth, key)
    means = float(x.mean()), float(y.mean())
    drawn = bootstrap.resamples(truth)
    if not np.isfinite(means).all():
        sign = 1 if METRICS[key].higher_is_better else -1
        good_a, good_b = (-np.inf if np.isnan(mean) else sign * mean for mean in means)
        why = FEW if drawn.shapes < FEWEST else "not finite" if good_a == good_b else ""
        verdict = "tie" if why else "ab"[good_a < good_b]
        return Difference(*means, np.nan, np.nan, floor, verdict, why)
    low, high = bootstrap.interval(drawn.means(x, a.slug) - drawn.means(y, b.slug))
    why = ""
    if not np.isfinite((low, high)).all():
        return Difference(*means, np.nan, np.nan, floor, "tie", "not finite")
    if x.shape == y.shape and np.array_equal(x, y):
        why, low, high = "equal", 0.0, 0.0
    elif drawn.shapes < FEWEST:
        why = FEW
    elif low <= 0 <= high:
        why = "interval"
    elif max(low, -high) <= 2 * (floor or 0):  # each of the two may be off by the floor
        why = "floor"
    better = "a" if (low > 0) == METRICS[key].higher_is_better else "b"
    return Difference(*means, low, high, floor, "tie" if why else better, why)


def ranked(submissions: Sequence[Submission]) -> list[Ranked]:
    """Return the submissions with their ranks: the exact ones first, then the best mean first.

    The exact ones have no rank. They are in the order of their speed against LaPy, which may be
    compared between machines; those that were not timed beside it follow, by milliseconds. Where
    some are verified, these alone are ranked, and the others stand below them in the same order;
    where none is, all are. The order of the input does not matter.
    """
    verified = {s.result_path for s in submissions if is_verified(s.result)}
    below = {s.result_path for s in submissions if verified and s.result_path not in verified}
    exact = {s.result_path for s in submissions if s.scores["exact"] == 1}

    def order(submission: Submission) -> tuple[bool, bool, float, float, str]:
        declared = submission.result_path in below
        if submission.result_path in exact:
            cost = submission.result["cost"]
            ratio = (cost.get("reference") or {}).get("ratio", 0.0)
            speed = (0.0, 0.0) if declared else (-ratio, cost["ms_per_mesh"])
            return declared, False, *speed, submission.slug
        mean = submission.scores["overall"][RANKED_BY]["mean"]
        return declared, True, (np.inf if mean is None else mean), 0.0, submission.slug

    rows = sorted(submissions, key=order)
    means, resampled = _resampled(rows)
    floor = _floor(rows[0].truth) if rows else 0.0
    unranked = {s.slug for s in submissions if s.result_path in below | exact}
    placed = []
    for i, row in enumerate(rows):
        apart = _apart(i, rows, means, resampled, floor, unranked)
        ranks = None
        if row.slug not in unranked:
            beside = [a.mean if a.sure else 0.0 for a in apart if a.slug not in unranked]
            better, worse = sum(mean < 0 for mean in beside), sum(mean > 0 for mean in beside)
            ranks = (1 + better, 1 + len(beside) - worse)
        declared = row.result_path in below
        placed.append(Ranked(row, ranks, apart, row.result_path in exact, declared))
    return placed


def count_ranked(rows: Sequence[Ranked]) -> int:
    """Return how many rows of a board have a rank."""
    return sum(row.ranks is not None for row in rows)


def _floor(truth: Truth) -> float:
    """Return the least difference of two rows; infinite where the shapes are too few to tell."""
    if bootstrap.resamples(truth).shapes < FEWEST:
        return np.inf
    return 2 * (targets.floor(truth, RANKED_BY) or 0)


def _resampled(rows: Sequence[Submission]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return each row's mean, (rows,), and its resampled means, (rows, RESAMPLES).

    Both are infinite for a row with a value that is not finite.
    """
    means = np.full(len(rows), np.inf)
    resampled = np.full((len(rows), bootstrap.RESAMPLES), np.inf)
    drawn = bootstrap.resamples(rows[0].truth) if rows else None
    for i, row in enumerate(rows):
        values = scores.of_metric(row.truth, row.predictions, RANKED_BY)
        if drawn is not None and np.isfinite(values).all():
            means[i], resampled[i] = values.mean(), drawn.means(values, row.slug)
    return means, resampled


def _apart(
    i: int,
    rows: Sequence[Submission],
    means: NDArray[np.float64],
    resampled: NDArray[np.float64],
    floor: float,
    unranked: Set[str],
) -> list[PairedDifference]:
    """Compare a row with every other one; those named by ``unranked`` have no rank."""
    others = [j for j in range(len(rows)) if j != i]
    with np.errstate(invalid="ignore"):
        apart = means - means[i]
        drawn = {j: resampled[j] - resampled[i] for j in others}
    sure: dict[int, bool] = {}
    for without in (False, True):
        group = [j for j in others if (rows[j].slug in unranked) == without]
        holm = bootstrap.holm([_p_value(apart[j], drawn[j], floor) for j in group])
        sure |= dict(zip(group, holm, strict=True))
    known = {j: np.isfinite(drawn[j]).all() for j in others}
    intervals = {j: bootstrap.interval(drawn[j]) if known[j] else (np.nan, np.nan) for j in others}
    return [PairedDifference(rows[j].slug, float(apart[j]), *intervals[j], sure[j]) for j in others]


def _p_value(apart: float, resampled: NDArray[np.float64], floor: float) -> float:
    """Return the p-value of a difference that must be larger than the floor."""
    if np.isnan(apart) or abs(apart) <= floor:  # NaN: both are infinite
        return 1.0
    if np.isinf(apart):
        return 0.0
    return bootstrap.two_sided(resampled - np.sign(apart) * floor)
