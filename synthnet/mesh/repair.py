"""From the triangles of a file to a surface that has a spectrum: what is repaired, what refused.

The rules, in their order. A repair is recorded with how many vertices or faces it met; what is
refused is named, and nothing is guessed. Those with a name in :data:`REPAIRS` can be left out.

====================  ==========================================================================
finding               rule
====================  ==========================================================================
no faces              refused: ``no_faces``
too many              refused: ``too_large``; faces before, vertices after merging
not finite            refused if a face uses such a coordinate: ``finite``
size                  refused if the diagonal is outside :data:`DIAGONALS`: ``extent``
equal positions       vertices nearer than :data:`NEAR` of the diagonal become one; refused
                      if :data:`COLLAPSED` of the faces fall together by it: ``extent``.
                      (``merge``). ``apart``: not if merging would give an edge more than
                      two faces, the surface is one as it is, and merging closes no seam.
                      If too many faces fall together, and one component alone is kept, each part
                      is measured by its own diagonal: parts may be small and far from each other
repeated corners      faces that name a vertex twice (after that) are dropped
duplicate faces       ``duplicates``: of faces with the same three corners one is kept
loose vertices        vertices without a face are dropped
no altitude           ``caps``: flat triangles go by a flip of their longest edge
non-manifold edges    ``cut``: cut where the faces are clearly pairs, as where two solids touch
several components    kept; or the largest by area alone; or a certain one. Components are of
                      faces that share edges, so what only shares a vertex is several
no altitude           refused, if any is left: ``degenerate_face``
non-manifold edges    refused, if any is left: ``non_manifold_edge``
pinched vertices      ``pinches``: a vertex where several fans of faces meet is one for each
                      of them; refused if that is left out: ``pinched_vertex``
orientation           ``orientation``: faces are turned to agree; a closed surface of one
                      component is turned outwards; one without orientation stays as it is
few vertices          refused: ``few_vertices``
====================  ==========================================================================
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.errors import SynthNetError, counted
from synthnet.mesh import caps, cutting
from synthnet.mesh.adjacency import connected, edge_keys, face_components, neighbours
from synthnet.mesh.geometry import MeshFacts, area, face_areas, volume
from synthnet.types import Mesh, Vertices

NEAR = 1e-7  # of the diagonal of the bounding box: a float32 has 6e-8 of its size
DIAGONALS = (1e-30, 1e30)  # of the bounding box: of these float32 can store the smallest parts
COLLAPSED = 0.25  # of the faces; scans and CAD have some slivers that merging takes away
FAR = 10  # times smaller is a mesh without its farthest vertex, if that is far away
# A factor has about 8 n log2(n) entries (A. George, SIAM J. Numer. Anal. 10, 1973): 2.7 GB here
MOST_VERTICES = 2_000_000
MOST_FACES = 4_000_000  # a closed surface has twice as many as vertices
KEEP, LARGEST, SPLIT = COMPONENTS = "keep", "largest", "split"
REPAIRS = {  # those that can be left out, and what a file then is refused for
    "polygons": "polygons that are not convex",
    "merge": "equal positions",
    "apart": "a surface whose parts touch",
    "duplicates": "faces with the same corners",
    "caps": "flat triangles",
    "cut": "solids that touch along an edge",
    "pinches": "fans that meet in a vertex",
    "orientation": "faces that turn against their neighbours",
}


class Refused(SynthNetError):
    """A mesh that no rule makes a surface: ``reason`` is the rule's name."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason, self.detail = reason, detail

    def __reduce__(self) -> tuple[type[Refused], tuple[str, str]]:
        """Say how another process makes it anew."""
        return Refused, (self.reason, self.detail)


@dataclass(frozen=True, slots=True)
class Rules:
    """What the rules leave open.

    Parameters
    ----------
    least : int
        Vertices that one component needs, by default for ten eigenvalues after zero.
    components : str
        ``keep`` all of them, or the ``largest`` by area.
    part : int or None
        Keep this component alone, by area from the largest, 0, to the smallest.
    without : tuple of str
        Names of :data:`REPAIRS` that are left out.
    cut_fins : bool
        Also cut where a face is alone at an edge of more than two faces, as a fin on a plate. That
        changes the surface: nothing connects the two any more.
    """

    least: int = 11
    components: str = KEEP
    part: int | None = None
    without: tuple[str, ...] = ()
    cut_fins: bool = False


