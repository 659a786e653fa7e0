"""Plain facts of a triangle mesh: areas, volume, edges, components."""

from functools import cached_property

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.mesh.adjacency import connected, edge_keys, face_components
from synthnet.types import Mesh


def corner_edges(mesh: Mesh) -> Floats:
    """Return the edge opposite each corner as a vector.

    Returns
    -------
    ndarray of shape (m, 3, 3), float64
        ``[t, i]`` is the edge of triangle ``t`` opposite corner ``i``, the three in
        cyclic order, so that they add up to zero.
    """
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    edges: Floats = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    return edges


def areas_of_edges(edges: Floats) -> Floats:
    """Return the area of each triangle, shape (m,), from :func:`corner_edges`."""
    normals = np.cross(edges[:, 0], edges[:, 1])
    areas: Floats = 0.5 * np.sqrt(np.einsum("ij,ij->i", normals, normals))
    return areas


def face_areas(mesh: Mesh) -> Floats:
    """Return the area of each triangle, shape (m,), in length².

    Examples
    --------
    >>> import numpy as np
    >>> round(float(face_areas(Mesh(np.eye(3), np.array([[0, 1, 2]])))[0] ** 2), 12)
    0.75
    """
    return areas_of_edges(corner_edges(mesh))


def area(mesh: Mesh) -> float:
    """Return the area of the surface in length².

    Examples
    --------
    >>> import numpy as np
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> area(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]])))
    1.0
    """
    return float(face_areas(mesh).sum())


def volume(mesh: Mesh) -> float:
    """Return the signed volume in length³ of a closed surface, positive if oriented outwards.

    Of any other surface it is a number that depends on the origin: :func:`enclosed_volume` checks.

    Examples
    --------
    >>> import numpy as np
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> round(6 * volume(Mesh(np.vstack([np.zeros(3), np.eye(3)]), faces)), 12)
    1.0
    """
    return float(_products(mesh.vertices.astype(np.float64)[mesh.faces]).sum() / 6)


def enclosed_volume(mesh: Mesh) -> float:
    """Return the volume in length³ that closed surfaces enclose, wherever they lie.

    All may be oriented inwards instead. A component that is oriented against the largest is a
    cavity, and its volume is taken off.

    Raises
    ------
    ValueError
        If the surface is not closed or not oriented, or a component is oriented against the largest
        and is in the bounding box of no other, so that it is no cavity.

    Examples
    --------
    >>> import numpy as np
    >>> faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])  # inwards
    >>> far = np.vstack([np.zeros(3), np.eye(3)]) + 1e8
    >>> round(6 * enclosed_volume(Mesh(far, faces)), 6)
    1.0
    """
    facts = MeshFacts(mesh)
    if not facts.is_closed:
        raise ValueError(
            f"{np.count_nonzero(facts.edge_valences != 2)} edges have not two faces: only a closed "
            "surface encloses a volume; close it first, or normalise by area"
        )
    if facts.n_repeated_half_edges:
        raise ValueError(
            f"neighbours turn against each other at {facts.n_repeated_half_edges} edges: orient "
            "the faces alike first, as spectrum.compute(mesh, repair=True) does; a surface with "
            "one side encloses no volume"
        )
    pieces = face_components(mesh.faces)
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    first = np.unique(pieces, return_index=True)[1]
    signed = np.bincount(pieces, _products(corners - corners[first, 0][pieces][:, None])) / 6
    signed *= np.sign(signed[np.abs(signed).argmax()])
    _check_cavities(corners, pieces, signed)
    return float(signed.sum())


def _products(corners: Floats) -> Floats:
    """Return the triple product of each triangle's corners, from (m, 3, 3): six signed volumes."""
    products: Floats = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    return products


