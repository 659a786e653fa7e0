r"""Triangles bent to the surface that a mesh samples: through its vertices, with its normals there.

Flat triangles cut the corners of a curved surface. Their area and their distances are off by terms
of order :math:`h^2`, as large as the error of linear elements: no element on them can be better.
Here the mesh gives the surface back. A normal at each vertex comes from the triangles around it.
An edge becomes the arc that leaves its ends at right angles to the normals there, and a triangle
the quadratic patch through its corners and the middles of its three arcs. Quadratic elements on
these patches are isoparametric; on spheres, and where the triangles around each vertex are nearly
symmetric, errors of order :math:`h^4` are observed. Elsewhere normals are off by terms of order h,
and the order may be two again, with a smaller constant. Max's weights make them so
on smooth meshes; where faces of very different sizes meet, as on CAD parts beside a fillet, the
large ones are flat parts of the surface, and weights are areas.

Across a crease, where two triangles meet at more than :data:`CREASE`, the surface has a normal on
each side. An edge along the crease is an arc in both sides' planes; at a boundary, it is the arc
of the circles through the boundary's own vertices.

References
----------
N. Max, "Weights for computing vertex normals from facet normals", Journal of Graphics Tools 4
(1999): exact on spheres. A. Vlachos, J. Peters, C. Boyd, J. L. Mitchell, "Curved PN triangles", I3D
(2001): patches from normals. G. Dziuk, "Finite elements for the Beltrami operator on arbitrary
surfaces", LNM 1357 (1988); A. Demlow, "Higher-order finite element methods and pointwise error
estimates for elliptic problems on surfaces", SIAM J. Numer. Anal. 47 (2009): why the surface's own
approximation limits the order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from synthnet.kernels import kernel, part
from synthnet.spectrum import fem
from synthnet.spectrum.fem import Matrices
from synthnet.types import Mesh

CREASE = 55.0  # degrees between the normals of two triangles: below those of a hexagon's sides
RISE = 0.2  # of an edge's length, the most that it is bent
UNEVEN = 12.0  # times the smallest face at a vertex, above which large faces settle its normal
FLATTEST = 0.3  # of a flat triangle's area, at a point of its patch: where it would fold over
STRAIGHT = 0.1  # sine between two sides' normals, below which a crease has no direction of its own

# Points in a triangle and weights for polynomials of degree four (Dunavant 1985).
_NEAR, _FAR = 0.091576213509770743, 0.44594849091596489
CORNERS = np.array(
    [(1 - 2 * a, a, a) for a in (_NEAR, _FAR)]
    + [(a, 1 - 2 * a, a) for a in (_NEAR, _FAR)]
    + [(a, a, 1 - 2 * a) for a in (_NEAR, _FAR)]
)
WEIGHTS = np.tile([0.10995174365532187, 0.22338158967801147], 3) / 2
SLOPES = np.array([(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)])  # of the three barycentric coordinates
SIDES = np.array([(0, 1), (1, 2), (2, 0)])
# Least eigenvalue of M⁻¹B on a triangle in Bernstein's form, where the density is constant
QUADRATIC = 1 / 15


Floats = NDArray[np.float64]


class Patches(NamedTuple):
    """A mesh with its edges bent.

    Attributes
    ----------
    vertices : ndarray of shape (n, 3), float64
    faces : ndarray of shape (m, 3), int32
    ends : ndarray of shape (e, 2), int32
        The vertices of each edge, the lower one first, in ascending order.
    sides : ndarray of shape (m, 3), int32
        The edge of each face from its corner i to i + 1.
    rises : ndarray of shape (e, 3), float64
        From the middle of each edge to the middle of its arc, in length.
    """

    vertices: Floats
    faces: NDArray[np.int32]
    ends: NDArray[np.int32]
    sides: NDArray[np.int32]
    rises: Floats


def bend(mesh: Mesh) -> Patches:
    """Bend the edges of a mesh.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices and m faces, which need not be oriented alike.

    Returns
    -------
    Patches
        An edge of more than two faces stays straight.

    Raises
    ------
    ValueError
        If a face has no area.
    """
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    if flat := fem.flat_triangles(vertices, faces):
        raise ValueError(f"{flat} of {len(faces)} faces have no area: {fem.REMEDY}")
    start, around = _around(faces, len(vertices))
    ends, sides, beside, oriented = _edges(faces, start, around)
    units, areas, weights = _units(vertices, faces)
    cosine = float(np.cos(np.radians(CREASE)))
    normals = _normals(faces, start, around, units, areas, weights, oriented, cosine)
    rises = _rises(vertices, faces, ends, beside, units, normals, cosine)
    return Patches(vertices, faces, ends, sides, rises)


def quadratic(patches: Patches) -> Matrices:
    r"""Assemble quadratic elements on patches: vertices are the first unknowns, then edges.

    The functions are those of :func:`synthnet.spectrum.operators.discretise`, in Bernstein's form.
    The mass matrix is at least as much of its lumped one as on flat triangles, times the least
    ratio of a patch's density, its area by the flat one's, at two points of the quadrature.

    Parameters
    ----------
    patches : Patches
        Of n vertices and e edges. A patch that would fold over is made flat.
    """
    stiffness, mass, ratio = _blocks(patches, *_bernstein())
    unknowns = len(patches.vertices) + len(patches.ends)
    numbers = np.concatenate([patches.faces, len(patches.vertices) + patches.sides], axis=1)
    return fem.gathered(numbers, stiffness, mass, unknowns, QUADRATIC * ratio)


def hierarchical(patches: Patches) -> tuple[Matrices, Floats, Floats]:
    """Assemble linear elements on patches, and the patches' own matrices with functions of edges.

    Parameters
    ----------
    patches : Patches
        Of n vertices and m faces. A patch that would fold over is made flat.

    Returns
    -------
    linear : Matrices
        Of the n vertices.
    stiffness, mass : ndarray of shape (m, 6, 6), float64
        Of each patch: of its corners' functions λᵢ, then of its sides' 2 λᵢ λⱼ.
    """
    functions, slopes = _bernstein()
    functions[:, :3], slopes[:, :3] = CORNERS, SLOPES
    stiffness, mass, ratio = _blocks(patches, functions, slopes)
    indptr, indices = fem.pattern(patches.faces, len(patches.vertices))
    stiff, heavy = np.zeros(len(indices)), np.zeros(len(indices))
    _scatter(patches.faces, indptr, indices, stiffness, mass, stiff, heavy)
    lumped = np.add.reduceat(heavy, indptr[:-1])
    return Matrices(indptr, indices, stiff, heavy, lumped, ratio / 4), stiffness, mass


def _bernstein() -> tuple[Floats, Floats]:
    """Return λᵢ² and 2 λᵢ λⱼ at the points, (q, 6), and their slopes, (q, 6, 2)."""
    i, j = SIDES.T
    functions = np.concatenate([CORNERS**2, 2 * CORNERS[:, i] * CORNERS[:, j]], axis=1)
    at_corners = 2 * CORNERS[:, :, None] * SLOPES
    on_sides = 2 * (CORNERS[:, i, None] * SLOPES[j] + CORNERS[:, j, None] * SLOPES[i])
    return functions, np.concatenate([at_corners, on_sides], axis=1)


def _blocks(patches: Patches, functions: Floats, slopes: Floats) -> tuple[Floats, Floats, float]:
    """Return each patch's matrices of six functions, and the least ratio of a patch's densities."""
    m, points = len(patches.faces), len(WEIGHTS)
    scales, areas = np.empty((m, 3, points)), np.empty((m, points))
    while True:
        folded, ratio = _densities(*patches, CORNERS, WEIGHTS, scales, areas)
        if not patches.rises[patches.sides[folded]].any():  # what is flat cannot fold
            break
        patches.rises[patches.sides[folded]] = 0.0
    u, v = np.moveaxis(slopes, 2, 0)
    energies = np.concatenate([_products(u, u), _products(u, v) + _products(v, u), _products(v, v)])
    stiffness = scales.reshape(m, -1) @ energies
    mass = areas @ _products(functions, functions)
    return stiffness.reshape(m, 6, 6), mass.reshape(m, 6, 6), ratio


def _products(a: Floats, b: Floats) -> Floats:
    """Return the products of two functions at each point, (q, 36)."""
    return np.asarray((a[:, :, None] * b[:, None, :]).reshape(len(a), -1))


@kernel
def _around(faces: NDArray[np.int32], n: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the corners 3 f + c at each vertex, and where those of each begin."""
    start = np.zeros(n + 1, np.int32)
    for f in range(faces.shape[0]):
        for c in range(3):
            start[faces[f, c] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    around = np.empty(3 * faces.shape[0], np.int32)
    for f in range(faces.shape[0]):
        for c in range(3):
            i = faces[f, c]
            around[fill[i]] = 3 * f + c
            fill[i] += 1
    return start, around


@kernel
def _edges(
    faces: NDArray[np.int32], start: NDArray[np.int32], around: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], bool]:
    """Return the ends of edges, ascending, those of each face, and the sides 3 f + s of each.

    Where an edge has one side, or more than two, its second one is -1 or -2. The last is whether
    every edge of two faces is passed by them in opposite directions.
    """
    n = start.shape[0] - 1
    ends = np.empty((3 * faces.shape[0], 2), np.int32)
    beside = np.full((3 * faces.shape[0], 2), -1, np.int32)
    sides = np.empty(faces.shape, np.int32)
    seen = np.full(n, -1, np.int32)
    number = np.empty(n, np.int32)
    higher = np.empty(2 * np.diff(start).max(), np.int32)  # neighbours of a vertex
    first = 0
    oriented = True
    for i in range(n):
        count = 0
        for p in range(start[i], start[i + 1]):
            f, c = around[p] // 3, around[p] % 3
            for j in (faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]):
                if j > i and seen[j] != i:
                    seen[j] = i
                    higher[count] = j
                    count += 1
        fem.sort(higher[:count])
        for e in range(count):
            ends[first + e, 0], ends[first + e, 1] = i, higher[e]
            number[higher[e]] = first + e
        first += count
        for p in range(start[i], start[i + 1]):
            f, c = around[p] // 3, around[p] % 3
            for s in (c, (c + 2) % 3):
                j = faces[f, (s + 1) % 3] if s == c else faces[f, s]
                if j <= i:
                    continue
                e = number[j]
                sides[f, s] = e
                if beside[e, 0] == -1:
                    beside[e, 0] = 3 * f + s
                elif beside[e, 1] == -1:
                    beside[e, 1] = 3 * f + s
                    other = beside[e, 0]
                    oriented &= faces[other // 3, other % 3] != faces[f, s]
                else:
                    beside[e, 1] = -2
    return ends[:first].copy(), sides, beside[:first].copy(), oriented


@kernel
def _units(vertices: Floats, faces: NDArray[np.int32]) -> tuple[Floats, Floats, Floats]:
    """Return unit normals of faces, twice their areas, and Max's weights of their corners.

    A weight is the sine of the angle there over the lengths of both its sides.
    """
    units, weights = np.empty((faces.shape[0], 3)), np.empty((faces.shape[0], 3))
    areas = np.empty(faces.shape[0])
    edges = np.empty((3, 3))  # from a corner to the next
    for f in range(faces.shape[0]):
        unit = units[f]
        for i in range(3):
            for x in range(3):
                edges[i, x] = vertices[faces[f, (i + 1) % 3], x] - vertices[faces[f, i], x]
        _cross(edges[0], edges[1], unit)
        length = np.sqrt(_dot(unit, unit))
        for x in range(3):
            unit[x] /= length
        a, b, c = _dot(edges[0], edges[0]), _dot(edges[1], edges[1]), _dot(edges[2], edges[2])
        weights[f, 0] = length / (a * c)
        weights[f, 1] = length / (a * b)
        weights[f, 2] = length / (b * c)
        areas[f] = length
    return units, areas, weights


@kernel
def _normals(
    faces: NDArray[np.int32],
    start: NDArray[np.int32],
    around: NDArray[np.int32],
    units: Floats,
    areas: Floats,
    weights: Floats,
    oriented: bool,
    cosine: float,
) -> Floats:
    """Return the normal at each corner: of the faces at its vertex that bend less than a crease."""
    normals = np.empty((faces.shape[0], 3, 3))
    signs = np.ones(np.diff(start).max())
    for i in range(start.shape[0] - 1):
        corners = around[start[i] : start[i + 1]]
        if not oriented:
            _orient(faces, corners, signs)
        smallest, largest = np.inf, 0.0
        for p in range(corners.shape[0]):
            area = areas[corners[p] // 3]
            smallest, largest = min(smallest, area), max(largest, area)
        uneven = largest > UNEVEN * smallest
        for p in range(corners.shape[0]):
            f = corners[p] // 3
            a, b, c = units[f, 0], units[f, 1], units[f, 2]
            nx, ny, nz = 0.0, 0.0, 0.0
            for q in range(corners.shape[0]):
                g = corners[q] // 3
                x, y, z = units[g, 0], units[g, 1], units[g, 2]
                sign = signs[p] * signs[q]
                if sign * (a * x + b * y + c * z) > cosine:
                    weight = sign * (areas[g] if uneven else weights[g, corners[q] % 3])
                    nx += weight * x
                    ny += weight * y
                    nz += weight * z
            length = np.sqrt(nx * nx + ny * ny + nz * nz)
            normal = normals[f, corners[p] % 3]
            normal[0], normal[1], normal[2] = nx / length, ny / length, nz / length
    return normals


@part
def _orient(faces: NDArray[np.int32], corners: NDArray[np.int32], signs: Floats) -> None:
    """Set signs with which faces around a vertex are oriented alike, from one to its neighbour."""
    signs[: corners.shape[0]] = 0.0
    for first in range(corners.shape[0]):
        if signs[first] != 0.0:
            continue
        signs[first] = 1.0
        changed = True
        while changed:
            changed = False
            for p in range(corners.shape[0]):
                if signs[p] == 0.0:
                    continue
                f, c = corners[p] // 3, corners[p] % 3
                after, before = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
                for q in range(corners.shape[0]):
                    g, d = corners[q] // 3, corners[q] % 3
                    if signs[q] == 0.0 and g != f:
                        theirs, others = faces[g, (d + 1) % 3], faces[g, (d + 2) % 3]
                        if others == after or theirs == before:
                            signs[q] = signs[p]
                            changed = True
                        elif theirs == after or others == before:
                            signs[q] = -signs[p]
                            changed = True


@kernel
def _rises(
    vertices: Floats,
    faces: NDArray[np.int32],
    ends: NDArray[np.int32],
    beside: NDArray[np.int32],
    units: Floats,
    normals: Floats,
    cosine: float,
) -> Floats:
    """Return from the middle of each edge to that of its arc: an eighth of its ends' tangents.

    A tangent is as long as the edge's part along it, and the arc the cubic with these two.
    """
    rises = np.zeros((ends.shape[0], 3))
    rim = np.full((vertices.shape[0], 2), -1, np.int32)  # the boundary's next vertices
    for e in range(ends.shape[0]):
        if beside[e, 1] == -1:
            for a in range(2):
                i, j = ends[e, a], ends[e, 1 - a]
                if rim[i, 0] == -1:
                    rim[i, 0] = j
                elif rim[i, 1] == -1:
                    rim[i, 1] = j
                else:
                    rim[i, 1] = -2  # two boundaries touch: it stays straight there
    edge, tangent = np.empty(3), np.empty(3)
    for e in range(ends.shape[0]):
        for x in range(3):
            edge[x] = vertices[ends[e, 1], x] - vertices[ends[e, 0], x]
        f, g = beside[e, 0] // 3, beside[e, 1] // 3
        if beside[e, 1] == -2:
            continue
        smooth = False
        if beside[e, 1] >= 0:
            turned = faces[f, beside[e, 0] % 3] == faces[g, beside[e, 1] % 3]
            across = _dot(units[f], units[g])
            smooth = (-across if turned else across) > cosine
        for a in range(2):
            i = ends[e, a]
            sign = 1.0 if a == 0 else -1.0
            if smooth:
                normal = normals[f, _corner(faces[f], i)]
                along = _dot(edge, normal)
                for x in range(3):
                    tangent[x] = edge[x] - along * normal[x]
            elif beside[e, 1] >= 0:
                one, other = normals[f, _corner(faces[f], i)], normals[g, _corner(faces[g], i)]
                _cross(one, other, tangent)
                _along(edge, tangent, STRAIGHT)
            else:
                _of_rim(vertices, rim[i], i, cosine, tangent)
                _along(edge, tangent, 0.0)
            for x in range(3):
                rises[e, x] += sign * tangent[x] / 8
        longest = RISE * np.sqrt(_dot(edge, edge))
        rise = np.sqrt(_dot(rises[e], rises[e]))
        if rise > longest:
            rises[e] *= longest / rise
    return rises


@part
def _of_rim(
    vertices: Floats,
    rim: NDArray[np.int32],
    i: int,
    cosine: float,
    tangent: Floats,
) -> None:
    """Set the tangent of the circle through a boundary's vertex and its neighbours, or zero."""
    tangent[:] = 0.0
    if rim[0] < 0 or rim[1] < 0:
        return
    before = vertices[i] - vertices[rim[0]]
    after = vertices[rim[1]] - vertices[i]
    first, second = _dot(before, before), _dot(after, after)
    if _dot(before, after) > cosine * np.sqrt(first * second):
        for x in range(3):
            tangent[x] = before[x] / first + after[x] / second


@part
def _along(edge: Floats, tangent: Floats, least: float) -> None:
    """Turn a direction into the part of an edge along it; where it is too short, into the edge."""
    square = _dot(tangent, tangent)
    if square > least * least:
        tangent *= _dot(edge, tangent) / square
    else:
        tangent[:] = edge


@part
def _corner(face: NDArray[np.int32], i: int) -> int:
    return 0 if face[0] == i else (1 if face[1] == i else 2)


@part
def _dot(x: Floats, y: Floats) -> float:
    return float(x[0] * y[0] + x[1] * y[1] + x[2] * y[2])


@part
def _cross(u: Floats, v: Floats, product: Floats) -> None:
    product[0] = u[1] * v[2] - u[2] * v[1]
    product[1] = u[2] * v[0] - u[0] * v[2]
    product[2] = u[0] * v[1] - u[1] * v[0]


@part
def _metric(
    vertices: Floats,
    face: NDArray[np.int32],
    side: NDArray[np.int32],
    rises: Floats,
    l0: float,
    l1: float,
    l2: float,
) -> tuple[float, float, float]:
    """Return the metric of a patch at a point: of its derivatives along two of its sides."""
    g11 = 0.0
    g12 = 0.0
    g22 = 0.0
    for x in range(3):
        r0, r1, r2 = rises[side[0], x], rises[side[1], x], rises[side[2], x]
        corner = vertices[face[0], x]
        u = vertices[face[1], x] - corner + 4 * ((l0 - l1) * r0 + l2 * r1 - l2 * r2)
        v = vertices[face[2], x] - corner + 4 * (-l1 * r0 + l1 * r1 + (l0 - l2) * r2)
        g11 += u * u
        g12 += u * v
        g22 += v * v
    return g11, g12, g22


@kernel
def _densities(
    vertices: Floats,
    faces: NDArray[np.int32],
    ends: NDArray[np.int32],
    sides: NDArray[np.int32],
    rises: Floats,
    corners: Floats,
    weights: Floats,
    scales: Floats,
    areas: Floats,
) -> tuple[NDArray[np.bool_], float]:
    """Fill in areas at the points, (m, q), and what the metric makes of slopes, (m, 3, q).

    Return which patches have too little area somewhere, by that of their flat triangle, and the
    least ratio of a patch's densities.
    """
    folded = np.zeros(faces.shape[0], np.bool_)
    straight, none = np.zeros((1, 3)), np.zeros(3, np.int32)
    ratio = 1.0
    for f in range(faces.shape[0]):
        g11, g12, g22 = _metric(vertices, faces[f], none, straight, 1.0, 0.0, 0.0)
        flat = np.sqrt(g11 * g22 - g12 * g12)
        least, most = np.inf, 0.0
        for q in range(corners.shape[0]):
            l0, l1, l2 = corners[q]
            g11, g12, g22 = _metric(vertices, faces[f], sides[f], rises, l0, l1, l2)
            density = np.sqrt(max(g11 * g22 - g12 * g12, 0.0))
            least, most = min(least, density), max(most, density)
            scale = weights[q] / density
            scales[f, 0, q], scales[f, 1, q], scales[f, 2, q] = (
                g22 * scale,
                -g12 * scale,
                g11 * scale,
            )
            areas[f, q] = weights[q] * density
        folded[f] = least < FLATTEST * flat
        ratio = min(ratio, least / most)
    return folded, ratio


@kernel
def _scatter(
    faces: NDArray[np.int32],
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    stiffness: Floats,
    mass: Floats,
    stiff: Floats,
    heavy: Floats,
) -> None:
    """Add the corners' parts of the patches' matrices to those of the mesh."""
    for f in range(faces.shape[0]):
        for c in range(3):
            row = faces[f, c]
            for d in range(3):
                p = fem.index(indices, indptr[row], indptr[row + 1], faces[f, d])
                stiff[p] += stiffness[f, c, d]
                heavy[p] += mass[f, c, d]
