r"""Laplace-Beltrami eigenvalues of smooth surfaces, of revolution and in closed form.

On a surface of revolution with the distance r(s) from the axis at arc length s the
functions u(s) cos mθ and u(s) sin mθ separate the variables:

.. math::
    -\frac{1}{r} (r u')' + \frac{m^2}{r^2} u = \lambda u, \qquad m = 0, 1, 2, \dots

with u finite on the axis, or periodic where the profile is closed, and u' = 0 (Neumann) on a
boundary, where the profile ends off the axis. Each eigenvalue of an m > 0 belongs to two
functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy import linalg

Array = NDArray[np.float64]

DEGREE = 10  # of the polynomials on an element
PIECES = 8  # elements of an arc before grading
RATIO = 3.0  # most that the radius may grow over an element that does not touch the axis
ON_AXIS = 1e-12  # of an arc's length: an end so near to the axis is on it
LAYERS = 12  # halvings of an element towards the axis


@dataclass(frozen=True, slots=True)
class Arc:
    """A smooth piece of a profile.

    Parameters
    ----------
    length : float
        Its arc length.
    radius : callable
        Distance from the axis, from arc length along the arc, arrays to arrays; positive
        but perhaps at the ends.
    """

    length: float
    radius: Callable[[Array], Array]


def line(start: float, stop: float, rise: float = 0.0) -> Arc:
    """Return the straight arc from one radius to another, ``rise`` up the axis meanwhile.

    Examples
    --------
    >>> slope = line(1.0, 0.0, rise=1.0)  # the side of a cone as high as wide
    >>> round(slope.length, 4), slope.radius(np.array([0.0, slope.length])).tolist()
    (1.4142, [1.0, 0.0])
    """
    length = math.hypot(stop - start, rise)
    return Arc(length, lambda s: start + (stop - start) * s / length)


def of_revolution(profile: Sequence[Arc], k: int, *, closed: bool = False) -> Array:
    r"""Return the first k non-zero eigenvalues of a surface of revolution.

    Polynomials of degree 10 on elements that are halved towards the axis, where a cone's
    eigenfunctions behave like :math:`s^{m/\sin\beta}`, β the half angle. A dense solver
    finds the largest :math:`1/(\lambda + \sigma)`, since grading makes the largest λ too
    large to compute with.

    Parameters
    ----------
    profile : sequence of Arc
        In order; the ends meet. The surface has a boundary where the first begins or the last
        ends off the axis, unless the profile is closed.
    k : int
        Number of eigenvalues.
    closed : bool
        Whether the last arc ends where the first begins, off the axis.

    Returns
    -------
    ndarray of shape (k,), float64
        In 1/length², ascending, with multiplicity; to a relative 1e-8.

    References
    ----------
    C. Schwab, p- and hp-Finite Element Methods, Oxford 1998, chapter 3 (grading).

    Examples
    --------
    >>> profile = [Arc(math.pi, np.sin)]
    >>> of_revolution(profile, 9).round(6)
    array([ 2.,  2.,  2.,  6.,  6.,  6.,  6.,  6., 12.])
    >>> of_revolution([line(0, 1)], 2).round(6)  # a disc: the square of J1's first maximum
    array([3.389958, 3.389958])
    """
    elements = [
        (arc, start, stop) for arc in profile for start, stop in _elements(arc, _largest(profile))
    ]
    smallest = np.zeros(0)
    m = 0
    while True:
        values = _separated(elements, m, k, closed)
        copies = values[1:] if m == 0 else np.repeat(values, 2)
        smallest = np.sort(np.concatenate([smallest, copies]))
        if len(smallest) >= k and m > 0 and values[0] > smallest[k - 1]:
            return smallest[:k]
        smallest = smallest[:k]
        m += 1


def of_sphere(radius: float, k: int) -> Array:
    r"""Return the first k non-zero eigenvalues of a sphere.

    :math:`\ell(\ell + 1)/r^2`, each :math:`2\ell + 1` times.

    Examples
    --------
    >>> of_sphere(2.0, 4)
    array([0.5, 0.5, 0.5, 1.5])
    """
    degrees = [degree for degree in range(1, k + 1) for _ in range(2 * degree + 1)]
    return np.array([degree * (degree + 1) for degree in degrees[:k]]) / radius**2


def of_rectangle(width: float, height: float, k: int) -> Array:
    r"""Return the first k non-zero eigenvalues of a rectangle with Neumann's condition.

    :math:`\pi^2 (i^2/w^2 + j^2/h^2)`.

    Examples
    --------
    >>> (of_rectangle(1.0, 1.0, 4) / math.pi**2).round(9)
    array([1., 1., 2., 4.])
    """
    return _lowest((math.pi * _upto(k) / width) ** 2, (math.pi * _upto(k) / height) ** 2, k)


def of_open_cylinder(radius: float, height: float, k: int) -> Array:
    r"""Return the first k non-zero eigenvalues of a cylinder without discs, Neumann at its ends.

    :math:`m^2/r^2 + \pi^2 j^2/h^2`, twice where m > 0.

    Examples
    --------
    >>> of_open_cylinder(1.0, math.pi, 4).round(9)
    array([1., 1., 1., 2.])
    """
    around = np.concatenate([_upto(k), _upto(k)[1:]])
    return _lowest((around / radius) ** 2, (math.pi * _upto(k) / height) ** 2, k)


def _upto(k: int) -> Array:
    return np.arange(k + 1, dtype=np.float64)


def _lowest(first: Array, second: Array, k: int) -> Array:
    """Return the k lowest sums after zero of one of each."""
    return np.sort(np.add.outer(first, second).ravel())[1 : k + 1]


def _largest(profile: Sequence[Arc]) -> float:
    return max(float(arc.radius(np.linspace(0, arc.length, 65)).max()) for arc in profile)


def _elements(arc: Arc, largest: float) -> list[tuple[float, float]]:
    """Cut an arc where its radius changes much, and in layers where it touches the axis."""

    def cut(start: float, stop: float, layers: int) -> list[tuple[float, float]]:
        least, most = sorted(arc.radius(np.array([start, stop])))
        if layers == 0 or most <= RATIO * least:
            return [(start, stop)]
        middle = (start + stop) / 2
        return cut(start, middle, layers - 1) + cut(middle, stop, layers - 1)

    ends = np.linspace(0, arc.length, PIECES + 1).tolist()
    return [piece for i in range(PIECES) for piece in cut(ends[i], ends[i + 1], LAYERS)]


@cache
def _basis() -> tuple[Array, Array, Array, Array]:
    """Gauss points and weights on [0, 1]; Lagrange polynomials of the Lobatto points there."""
    inner = legendre.legroots(legendre.legder([0] * DEGREE + [1]))
    nodes = np.concatenate([[-1], inner, [1]])
    points, weights = legendre.leggauss(DEGREE + 4)
    to_legendre = np.linalg.inv(legendre.legvander(nodes, DEGREE))
    values = legendre.legvander(points, DEGREE) @ to_legendre
    slopes = legendre.legval(points, legendre.legder(to_legendre)).T
    return (points + 1) / 2, weights / 2, values, np.asarray(2 * slopes, dtype=np.float64)


def _separated(elements: Sequence[tuple[Arc, float, float]], m: int, k: int, closed: bool) -> Array:
    """Return the first k + 1 eigenvalues of the one-dimensional problem of an m."""
    points, weights, values, slopes = _basis()
    size = len(elements) * DEGREE + 1
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for number, (arc, start, stop) in enumerate(elements):
        length = stop - start
        radius = arc.radius(start + length * points)
        here = slice(number * DEGREE, (number + 1) * DEGREE + 1)
        stiffness[here, here] += slopes.T * (weights * radius / length) @ slopes
        stiffness[here, here] += values.T * (weights * length * m**2 / radius) @ values
        mass[here, here] += values.T * (weights * length * radius) @ values
    stiffness, mass = (_joined(matrix, elements, m, closed) for matrix in (stiffness, mass))
    shift = 1 / sum(stop - start for _, start, stop in elements) ** 2
    size = len(mass)
    inverse = linalg.eigh(
        mass, stiffness + shift * mass, eigvals_only=True, subset_by_index=[size - k - 1, size - 1]
    )
    return 1 / inverse[::-1] - shift


def _joined(
    matrix: Array, elements: Sequence[tuple[Arc, float, float]], m: int, closed: bool
) -> Array:
    """Join the ends of a closed profile; take u = 0 on the axis where m > 0."""
    if closed:
        matrix[0] += matrix[-1]
        matrix[:, 0] += matrix[:, -1]
        return matrix[:-1, :-1]
    (first, start, _), (last, _, stop) = elements[0], elements[-1]
    starts_on_axis = m > 0 and first.radius(np.array([start]))[0] <= ON_AXIS * first.length
    ends_on_axis = m > 0 and last.radius(np.array([stop]))[0] <= ON_AXIS * last.length
    kept = slice(int(starts_on_axis), len(matrix) - int(ends_on_axis))
    return matrix[kept, kept]
