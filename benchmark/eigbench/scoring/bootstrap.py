"""Intervals of means, by a bootstrap over shapes within each family, and over seeds.

Shapes are resampled, not instances: the copies of a shape are not independent, and two draws of
one shape (a group) count as one. Each family keeps its number of shapes; families with fewer than
five are resampled together. Where a model has several seeds, these are resampled too.

References
----------
B. Efron, R. J. Tibshirani, "An Introduction to the Bootstrap" (1993), chapters 13 and 15. J. N. K.
Rao, C. F. J. Wu, "Resampling inference with complex survey data", JASA 83 (1988), for the factor
that a resample of few seeds needs.
"""

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eigbench.scoring.truth import Truth

RESAMPLES = 4000
COVERAGE = 0.95
FEWEST = 5  # shapes from which a family is resampled by itself, and has a verdict of its own

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Resamples:
    """How often each shape is taken in each resample."""

    group: NDArray[np.int64]  #: the group of equal shapes of each instance, shape (n,)
    weights: Array  #: whole numbers, shape (RESAMPLES, groups)

    @property
    def shapes(self) -> int:
        """The number of groups."""
        return int(self.weights.shape[1])

    def means(self, values: Array, name: str = "") -> Array:
        """Return the mean of each resample, shape (RESAMPLES,).

        Parameters
        ----------
        values : ndarray of shape (seeds, n), float64
            Finite values of each instance, one row per seed.
        name : str
            Of the model: models draw their seeds apart, each always the same.
        """
        counts = np.bincount(self.group, minlength=self.shapes).astype(np.float64)
        sums = np.stack([np.bincount(self.group, row, self.shapes) for row in values])
        by_seed = (self.weights @ sums.T) / (self.weights @ counts)[:, None]
        return np.asarray((by_seed * _seed_weights(len(values), name)).sum(axis=1))


def resamples(truth: Truth) -> Resamples:
    """Draw the resamples of a truth's shapes, the same in every run and on every machine."""
    _, first, group = np.unique(truth.groups, return_index=True, return_inverse=True)
    _, family, sizes = np.unique(truth.families[first], return_inverse=True, return_counts=True)
    strata = np.where(sizes[family] < FEWEST, -1, family)
    return Resamples(group, _weights(tuple(strata.tolist())))


@lru_cache(maxsize=8)
def _weights(strata: Sequence[int]) -> Array:
    """Draw within strata, of which each group has a number."""
    count = len(strata)
    order = np.argsort(strata, kind="stable")
    _, start, stratum, sizes = np.unique(
        np.array(strata)[order], return_index=True, return_inverse=True, return_counts=True
    )
    drawn = _uniform(0, RESAMPLES * count).reshape(RESAMPLES, count)
    taken = order[start[stratum] + (drawn * sizes[stratum]).astype(np.int64)]
    flat = (taken + count * np.arange(RESAMPLES)[:, None]).ravel()
    return np.bincount(flat, minlength=RESAMPLES * count).reshape(RESAMPLES, count).astype(float)


@lru_cache(maxsize=64)
def _seed_weights(count: int, name: str) -> Array:
    """Return the weight of each seed in each resample, shape (RESAMPLES, count); rows add to 1.

    Resampling s seeds gives (s − 1) / s of their variance, so deviations from equal weights are
    enlarged by √(s / (s − 1)).
    """
    if count == 1:
        return np.ones((RESAMPLES, 1))
    drawn = _uniform(zlib.crc32(name.encode()) + 1, RESAMPLES * count)
    taken = (drawn * count).astype(np.int64).reshape(RESAMPLES, count)
    shares = np.stack([(taken == seed).mean(axis=1) for seed in range(count)], axis=1)
    return np.asarray(1 / count + np.sqrt(count / (count - 1)) * (shares - 1 / count))


def _uniform(seed: int, count: int) -> Array:
    """Draw from [0, 1) by the raw stream of a bit generator, which NumPy promises not to change."""
    raw = np.random.PCG64(seed).random_raw(count)
    return np.asarray((raw >> np.uint64(11)) * 2.0**-53)


def interval(means: Array) -> tuple[float, float]:
    """Return the percentile interval of resampled means, shape (n,)."""
    tail = 50 * (1 - COVERAGE)
    low, high = np.percentile(means, [tail, 100 - tail])
    return float(low), float(high)


def two_sided(means: Array) -> float:
    """Return the p-value of resampled mean differences, shape (n,): twice the share beyond zero.

    Where none is beyond, it is the smaller of 2 / (n + 1) and the tail of a normal distribution
    with their mean and deviation: a board of a hundred rows and more asks for smaller p-values than
    n resamples can show. That tail is an estimate, and too small for very skewed differences.

    Examples
    --------
    >>> two_sided(np.array([0.1, 0.2, 0.3, -0.1])), two_sided(np.zeros(4))
    (0.8, 1.0)
    >>> round(two_sided(np.array([0.1, 0.3])), 4)  # two deviations from zero
    0.0455
    """
    beyond = min(np.count_nonzero(means <= 0), np.count_nonzero(means >= 0))
    counted = min(1.0, float(2 * (beyond + 1) / (len(means) + 1)))
    deviation = float(means.std())
    if beyond or deviation == 0:
        return counted
    return min(counted, math.erfc(abs(float(means.mean())) / deviation / math.sqrt(2)))


def holm(p: Sequence[float]) -> list[bool]:
    """Return which hypotheses are rejected, the chance of any error being at most ``1 - COVERAGE``.

    A hypothesis that is rejected anyway does not change what becomes of the others.

    References
    ----------
    S. Holm, "A simple sequentially rejective multiple test procedure", Scand. J. Stat. 6 (1979).

    Examples
    --------
    >>> holm([0.04, 0.001, 0.02]), holm([0.04, 0.03])
    ([True, True, True], [False, False])
    """
    rejected = [False] * len(p)
    for left, i in enumerate(sorted(range(len(p)), key=p.__getitem__)):
        if p[i] > (1 - COVERAGE) / (len(p) - left):
            break
        rejected[i] = True
    return rejected
