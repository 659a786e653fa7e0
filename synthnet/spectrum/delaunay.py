"""Linear elements on the intrinsic Delaunay triangulation of a surface: same points, better edges.

The surface stays the flat triangles that it is. Edges are flipped on it, not in space: an edge of
two triangles becomes the other diagonal of the quadrangle that they are when unfolded. Where no two
angles opposite an edge add up to more than π, no entry of the stiffness off the diagonal is
positive, and of all triangulations of these points, gradients are smallest.

References
----------
A. I. Bobenko, B. A. Springborn, "A discrete Laplace–Beltrami operator for simplicial surfaces",
Discrete & Computational Geometry 38 (2007). M. Fisher, B. Springborn, P. Schröder, A. I. Bobenko,
"An algorithm for the construction of intrinsic Delaunay triangulations with applications to
digital geometry processing", Computing 81 (2007).
"""

import numpy as np

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.kernels import kernel
from synthnet.mesh.adjacency import edge_keys, joined_half_edges
from synthnet.mesh.geometry import MeshFacts, corner_edges
from synthnet.spectrum.fem import REMEDY, Matrices, gathered
from synthnet.types import Mesh

ROUNDING = 1e-12  # relative: an edge whose angles add up to π but for this stays
MOST_FLIPS = 100  # for each face; a few are usual


def assemble(mesh: Mesh) -> tuple[Matrices, float]:
    """Return stiffness and consistent mass on the intrinsic Delaunay triangulation.

    And the largest relative error of an area, in rounding units, see :func:`_area_error`.

    Parameters
    ----------
    mesh : Mesh
        In which every vertex belongs to a face.

    Raises
    ------
    ValueError
        If an edge has more than two faces, or a triangle has no area that flips do not take away.
    """
    corners, lengths = triangulate(mesh)
    a, b, c = np.sort(lengths, axis=1).T[::-1]  # Kahan's form of Heron's
    product = (a + (b + c)) * (c - (a - b)) * (c + (a - b)) * (a + (b - c))
    areas = np.sqrt(np.maximum(product, 0.0)) / 4
    flat = int(np.count_nonzero(~(areas > 0)))
    if flat:
        raise ValueError(f"{flat} of {len(areas)} intrinsic triangles have no area: {REMEDY}")
    squares = lengths**2
    # Of the edge from corner i to i + 1, half the cotangent of the angle opposite
    weights = (squares.sum(axis=1, keepdims=True) - 2 * squares) / (8 * areas[:, None])
    stiffness, mass = np.zeros((2, len(areas), 3, 3))
    for i in range(3):
        j = (i + 1) % 3
        stiffness[:, i, j] = stiffness[:, j, i] = -weights[:, i]
        stiffness[:, i, i] += weights[:, i]
        stiffness[:, j, j] += weights[:, i]
    mass[:] = (1 + np.eye(3)) / 12 * areas[:, None, None]
    error = _area_error(mesh, corners, squares.max(axis=1) ** 0.5, areas)
    return gathered(corners, stiffness, mass, len(mesh.vertices)), error


def _area_error(mesh: Mesh, corners: Int64s, longest: Floats, areas: Floats) -> float:
    """Return the largest relative error of an intrinsic triangle's area, in rounding units.

    A length that is off by so much of itself moves an area by the square of the longest edge over
    the altitude. An altitude of a triangle that is flipped away is off by the same in relation to
    itself, or if that is more, by the root of a unit in relation to the edge; and with it the new
    edge. What errors do to each other along a chain of flips is left out.
    """
    altitudes = 2 * areas / longest
    error = float((longest / altitudes).max()) ** 2
    flipped = (corners != mesh.faces).any(axis=1)
    if flipped.any():
        old = Mesh(mesh.vertices, mesh.faces[flipped])
        edges = np.sqrt(np.square(corner_edges(old)).sum(axis=2).max(axis=1))
        off = edges / np.maximum(MeshFacts(old).relative_altitudes, np.finfo(np.float64).eps ** 0.5)
        error = max(error, float(off.max() / altitudes[flipped].min()))
    return error


def triangulate(mesh: Mesh) -> tuple[Int64s, Floats]:
    """Return the corners of the intrinsic Delaunay triangles, and the lengths of their edges.

    Parameters
    ----------
    mesh : Mesh
        A surface, closed or not, with two sides or one.

    Returns
    -------
    corners : ndarray of shape (m, 3), int64
        Two corners may be the same vertex, and two edges may join the same two.
    lengths : ndarray of shape (m, 3), float64
        Of the edge from corner i to i + 1.

    Raises
    ------
    ValueError
        If an edge has more than two faces, or flips do not come to an end.
    """
    corners = np.array(mesh.faces, dtype=np.int64)
    keys = edge_keys(corners)
    many = int(np.count_nonzero(np.unique(keys, return_counts=True)[1] > 2))
    if many:
        raise ValueError(
            f"{many} edges have more than two faces, so that there is no intrinsic Delaunay "
            'triangulation: Operator(elements="tufted") takes the mesh as it is'
        )
    first, second = joined_half_edges(keys)
    points = np.asarray(mesh.vertices, dtype=np.float64)
    ends = points[corners]
    lengths = np.linalg.norm(np.roll(ends, -1, axis=1) - ends, axis=2).ravel()
    twin = np.full(corners.size, -1, dtype=np.int64)
    twin[first], twin[second] = second, first
    tails = corners.ravel()
    mirrored = np.zeros(corners.size, dtype=np.bool_)  # both run the same way
    mirrored[first] = mirrored[second] = tails[first] == tails[second]
    if _flip_all(corners.reshape(-1), lengths, twin, mirrored, MOST_FLIPS * len(corners)) < 0:
        raise ValueError("edge flips do not end: this is no mesh whose lengths a float64 can tell")
    return corners, lengths.reshape(-1, 3)


