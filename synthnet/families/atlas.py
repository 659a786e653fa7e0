r"""Surfaces given by charts, and their triangulations.

A surface is the image of a few flat patches, triangles with coordinates in a chart. Their
corners and edges are glued where their images meet. A mesh of the surface is a triangulation
of the patches that fits together along the glue; each corner of its triangles keeps its
coordinates, so that a mesh can be refined and its vertices be moved on the smooth surface:

.. math::
    X : \{1, \dots, q\} \times \mathbb{R}^d \to \mathbb{R}^3, \qquad v = X(\text{chart}, u)

No decision of :meth:`Atlas.uniform` depends on rounding: the faces are a function of the
integers alone, the same on every machine.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self, TypeAlias

import numpy as np
from scipy.spatial import cKDTree

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.mesh.adjacency import connected, edge_keys
from synthnet.types import Mesh

Chart: TypeAlias = Callable[[Int64s, Floats], Floats]

SAME = 1e-7  # of the surface's extent: corners of patches so near are one


@dataclass(frozen=True, slots=True)
class Charted:
    """A triangulation whose corners know their coordinates.

    Parameters
    ----------
    faces : ndarray of shape (m, 3), int64
        Vertex numbers.
    corners : ndarray of shape (m, 3, d), float64
        Chart coordinates of each corner; a vertex on a seam has several.
    charts : ndarray of shape (m,), int64
        Chart of each face.
    """

    faces: Int64s
    corners: Floats
    charts: Int64s

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return int(self.faces.max()) + 1

    def first_corners(self) -> Int64s:
        """Return of each vertex the first of the 3m corners that is there, shape (n,)."""
        _, first = np.unique(self.faces.ravel(), return_index=True)
        return first.astype(np.int64)

    def edges(self) -> tuple[Int64s, Int64s]:
        """Return the edges, shape (e, 2), and of each face that from corner i to i + 1, (m, 3)."""
        unique, of_side = np.unique(edge_keys(self.faces), return_inverse=True)
        edges = np.stack(np.divmod(unique, self.n_vertices), axis=1)
        return edges, of_side.reshape(-1, 3)

    def numbered(self, n: int) -> Int64s:
        """Number the points of a lattice in every face, those on a common edge once.

        Corners come first, then the points on edges, then inner ones.

        Parameters
        ----------
        n : int
            How often each edge is cut.

        Returns
        -------
        ndarray of shape (m, (n + 1)(n + 2) / 2), int64
            In the order of :func:`lattice`.
        """
        edges, of_side = self.edges()
        i, j = lattice(n)
        first_inner = self.n_vertices + len(edges) * (n - 1)
        m = len(self.faces)
        numbers = np.zeros((m, len(i)), dtype=np.int64)
        inner = (i > 0) & (j > 0) & (i + j < n)
        numbers[:, inner] = first_inner + np.arange(m * inner.sum()).reshape(m, -1)
        for side, on, along in ((0, j == 0, i), (1, i + j == n, j), (2, i == 0, n - j)):
            tails, heads = self.faces[:, side], self.faces[:, (side + 1) % 3]
            forth = np.where((tails < heads)[:, None], along[on], n - along[on])
            numbers[:, on] = self.n_vertices + of_side[:, [side]] * (n - 1) + forth - 1
        for corner, at in enumerate((n - i - j, i, j)):
            numbers[:, at == n] = self.faces[:, [corner]]
        return numbers


@dataclass(frozen=True, slots=True)
class Atlas:
    """A surface as the image of patches.

    Parameters
    ----------
    corners : ndarray of shape (p, 3, d), float64
        Chart coordinates of the patches' corners, counter-clockwise seen from outside.
    charts : ndarray of shape (p,), int64
        Chart of each patch.
    chart : callable
        X: from charts (n,) and coordinates (n, d) to points (n, 3), in length units.
    singular : ndarray of shape (p, 3), bool, optional
        Corners where eigenfunctions have infinite slope (the surface has more than 2π of angle
        there, or its boundary turns inwards), at most one of a patch. A graded mesh is finer
        towards them.
    """

    corners: Floats
    charts: Int64s
    chart: Chart
    singular: Booleans | None = None

    def glued(self) -> Int64s:
        """Return the corners' vertex numbers, shape (p, 3): images that meet are one vertex.

        Raises
        ------
        ValueError
            If more than two patches meet in an edge, or two corners of a patch coincide.
        """
        points = self.chart(np.repeat(self.charts, 3), _flat(self.corners))
        near = cKDTree(points).query_pairs(
            SAME * float(np.ptp(points, axis=0).max()), output_type="ndarray"
        )
        faces: Int64s = connected(len(points), *near.T).reshape(-1, 3)
        _, of_side = Charted(faces, self.corners, self.charts).edges()
        repeated = faces == np.roll(faces, 1, axis=1)
        if np.bincount(of_side.ravel()).max() > 2 or repeated.any():
            raise ValueError("patches must meet in whole edges, at most two in each")
        return faces

    def uniform(self, n: int, *, graded: bool = False) -> Charted:
        """Cut every patch into n² triangles of equal size in its chart.

        Vertices are numbered corners first, then those on the patches' edges, then inner ones.

        Parameters
        ----------
        n : int
            How often each edge is cut.
        graded : bool
            Whether distances from singular corners are squared, so that triangles there shrink
            like n⁻²: then eigenvalues approach their limits like n⁻² there, too.

        Raises
        ------
        ValueError
            If n is below 1.

        References
        ----------
        G. Raugel, "Résolution numérique par une méthode d'éléments finis du problème de Dirichlet
        pour le laplacien dans un polygone", C. R. Acad. Sci. 286 (1978).
        """
        if n < 1:
            raise ValueError(f"n must be at least 1, got {n}")
        macro = Charted(self.glued(), self.corners, self.charts)
        i, j = lattice(n)
        # What each corner of a patch weighs, (l, 3)
        weights = np.stack([n - i - j, i, j], axis=1) / n
        numbers = macro.numbered(n)

        number = np.full((n + 2, n + 2), -1)
        number[i, j] = np.arange(len(i))
        up, down = i + j < n, i + j < n - 1
        local = np.concatenate(
            [
                np.stack([number[i, j], number[i + 1, j], number[i, j + 1]], axis=1)[up],
                np.stack([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], axis=1)[down],
            ]
        )
        shares = np.broadcast_to(weights, (len(macro.faces), *weights.shape))
        if graded and self.singular is not None:
            shares = _graded(shares, self.singular)
        coordinates = np.einsum("plc,pcd->pld", shares, self.corners)
        return Charted(
            numbers[:, local].reshape(-1, 3),
            coordinates[:, local].reshape(-1, 3, self.corners.shape[2]),
            np.repeat(self.charts, len(local)),
        )

    def put_through(self, onto: Callable[[Floats], Floats]) -> Self:
        """Return the surface that a map of space makes of this, from points (n, 3) to points."""
        return replace(self, chart=lambda charts, u: onto(self.chart(charts, u)))

    def steps(self, vertices: float) -> int:
        """Return the n for which :meth:`uniform` has about so many vertices."""
        return max(1, math.floor(math.sqrt(2 * vertices / len(self.charts)) + 0.5))

    def points(self, mesh: Charted) -> Floats:
        """Return the vertices of a mesh, shape (n, 3)."""
        first = mesh.first_corners()
        return self.chart(mesh.charts[first // 3], _flat(mesh.corners)[first])

    def mesh(self, mesh: Charted) -> Mesh:
        """Return the mesh in space."""
        return Mesh(self.points(mesh), mesh.faces)


def _graded(shares: Floats, singular: Booleans) -> Floats:
    """Square the distance from the singular corner of each patch that has one."""
    if (singular.sum(axis=1) > 1).any():
        raise ValueError("a patch must have at most one singular corner")
    corner = singular[:, np.newaxis, :]
    away = 1 - (shares * corner).sum(axis=2, keepdims=True)
    squared = np.where(corner, 1 - away**2, shares * away)
    return np.where(corner.any(axis=2, keepdims=True), squared, shares)


def _flat(corners: Floats) -> Floats:
    return corners.reshape(-1, corners.shape[2])


def lattice(n: int) -> tuple[Int64s, Int64s]:
    """Return the numbers i, j ≥ 0 with i + j ≤ n, those of corners 2 and 3 in a face's lattice."""
    i, j = np.indices((n + 1, n + 1), dtype=np.int64)
    return i[i + j <= n], j[i + j <= n]


