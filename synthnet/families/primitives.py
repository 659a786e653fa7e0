"""Open3D's primitives as :class:`~synthnet.types.Mesh`, for the families to build on."""

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Floats, Int64s
from synthnet.mesh.adjacency import connected
from synthnet.mesh.open3d import from_open3d, load_open3d
from synthnet.mesh.repair import compact
from synthnet.types import Mesh

PLANE = 1e-9  # distance under which a point lies on a plane, or two points are one
CLEAR = 1e-6  # angle by which a cap keeps off a plane to be on one side of it
FLAT = 1e-9  # neighbours whose unit normals differ by less form one flat facet


def box(*, width: float, height: float, depth: float) -> Mesh:
    """Rectangular box [0, width] × [0, height] × [0, depth]."""
    return _made("box", width=width, height=height, depth=depth)


def cone(*, radius: float, height: float, resolution: int, split: int) -> Mesh:
    """Closed cone on the plane z = 0, apex at (0, 0, height), in ``split`` bands."""
    return _made("cone", radius=radius, height=height, resolution=resolution, split=split)


def cylinder(*, radius: float, height: float, resolution: int, split: int) -> Mesh:
    """Closed cylinder, -height/2 ≤ z ≤ height/2, in ``split`` bands; each cap is one fan."""
    return _made("cylinder", radius=radius, height=height, resolution=resolution, split=split)


def sphere(*, radius: float, resolution: int) -> Mesh:
    """Sphere of two poles and ``resolution`` − 1 circles of 2·``resolution`` points."""
    return _made("sphere", radius=radius, resolution=resolution)


def torus(
    *, torus_radius: float, tube_radius: float, radial_resolution: int, tubular_resolution: int
) -> Mesh:
    """Torus about the z axis; embedded only while the tube radius is below the torus radius.

    Examples
    --------
    >>> ring = torus(torus_radius=1, tube_radius=0.3, radial_resolution=8, tubular_resolution=6)
    >>> ring.vertices.shape, ring.faces.shape
    ((48, 3), (96, 3))
    """
    return _made("torus", torus_radius, tube_radius, radial_resolution, tubular_resolution)


def _made(shape: str, *numbers: float, **named: float) -> Mesh:
    create = getattr(load_open3d().geometry.TriangleMesh, f"create_{shape}")
    return from_open3d(create(*numbers, **named))


def join_halves(left: Mesh, right: Mesh) -> Mesh:
    """Cut two meshes by the plane x = 0 and take the convex hull of the two halves' points.

    The left half is ``left``'s vertices with x ≤ 0, the right half ``right``'s with
    x ≥ 0; points that coincide are one point.
    """
    points, _ = _points_of_halves(left, right)
    return convex_hull(points)


def join_hemispheres(left: Mesh, right: Mesh) -> Mesh:
    """Do what :func:`join_halves` does for two spheres about the origin, more quickly.

    A facet of a sphere's mesh is one of the hull if the cap it cuts off stays on its side of
    the plane, since then no point of the other half is outside it. What is left is a band
    along the plane, and only its hull is sought.
    """
    points, halves = _points_of_halves(left, right)
    known = np.concatenate(
        [
            _facets_beyond(mesh, number, side)
            for mesh, number, side in zip((left, right), halves, (-1, 1), strict=True)
        ]
    )
    faces = np.concatenate([known, _band(points, known)])
    if not _closed(faces, len(points)):  # rounding has put a facet on both sides of a limit
        faces = _hull(points)
    return compact(Mesh(points, _fan_flat_facets(points, faces)))


def _points_of_halves(left: Mesh, right: Mesh) -> tuple[Floats, tuple[Int64s, Int64s]]:
    """Return the points of both halves, and the number there of each vertex, −1 if none."""
    kept = (
        np.flatnonzero(left.vertices[:, 0] <= PLANE),
        np.flatnonzero(right.vertices[:, 0] >= -PLANE),
    )
    points = np.concatenate([left.vertices[kept[0]], right.vertices[kept[1]]])
    cells = np.round(points / PLANE)
    order = np.lexsort(cells.T)  # stable: of coinciding points the first comes first
    new = np.append(True, (np.diff(cells[order], axis=0) != 0).any(axis=1))
    first = order[new][np.cumsum(new) - 1]
    representative = np.empty(len(points), dtype=np.int64)
    representative[order] = first
    unique, number = np.unique(representative, return_inverse=True)
    numbers = [np.full(len(mesh.vertices), -1, dtype=np.int64) for mesh in (left, right)]
    parts = np.split(number, [len(kept[0])])
    for of_mesh, there, part in zip(numbers, kept, parts, strict=True):
        of_mesh[there] = part
    return points[unique], (numbers[0], numbers[1])