@dataclass(frozen=True, slots=True)
class Repaired:
    """A surface, and what it took.

    Parameters
    ----------
    mesh : Mesh
        Every edge with one face or two.
    repairs : dict of str to int
        How many vertices or faces each repair met; those that met none are left out.
    orientable : bool
        Whether its faces could be turned to agree.
    shares : ndarray of float64
        Of the area, of all components there were, descending.
    components : int
        Of the surface as it is now.
    """

    mesh: Mesh
    repairs: dict[str, int] = field(default_factory=dict)
    orientable: bool = True
    shares: Floats = field(default_factory=lambda: np.ones(1))
    components: int = 1

    def with_repair(self, name: str, count: int, mesh: Mesh) -> Repaired:
        """Return the next state, with a repair that met so many."""
        repairs = {**self.repairs, name: count} if count else self.repairs
        return replace(self, mesh=mesh, repairs=repairs)


def repair(mesh: Mesh, rules: Rules | None = None) -> Repaired:
    """Return the surface that the triangles of a file stand for.

    Parameters
    ----------
    mesh : Mesh
        As it was read.
    rules : Rules, optional
        What is kept of several components, and which repairs are left out.

    Raises
    ------
    Refused
        By the first rule that the mesh offends.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> done = repair(Mesh(corners, np.arange(6).reshape(2, 3)), Rules(least=4))
    >>> done.repairs, len(done.mesh.vertices)
    ({'merged vertices': 2}, 4)
    """
    rules = rules or Rules()
    state = in_order(told_apart(mesh, rules), (not_flat, partial(manifold_edges, rules=rules)))
    state = without_pinches(state, split="pinches" not in rules.without)
    state = replace(state, components=int(face_components(state.mesh.faces).max()) + 1)
    turned = oriented(state)
    kept = replace(state, orientable=turned.orientable)
    state = turned if "orientation" not in rules.without else kept
    count, least = len(state.mesh.vertices), rules.least + state.components - 1
    if count < least:
        of = "" if state.components == 1 else f" of {state.components} components"
        raise Refused("few_vertices", f"{count} vertices, a spectrum{of} needs at least {least}")
    return state


def welded(mesh: Mesh) -> Repaired:
    """Return the mesh with one vertex of those at the same position, and else as it stands.

    This alone makes a surface of formats whose triangles have corners of their own, as STL. Its
    edges may have any number of faces.

    Raises
    ------
    Refused
        If a coordinate is not finite, or the size is out of bounds.

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> welded(Mesh(corners, np.arange(6).reshape(2, 3))).mesh.faces.tolist()
    [[0, 1, 2], [1, 3, 2]]
    """
    state = in_order(Repaired(mesh), (finite, within_extent, merged))
    return in_order(state, (without_repeated_corners, without_loose_vertices))


def count_components(mesh: Mesh, rules: Rules) -> int:
    """Return how many components a mesh has, as :func:`repair` numbers them.

    Raise Refused by the first rule that the mesh offends before its components are told apart.
    """
    return len(told_apart(mesh, replace(rules, components=KEEP, part=None), alone=True).shares)


def told_apart(mesh: Mesh, rules: Rules, *, alone: bool = False) -> Repaired:
    """Return the mesh after all rules up to the one of its components.

    ``alone`` is whether each component becomes a shape by itself, as the rules may say, too.
    """
    if not len(mesh.faces):
        count = len(mesh.vertices)
        raise Refused("no_faces", f"a point cloud: {count:,} points" if count else "it is empty")
    if len(mesh.faces) > MOST_FACES:
        raise Refused("too_large", f"{len(mesh.faces):,} faces, more than {MOST_FACES:,}")
    state = Repaired(Mesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)))
    state = in_order(state, (finite, within_extent))
    cleaning: list[Rule] = [without_repeated_corners, without_loose_vertices]
    if "duplicates" not in rules.without:
        cleaning.insert(1, without_duplicates)
    as_it_is = in_order(state, cleaning)
    repaired = as_it_is
    if "merge" not in rules.without:
        join = partial(merged, alone=alone or rules.components != KEEP or rules.part is not None)
        repaired = in_order(join(state), cleaning)
        if "apart" not in rules.without and not has_manifold_edges(repaired.mesh):
            touching = repaired.repairs.get("merged vertices", 0)
            if is_surface(as_it_is.mesh) and not has_seams(as_it_is, join):
                repaired = as_it_is.with_repair("touching vertices", touching, as_it_is.mesh)
    repaired = not_too_large(repaired)
    if "caps" not in rules.without:
        repaired = without_caps(repaired)
    if "cut" not in rules.without:
        repaired = cut(repaired, fins=rules.cut_fins)
    return chosen(repaired, rules)


