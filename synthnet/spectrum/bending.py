r"""A mesh's edges bent to the surface that it samples: arcs between the normals at their ends.

A normal at each vertex comes from the triangles around it, an edge becomes the arc that leaves its
ends at right angles to the normals there, and a triangle the quadratic patch through its corners
and the middles of its three arcs. Weights of the triangles are Max's, which are exact on spheres
and good where the triangles around a vertex are nearly symmetric; elsewhere a normal is off by a
term of order h. Where a large face is in one plane with a neighbour and meets faces that are much
smaller, as on CAD parts beside a fillet, it is a flat part of the surface, and only such faces
settle the normal.

Across a crease, where two triangles meet at more than :data:`CREASE`, the surface has a normal on
each side, and an edge along the crease is an arc in both sides' planes. At a boundary, the tangent
at a vertex is that of the circle through it and its two neighbours, or two on one side where an
edge is much shorter there.

References
----------
N. Max, "Weights for computing vertex normals from facet normals", Journal of Graphics Tools 4
(1999). A. Vlachos, J. Peters, C. Boyd, J. L. Mitchell, "Curved PN triangles", I3D (2001): patches
from normals.
"""

from typing import NamedTuple

import numpy as np

from synthnet.arrays import Booleans, Floats, Int32s
from synthnet.kernels import kernel, part
from synthnet.spectrum import fem
from synthnet.types import Mesh

CREASE = 55.0  # degrees between the normals of two triangles: below those of a hexagon's sides
RISE = 0.2  # of an edge's length, the most that it is bent
UNEVEN = 3.0  # times as large as another face of the same normal: flat ones then settle that
COPLANAR = 0.05  # degrees to a neighbour, below which a face is part of something flat
LONG = 2.0  # times as long as the next edge of a boundary: its direction is not settled by both
STRAIGHT = 0.1  # sine between two sides' normals, below which a crease has no direction of its own


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
    faces: Int32s
    ends: Int32s
    sides: Int32s
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
    vertices, faces = _arrays(mesh)
    start, around = fem.grouped(faces.ravel(), len(vertices))
    ends, sides, beside, oriented = _edges(faces, start, around)
    units, areas, weights = _units(vertices, faces)
    cosine = float(np.cos(np.radians(CREASE)))
    flat = _flat(beside, units, float(np.sin(np.radians(COPLANAR))))
    normals = _normals(faces, start, around, units, areas, weights, flat, oriented, cosine)
    rises = _rises(vertices, faces, ends, beside, units, normals, cosine)
    return Patches(vertices, faces, ends, sides, rises)


def straight(mesh: Mesh) -> Patches:
    """Return a mesh with its edges as they are.

    Raises
    ------
    ValueError
        If a face has no area.
    """
    vertices, faces = _arrays(mesh)
    ends, sides = edges(faces, len(vertices))
    return Patches(vertices, faces, ends, sides, np.zeros((len(ends), 3)))


def edges(faces: Int32s, n: int) -> tuple[Int32s, Int32s]:
    """Return the edges of faces on n vertices, (e, 2), and which of them each face has, (m, 3)."""
    ends, sides, _, _ = _edges(faces, *fem.grouped(faces.ravel(), n))
    return ends, sides


def edges_and_rims(mesh: Mesh) -> tuple[Int32s, Booleans]:
    """Return a mesh's edges, (e, 2), as :class:`Patches` has them, and which have one face."""
    _, faces = fem.as_arrays(mesh)
    ends, _, beside, _ = _edges(faces, *fem.grouped(faces.ravel(), len(mesh.vertices)))
    return ends, beside[:, 1] == -1


def _arrays(mesh: Mesh) -> tuple[Floats, Int32s]:
    vertices, faces = fem.as_arrays(mesh)
    if flat := fem.flat_triangles(vertices, faces):
        raise ValueError(f"{flat} of {len(faces)} faces have no area: {fem.REMEDY}")
    return vertices, faces


