r"""The paper's metrics, in NumPy, and the registry that names them.

Every metric takes predictions p and labels g, arrays, tensors or lists of shape (B, k), in
1/length², and returns one value a mesh, shape (B,), float64. It raises :class:`ValueError` if they
are not both of one such shape: nothing is broadcast. A prediction that is not finite gives a value
that is not finite, and 0 in :func:`psnr_above_20`; nothing is dropped.

References
----------
Y. Wu, R. Fu, R. Peng, Q. Chen, "Graph Convolutional Networks for Learning Laplace-Beltrami
Operators", GRaM workshop at ICML 2024, PMLR 251; "the paper" below.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import wraps
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import as_reals

Array = NDArray[np.float64]

# Counts changes of the formulas and their intervals; results of other versions are not compared
METRIC_VERSION = 2
NAMES = "predictions and labels"  # in errors
ZERO = 1e-4  # of the next eigenvalue: what solvers leave of the zero is smaller
EPSILON = 1e-12  # what RPD adds; the paper says "a small non-zero constant"
ACCURATE = 20.0  # decibels of PSNR above which the paper calls a prediction accurate


def _of_rows(function: Callable[[Array, Array], Array]) -> Callable[[Any, Any], Array]:
    """Return a metric that checks what it is given, and is silent where numbers overflow."""

    @wraps(function)
    def metric(p: Any, g: Any) -> Array:
        p, g = as_reals(p, NAMES), as_reals(g, NAMES)
        check_shapes(p.shape, g.shape)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return function(p, g)

    return metric


def check_shapes(p: tuple[int, ...], g: tuple[int, ...]) -> None:
    """Check that predictions and labels have one shape, a row for each mesh.

    Raises
    ------
    ValueError
        If they have not.
    """
    if len(p) != 2 or p != g:
        raise ValueError(f"{NAMES} must both have shape (B, k), got {p} and {g}")


@_of_rows
def inverse_laplacian(p: Array, g: Array) -> Array:
    r"""Return :math:`\sqrt{\sum_i (g_i/p_i - 1)^2}`; infinite where some p is zero.

    Paper, section 3.5. It has no upper bound: one small p dominates.

    Examples
    --------
    >>> inverse_laplacian(np.array([[1.0, 4.0]]), np.array([[2.0, 4.0]]))
    array([1.])
    """
    ratio = np.where(np.isfinite(p), g / p, np.nan)  # g / inf would pass for 0
    return np.asarray(np.sqrt(((ratio - 1) ** 2).sum(axis=1)))


@_of_rows
def relative_percent_difference(p: Array, g: Array) -> Array:
    r"""Return :math:`\sum_i |p_i - g_i| / (|p_i| + |g_i| + \varepsilon)`, from 0 to k.

    Paper, section 3.4.

    Examples
    --------
    >>> relative_percent_difference(np.array([[1.0, 4.0]]), np.array([[3.0, 4.0]])).round(9)
    array([0.5])
    """
    return np.asarray((np.abs(p - g) / (np.abs(p) + np.abs(g) + EPSILON)).sum(axis=1))


@_of_rows
def polar_loss(p: Array, g: Array) -> Array:
    r"""Return :math:`1 - \langle\hat p,\hat g\rangle + \|p-g\| / (\|p\|+\|g\|)`, from 0 to 3.

    Paper, section 3.4, the numerator of the second term as printed there.

    Examples
    --------
    >>> polar_loss(np.array([[3.0, 0.0]]), np.array([[0.0, 4.0]])).round(6)
    array([1.714286])
    """
    length_p, length_g = np.linalg.norm(p, axis=1), np.linalg.norm(g, axis=1)
    cosine = (p * g).sum(axis=1) / (length_p * length_g)
    apart = np.linalg.norm(p - g, axis=1) / (length_p + length_g)
    return np.asarray(1 - np.minimum(cosine, 1) + apart)  # rounding may exceed 1


@_of_rows
def psnr(p: Array, g: Array) -> Array:
    r"""Return :math:`10 \log_{10}(R^2 / \mathrm{MSE})` in dB, R the range of the label.

    Paper, section 4.3. Infinite for an exact prediction.

    Examples
    --------
    >>> psnr(np.array([[1.0, 3.0]]), np.array([[2.0, 4.0]])).round(4)  # R² / MSE = 4
    array([6.0206])
    """
    error = ((p - g) ** 2).mean(axis=1)
    return np.asarray(10 * np.log10(np.ptp(g, axis=1) ** 2 / error))


@_of_rows
def psnr_above_20(p: Array, g: Array) -> Array:
    """Return 1 where :func:`psnr` is above 20 dB, else 0; the mean is the paper's share.

    Examples
    --------
    >>> psnr_above_20(np.array([[1.0, 3.0], [1.0, 9.9]]), np.array([[2.0, 4.0], [1.0, 10.0]]))
    array([0., 1.])
    """
    return (psnr(p, g) > ACCURATE).astype(np.float64)


@_of_rows
def l1_norm(p: Array, g: Array) -> Array:
    r"""Return :math:`\sum_i |p_i - g_i|`.

    Paper, tables 1 to 3.

    Examples
    --------
    >>> l1_norm(np.array([[1.0, 8.0]]), np.array([[4.0, 4.0]]))
    array([7.])
    """
    return np.asarray(np.abs(p - g).sum(axis=1))


@_of_rows
def l2_norm(p: Array, g: Array) -> Array:
    r"""Return :math:`\sqrt{\sum_i (p_i - g_i)^2}`.

    Paper, tables 1 to 3.

    Examples
    --------
    >>> l2_norm(np.array([[1.0, 8.0]]), np.array([[4.0, 4.0]]))
    array([5.])
    """
    return np.asarray(np.linalg.norm(p - g, axis=1))


@dataclass(frozen=True, slots=True)
class Metric:
    """A metric and how to read it.

    Parameters
    ----------
    key, title : str
        Name in files, and in tables.
    function : callable
        From (B, k) predictions and labels to (B,) values.
    higher_is_better : bool
        Direction.
    unit : str
        Unit of a value; empty for a pure number.
    decimals : int
        In tables.
    note : str
        What it is, in a sentence or two, for the columns of a board.
    """

    key: str
    title: str
    function: Callable[[Any, Any], Array]
    higher_is_better: bool
    unit: str
    decimals: int
    note: str

    @property
    def heading(self) -> str:
        """Title with an arrow to the better side: ``RPD ↓``."""
        return f"{self.title} {'↑' if self.higher_is_better else '↓'}"


# The mean of PSNR is infinite as soon as one prediction is exact: look at the median.
METRICS: dict[str, Metric] = {
    m.key: m
    for m in (
        Metric(
            *("invlap", "InvLap", inverse_laplacian, False, "", 4),
            "Inverse Laplacian: √ Σ (g/p − 1)² of prediction p and target g. It has no upper "
            "bound: one prediction that is too small can dominate the mean.",
        ),
        Metric(
            *("rpd", "RPD", relative_percent_difference, False, "", 4),
            "Relative percent difference: Σ |p − g| / (|p| + |g|), from 0 to 10. Ranks go by it.",
        ),
        Metric(
            *("polar", "PolarLoss", polar_loss, False, "", 4),
            "1 − cosine of the angle between the spectra + ‖p − g‖ / (‖p‖ + ‖g‖), from 0 to 3. "
            "The largest eigenvalues dominate it.",
        ),
        Metric(
            *("psnr", "PSNR", psnr, True, "dB", 2),
            "Peak signal-to-noise ratio of a spectrum in dB, infinite for an exact one.",
        ),
        Metric(
            *("psnr20", "PSNR>20", psnr_above_20, True, "share", 4),
            "Share of meshes whose spectrum is predicted with a PSNR above 20 dB.",
        ),
        Metric(
            *("l1", "ℓ1", l1_norm, False, "1/length²", 3),
            "Σ |p − g|. It scales as 1/length²; small shapes dominate it.",
        ),
        Metric(
            *("l2", "ℓ2", l2_norm, False, "1/length²", 3),
            "√ Σ (p − g)². It scales as 1/length²; small shapes dominate it.",
        ),
    )
}

# The paper's six, which the boards' main tables have; the others are in a row's result.
MAIN = ("invlap", "rpd", "polar", "psnr20", "l1", "l2")


def has_zero(values: NDArray[Any], count: int, k: int) -> bool:
    """Return whether these are k eigenvalues after a zero, a row for each of so many meshes.

    Examples
    --------
    >>> has_zero(np.array([[1e-15, 2.0, 2.0]]), 1, 2), has_zero(np.array([[2.0, 2.0, 6.0]]), 1, 2)
    (True, False)
    """
    if values.shape != (count, k + 1) or not np.isfinite(values[:, :2]).all():
        return False
    return bool((np.abs(values[:, 0]) < ZERO * np.abs(values[:, 1])).all())