Rule: TypeAlias = Callable[[Repaired], Repaired]


def in_order(state: Repaired, rules: Iterable[Rule]) -> Repaired:
    """Return what one rule after the other makes of a mesh."""
    for rule in rules:
        state = rule(state)
    return state


def has_manifold_edges(mesh: Mesh) -> bool:
    """Return whether no edge has more than two faces."""
    return bool((MeshFacts(mesh).edge_valences <= 2).all())


def is_surface(mesh: Mesh) -> bool:
    """Return whether each edge has at most two faces, and each face an area."""
    return has_manifold_edges(mesh) and not flat_faces(mesh)


def has_seams(state: Repaired, join: Rule) -> bool:
    """Return whether merging gives an edge of one face its second one, as along a seam."""
    before, after = (_valences(repaired.mesh.faces) for repaired in (state, join(state)))
    return bool(((before == 1) & (after == 2)).any())


def _valences(faces: NDArray[np.integer]) -> Int64s:
    """Return how many faces the edge from corner i to corner i + 1 of each face has, (3 m,)."""
    _, number, counts = np.unique(edge_keys(faces), return_inverse=True, return_counts=True)
    valences: Int64s = counts[number.ravel()]
    return valences


def finite(state: Repaired) -> Repaired:
    """Refuse coordinates that are not finite, where a face uses them."""
    used = np.zeros(len(state.mesh.vertices), bool)
    used[state.mesh.faces.ravel()] = True
    bad = used & ~np.isfinite(state.mesh.vertices).all(axis=1)
    if bad.any():
        nan = int(np.isnan(state.mesh.vertices[bad]).any(axis=1).sum())
        of_them = f", {nan} of them NaN" if nan else ", but infinite or too large for a number"
        first = f"the first is vertex {np.flatnonzero(bad)[0]}"
        many = counted(int(bad.sum()), "vertex is", "vertices are")
        raise Refused("finite", f"{many} not finite{of_them}, {first}")
    vertices = np.where(used[:, None], state.mesh.vertices, 0.0)  # the others fall away below
    return replace(state, mesh=Mesh(vertices, state.mesh.faces))


def within_extent(state: Repaired) -> Repaired:
    """Refuse sizes that float32 cannot store or whose squares and areas have no float64."""
    diagonal, (least, most) = _diagonal(state.mesh), DIAGONALS
    if least <= diagonal <= most:
        return state
    if diagonal == 0:
        raise Refused("extent", "all its vertices are at the same position")
    if diagonal < least:
        raise Refused("extent", f"the diagonal is {diagonal:g}, below {least:g}: scale the mesh")
    used = np.unique(state.mesh.faces)
    sizes = np.abs(state.mesh.vertices[used]).max(axis=1)
    size = "overflows" if np.isinf(diagonal) else f"is {diagonal:g}, above {most:g}"
    raise Refused(
        "extent",
        f"the diagonal {size}: vertex {used[sizes.argmax()]} has a coordinate of "
        f"{sizes.max():.3g}; scale the mesh",
    )


def merged(state: Repaired, *, alone: bool = False) -> Repaired:
    """Make one vertex of those at the same position, the one that comes first.

    What is the same goes by the size of the mesh. Parts that are small beside the distance between
    them would collapse by that. If one component alone is kept (``alone``), each part is measured
    by itself then: a part is what faces connect, and vertices that were the same so far.
    """
    vertices, faces = state.mesh.vertices, state.mesh.faces
    used, corners = np.unique(faces, return_inverse=True)
    corners = corners.reshape(-1, 3)
    joined = _near(vertices[used], NEAR * _diagonal(state.mesh))
    parts = 1
    while (gone := _collapsed(vertices[faces], joined[corners])) > COLLAPSED * len(faces):
        part = _parts(corners, joined)
        before, parts = parts, int(part.max()) + 1
        if parts == before or not alone:
            raise _too_many_collapsed(state.mesh, gone, part, alone=alone)
        joined = _near_in_parts(vertices[used], part)
    keep = np.full(joined.max() + 1, len(used))
    np.minimum.at(keep, joined, np.arange(len(used)))
    target = np.arange(len(vertices))
    target[used] = used[keep[joined]]
    mesh = Mesh(vertices, target[faces])
    return state.with_repair("merged vertices", len(used) - len(keep), mesh)


def _collapsed(corners: NDArray[np.floating], joined: Int64s) -> int:
    """Return how many faces whose corners (m, 3, 3) differ have two that are joined, (m, 3)."""
    apart = (corners != np.roll(corners, 1, axis=1)).any(axis=2).all(axis=1)
    return int(np.count_nonzero(apart & _repeated(joined)))


