"""From the triangles of a file to one surface that has a spectrum: what is repaired, what refused.

The rules, in their order. A repair is recorded with how many vertices or faces it met; what is
refused is named, and nothing is guessed.

====================  ==========================================================================
finding               rule
====================  ==========================================================================
no faces              refused: ``no_faces``
too many              refused: ``too_large``; faces before, vertices after merging
not finite            refused if a face uses such a coordinate: ``finite``
size                  refused if the diagonal is outside :data:`DIAGONALS`: ``extent``
equal positions       vertices nearer than :data:`NEAR` of the diagonal become one; refused
                      if :data:`COLLAPSED` of the faces fall together by it: ``extent``
repeated corners      faces that name a vertex twice (after that) are dropped
duplicate faces       of faces with the same three corners one is kept
loose vertices        vertices without a face are dropped
no altitude           refused: ``degenerate_face``; without its face the surface would be slit
non-manifold edges    refused: ``non_manifold_edge``; an edge may have one face or two
pinched vertices      a vertex where several fans of faces meet is one for each of them
several components    refused: ``components``; or, on request, the largest by area is kept
orientation           faces are turned to agree; a closed surface is turned outwards; a surface
                      that has no orientation stays as it is
few vertices          refused: ``few_vertices``
====================  ==========================================================================
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from synthnet.errors import SynthNetError
from synthnet.mesh.geometry import MeshFacts, area, face_areas, volume
from synthnet.types import Mesh, Vertices

NEAR = 1e-7  # of the diagonal of the bounding box: a float32 has 6e-8 of its size
FLAT = 1e-9  # altitude / longest edge, at or below which a triangle has no area to speak of
DIAGONALS = (1e-30, 1e30)  # of the bounding box: of these float32 can store the smallest parts
COLLAPSED = 0.25  # of the faces; scans and CAD have some slivers that merging takes away
# A factor has about 8 n log2(n) entries (A. George, SIAM J. Numer. Anal. 10, 1973): 2.7 GB here
MOST_VERTICES = 2_000_000
MOST_FACES = 4_000_000  # a closed surface has twice as many as vertices


class Refused(SynthNetError):
    """A mesh that no rule makes one surface: ``reason`` is the rule's name."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason, self.detail = reason, detail


@dataclass(frozen=True, slots=True)
class Repaired:
    """A surface, and what it took.

    Parameters
    ----------
    mesh : Mesh
        One component, every edge with one face or two.
    repairs : dict of str to int
        How many vertices or faces each repair met; those that met none are left out.
    orientable : bool
        Whether its faces could be turned to agree.
    """

    mesh: Mesh
    repairs: dict[str, int] = field(default_factory=dict)
    orientable: bool = True

    def with_repair(self, name: str, count: int, mesh: Mesh) -> Repaired:
        """Return the next state, with a repair that met so many."""
        repairs = {**self.repairs, name: count} if count else self.repairs
        return replace(self, mesh=mesh, repairs=repairs)


def repair(mesh: Mesh, *, least: int = 11, keep_largest: bool = False) -> Repaired:
    """Return the surface that the triangles of a file stand for.

    Parameters
    ----------
    mesh : Mesh
        As it was read.
    least : int
        Vertices that a spectrum of ten eigenvalues after zero needs.
    keep_largest : bool
        Keep the largest of several components instead of refusing the mesh.

    Raises
    ------
    Refused
        By the first rule that the mesh offends.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> done = repair(Mesh(corners, np.arange(6).reshape(2, 3)), least=4)
    >>> done.repairs, len(done.mesh.vertices)
    ({'merged vertices': 2}, 4)
    """
    if not len(mesh.faces):
        raise Refused("no_faces", "the file has vertices only, or nothing")
    if len(mesh.faces) > MOST_FACES:
        raise Refused("too_large", f"{len(mesh.faces):,} faces, more than {MOST_FACES:,}")
    state = Repaired(Mesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)))
    rules: tuple[Callable[[Repaired], Repaired], ...] = (
        finite,
        within_extent,
        merged,
        without_repeated_corners,
        without_duplicates,
        without_loose_vertices,
        not_too_large,
        not_flat,
        manifold_edges,
        split_pinches,
    )
    for rule in rules:
        state = rule(state)
    state = connected(state, keep_largest)
    state = oriented(state)
    if len(state.mesh.vertices) < least:
        count = len(state.mesh.vertices)
        raise Refused("few_vertices", f"{count} vertices, a spectrum needs at least {least}")
    return state


def finite(state: Repaired) -> Repaired:
    """Refuse coordinates that are not finite, where a face uses them."""
    used = np.zeros(len(state.mesh.vertices), bool)
    used[state.mesh.faces.ravel()] = True
    bad = used & ~np.isfinite(state.mesh.vertices).all(axis=1)
    if bad.any():
        raise Refused("finite", f"{bad.sum()} vertices are not finite")
    vertices = np.where(used[:, None], state.mesh.vertices, 0.0)  # the others fall away below
    return replace(state, mesh=Mesh(vertices, state.mesh.faces))


