r"""Laplace-Beltrami eigenvalues of smooth surfaces, of revolution and in closed form.

On a surface of revolution with the distance r(s) from the axis at arc length s the
functions u(s) cos mθ and u(s) sin mθ separate the variables:

.. math::
    -\frac{1}{r} (r u')' + \frac{m^2}{r^2} u = \lambda u, \qquad m = 0, 1, 2, \dots

with u finite on the axis, or periodic where the profile is closed, and u' = 0 (Neumann) on a
boundary, where the profile ends off the axis. Each eigenvalue of an m > 0 belongs to two
functions.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy import linalg, sparse
from scipy.sparse.linalg import LinearOperator, eigsh

from synthnet.arrays import Floats
from synthnet.spectrum.fem import products

DEGREE = 10  # the polynomials on an element have this degree
PIECES = 8  # so many elements has an arc before grading
RATIO = 3.0  # most that the radius may grow over an element that does not touch the axis
ON_AXIS = 1e-12  # of an arc's length: an end so near to the axis is on it
LAYERS = 12  # so often an element is halved towards the axis
TOLERANCE = 1e-13  # relative: how well ARPACK finds eigenvalues of the inverse
KNOWN = 1e-8  # every limit of this file has a smaller relative error


@dataclass(frozen=True, slots=True)
class Limit:
    """The spectrum of a smooth or polyhedral surface.

    Parameters
    ----------
    eigenvalues : ndarray of shape (k,), float64
        The first after zero, in 1/length², ascending, with multiplicity.
    bar : ndarray of shape (k,), float64
        How far each may be from the true one, in 1/length².
    """

    eigenvalues: Floats
    bar: Floats


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
    radius: Callable[[Floats], Floats]


def extrapolate(coarse: Floats, fine: Floats) -> Floats:
    r"""Return the limits of eigenvalues of linear elements, which approach them like h².

    .. math::
        \lambda \approx \lambda_{h/2} + (\lambda_{h/2} - \lambda_h) / 3

    By index, so it is wrong where eigenvalues cross from one mesh to the other.

    Parameters
    ----------
    coarse, fine : ndarray of shape (k,), float64
        The eigenvalues of meshes of step h and h/2.

    Examples
    --------
    >>> extrapolate(np.array([2.4]), np.array([2.1])).round(12)
    array([2.])
    """
    return fine + (fine - coarse) / 3


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


def of_revolution(profile: Sequence[Arc], k: int, *, closed: bool = False) -> Floats:
    r"""Return the first k non-zero eigenvalues of a surface of revolution.

    Polynomials of degree 10 on elements that are halved towards the axis, where a cone's
    eigenfunctions behave like :math:`s^{m/\sin\beta}`, β the half angle. Lanczos's method
    finds the largest :math:`1/(\lambda + \sigma)`, since grading makes the largest λ too
    large to compute with, by a factorisation as narrow as an element.

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
    bands = _bands(profile)
    smallest = np.zeros(0)
    m, needed = 0, k + 1
    while needed:
        values = _closed(bands, m, needed) if closed else _open(bands, m, needed)
        copies = values[1:] if m == 0 else np.repeat(values, 2)
        smallest = np.sort(np.concatenate([smallest, copies]))[:k]
        # The j-th eigenvalue grows with m: the next m has no more below the k-th of all.
        needed = int(np.count_nonzero(values <= smallest[-1])) if len(smallest) == k else k
        m += 1
    return smallest


def of_corners(corners: Sequence[tuple[float, float]], k: int, *, closed: bool = False) -> Floats:
    """Do what :func:`of_revolution` does for lines from each (radius, height) to the next."""
    profile = [line(start[0], stop[0], stop[1] - start[1]) for start, stop in pairwise(corners)]
    return of_revolution(profile, k, closed=closed)