def _parts(corners: Int64s, joined: Int64s) -> Int64s:
    """Return the part of each vertex, (n,): faces connect it, and vertices that are joined."""
    n = len(joined)
    tails = np.concatenate([corners[:, :2].ravel(), np.arange(n)])
    heads = np.concatenate([corners[:, 1:].ravel(), n + joined])
    return connected(n + int(joined.max()) + 1, tails, heads)[:n]


def _too_many_collapsed(mesh: Mesh, gone: int, part: Int64s, *, alone: bool) -> Refused:
    """Return that merging collapses too many faces, with the cause and what helps.

    ``part`` is that of each vertex with a face.
    """
    parts = int(part.max()) + 1
    distance = f"{NEAR * _diagonal(mesh):.2g}, {NEAR:g} of the diagonal"
    if _has_far_vertex(mesh.vertices[np.unique(mesh.faces)], part):
        cause = "is a vertex far away?"
    else:
        cause = (
            "the mesh is too thin or too fine for that: remesh it, or try it without repair "
            "(repair=False, --no-repair) or with `synthnet import --without merge`"
        )
    if parts > 1 and alone:
        distance = f"{NEAR:g} of the diagonal of their part"
    elif parts > 1:
        cause = (
            f"its {parts:,} parts are small beside the distance between them; `synthnet import "
            "--components largest`, or split, measures each by itself"
        )
    return Refused(
        "extent", f"{gone:,} of {len(mesh.faces):,} faces are smaller than {distance}: {cause}"
    )


def _has_far_vertex(points: Vertices, part: Int64s) -> bool:
    """Return whether a part is smaller than a :data:`FAR`-th without the vertex farthest out."""
    points, first = np.unique(points, axis=0, return_index=True)  # an STL file repeats a corner
    part = np.unique(part[first], return_inverse=True)[1]
    counts = np.bincount(part)
    middle = np.stack([np.bincount(part, x) for x in points.T], axis=1) / counts[:, None]
    order = np.lexsort((np.linalg.norm(points - middle[part], axis=1), part))
    rest = np.delete(order, np.cumsum(counts) - 1)
    without = _boxes(points[rest], part[rest], len(counts))[1]
    return bool((FAR * without < _boxes(points, part, len(counts))[1]).any())


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
    mesh = compact(state.mesh)
    gone = len(state.mesh.vertices) - len(mesh.vertices)
    count = gone - state.repairs.get("merged vertices", 0)
    return state.with_repair("loose vertices", count, mesh)


def not_flat(state: Repaired) -> Repaired:
    """Refuse triangles without area."""
    bad = flat_faces(state.mesh)
    if bad:
        raise Refused("degenerate_face", f"{bad} of {len(state.mesh.faces)} faces have no area")
    return state


def manifold_edges(state: Repaired, rules: Rules) -> Repaired:
    """Refuse edges of more than two faces, with the cause and what helps."""
    bad = int(np.count_nonzero(MeshFacts(state.mesh).edge_valences > 2))
    if not bad:
        return state
    if "cut" in rules.without:
        cause = "which are not to be cut (--without cut)"
    elif not rules.cut_fins and has_manifold_edges(cut(state, fins=True).mesh):
        cause = "not clearly in pairs: `synthnet import --cut-fins` may cut them"
    elif cutting.without_edges_of_many(state.mesh, loose=rules.cut_fins)[1]:  # once more
        cause = "in pairs that are joined at both ends of their edge: subdivide the mesh there"
    else:
        cause = "not clearly in pairs: remove faces until each edge has two at most"
    many = counted(bad, "edge has", "edges have")
    raise Refused("non_manifold_edge", f"{many} more than two faces, {cause}")


def without_caps(state: Repaired) -> Repaired:
    """Take away flat triangles without moving the surface, where that can be done."""
    mesh, count = caps.without_caps(state.mesh)
    return state.with_repair("flat faces", count, compact(mesh) if count else mesh)


def cut(state: Repaired, *, fins: bool) -> Repaired:
    """Cut edges of more than two faces where these are clearly pairs, then fins if asked to."""
    mesh, count = cutting.without_edges_of_many(state.mesh)
    state = state.with_repair("cut edges", count, mesh)
    mesh, count = cutting.without_edges_of_many(mesh, loose=True) if fins else (mesh, 0)
    return state.with_repair("edges cut from fins", count, mesh)