def _facets_beyond(mesh: Mesh, number: Int64s, side: int) -> Int64s:
    """Return the faces of a sphere whose caps lie on one side of x = 0, renumbered."""
    a = mesh.vertices[mesh.faces[:, 0]]
    normals = _unit_normals(mesh.vertices, mesh.faces)
    height = (normals * a).sum(axis=1) / np.linalg.norm(a, axis=1)
    nearest = np.arccos(np.clip(side * normals[:, 0], -1, 1)) + np.arccos(np.clip(height, -1, 1))
    faces = number[mesh.faces]
    known: Int64s = faces[(nearest < np.pi / 2 - CLEAR) & (faces >= 0).all(axis=1)]
    return known


def _band(points: Floats, known: Int64s) -> Int64s:
    """Return the facets of the hull that the known ones leave open."""
    n = len(points)
    tails, heads = known.ravel(), np.roll(known, -1, axis=1).ravel()
    forward, backward = _half_edges(known, n)
    rim = ~np.isin(forward, backward)
    inside = np.zeros(n, dtype=bool)
    inside[tails] = True
    inside[tails[rim]] = inside[heads[rim]] = False
    band = np.flatnonzero(~inside)
    faces = band[_hull(points[band])]
    # Its facets come in parts, parted by the rim: the band, and a lid for each half.
    keys, opposite = _half_edges(faces, n)
    neighbour = _neighbours(keys, opposite)
    cut = np.isin(keys, backward[rim]) | np.isin(opposite, backward[rim])
    part = connected(len(faces), np.repeat(np.arange(len(faces)), 3)[~cut], neighbour[~cut])
    x = points[faces, 0]
    touching = (x.min(axis=1) <= PLANE) & (x.max(axis=1) >= -PLANE)  # which no lid does
    return faces[np.isin(part, part[touching])]


def _closed(faces: Int64s, n: int) -> bool:
    """Whether every edge has its opposite, once."""
    forward, backward = (np.sort(keys) for keys in _half_edges(faces, n))
    return bool((forward == backward).all() and (np.diff(forward) > 0).all())


def _half_edges(faces: Int64s, n: int) -> tuple[Int64s, Int64s]:
    """Return a number of each half-edge 3 f + i of n vertices, and that of its opposite."""
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    return tails * n + heads, heads * n + tails


def _neighbours(keys: Int64s, opposite: Int64s) -> Int64s:
    """Return for each half-edge of a closed surface the face of its opposite."""
    order = np.argsort(keys)
    return order[np.searchsorted(keys[order], opposite)] // 3


def _unit_normals(points: NDArray[np.floating], faces: NDArray[np.integer]) -> Floats:
    a, b, c = (points[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def convex_hull(points: Floats) -> Mesh:
    """Triangulate the convex hull of points of shape (n, 3), flat facets in a normal form.

    The vertices are in the order of ``points``, the faces sorted and oriented outwards.

    Examples
    --------
    >>> corners = np.array([[x, y, z] for x in (0.0, 1) for y in (0.0, 1) for z in (0.0, 1)])
    >>> len(convex_hull(corners).faces)
    12
    """
    return compact(Mesh(points, _fan_flat_facets(points, _hull(points))))


def _hull(points: Floats) -> Int64s:
    """Triangulate the convex hull by Open3D: faces of shape (m, 3), oriented outwards."""
    o3d = load_open3d()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    hull, kept = cloud.compute_convex_hull()
    faces: Int64s = np.asarray(kept, dtype=np.int64)[np.asarray(hull.triangles)]
    return faces


def _fan_flat_facets(points: Floats, faces: Int64s) -> Int64s:
    """Put the faces of a hull into a normal form.

    Where more than three hull vertices lie in one plane, the triangulation of that
    facet (and the order of everything) depends on the last bit of the coordinates, which
    differs between machines. So each flat facet is fanned out from its first vertex,
    and the faces are put in order: the same points give the same faces.
    """
    normals = _unit_normals(points, faces)
    tails, heads = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    face = np.repeat(np.arange(len(faces)), 3)
    neighbour = _neighbours(*_half_edges(faces, len(points)))
    flat = np.linalg.norm(normals[face] - normals[neighbour], axis=1) < FLAT
    facet = connected(len(faces), face[flat], neighbour[flat])

    # A facet's border, less the two edges at its first vertex, is the fan of that vertex.
    border = facet[face] != facet[neighbour]
    tails, heads, owner = tails[border], heads[border], facet[face[border]]
    first = np.full(facet.max() + 1, len(points))
    np.minimum.at(first, owner, tails)
    apex = first[owner]
    away = (tails != apex) & (heads != apex)
    fans = np.stack([apex[away], tails[away], heads[away]], axis=1)
    return fans[np.lexsort(fans.T[::-1])]
