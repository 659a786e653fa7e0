"""Flat caps, triangles with a corner on the opposite edge, taken away without moving the surface.

A cap has no area: all of it lies in its longest edge. That edge is flipped, so that the cap and
the triangle across it become the two halves of that triangle, cut from the cap's corner. The
surface stays where it is to :data:`FLAT` of the edge, and no edge is slit, as dropping the cap
would. A cap whose longest edge is a boundary is dropped: the boundary then passes its corner.
"""

import numpy as np

from synthnet.arrays import Booleans, Int64s
from synthnet.mesh.adjacency import edge_keys
from synthnet.mesh.geometry import MeshFacts, corner_edges
from synthnet.types import Mesh

FLAT = 1e-9  # altitude / longest edge, at or below which a triangle has no area to speak of
ROUNDS = 200  # at most; each takes away the outermost cap of a chain


def flat(mesh: Mesh) -> Booleans:
    """Return which triangles have no area to speak of, (m,)."""
    return ~(MeshFacts(mesh).relative_altitudes > FLAT)  # NaN is none


def without_caps(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without those flat triangles that can go, and how many went.

    Parameters
    ----------
    mesh : Mesh
        No face names a vertex twice, no two faces have the same corners.

    Examples
    --------
    >>> corners = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0]])
    >>> mesh, count = without_caps(Mesh(corners, np.array([[0, 1, 2], [1, 0, 3]])))
    >>> mesh.faces.tolist(), count
    ([[0, 3, 2], [3, 1, 2]], 1)
    """
    before = int(flat(mesh).sum())
    for _ in range(ROUNDS):
        bad = np.flatnonzero(flat(mesh))
        faces = _one_round(mesh, bad) if 0 < len(bad) < len(mesh.faces) else None
        if faces is None:
            break
        mesh = Mesh(mesh.vertices, faces)
    return mesh, before - int(flat(mesh).sum())


def _one_round(mesh: Mesh, bad: Int64s) -> Int64s | None:
    """Flip the longest edges of ``bad`` faces, those without area; None if there is none to flip.

    Each face is in one flip at most.
    """
    faces = mesh.faces.astype(np.int64)
    lengths = np.linalg.norm(corner_edges(mesh), axis=2)  # opposite to each corner
    widest = lengths.argmax(axis=1)
    keys, count = edge_keys(faces), int(faces.max()) + 1
    order = np.argsort(keys, kind="stable")
    longest = 3 * bad + (widest[bad] + 1) % 3  # the half-edge opposite to the widest corner
    low = np.searchsorted(keys, keys[longest], "left", sorter=order)
    many = np.searchsorted(keys, keys[longest], "right", sorter=order) - low
    taken, gone = np.zeros(len(faces), bool), np.zeros(len(faces), bool)
    known, new, flat_ones = set[tuple[int, int]](), faces.copy(), set(bad.tolist())
    for i in np.argsort(-lengths[bad].max(axis=1), kind="stable").tolist():
        face, at = int(bad[i]), int(longest[i])
        if taken[face] or many[i] > 2:
            continue
        if many[i] == 1:
            taken[face] = gone[face] = True
            continue
        half = order[low[i] : low[i] + 2]
        across = int(half[half != at][0])
        other = across // 3
        a, b = int(faces[face, at % 3]), int(faces[face, (at + 1) % 3])
        c, d = int(faces[face, widest[face]]), int(faces[other, (across + 2) % 3])
        pair = min(c, d), max(c, d)
        wider = lengths[other].max() > lengths[face].max() and other in flat_ones
        if taken[other] or c == d or wider or pair in known:
            continue
        if _is_edge(keys, order, pair[0] * count + pair[1]):
            continue
        known.add(pair)
        taken[face] = taken[other] = True
        new[face], new[other] = (a, d, c), (d, b, c)
    return new[~gone] if taken.any() else None


def _is_edge(keys: Int64s, order: Int64s, key: int) -> bool:
    """Return whether two vertices, by their key of :func:`edge_keys`, have an edge."""
    at = int(np.searchsorted(keys, key, sorter=order))
    return at < len(keys) and int(keys[order[at]]) == key