def of_sphere(radius: float, k: int) -> Floats:
    r"""Return the first k non-zero eigenvalues of a sphere.

    :math:`\ell(\ell + 1)/r^2`, each :math:`2\ell + 1` times.

    Examples
    --------
    >>> of_sphere(2.0, 4)
    array([0.5, 0.5, 0.5, 1.5])
    """
    degrees = [degree for degree in range(1, k + 1) for _ in range(2 * degree + 1)]
    return np.array([degree * (degree + 1) for degree in degrees[:k]]) / radius**2


def of_rectangle(width: float, height: float, k: int) -> Floats:
    r"""Return the first k non-zero eigenvalues of a rectangle with Neumann's condition.

    :math:`\pi^2 (i^2/w^2 + j^2/h^2)`.

    Examples
    --------
    >>> (of_rectangle(1.0, 1.0, 4) / math.pi**2).round(9)
    array([1., 1., 2., 4.])
    """
    return _lowest((math.pi * _upto(k) / width) ** 2, (math.pi * _upto(k) / height) ** 2, k)


def of_open_cylinder(radius: float, height: float, k: int) -> Floats:
    r"""Return the first k non-zero eigenvalues of a cylinder without discs, Neumann at its ends.

    :math:`m^2/r^2 + \pi^2 j^2/h^2`, twice where m > 0.

    Examples
    --------
    >>> of_open_cylinder(1.0, math.pi, 4).round(9)
    array([1., 1., 1., 2.])
    """
    around = np.concatenate([_upto(k), _upto(k)[1:]])
    return _lowest((around / radius) ** 2, (math.pi * _upto(k) / height) ** 2, k)


def _upto(k: int) -> Floats:
    return np.arange(k + 1, dtype=np.float64)


def _lowest(first: Floats, second: Floats, k: int) -> Floats:
    """Return the k lowest sums after zero of one of each."""
    return np.sort(np.add.outer(first, second).ravel())[1 : k + 1]


def _elements(arc: Arc) -> list[tuple[float, float]]:
    """Cut an arc where its radius changes much, and in layers where it touches the axis."""

    def cut(start: float, stop: float, layers: int) -> list[tuple[float, float]]:
        least, most = sorted(arc.radius(np.array([start, stop])))
        if layers == 0 or most <= RATIO * least:
            return [(start, stop)]
        middle = (start + stop) / 2
        return cut(start, middle, layers - 1) + cut(middle, stop, layers - 1)

    ends = np.linspace(0, arc.length, PIECES + 1).tolist()
    return [piece for i in range(PIECES) for piece in cut(ends[i], ends[i + 1], LAYERS)]


class Bands(NamedTuple):
    """The matrices of a profile, of every m: A = stiffness + m² around, and B = mass.

    Attributes
    ----------
    stiffness, around, mass : ndarray of shape (DEGREE + 1, n), float64
        Entry (i + d, i) of a symmetric matrix at [d, i].
    shift : float
        σ > 0, in 1/length²: A + σB is factorised.
    on_axis : tuple of bool
        Whether the first, and the last, of the n points is on the axis.
    """

    stiffness: Floats
    around: Floats
    mass: Floats
    shift: float
    on_axis: tuple[bool, bool]


def _bands(profile: Sequence[Arc]) -> Bands:
    """Assemble the matrices on the elements of all arcs."""
    points, weights, values, slopes = _basis()
    pairs = (products(slopes, slopes), products(values, values), products(values, values))
    blocks: list[list[Floats]] = [[], [], []]
    for arc in profile:
        start, stop = np.array(_elements(arc)).T
        length = (stop - start)[:, None]
        radius = arc.radius(start[:, None] + length * points)
        integrands = (
            weights * radius / length,
            weights * length / radius,
            weights * length * radius,
        )
        for block, integrand, product in zip(blocks, integrands, pairs, strict=True):
            block.append(integrand @ product)
    first, last = profile[0], profile[-1]
    stiffness, around, mass = (_banded(np.concatenate(block)) for block in blocks)
    return Bands(
        stiffness,
        around,
        mass,
        shift=1 / sum(arc.length for arc in profile) ** 2,
        on_axis=(
            bool(first.radius(np.zeros(1))[0] <= ON_AXIS * first.length),
            bool(last.radius(np.array([last.length]))[0] <= ON_AXIS * last.length),
        ),
    )


