r"""Finite elements of any degree on the triangles of an atlas, for spectra of smooth surfaces.

On each triangle functions are polynomials in its barycentric coordinates,

.. math::
    u = \sum_{i+j+l=p} c_{ijl}\, \frac{p!}{i!\,j!\,l!}\, \lambda_1^i \lambda_2^j \lambda_3^l,

in Bernstein's form: they are continuous where triangles share the coefficients on their common
edge, they are the constant 1 where all coefficients are, and every row of the mass matrix has a
positive sum. The surface is interpolated by polynomials of one degree more.

References
----------
M.-J. Lai, L. L. Schumaker, Spline Functions on Triangulations, Cambridge 2007, chapter 2. T.
Isaac, "Recursive, parameter-free, explicitly defined interpolation nodes for simplices", SIAM J.
Sci. Comput. 42 (2020): where the surface is interpolated.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from scipy import special

from synthnet.arrays import Floats
from synthnet.families.atlas import SAME, Atlas, Charted, lattice
from synthnet.families.limits import lobatto
from synthnet.spectrum.fem import Matrices, gathered, products


class Reference(NamedTuple):
    """What the elements of a degree p have in common, with b = (p + 1)(p + 2) / 2 functions.

    Attributes
    ----------
    nodes : ndarray of shape (g, 3), float64
        Barycentric coordinates where the surface is interpolated.
    tangents : ndarray of shape (2, q, g), float64
        From the points there to the derivatives at q points of a quadrature, in the directions
        from the first corner to the second and the third.
    stiffness : ndarray of shape (3, q, b²), float64
        Products of derivatives of two functions there: 11, 12 and 21 together, 22.
    mass : ndarray of shape (q, b²), float64
        Products of two functions there.
    weights : ndarray of shape (q,), float64
        Of the quadrature; their sum is 1/2.
    """

    nodes: Floats
    tangents: Floats
    stiffness: Floats
    mass: Floats
    weights: Floats


def assemble(atlas: Atlas, mesh: Charted, degree: int) -> Matrices:
    """Assemble stiffness and mass of a triangulation, with the natural condition on a boundary.

    Parameters
    ----------
    atlas : Atlas
        The surface, smooth on each triangle.
    mesh : Charted
        Its triangulation.
    degree : int
        Of the polynomials, at least 1.

    Returns
    -------
    Matrices
        With ``least`` of linear elements, where these have at most 1 / C(2p + 2, p): the search
        ends by a residual as usual, but that residual is no bound of an eigenvalue's error.

    Raises
    ------
    ValueError
        If a triangle has no area, or the images of two triangles do not meet in their edge.
    """
    reference = of_degree(degree)
    points = _images(atlas, mesh, degree + 1, reference.nodes)
    centred = points - points[:, :1]
    first, second = (directions @ centred for directions in reference.tangents)
    g11, g12, g22 = (
        (a * b).sum(axis=2) for a, b in ((first, first), (first, second), (second,) * 2)
    )
    squares = g11 * g22 - g12**2
    if not (squares > 0).all():
        raise ValueError("a triangle of the surface has no area")
    area = np.sqrt(squares) * reference.weights
    scale = reference.weights**2 / area
    stiff = np.stack([g22 * scale, -g12 * scale, g11 * scale], axis=1)
    m, functions = len(mesh.faces), math.isqrt(reference.mass.shape[1])
    stiffness = stiff.reshape(m, -1) @ reference.stiffness.reshape(-1, functions**2)
    numbers = mesh.numbered(degree)
    return gathered(numbers, stiffness, area @ reference.mass, int(numbers.max()) + 1)


def _images(atlas: Atlas, mesh: Charted, degree: int, nodes: Floats) -> Floats:
    """Return the surface's points at the nodes of every triangle, shape (m, g, 3)."""
    inside = nodes @ mesh.corners
    charts = np.repeat(mesh.charts, len(nodes))
    points = atlas.chart(charts, inside.reshape(-1, inside.shape[2])).reshape(-1, len(nodes), 3)
    numbers = mesh.numbered(degree)
    shared = np.empty((int(numbers.max()) + 1, 3))
    shared[numbers] = points
    apart = float(np.abs(shared[numbers] - points).max())
    if not apart <= SAME * float(np.ptp(points.reshape(-1, 3), axis=0).max()):
        raise ValueError(f"images of triangles in their common edge are {apart:.2g} apart")
    return shared[numbers]