def _check_cavities(corners: Floats, pieces: Int64s, signed: Floats) -> None:
    """Check that each component of negative volume is in the bounding box of a positive one."""
    low, high = np.full((len(signed), 3), np.inf), np.full((len(signed), 3), -np.inf)
    np.minimum.at(low, pieces, corners.min(axis=1))
    np.maximum.at(high, pieces, corners.max(axis=1))
    solid = signed > 0
    for i in np.flatnonzero(signed < 0):
        if not ((low[solid] <= low[i]) & (high[i] <= high[solid])).all(axis=1).any():
            face = np.flatnonzero(pieces == i)[0]
            raise ValueError(
                f"the component of face {face} is oriented against the largest and in no other, so "
                "that it is no cavity: turn its faces first"
            )


class MeshFacts:
    """Facts of a mesh, each computed when it is first used.

    Parameters
    ----------
    mesh : Mesh
        Any triangles, however broken.

    Examples
    --------
    >>> import numpy as np
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> facts = MeshFacts(Mesh(np.vstack([np.zeros(3), np.eye(3)]), faces))
    >>> facts.euler_characteristic, facts.is_closed, facts.n_components
    (2, True, 1)
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh

    @cached_property
    def n_vertices(self) -> int:
        """Number of vertices, used by a face or not."""
        return len(self.mesh.vertices)

    @cached_property
    def n_faces(self) -> int:
        """Number of triangles."""
        return len(self.mesh.faces)

    @cached_property
    def area(self) -> float:
        """Area of the surface in length²."""
        return area(self.mesh)

    @cached_property
    def volume(self) -> float:
        """Signed enclosed volume in length³, if the surface is closed."""
        return volume(self.mesh)

    @cached_property
    def relative_altitudes(self) -> Floats:
        """Each triangle's least altitude over its longest edge, shape (m,).

        Zero for a degenerate triangle, sqrt(3)/2 for an equilateral one.
        """
        edges = corner_edges(self.mesh)
        longest = np.einsum("fij,fij->fi", edges, edges).max(axis=1, initial=0.0)
        ratios: Floats = np.divide(
            2 * areas_of_edges(edges), longest, out=np.zeros(len(longest)), where=longest > 0
        )
        return ratios

    @cached_property
    def _half_edges(self) -> tuple[Int64s, Int64s]:
        faces = self.mesh.faces.astype(np.int64)
        return faces.ravel(), faces[:, [1, 2, 0]].ravel()

    @cached_property
    def _edge_keys(self) -> Int64s:
        """A number of each half-edge's undirected edge, shape (3m,)."""
        return edge_keys(self.mesh.faces)

    @cached_property
    def edge_valences(self) -> Int64s:
        """Number of triangles at each undirected edge, shape (e,)."""
        _, counts = np.unique(self._edge_keys, return_counts=True)
        return counts

    @cached_property
    def n_repeated_half_edges(self) -> int:
        """How often an edge is passed again in the same direction; 0 if oriented."""
        tails, heads = self._half_edges
        ordered = np.sort(tails * self.n_vertices + heads)
        return int(np.count_nonzero(ordered[1:] == ordered[:-1]))

    @cached_property
    def n_duplicate_faces(self) -> int:
        """Triangles that have the three corners of another."""
        corners = np.sort(self.mesh.faces.astype(np.int64), axis=1)
        order = np.lexsort(corners.T)
        return int((np.diff(corners[order], axis=0) == 0).all(axis=1).sum())

    @cached_property
    def is_closed(self) -> bool:
        """Whether every edge has exactly two triangles."""
        return bool((self.edge_valences == 2).all())

    @cached_property
    def n_boundaries(self) -> int:
        """Number of connected pieces of the edges with a single triangle; 0 if closed."""
        if self.is_closed:
            return 0
        _, first = np.unique(self._edge_keys, return_index=True)  # in the order of the valences
        tails, heads = (ends[first[self.edge_valences == 1]] for ends in self._half_edges)
        return len(np.unique(connected(self.n_vertices, tails, heads)[tails]))

    @cached_property
    def euler_characteristic(self) -> int:
        """V − E + F."""
        return self.n_vertices - len(self.edge_valences) + self.n_faces

    @cached_property
    def n_components(self) -> int:
        """Number of connected components; a vertex without a triangle is one."""
        return int(connected(self.n_vertices, *self._half_edges).max(initial=-1)) + 1