def without_pinches(state: Repaired, *, split: bool) -> Repaired:
    """Make a vertex where several fans of faces meet one vertex for each fan, or refuse it."""
    mesh, count = cutting.without_pinches(state.mesh)
    if count and not split:
        raise Refused("pinched_vertex", f"{count} vertices join several fans of faces")
    return state.with_repair("pinched vertices", count, mesh) if split else state


def chosen(state: Repaired, rules: Rules) -> Repaired:
    """Keep all components, the largest by area, or a certain one."""
    of_face = face_components(state.mesh.faces)
    areas = np.bincount(of_face, face_areas(state.mesh))
    order = np.argsort(-areas, kind="stable")
    state = replace(state, shares=areas[order] / max(areas.sum(), np.finfo(float).tiny))
    if len(areas) == 1 or (rules.components == KEEP and rules.part is None):
        return state
    kept = order[rules.part or 0]
    mesh = compact(Mesh(state.mesh.vertices, state.mesh.faces[of_face == kept]))
    left_out = 0 if rules.part is not None else len(areas) - 1
    return state.with_repair("components left out", left_out, mesh)


def oriented(state: Repaired) -> Repaired:
    """Turn the faces of each component to agree, and a closed surface of one outwards."""
    faces = state.mesh.faces
    m = len(faces)
    left, right, tails = neighbours(faces)
    # Each face twice, as it is and turned: neighbours that agree are joined side by side
    agree = faces[left, tails[:, 0]] != faces[right, tails[:, 1]]
    other = np.where(agree, right, right + m)
    double = connected(
        2 * m, np.concatenate([left, left + m]), np.concatenate([other, (other + m) % (2 * m)])
    )
    two_sided = double[:m] != double[m:]
    piece = connected(m, left, right)
    first = np.unique(piece, return_index=True)[1][piece]  # a face of the same component
    turn = two_sided & (double[:m] != double[first])
    most = 2 * np.bincount(piece, turn) > np.bincount(piece)  # the way that the most of them are
    turn ^= two_sided & most[piece]
    mesh = Mesh(state.mesh.vertices, np.where(turn[:, None], faces[:, ::-1], faces))
    state = replace(state, orientable=bool(two_sided.all()))
    closed = 2 * len(left) == 3 * m
    if closed and state.orientable and state.components == 1 and volume(centred(mesh)) < 0:
        turn, mesh = ~turn, Mesh(mesh.vertices, mesh.faces[:, ::-1])
    return state.with_repair("turned faces", int(turn.sum()), mesh)


def flat_faces(mesh: Mesh) -> int:
    """Return how many triangles have no area to speak of."""
    return int(np.count_nonzero(caps.flat(mesh)))


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


def _repeated(faces: NDArray[np.integer]) -> Booleans:
    """Return which faces name a vertex twice."""
    repeated: Booleans = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    return repeated


def _near_in_parts(points: Vertices, part: Int64s) -> Int64s:
    """Return :func:`_near` by :data:`NEAR` of the diagonal of each point's part, (n,)."""
    least, diagonals = _boxes(points, part, int(part.max()) + 1)
    diagonals[diagonals == 0] = 1.0  # of a part whose vertices are all in one point
    return _near((points - least[part]) / diagonals[part, None], NEAR, part)


def _boxes(points: Vertices, part: Int64s, parts: int) -> tuple[Floats, Floats]:
    """Return the lowest corner, (p, 3), and the diagonal, (p,), of each part's bounding box."""
    least, most = np.full((2, parts, 3), [[[np.inf]], [[-np.inf]]])
    np.minimum.at(least, part, points)
    np.maximum.at(most, part, points)
    return least, np.linalg.norm(most - least, axis=1)


def _near(points: Vertices, distance: float, part: Int64s | None = None) -> Int64s:
    """Return a number for each point, (n,), equal for those joined by steps below a distance.

    ``part`` is a number of each point, (n,); points of different ones are not joined.

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
        if part is not None:
            x = np.unique((part << 24) + x, return_inverse=True)[1].ravel()
        column = np.unique((x << 24) + y, return_inverse=True)[1].ravel()
        cell = np.unique((column << 24) + z, return_inverse=True)[1].ravel()
        joined = connected(2 * n, joined, n + cell)[joined]
    return np.unique(joined, return_inverse=True)[1].ravel()


def compact(mesh: Mesh) -> Mesh:
    """Return the mesh without the vertices that no face names."""
    used, numbered = np.unique(mesh.faces, return_inverse=True)
    return Mesh(mesh.vertices[used], numbered.reshape(-1, 3))
