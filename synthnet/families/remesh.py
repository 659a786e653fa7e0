"""Triangulations that are not uniform: finer in places, and irregular."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.families.atlas import SAME, Atlas, Charted
from synthnet.kernels import kernel
from synthnet.mesh.adjacency import edge_keys, joined_half_edges

REACH = 0.4  # how far a vertex moves towards the far side of a triangle beside it, at most
HALF = 1e-6  # of the width: so far from the plane a triangle counts as beyond it
COCIRCULAR = 1e-6  # sum of cotangents under which an edge is as good as its flip


def refine(mesh: Charted, marked: Booleans) -> Charted:
    """Split marked triangles into four, and their neighbours so that the mesh conforms.

    A triangle with two or three split edges is split into four, one with a single split edge
    into two (red-green refinement).

    References
    ----------
    R. E. Bank, A. H. Sherman, A. Weiser, "Refinement algorithms and data structures for regular
    local mesh refinement", Scientific Computing, 1983.
    """
    edges, of_side = mesh.edges()
    split = np.zeros(len(edges), dtype=bool)
    while True:
        split[of_side[marked]] = True
        more = ~marked & (split[of_side].sum(axis=1) >= 2)
        if not more.any():
            break
        marked = marked | more
    number = mesh.n_vertices + np.cumsum(split) - 1
    middle = number[of_side]  # of the edge from corner i to corner i + 1, where it is split
    halfway = (mesh.corners + np.roll(mesh.corners, -1, axis=1)) / 2

    whole = ~split[of_side].any(axis=1)
    red = np.flatnonzero(marked)
    green = np.flatnonzero(~marked & ~whole)
    side = split[of_side[green]].argmax(axis=1)
    a, b, c = ((side + turn) % 3 for turn in range(3))

    def children(at: NDArray[Any], half: NDArray[Any]) -> NDArray[Any]:
        """Return the corners of the new triangles, from those of the old and of their middles."""
        corners = [
            [half[red, 0], half[red, 1], half[red, 2]],
            *([at[red, i], half[red, i], half[red, i - 1]] for i in range(3)),
            [at[green, a], half[green, a], at[green, c]],
            [half[green, a], at[green, b], at[green, c]],
        ]
        return np.concatenate([at[whole], *(np.stack(three, axis=1) for three in corners)])

    order = np.concatenate([np.flatnonzero(whole), *[red] * 4, *[green] * 2])
    return Charted(
        children(mesh.faces, middle), children(mesh.corners, halfway), mesh.charts[order]
    )


def towards(atlas: Atlas, mesh: Charted, focus: Floats, shares: tuple[float, ...]) -> Charted:
    """Refine what is nearest to a point, once for each share of the first mesh's vertices.

    Parameters
    ----------
    atlas : Atlas
        The surface.
    mesh : Charted
        A mesh of it.
    focus : ndarray of shape (3,)
        The point; in general position, so that no distance depends on a rounding.
    shares : tuple of float
        Shares of the vertices, descending: what is within the distance of so many is refined.
    """
    distances = np.linalg.norm(atlas.points(mesh) - focus, axis=1)
    for radius in np.quantile(distances, shares):
        mesh = refine(mesh, np.linalg.norm(_centres(atlas, mesh) - focus, axis=1) <= radius)
    return mesh


def finer_half(atlas: Atlas, mesh: Charted, times: int) -> Charted:
    """Refine the half with x > 0, ``times`` times."""
    for _ in range(times):
        x = _centres(atlas, mesh)[:, 0]
        mesh = refine(mesh, x > HALF * np.ptp(x))
    return mesh


def _centres(atlas: Atlas, mesh: Charted) -> Floats:
    return np.asarray(atlas.points(mesh)[mesh.faces].mean(axis=1))


def irregular(atlas: Atlas, mesh: Charted, rng: np.random.Generator) -> Charted:
    """Move inner vertices of the charts at random, then flip edges until they are Delaunay.

    A vertex goes up to two fifths of the way into a random triangle beside it. Vertices where
    charts meet, on a seam, on the boundary and in a patch's corner stay; edges there are not
    flipped. So creases, and the tips of cones, must be borders or corners of patches.
    """
    return delaunay(atlas, jittered(atlas, mesh, rng))


def jittered(atlas: Atlas, mesh: Charted, rng: np.random.Generator) -> Charted:
    """Move the free vertices of a mesh in their charts."""
    free = _free(mesh)
    free[: int(atlas.glued().max()) + 1] = False  # the patches' corners come first
    count = mesh.faces.size
    priority, along, across = rng.random((3, count))
    vertex = mesh.faces.ravel()
    order = np.lexsort((priority, vertex))
    last = np.append(np.flatnonzero(np.diff(vertex[order])), count - 1)
    chosen = order[last]  # this is a corner of each vertex
    face, corner = np.divmod(chosen, 3)
    origin = mesh.corners[face, corner]
    to_b = mesh.corners[face, (corner + 1) % 3] - origin
    to_c = mesh.corners[face, (corner + 2) % 3] - origin
    outside = along + across > 1
    b = np.where(outside, 1 - along, along)[chosen]
    c = np.where(outside, 1 - across, across)[chosen]
    moved = origin + REACH * (b[:, None] * to_b + c[:, None] * to_c)
    corners = np.where(free[mesh.faces][:, :, None], moved[mesh.faces], mesh.corners)
    return Charted(mesh.faces, corners, mesh.charts)


def _free(mesh: Charted) -> Booleans:
    """Return which vertices are inside a chart: one chart, one set of coordinates, no border."""
    first = mesh.first_corners()
    d = mesh.corners.shape[2]
    flat = mesh.corners.reshape(-1, d)
    vertex = mesh.faces.ravel()
    same = (np.abs(flat - flat[first][vertex]) <= SAME * np.ptp(flat)).all(axis=1)
    same &= np.repeat(mesh.charts, 3) == mesh.charts[first // 3][vertex]
    free = np.ones(mesh.n_vertices, dtype=bool)
    free[vertex[~same]] = False
    edges, of_side = mesh.edges()
    border = np.bincount(of_side.ravel(), minlength=len(edges)) == 1
    free[edges[border]] = False
    return free


def delaunay(atlas: Atlas, mesh: Charted) -> Charted:
    """Flip edges inside charts until the angles opposite to each add up to at most π."""
    first, second = joined_half_edges(edge_keys(mesh.faces))
    twin = np.full(mesh.faces.size, -1, dtype=np.int64)
    twin[first], twin[second] = second, first

    flat = mesh.corners.reshape(-1, mesh.corners.shape[2])
    charts, near = np.repeat(mesh.charts, 3), SAME * np.ptp(flat)
    ahead = _next(np.arange(mesh.faces.size))
    other = twin >= 0
    fixed = ~other
    here, there = np.flatnonzero(other), twin[other]
    fixed[here] = (
        (charts[here] != charts[there])
        | (np.abs(flat[here] - flat[_next(there)]) > near).any(axis=1)
        | (np.abs(flat[ahead[here]] - flat[there]) > near).any(axis=1)
    )
    faces, corner_of = mesh.faces.copy(), np.arange(mesh.faces.size).reshape(-1, 3)
    _flip(atlas.points(mesh), faces, corner_of, twin, fixed)
    return Charted(faces, flat[corner_of], mesh.charts)


def _next(half_edges: Int64s) -> Int64s:
    return half_edges - half_edges % 3 + (half_edges + 1) % 3


@kernel
def _cotangent(p: Floats, q: Floats, r: Floats) -> tuple[float, float, float, float]:
    """Return the cotangent of the angle at p, and the triangle's normal."""
    a0, a1, a2 = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    b0, b1, b2 = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    n0, n1, n2 = a1 * b2 - a2 * b1, a2 * b0 - a0 * b2, a0 * b1 - a1 * b0
    return (a0 * b0 + a1 * b1 + a2 * b2) / np.sqrt(n0 * n0 + n1 * n1 + n2 * n2), n0, n1, n2