@kernel
def _flip_all(corners: Int64s, lengths: Floats, twin: Int64s, mirrored: Booleans, most: int) -> int:
    """Flip until all edges are Delaunay, in place; return how many were, or -1 for too many."""
    stack = np.arange(twin.shape[0])
    waits = np.ones(twin.shape[0], np.bool_)
    top, flips = stack.shape[0], 0
    while top:
        top -= 1
        half = stack[top]
        waits[half] = False
        other = twin[half]
        if other < 0 or half // 3 == other // 3 or _is_delaunay(lengths, half, other):
            continue
        if mirrored[half]:
            _turn(corners, lengths, twin, mirrored, other // 3)
            other = twin[half]
        _flip(corners, lengths, twin, mirrored, half, other)
        flips += 1
        if flips > most:
            return -1
        for face in (half // 3, other // 3):
            for side in range(1, 3):
                changed = 3 * face + side
                if not waits[changed]:
                    waits[changed] = True
                    stack[top] = changed
                    top += 1
    return flips


@kernel
def _is_delaunay(lengths: Floats, half: int, other: int) -> bool:
    """Whether the angles opposite an edge add up to no more than π."""
    cosine_here, area_here = _opposite(lengths, half)
    cosine_there, area_there = _opposite(lengths, other)
    size = (abs(cosine_here) + area_here) * (abs(cosine_there) + area_there)
    return cosine_here * area_there + cosine_there * area_here >= -ROUNDING * size


@kernel
def _opposite(lengths: Floats, half: int) -> tuple[float, float]:
    """Return multiples of cosine and sine of the angle opposite a half-edge: |a||b| times each."""
    face, side = half // 3, half % 3
    a = lengths[half]
    b, c = lengths[3 * face + (side + 1) % 3], lengths[3 * face + (side + 2) % 3]
    low, high = min(b, c), max(b, c)
    cosine = ((high - a) * (high + a) + low * low) / 2
    x, y, z = max(a, high), max(min(a, high), low), min(a, low)  # descending
    product = (x + (y + z)) * (z - (x - y)) * (z + (x - y)) * (x + (y - z))
    return cosine, np.sqrt(max(product, 0.0)) / 2


@kernel
def _turn(corners: Int64s, lengths: Floats, twin: Int64s, mirrored: Booleans, face: int) -> None:
    """Turn a face over: its sides 0 and 2 change places."""
    p, q, r = 3 * face, 3 * face + 1, 3 * face + 2
    corners[q], corners[r] = corners[r], corners[q]
    lengths[p], lengths[r] = lengths[r], lengths[p]
    old_p, old_r = twin[p], twin[r]
    twin[p], twin[r] = old_r, old_p
    mirrored[p], mirrored[r] = mirrored[r], mirrored[p]
    for half in (p, q, r):  # of its own sides that are each other's twins
        if twin[half] == p:
            twin[half] = r
        elif twin[half] == r:
            twin[half] = p
    for half in (p, q, r):
        other = twin[half]
        if other >= 0 and other // 3 != face:
            twin[other] = half
            mirrored[half] = not mirrored[half]
            mirrored[other] = mirrored[half]


@kernel
def _flip(
    corners: Int64s, lengths: Floats, twin: Int64s, mirrored: Booleans, half: int, other: int
) -> None:
    """Flip the edge from a to b of the faces abc and bad: they become cdb and dca."""
    f, i, g, j = half // 3, half % 3, other // 3, other % 3
    a, b = corners[half], corners[other]
    c, d = corners[3 * f + (i + 2) % 3], corners[3 * g + (j + 2) % 3]
    old = np.array([3 * f + (i + 1) % 3, 3 * f + (i + 2) % 3, 3 * g + (j + 1) % 3, 0])
    old[3] = 3 * g + (j + 2) % 3  # bc, ca, ad, db
    new = np.array([3 * f + 2, 3 * g + 1, 3 * g + 2, 3 * f + 1])
    length, sides = lengths[half], lengths[old]
    twins, signs = twin[old], mirrored[old]
    # Unfolded, a at the origin and b along x, c is above and d below
    x_c = ((sides[1] - sides[0]) * (sides[1] + sides[0]) / length + length) / 2
    x_d = ((sides[2] - sides[3]) * (sides[2] + sides[3]) / length + length) / 2
    height = _opposite(lengths, half)[1] / length + _opposite(lengths, other)[1] / length
    across = np.hypot(x_c - x_d, height)
    corners[3 * f], corners[3 * f + 1], corners[3 * f + 2] = c, d, b
    corners[3 * g], corners[3 * g + 1], corners[3 * g + 2] = d, c, a
    for p in range(4):
        lengths[new[p]] = sides[p]
        mirrored[new[p]] = signs[p]
        goal = twins[p]
        for q in range(4):
            if twins[p] == old[q]:
                goal = new[q]
        twin[new[p]] = goal
        if goal >= 0:
            twin[goal] = new[p]
    lengths[3 * f] = lengths[3 * g] = across
    twin[3 * f], twin[3 * g] = 3 * g, 3 * f
    mirrored[3 * f] = mirrored[3 * g] = False