@kernel
def _edges(faces: Int32s, start: Int32s, around: Int32s) -> tuple[Int32s, Int32s, Int32s, bool]:
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
def _units(vertices: Floats, faces: Int32s) -> tuple[Floats, Floats, Floats]:
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
        cross(edges[0], edges[1], unit)
        length = np.sqrt(dot(unit, unit))
        for x in range(3):
            unit[x] /= length
        a, b, c = dot(edges[0], edges[0]), dot(edges[1], edges[1]), dot(edges[2], edges[2])
        weights[f, 0] = length / (a * c)
        weights[f, 1] = length / (a * b)
        weights[f, 2] = length / (b * c)
        areas[f] = length
    return units, areas, weights


@kernel
def _flat(beside: Int32s, units: Floats, sine: float) -> Booleans:
    """Return which faces are in one plane with a neighbour."""
    flat = np.zeros(units.shape[0], np.bool_)
    product = np.empty(3)
    for e in range(beside.shape[0]):
        if beside[e, 1] >= 0:
            f, g = beside[e, 0] // 3, beside[e, 1] // 3
            cross(units[f], units[g], product)
            if dot(product, product) < sine * sine:
                flat[f] = flat[g] = True
    return flat


@kernel
def _normals(
    faces: Int32s,
    start: Int32s,
    around: Int32s,
    units: Floats,
    areas: Floats,
    weights: Floats,
    flat: Booleans,
    oriented: bool,
    cosine: float,
) -> Floats:
    """Return the normal at each corner: of the faces at its vertex that bend less than a crease."""
    normals = np.empty((faces.shape[0], 3, 3))
    signs = np.ones(np.diff(start).max())
    queue = np.empty(len(signs), np.int32)
    normal = np.empty(3)
    for i in range(start.shape[0] - 1):
        corners = around[start[i] : start[i + 1]]
        if not oriented:
            _orient(faces, corners, signs, queue)
        for p in range(corners.shape[0]):
            f = corners[p] // 3
            smallest, largest = areas[f], 0.0
            normal[:] = 0.0
            for q in range(corners.shape[0]):
                g = corners[q] // 3
                sign = signs[p] * signs[q]
                if sign * dot(units[f], units[g]) > cosine:
                    smallest = min(smallest, areas[g])
                    largest = max(largest, areas[g] if flat[g] else 0.0)
                    for x in range(3):
                        normal[x] += sign * weights[g, corners[q] % 3] * units[g, x]
            if largest > UNEVEN * smallest:
                normal[:] = 0.0
                for q in range(corners.shape[0]):
                    g = corners[q] // 3
                    sign = signs[p] * signs[q]
                    alike = sign * dot(units[f], units[g]) > cosine
                    if alike and flat[g] and areas[g] > UNEVEN * smallest:
                        for x in range(3):
                            normal[x] += sign * weights[g, corners[q] % 3] * units[g, x]
            length = np.sqrt(dot(normal, normal))
            for x in range(3):
                normals[f, corners[p] % 3, x] = normal[x] / length
    return normals


@part
def _orient(faces: Int32s, corners: Int32s, signs: Floats, queue: Int32s) -> None:
    """Set signs with which faces around a vertex are oriented alike, from one to its neighbours."""
    signs[: corners.shape[0]] = 0.0
    for first in range(corners.shape[0]):
        if signs[first] != 0.0:
            continue
        signs[first] = 1.0
        queue[0] = first
        done, count = 0, 1
        while done < count:
            p = queue[done]
            done += 1
            f, c = corners[p] // 3, corners[p] % 3
            after, before = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
            for q in range(corners.shape[0]):
                if signs[q] != 0.0:
                    continue
                g, d = corners[q] // 3, corners[q] % 3
                theirs, others = faces[g, (d + 1) % 3], faces[g, (d + 2) % 3]
                if others == after or theirs == before:
                    signs[q] = signs[p]
                elif theirs == after or others == before:
                    signs[q] = -signs[p]
                else:
                    continue
                queue[count] = q
                count += 1