def within_extent(state: Repaired) -> Repaired:
    """Refuse sizes that float32 cannot store or whose squares and areas have no float64."""
    diagonal, (least, most) = _diagonal(state.mesh), DIAGONALS
    if not least <= diagonal <= most:
        raise Refused("extent", f"the diagonal is {diagonal:g}, not between {least:g} and {most:g}")
    return state


def merged(state: Repaired) -> Repaired:
    """Make one vertex of those at the same position, the one that comes first."""
    vertices, faces = state.mesh.vertices, state.mesh.faces
    used = np.unique(faces)
    distance = NEAR * _diagonal(state.mesh)
    joined = _near(vertices[used], distance)
    keep = np.full(joined.max() + 1, len(used))
    np.minimum.at(keep, joined, np.arange(len(used)))
    target = np.arange(len(vertices))
    target[used] = used[keep[joined]]
    mesh = Mesh(vertices, target[faces])
    apart = (vertices[faces] != np.roll(vertices[faces], 1, axis=1)).any(axis=2).all(axis=1)
    gone = int(np.count_nonzero(apart & _repeated(mesh.faces)))
    if gone > COLLAPSED * len(faces):
        raise Refused(
            "extent",
            f"{gone:,} of {len(faces):,} faces are smaller than {distance:.2g}, {NEAR:g} of the "
            "diagonal: is a vertex far away?",
        )
    return state.with_repair("merged vertices", len(used) - len(keep), mesh)


def not_too_large(state: Repaired) -> Repaired:
    """Refuse surfaces whose label would take all memory."""
    count = len(state.mesh.vertices)
    if count > MOST_VERTICES:
        raise Refused("too_large", f"{count:,} vertices, more than {MOST_VERTICES:,}")
    return state


def without_repeated_corners(state: Repaired) -> Repaired:
    """Drop faces that name a vertex twice."""
    faces = state.mesh.faces
    good = ~_repeated(faces)
    if not good.any():
        raise Refused("no_faces", "no face has three corners that differ")
    mesh = Mesh(state.mesh.vertices, faces[good])
    return state.with_repair("faces with repeated corners", int((~good).sum()), mesh)


def without_duplicates(state: Repaired) -> Repaired:
    """Keep one, the first, of the faces with the same three corners."""
    _, first = np.unique(np.sort(state.mesh.faces, axis=1), axis=0, return_index=True)
    count = len(state.mesh.faces) - len(first)
    mesh = Mesh(state.mesh.vertices, state.mesh.faces[np.sort(first)])
    return state.with_repair("duplicate faces", count, mesh)


def without_loose_vertices(state: Repaired) -> Repaired:
    """Drop vertices without a face; those that were merged into another are no repair."""
    mesh = _compact(state.mesh)
    gone = len(state.mesh.vertices) - len(mesh.vertices)
    count = gone - state.repairs.get("merged vertices", 0)
    return state.with_repair("loose vertices", count, mesh)


def not_flat(state: Repaired) -> Repaired:
    """Refuse triangles without area."""
    bad = flat_faces(state.mesh)
    if bad:
        raise Refused("degenerate_face", f"{bad} of {len(state.mesh.faces)} faces have no area")
    return state


def manifold_edges(state: Repaired) -> Repaired:
    """Refuse edges of more than two faces."""
    bad = int(np.count_nonzero(MeshFacts(state.mesh).edge_valences > 2))
    if bad:
        raise Refused("non_manifold_edge", f"{bad} edges have more than two faces")
    return state


def split_pinches(state: Repaired) -> Repaired:
    """Make a vertex where several fans of faces meet one vertex for each fan."""
    faces = state.mesh.faces
    left, right, tails = _neighbours(faces)
    m = len(faces)
    # Corner i of face f is 3 f + i; those of two faces at the same end of an edge belong together
    ends = []
    for shift in (0, 1):
        here = 3 * left + (tails[:, 0] + shift) % 3
        vertex = faces.ravel()[here]
        at = (faces[right] == vertex[:, None]).argmax(axis=1)
        ends.append((here, 3 * right + at))
    fans = _components(3 * m, *(np.concatenate(side) for side in zip(*ends, strict=True)))
    owner = np.zeros(fans.max() + 1, np.int64)
    owner[fans] = faces.ravel()
    order = np.argsort(owner, kind="stable")
    repeated = np.zeros(len(owner), bool)
    repeated[order[1:]] = owner[order[1:]] == owner[order[:-1]]
    number = owner.copy()
    number[repeated] = len(state.mesh.vertices) + np.arange(repeated.sum())
    vertices = np.concatenate([state.mesh.vertices, state.mesh.vertices[owner[repeated]]])
    mesh = Mesh(vertices, number[fans].reshape(-1, 3))
    return state.with_repair("pinched vertices", len(np.unique(owner[repeated])), mesh)