@cache
def of_degree(degree: int) -> Reference:
    """Return what the elements of a degree have in common."""
    geometry = degree + 1
    nodes = interpolation_nodes(geometry)
    points, weights = quadrature(degree + 3)
    to_coefficients = np.linalg.inv(bernstein(geometry, nodes)[0])
    _, slopes = bernstein(geometry, points)
    tangents = slopes @ to_coefficients
    values, (d1, d2) = bernstein(degree, points)
    pairs = [products(d1, d1), products(d1, d2) + products(d2, d1), products(d2, d2)]
    return Reference(nodes, tangents, np.stack(pairs), products(values, values), weights)


def bernstein(degree: int, points: Floats) -> tuple[Floats, Floats]:
    """Return Bernstein's polynomials and their derivatives towards corners 2 and 3.

    Parameters
    ----------
    degree : int
        p.
    points : ndarray of shape (q, 3)
        Barycentric coordinates.

    Returns
    -------
    values : ndarray of shape (q, b), float64
        In the order of :func:`~synthnet.families.atlas.lattice`.
    slopes : ndarray of shape (2, q, b), float64

    Examples
    --------
    >>> values, slopes = bernstein(1, np.array([[0.5, 0.25, 0.25]]))
    >>> values.tolist(), slopes[0].tolist()
    ([[0.5, 0.25, 0.25]], [[-1.0, 0.0, 1.0]])
    """
    i, j = lattice(degree)
    powers = np.stack([degree - i - j, i, j], axis=1)
    factors = math.factorial(degree) / special.factorial(powers).prod(axis=1)
    raised = points[:, None, :] ** powers
    lowered = powers * points[:, None, :] ** np.maximum(powers - 1, 0)
    by_corner = [
        factors * lowered[:, :, c] * raised[:, :, (c + 1) % 3] * raised[:, :, (c + 2) % 3]
        for c in range(3)
    ]
    slopes = np.stack([by_corner[1] - by_corner[0], by_corner[2] - by_corner[0]])
    return factors * raised.prod(axis=2), slopes


def quadrature(n: int) -> tuple[Floats, Floats]:
    """Return n² points and weights on the triangle, exact to degree 2n − 2 (Stroud's)."""
    x, along = legendre.leggauss(n)
    y, across = special.roots_jacobi(n, 1, 0)
    x, y = (x + 1) / 2, (y + 1) / 2
    third = np.repeat(y, n)
    second = np.tile(x, n) * (1 - third)
    weights = np.outer(across, along).ravel() / 8
    return np.stack([1 - second - third, second, third], axis=1), weights


@cache
def interpolation_nodes(degree: int) -> Floats:
    """Return barycentric coordinates of nodes in the order of the lattice, shape (g, 3).

    On an edge they are Lobatto's points; inside, Isaac's weighted means of those.
    """
    i, j = lattice(degree)
    powers = np.stack([degree - i - j, i, j], axis=1)
    return np.array([_node(tuple(numbers)) for numbers in powers.tolist()])


def _node(numbers: tuple[int, ...]) -> Floats:
    if len(numbers) == 1:
        return np.ones(1)
    total = sum(numbers)
    weights = [_lobatto(total)[total - number] for number in numbers]
    node = np.zeros(len(numbers))
    for left_out, weight in enumerate(weights):
        others = [c for c in range(len(numbers)) if c != left_out]
        node[others] += weight * _node(tuple(numbers[c] for c in others))
    return np.asarray(node / sum(weights))


@cache
def _lobatto(degree: int) -> Floats:
    """Return Lobatto's points of [0, 1]."""
    return (lobatto(degree) + 1) / 2 if degree else np.array([0.5])