def glue_charts(parts: Sequence[Floats]) -> tuple[Floats, Int64s]:
    """Put the patches of charts 0, 1, ... together: corners (p, 3, d) and charts (p,)."""
    charts = np.repeat(np.arange(len(parts)), [len(corners) for corners in parts])
    return np.concatenate(parts), charts.astype(np.int64)


def borders(lengths: Floats) -> Floats:
    """Return where pieces begin and end that lie one after the other, from 0 on.

    Examples
    --------
    >>> borders(np.array([1.0, 0.5])).tolist()
    [0.0, 1.0, 1.5]
    """
    return np.concatenate([[0.0], np.cumsum(lengths)])


def rows(length: float, around: float, most: int = 12) -> int:
    """Return how many rows of patches make them about as long as they are wide."""
    return max(1, min(most, math.floor(length / around + 0.5)))


def rectangle(u: Floats, v: Floats) -> Floats:
    """Return patches of the rectangles between grid lines, two each, shape (p, 3, 2).

    Parameters
    ----------
    u, v : ndarray of shape (a,) and (b,)
        Ascending coordinates of the lines.

    Examples
    --------
    >>> rectangle(np.array([0.0, 1.0]), np.array([0.0, 2.0])).shape
    (2, 3, 2)
    """
    corner = np.stack(np.meshgrid(u, v, indexing="ij"), axis=2)
    low, right = corner[:-1, :-1], corner[1:, :-1]
    high, left = corner[1:, 1:], corner[:-1, 1:]
    pairs = [np.stack([low, right, high], axis=2), np.stack([low, high, left], axis=2)]
    return np.stack(pairs, axis=2).reshape(-1, 3, 2)