@kernel
def _flip(
    points: Floats,
    faces: Int64s,
    corner_of: Int64s,
    twin: Int64s,
    fixed: Booleans,
) -> None:
    """Flip edges in place, from a stack, until every edge is Delaunay or each had ten turns.

    Half-edge 3f + i goes from corner i of face f to corner i + 1; ``corner_of`` names the corner
    whose coordinates a corner has; ``fixed`` half-edges stay.
    """
    face, origin = faces.ravel(), corner_of.ravel()
    count = len(face)
    stack = np.empty(count, dtype=np.int64)
    waits = np.ones(count, dtype=np.bool_)
    for h in range(count):
        stack[h] = count - 1 - h
    size = count
    left = 10 * count
    while size and left:
        left -= 1
        size -= 1
        h = stack[size]
        waits[h] = False
        if fixed[h] or not _improves(points, face, twin, h):
            continue
        for side in _turn(face, origin, twin, fixed, h):
            if not waits[side]:
                waits[side] = True
                stack[size] = side
                size += 1


@kernel
def _improves(points: Floats, face: Int64s, twins: Int64s, h: int) -> bool:
    """Return whether to flip half-edge h: it is not Delaunay, and the flip gives a surface."""
    t = twins[h]
    h1, h2 = h - h % 3 + (h + 1) % 3, h - h % 3 + (h + 2) % 3
    a, b, c, d = face[h], face[h1], face[h2], face[t - t % 3 + (t + 2) % 3]
    here, n0, n1, n2 = _cotangent(points[c], points[a], points[b])
    there, m0, m1, m2 = _cotangent(points[d], points[b], points[a])
    if not here + there < -COCIRCULAR:
        return False
    # The flip gives (a, d, c) and (d, b, c); both must face where the two faced.
    _, k0, k1, k2 = _cotangent(points[a], points[d], points[c])
    _, l0, l1, l2 = _cotangent(points[d], points[b], points[c])
    s0, s1, s2 = n0 + m0, n1 + m1, n2 + m2
    if k0 * s0 + k1 * s1 + k2 * s2 <= 0 or l0 * s0 + l1 * s1 + l2 * s2 <= 0:
        return False
    return not _joined(face, twins, h2, c, d)


