"""From predictions to the numbers of a result: means, medians and intervals, for each target."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.scoring import bootstrap, targets
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.names import TARGETS
from eigbench.scoring.truth import Truth
from synthnet import recipe

DIGITS = 3  # of the scores of a sealed set
CERTAIN = 3.0  # rule of three: where n of n succeed, the failing share is below 3/n, at 95 %


def of_metric(truth: Truth, predictions: NDArray[np.float64], key: str) -> NDArray[np.float64]:
    """Return one metric of every prediction, shape (seeds, n); those within the bar are exact."""
    return _values(truth, targets.settled(truth, predictions), key)


def _values(truth: Truth, settled: NDArray[np.float64], key: str) -> NDArray[np.float64]:
    return np.stack([METRICS[key].function(p, truth.eigenvalues) for p in settled])


def of_targets(truth: Truth, predictions: NDArray[np.float64]) -> dict[str, dict[str, Any] | None]:
    """Score predictions against every target; None where the surfaces' spectra are not known.

    Those of a sealed set have :data:`DIGITS` digits: every digit tells a little of its labels.
    """
    known = {target: targets.at(truth, target) for target in TARGETS}
    scored = {
        target: None if labels is None else score(labels, predictions)
        for target, labels in known.items()
    }
    return rounded(scored) if is_sealed(truth.version) else scored


def is_sealed(version: str) -> bool:
    """Return whether a dataset's name is that of a sealed set."""
    return recipe.parse_name(version).kind is recipe.Kind.SEALED


def rounded(numbers: Any) -> Any:
    """Return JSON-ready data with every fraction in it rounded to :data:`DIGITS` digits.

    Examples
    --------
    >>> rounded({"mean": 0.0123456, "interval": [9876.5, None], "shapes": 12345})
    {'mean': 0.0123, 'interval': [9880.0, None], 'shapes': 12345}
    """
    if isinstance(numbers, dict):
        return {key: rounded(value) for key, value in numbers.items()}
    if isinstance(numbers, list):
        return [rounded(value) for value in numbers]
    return float(f"{numbers:.{DIGITS}g}") if isinstance(numbers, float) else numbers


@np.errstate(over="ignore", invalid="ignore")  # of predictions near the ends of float64
def score(truth: Truth, predictions: NDArray[np.float64]) -> dict[str, Any]:
    """Score predictions of shape (seeds, n, k) against one target.

    Returns
    -------
    dict
        ``overall``: for each metric the mean over meshes and seeds, the median, a 95 %
        percentile-bootstrap interval of the mean over shapes and seeds, the standard deviation
        of the mean over seeds, and the mean over families of the families' means. The interval
        of a share lies within 0 and 1; of n shapes its lower end is at most 1 - 3/n, its upper end
        at least 3/n, by the rule of three.
        ``families``: count, shapes, mean and median for each family. ``per_index``: mean and
        median relative error of each eigenvalue. ``exact``: the share of spectra, over seeds,
        that are right within the bars of the target. Numbers that are not finite are ``None``;
        nothing is left out of a mean.

    Examples
    --------
    >>> from eigbench.scoring import truth
    >>> labels = truth.load("1.0-mini")
    >>> scores = score(labels, 1.1 * labels.eigenvalues[None])  # one seed, 10 % too large
    >>> round(scores["overall"]["rpd"]["mean"], 4), round(scores["per_index"][0]["mean"], 4)
    (0.4762, 0.1)
    """
    settled = targets.settled(truth, predictions)
    values = {key: _values(truth, settled, key) for key in METRICS}
    families = {
        family: _family(truth, values, family) for family in sorted(set(truth.families.tolist()))
    }
    drawn = bootstrap.resamples(truth)
    overall = {
        key: _overall(table, drawn, METRICS[key].unit == "share")
        | {"by_family": _mean_of([family[key]["mean"] for family in families.values()])}
        for key, table in values.items()
    }
    relative = np.abs(settled - truth.eigenvalues) / truth.eigenvalues
    per_index = [_middles(relative[..., i]) for i in range(relative.shape[-1])]
    exact = float((relative == 0).all(axis=-1).mean())
    return {"overall": overall, "families": families, "per_index": per_index, "exact": exact}


def _overall(
    table: NDArray[np.float64], drawn: bootstrap.Resamples, share: bool
) -> dict[str, float | None]:
    """Return the numbers of one metric over all instances, of values of shape (seeds, n)."""
    means = table.mean(axis=1)
    low = high = float("nan")
    if np.isfinite(table).all():
        low, high = bootstrap.interval(drawn.means(table))
    if share:  # the factor for few seeds may lead beyond 0 and 1
        bound = min(1.0, CERTAIN / drawn.shapes)
        low, high = min(max(low, 0.0), 1 - bound), max(min(high, 1.0), bound)
    return {
        "mean": _number(means.mean()),
        "median": _number(np.median(table)),
        "low": _number(low),
        "high": _number(high),
        "seed_std": _number(means.std(ddof=1)) if len(means) > 1 else None,
    }


def _family(truth: Truth, values: dict[str, NDArray[np.float64]], family: str) -> dict[str, Any]:
    mine = truth.families == family
    return {
        "count": int(mine.sum()),
        "shapes": len(set(truth.groups[mine].tolist())),
        **{key: _middles(table[:, mine]) for key, table in values.items()},
    }


def _middles(values: NDArray[np.float64]) -> dict[str, float | None]:
    return {"mean": _number(values.mean()), "median": _number(np.median(values))}


def _mean_of(means: list[float | None]) -> float | None:
    return _number(np.array(means, dtype=np.float64).mean())  # None becomes NaN


def _number(value: Any) -> float | None:
    number = float(value)
    return number if np.isfinite(number) else None
