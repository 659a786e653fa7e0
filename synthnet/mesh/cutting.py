"""Where more than two faces meet in an edge, or several fans in a vertex, told apart.

Two solids that touch along an edge have four faces there, and are two surfaces all the same. Which
faces belong together is seen from the rest of the mesh: those of one component, joined by edges of
two faces, stay together where there are two of them at the edge. Where one component has more, as
a solid that touches itself, or several have one each, they are paired around the edge: two faces
with the inside between them, by the way they are turned, are one sheet.
"""

import numpy as np

from synthnet.arrays import Int64s
from synthnet.mesh.adjacency import connected, edge_keys, joined_half_edges
from synthnet.types import Mesh


def without_edges_of_many(mesh: Mesh, *, loose: bool = False) -> tuple[Mesh, int]:
    """Return the mesh cut at edges of more than two faces where these are pairs, and how many.

    Edges whose faces are not clearly pairs stay as they are.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices. Cut ones come after them; the first fan keeps the vertex.
    loose : bool
        Also cut where a component has one face alone at the edge, as a fin on a plate: that face
        gets a boundary there.
    """
    faces = mesh.faces.astype(np.int64)
    keys = edge_keys(faces)
    _, at, valences = np.unique(keys, return_inverse=True, return_counts=True)
    if valences.max() <= 2:
        return mesh, 0
    first, second = joined_half_edges(keys)
    simple = valences[at[first]] == 2
    piece = connected(len(faces), first[simple] // 3, second[simple] // 3)
    pairs = [np.stack([first[simple], second[simple]])]
    cut = 0
    order = np.argsort(at, kind="stable")
    ends = np.cumsum(valences)
    for edge in np.flatnonzero(valences > 2).tolist():
        halves = order[ends[edge] - valences[edge] : ends[edge]]
        paired = _paired(mesh, halves, piece[halves // 3], loose=loose)
        cut += paired is not None
        kept = np.stack([halves[:-1], halves[1:]]) if paired is None else paired
        pairs.append(kept)
    if not cut:
        return mesh, 0
    return separated(mesh, *np.concatenate(pairs, axis=1))[0], cut


def _paired(mesh: Mesh, halves: Int64s, piece: Int64s, *, loose: bool) -> Int64s | None:
    """Return the half-edges 3 f + i of one edge in pairs, (2, p), or None where they are none.

    ``piece`` is the component of each; ``loose`` says whether one may be left alone.
    """
    pairs, alone = list[Int64s](), list[Int64s]()
    for name in np.unique(piece):
        mine = halves[piece == name]
        if len(mine) == 1:
            alone.append(mine)
            continue
        pair = mine[:, None] if len(mine) == 2 else _around(mesh, mine)
        if pair is None:
            return None
        pairs.append(pair)
    if alone:
        pair = _around(mesh, np.concatenate(alone))
        if pair is None and not loose:
            return None
        pairs.append(np.zeros((2, 0), np.int64) if pair is None else pair)
    return np.concatenate(pairs, axis=1)


def _around(mesh: Mesh, halves: Int64s) -> Int64s | None:
    """Return half-edges in pairs that have the inside between them, (2, p), or None."""
    faces = mesh.faces.astype(np.int64)
    tails = faces[halves // 3, halves % 3]
    heads = faces[halves // 3, (halves + 1) % 3]
    opposite = mesh.vertices[faces[halves // 3, (halves + 2) % 3]].astype(np.float64)
    low = np.minimum(tails, heads)[0]
    along = tails == low
    if 2 * along.sum() != len(halves):
        return None
    start, end = (mesh.vertices[v].astype(np.float64) for v in (low, np.maximum(tails, heads)[0]))
    axis = (end - start) / np.linalg.norm(end - start)
    out = opposite - start
    out -= np.outer(out @ axis, axis)
    order = np.argsort(np.arctan2(out @ np.cross(axis, out[0]), out @ out[0]))
    halves, along = halves[order], along[order]
    if (along == np.roll(along, 1)).any():
        return None
    # Seen along the axis, the inside is clockwise of a face that runs along it
    behind = np.roll(halves, 1)
    return np.stack([behind[along], halves[along]])


def without_pinches(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh with a vertex for each fan where several meet in one, and how many did."""
    return separated(mesh, *joined_half_edges(edge_keys(mesh.faces)))


def separated(mesh: Mesh, first: Int64s, second: Int64s) -> tuple[Mesh, int]:
    """Return the mesh with a vertex for each fan of faces joined at half-edges, and how many broke.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices.
    first, second : ndarray of shape (e,), int64
        Half-edges 3 f + i of the same edge that stay together.
    """
    faces = mesh.faces.astype(np.int64)
    # Corner i of face f is 3 f + i; those of two faces at the same end of an edge belong together
    ends = []
    for shift in (0, 1):
        here = 3 * (first // 3) + (first % 3 + shift) % 3
        vertex = faces.ravel()[here]
        at = (faces[second // 3] == vertex[:, None]).argmax(axis=1)
        ends.append((here, 3 * (second // 3) + at))
    fans = connected(faces.size, *(np.concatenate(side) for side in zip(*ends, strict=True)))
    owner = np.zeros(fans.max() + 1, np.int64)
    owner[fans] = faces.ravel()
    order = np.argsort(owner, kind="stable")
    repeated = np.zeros(len(owner), bool)
    repeated[order[1:]] = owner[order[1:]] == owner[order[:-1]]
    number = owner.copy()
    number[repeated] = len(mesh.vertices) + np.arange(repeated.sum())
    vertices = np.concatenate([mesh.vertices, mesh.vertices[owner[repeated]]])
    return Mesh(vertices, number[fans].reshape(-1, 3)), len(np.unique(owner[repeated]))