@kernel
def _turn(
    face: Int64s, origin: Int64s, twins: Int64s, stays: Booleans, h: int
) -> tuple[int, int, int, int]:
    """Flip half-edge h in its two faces; return the half-edges of the four sides around them."""
    t = twins[h]
    f, g = h - h % 3, t - t % 3
    h1, h2 = f + (h + 1) % 3, f + (h + 2) % 3
    t1, t2 = g + (t + 1) % 3, g + (t + 2) % 3
    a, b, c, d = face[h], face[h1], face[h2], face[t2]
    # Faces f = (a, d, c), g = (d, b, c): half-edges f: a→d, d→c, c→a; g: d→b, b→c, c→d.
    ad_twin, ca_twin, db_twin, bc_twin = twins[t1], twins[h2], twins[t2], twins[h1]
    ad_stays, ca_stays, db_stays, bc_stays = stays[t1], stays[h2], stays[t2], stays[h1]
    oa, ob, oc, od = origin[h], origin[h1], origin[h2], origin[t2]
    face[f], face[f + 1], face[f + 2] = a, d, c
    face[g], face[g + 1], face[g + 2] = d, b, c
    origin[f], origin[f + 1], origin[f + 2] = oa, od, oc
    origin[g], origin[g + 1], origin[g + 2] = od, ob, oc
    for side, other, still in (
        (f, ad_twin, ad_stays),
        (f + 2, ca_twin, ca_stays),
        (g, db_twin, db_stays),
        (g + 1, bc_twin, bc_stays),
    ):
        twins[side] = other
        stays[side] = still
        if other >= 0:
            twins[other] = side
    twins[f + 1], twins[g + 2] = g + 2, f + 1
    stays[f + 1] = stays[g + 2] = False
    return f, f + 2, g, g + 1


@kernel
def _joined(face: Int64s, twins: Int64s, start: int, c: int, d: int) -> bool:
    """Return whether an edge joins c, where half-edge ``start`` begins, to d already.

    The walk round c ends at the border, and where neighbours turn the other way (on a Möbius band).
    """
    h = start
    while True:
        f = h - h % 3
        if face[f + (h + 1) % 3] == d or face[f + (h + 2) % 3] == d:
            return True
        h = twins[f + (h + 2) % 3]  # the next half-edge from c, beyond the side that ends in c
        if h == start:
            return False
        if h < 0 or face[h] != c:
            break
    h = twins[start]  # the other way round
    while h >= 0 and face[h - h % 3 + (h + 1) % 3] == c:
        f = h - h % 3
        h1 = f + (h + 1) % 3  # h ends in c, h1 begins there
        if face[f + (h1 + 1) % 3] == d or face[f + (h1 + 2) % 3] == d:
            return True
        h = twins[h1]
    return False