@kernel
def _rises(
    vertices: Floats,
    faces: Int32s,
    ends: Int32s,
    beside: Int32s,
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
    edge, tangent, normal = np.empty(3), np.empty(3), np.empty(3)
    for e in range(ends.shape[0]):
        for x in range(3):
            edge[x] = vertices[ends[e, 1], x] - vertices[ends[e, 0], x]
        f, g = beside[e, 0] // 3, beside[e, 1] // 3
        if beside[e, 1] == -2:
            continue
        smooth = turned = False
        if beside[e, 1] >= 0:
            turned = faces[f, beside[e, 0] % 3] == faces[g, beside[e, 1] % 3]
            across = dot(units[f], units[g])
            smooth = (-across if turned else across) > cosine
        for a in range(2):
            i = ends[e, a]
            sign = 1.0 if a == 0 else -1.0
            if smooth:
                one, other = normals[f, _corner(faces[f], i)], normals[g, _corner(faces[g], i)]
                for x in range(3):
                    normal[x] = one[x] - other[x] if turned else one[x] + other[x]
                along = dot(edge, normal) / dot(normal, normal)
                for x in range(3):
                    tangent[x] = edge[x] - along * normal[x]
            elif beside[e, 1] >= 0:
                one, other = normals[f, _corner(faces[f], i)], normals[g, _corner(faces[g], i)]
                cross(one, other, tangent)
                _along(edge, tangent, STRAIGHT)
            else:
                _of_rim(vertices, rim, i, cosine, tangent)
                _along(edge, tangent, 0.0)
            for x in range(3):
                rises[e, x] += sign * tangent[x] / 8
        longest = RISE * np.sqrt(dot(edge, edge))
        rise = np.sqrt(dot(rises[e], rises[e]))
        if rise > longest:
            rises[e] *= longest / rise
    return rises


@part
def _of_rim(vertices: Floats, rim: Int32s, i: int, cosine: float, tangent: Floats) -> None:
    """Set the tangent at a boundary's vertex, or zero at a corner and at the boundary's ends.

    It is that of the circle through the vertex and its neighbours. Where one of these is much
    farther, it is that of the circle through the vertex and two on the nearer side: so a straight
    edge beside a fillet stays straight. Where that side has no such two, it is the long edge's if
    its arc would turn by more than a crease.
    """
    before, after = rim[i]
    if not _circle(vertices, before, i, after, cosine, tangent):
        return
    one, other = vertices[i] - vertices[before], vertices[after] - vertices[i]
    first, second = dot(one, one), dot(other, other)
    short = min(first, second)
    if max(first, second) <= LONG * LONG * short:
        return
    sign, near = (-1.0, before) if first < second else (1.0, after)
    beyond = rim[near, 1] if rim[near, 0] == i else rim[near, 0]
    next_one = vertices[beyond] - vertices[near]
    at_near = np.empty(3)
    if _circle(vertices, i, near, beyond, cosine, at_near) and (
        dot(next_one, next_one) <= LONG * LONG * short
    ):
        edge = vertices[near] - vertices[i]
        along = 2 * dot(at_near, edge) / short
        for x in range(3):  # the chord's mirror image of the tangent at its other end
            tangent[x] = sign * (along * edge[x] - at_near[x])
    elif 2 * dot(one, other) ** 2 < (1 + cosine) * first * second:  # by more than half a crease
        tangent[:] = one if first > second else other


@part
def _circle(vertices: Floats, i: int, j: int, k: int, cosine: float, tangent: Floats) -> bool:
    """Set the tangent at j of the circle through i, j and k, towards k; or zero, and say so."""
    tangent[:] = 0.0
    if min(i, k) < 0:
        return False
    before, after = vertices[j] - vertices[i], vertices[k] - vertices[j]
    first, second = dot(before, before), dot(after, after)
    if dot(before, after) <= cosine * np.sqrt(first * second):
        return False
    for x in range(3):
        tangent[x] = before[x] / first + after[x] / second
    return True


@part
def _along(edge: Floats, tangent: Floats, least: float) -> None:
    """Turn a direction into the part of an edge along it; where it is too short, into the edge."""
    square = dot(tangent, tangent)
    if square > least * least:
        tangent *= dot(edge, tangent) / square
    else:
        tangent[:] = edge


@part
def _corner(face: Int32s, i: int) -> int:
    return 0 if face[0] == i else (1 if face[1] == i else 2)


@part
def dot(x: Floats, y: Floats) -> float:
    """Return x · y in space."""
    return float(x[0] * y[0] + x[1] * y[1] + x[2] * y[2])


@part
def cross(u: Floats, v: Floats, product: Floats) -> None:
    """Set ``product`` to u × v."""
    product[0] = u[1] * v[2] - u[2] * v[1]
    product[1] = u[2] * v[0] - u[0] * v[2]
    product[2] = u[0] * v[1] - u[1] * v[0]