def _banded(blocks: Floats) -> Floats:
    """Add up the elements' matrices, shape (e, (DEGREE + 1)²); neighbours share a point."""
    blocks = blocks.reshape(-1, DEGREE + 1, DEGREE + 1)
    bands = np.zeros((DEGREE + 1, len(blocks) * DEGREE + 1))
    for i in range(DEGREE + 1):
        for j in range(i + 1):
            bands[i - j, j : j + (len(blocks) - 1) * DEGREE + 1 : DEGREE] += blocks[:, i, j]
    return bands


@cache
def lobatto(degree: int) -> Floats:
    """Return Lobatto's points of [-1, 1], one more than the degree, which is at least 1."""
    inner = legendre.legroots(legendre.legder([0] * degree + [1]))
    return np.concatenate([[-1.0], inner, [1.0]])


@cache
def _basis() -> tuple[Floats, Floats, Floats, Floats]:
    """Gauss points and weights on [0, 1]; Lagrange polynomials of the Lobatto points there."""
    nodes = lobatto(DEGREE)
    points, weights = legendre.leggauss(DEGREE + 4)
    to_legendre = np.linalg.inv(legendre.legvander(nodes, DEGREE))
    values = legendre.legvander(points, DEGREE) @ to_legendre
    slopes = legendre.legval(points, legendre.legder(to_legendre)).T
    return (points + 1) / 2, weights / 2, values, np.asarray(2 * slopes, dtype=np.float64)


def _open(bands: Bands, m: int, count: int) -> Floats:
    """Return the first eigenvalues of an m; u = 0 on the axis if m > 0."""
    size = bands.mass.shape[1]
    kept = slice(int(m > 0 and bands.on_axis[0]), size - int(m > 0 and bands.on_axis[1]))
    mass = bands.mass[:, kept]
    factor = linalg.cholesky_banded(
        bands.stiffness[:, kept] + m**2 * bands.around[:, kept] + bands.shift * mass,
        lower=True,
        check_finite=False,
    )
    weighted = _symmetric(mass).tocsr()
    size = mass.shape[1]
    operator: LinearOperator[Any] = LinearOperator(
        (size, size),
        matvec=lambda vector: linalg.cho_solve_banded((factor, True), vector, check_finite=False),
        dtype=np.float64,
    )
    values = eigsh(
        weighted,  # not used: ARPACK takes A from the factorisation alone
        count,
        weighted,
        sigma=-bands.shift,
        OPinv=operator,
        v0=np.random.default_rng(0).random((size,)) - 0.5,
        ncv=min(size, max(2 * count + 1, 16)),
        tol=TOLERANCE,
        return_eigenvectors=False,
    )
    return np.sort(values)


def _closed(bands: Bands, m: int, count: int) -> Floats:
    """Return the first eigenvalues of an m on a closed profile.

    Dense: pairs next to each other, which a symmetric profile has, are not told apart by Lanczos.
    """
    matrices = bands.stiffness + m**2 * bands.around, bands.mass
    stiffness, mass = (_joined(_symmetric(matrix).toarray()) for matrix in matrices)
    size = len(mass)
    inverse = linalg.eigh(
        mass,
        stiffness + bands.shift * mass,
        eigvals_only=True,
        subset_by_index=[size - count, size - 1],
    )
    return np.asarray(1 / inverse[::-1] - bands.shift)


def _symmetric(bands: Floats) -> sparse.dia_array:
    below = [band[: len(band) - d] for d, band in enumerate(bands)]
    offsets = [*range(0, -DEGREE - 1, -1), *range(1, DEGREE + 1)]
    return sparse.diags_array([*below, *below[1:]], offsets=offsets)


def _joined(matrix: Floats) -> Floats:
    """Make the last point of a closed profile the first."""
    matrix[0] += matrix[-1]
    matrix[:, 0] += matrix[:, -1]
    return matrix[:-1, :-1]