def connected(state: Repaired, keep_largest: bool) -> Repaired:
    """Refuse several components, or keep the largest by area."""
    faces = state.mesh.faces
    joined = _components(len(state.mesh.vertices), faces[:, [0, 1]].ravel(), faces[:, 1:].ravel())
    of_face = joined[faces[:, 0]]
    count = int(joined.max()) + 1
    if count == 1:
        return state
    areas = np.bincount(of_face, face_areas(state.mesh), count)
    share = areas.max() / areas.sum()
    if not keep_largest:
        raise Refused("components", f"{count} components, the largest has {share:.1%} of the area")
    mesh = _compact(Mesh(state.mesh.vertices, faces[of_face == areas.argmax()]))
    return state.with_repair("components left out", count - 1, mesh)


def oriented(state: Repaired) -> Repaired:
    """Turn faces to agree, and a closed surface outwards, if it has an orientation."""
    faces = state.mesh.faces
    m = len(faces)
    left, right, tails = _neighbours(faces)
    # Each face twice, as it is and turned: neighbours that agree are joined side by side
    agree = faces[left, tails[:, 0]] != faces[right, tails[:, 1]]
    other = np.where(agree, right, right + m)
    double = _components(
        2 * m, np.concatenate([left, left + m]), np.concatenate([other, (other + m) % (2 * m)])
    )
    if double[0] == double[m]:
        return replace(state, orientable=False)
    turn = double[:m] != double[0]
    if 2 * turn.sum() > m:
        turn = ~turn  # as the most of them are
    mesh = Mesh(state.mesh.vertices, np.where(turn[:, None], faces[:, ::-1], faces))
    closed = 2 * len(left) == 3 * m
    if closed and volume(centred(mesh)) < 0:
        turn, mesh = ~turn, Mesh(mesh.vertices, mesh.faces[:, ::-1])
    return state.with_repair("turned faces", int(turn.sum()), mesh)


def flat_faces(mesh: Mesh) -> int:
    """Return how many triangles have no area to speak of."""
    return int(np.count_nonzero(~(MeshFacts(mesh).relative_altitudes > FLAT)))  # NaN is none


def unit_area(mesh: Mesh) -> tuple[Mesh, float]:
    """Return the mesh centred and scaled to area 1, and the factor of its lengths.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0.0, 0, 0], [4, 0, 0], [0, 2, 0]])
    >>> mesh, scale = unit_area(Mesh(corners, np.array([[0, 1, 2]])))
    >>> scale, area(mesh)
    (0.5, 1.0)
    """
    scale = 1 / np.sqrt(area(mesh))
    return Mesh(centred(mesh).vertices * scale, mesh.faces), float(scale)


def centred(mesh: Mesh) -> Mesh:
    """Return the mesh with the mean of its vertices at the origin."""
    return Mesh(mesh.vertices - mesh.vertices.mean(axis=0), mesh.faces)


def _diagonal(mesh: Mesh) -> float:
    """Return the diagonal of the bounding box; vertices without a face do not count."""
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.faces)], axis=0)))


def _repeated(faces: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return which faces name a vertex twice."""
    repeated: NDArray[np.bool_] = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return repeated


def _near(points: Vertices, distance: float) -> NDArray[np.int64]:
    """Return a number for each point, (n,), equal for those joined by steps below a distance.

    Points that share a cell of twice that width are joined. Along an axis the cells of two grids
    half a cell apart have no walls nearer to each other than the distance, so two points within
    it share a cell of one of the two, and of one of the eight in space. No step is longer than
    a cell's diagonal, 3.5 times the distance. Memory is linear in the points, however they lie.
    """
    n = len(points)
    scaled = (points - points.min(axis=0)) / (2 * distance)  # at most 5e6 by NEAR
    joined = np.arange(n)
    for shift in itertools.product((0.0, 0.5), repeat=3):
        x, y, z = np.floor(scaled + shift).astype(np.int64).T
        column = np.unique((x << 24) + y, return_inverse=True)[1].ravel()
        cell = np.unique((column << 24) + z, return_inverse=True)[1].ravel()
        joined = _components(2 * n, joined, n + cell)[joined]
    return np.unique(joined, return_inverse=True)[1].ravel()


def _compact(mesh: Mesh) -> Mesh:
    """Return the mesh without the vertices that no face names."""
    used, numbered = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[used], numbered.reshape(-1, 3))


def _neighbours(
    faces: NDArray[np.integer],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the two faces of each inner edge, (e,) twice, and where it begins in each, (e, 2).

    An edge that begins at corner i of a face goes on to corner i + 1.
    """
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keys = np.minimum(tails, heads) * (int(faces.max()) + 1) + np.maximum(tails, heads)
    order = np.argsort(keys, kind="stable")
    twice = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    first, second = order[twice], order[twice + 1]
    return first // 3, second // 3, np.stack([first % 3, second % 3], axis=1)


def _components(
    count: int, tails: NDArray[np.integer], heads: NDArray[np.integer]
) -> NDArray[np.int64]:
    """Return the number of the component of each of ``count`` nodes, (count,)."""
    graph = sparse.coo_matrix((np.ones(len(tails), bool), (tails, heads)), shape=(count, count))
    labels: NDArray[np.int64] = connected_components(graph, directed=False)[1].astype(np.int64)
    return labels
