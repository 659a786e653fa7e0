r"""The paper's geometric encodings as transforms of ``Data(pos, face)``, without a loop.

Channels are computed in float64 and appended to ``x`` as float32. With f the triangles, a(f) the
area of f, and v a vertex:

=============  ==========================================  ========  ========================
encoding       what                                        unit      attribute
=============  ==========================================  ========  ========================
coordinates    position                                    length    ``x``, 3 channels
``A``          mixed Voronoi area                          length²   ``x``, 1 channel
``L``          edge length over the mesh's longest edge    none      ``edge_weight``
``G``          area-weighted mean of the faces' normals    none      ``x``, 3 channels
virtual node   a vertex of zeros joined to all others      none      a row of ``x``, edges
=============  ==========================================  ========  ========================

References
----------
Paper, section 3.2; virtual node: section 4.3.3, after Gilmer et al. 2017.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch_geometric.data import Data
from torch_geometric.transforms import BaseTransform, Compose, FaceToEdge, VirtualNode


class MeshError(ValueError):
    """A mesh that no encoding can be made of."""


def check(pos: Tensor, face: Tensor) -> None:
    """Raise ``MeshError`` unless these are a mesh's finite vertices and at least one triangle."""
    if face.shape[1] == 0:
        raise MeshError("the mesh has no faces, at least one is needed")
    finite = torch.isfinite(pos).all(dim=1)
    if not finite.all():
        first = int(torch.nonzero(~finite)[0])
        raise MeshError(f"vertex {first} is {pos[first].tolist()}, coordinates must be finite")


def corner_edges(pos: Tensor, face: Tensor) -> Tensor:
    """Return the edge opposite each corner, ``[:, i, t]`` of shape (3, 3, m), float64, cyclic."""
    x = pos.double().T.contiguous()  # coordinates first: sums over them run along the triangles
    a, b, c = (x.index_select(1, corner) for corner in face)
    return torch.stack([c - b, a - c, b - a], dim=1)


def doubled_normals(edges: Tensor) -> tuple[Tensor, Tensor]:
    """Return the normals of length 2 a(f), (3, m), and 2 a(f), (m,), from :func:`corner_edges`.

    Raises
    ------
    MeshError
        If a triangle has no area.
    """
    normals = torch.linalg.cross(edges[:, 0], edges[:, 1], dim=0)
    doubled = normals.square().sum(dim=0).sqrt()
    if not (doubled > 0).all():
        first = int(torch.nonzero(~(doubled > 0))[0])
        raise MeshError(f"face {first} has no area: remove degenerate faces first")
    return normals, doubled


def voronoi_areas(pos: Tensor, face: Tensor) -> Tensor:
    r"""Return the mixed Voronoi area of every vertex.

    In a triangle without an obtuse angle the corner v, opposite to which lies the edge
    between x and y, has :math:`(\|x-v\|^2 \cot\angle y + \|y-v\|^2 \cot\angle x) / 8`, the
    cotangents being those opposite the two edges; in an obtuse one half of the triangle's
    area if the obtuse angle is at v, else a quarter.

    Parameters
    ----------
    pos : Tensor of shape (n, 3)
        Vertices in units of length.
    face : Tensor of shape (3, m), int64
        Triangles.

    Returns
    -------
    Tensor of shape (n,), float64
        In length²; they add up to the area of the surface. Zero at a vertex without a
        triangle.

    References
    ----------
    Paper, section 3.2; M. Meyer, M. Desbrun, P. Schröder, A. H. Barr, "Discrete
    differential-geometry operators for triangulated 2-manifolds", 2002.
    """
    edges = corner_edges(pos, face)
    squares = edges.square().sum(dim=0)  # (3, m): squared length opposite each corner
    # At corner i the two edges are e[i+1] and e[i+2], with opposite directions there.
    products = -(edges.roll(-1, 1) * edges.roll(-2, 1)).sum(dim=0)
    _, doubled = doubled_normals(edges)
    weighted = squares * products / doubled  # length² times cotangent of the same corner
    shares = (weighted.roll(-1, 0) + weighted.roll(-2, 0)) / 8
    obtuse = products < 0
    quarters = torch.where(obtuse, doubled / 4, doubled / 8)
    shares = torch.where(obtuse.any(dim=0), quarters, shares)
    areas = torch.zeros(len(pos), dtype=torch.float64, device=pos.device)
    return areas.index_add_(0, face.reshape(-1), shares.reshape(-1))


def normalised_lengths(pos: Tensor, edge_index: Tensor) -> Tensor:
    r"""Return :math:`\|v_i - v_j\| / \max \|v_i - v_j\|` of each edge, shape (e,), float64."""
    x = pos.double().T.contiguous()
    along = x.index_select(1, edge_index[0]) - x.index_select(1, edge_index[1])
    lengths = along.square().sum(dim=0).sqrt()
    return lengths / lengths.max()


def gauss_map(pos: Tensor, face: Tensor) -> Tensor:
    r"""Return the area-weighted mean normal :math:`\sum_f a(f) N_f / \sum_f a(f)` of a vertex.

    It is a unit vector where the surface is flat, and shorter where normals disagree.
    Outward: on a mesh whose faces enclose a negative volume the sign is turned.

    Parameters
    ----------
    pos : Tensor of shape (n, 3)
        Vertices.
    face : Tensor of shape (3, m), int64
        Triangles, consistently oriented.

    Returns
    -------
    Tensor of shape (n, 3), float64
        Zero at a vertex without a triangle.

    References
    ----------
    Paper, section 3.2.
    """
    normals, doubled = doubled_normals(corner_edges(pos, face))
    centred = (pos.double() - pos.double().mean(dim=0)).T
    enclosed = (centred.index_select(1, face[0]) * normals).sum()  # six times the volume
    rows = torch.cat([torch.where(enclosed < 0, -1.0, 1.0) * normals, doubled[None]]).T.contiguous()
    sums = torch.zeros(len(pos), 4, dtype=torch.float64, device=pos.device)
    for corner in face:
        sums.index_add_(0, corner, rows)
    return sums[:, :3] / sums[:, 3:].clamp(min=torch.finfo(torch.float64).tiny)


class UnitArea(BaseTransform):  # type: ignore[misc]
    """Centre a surface at its centroid and scale it to area 1; ``area`` keeps what it was."""

    def forward(self, data: Data) -> Data:
        """Replace ``pos``, set ``area``."""
        check(data.pos, data.face)
        _, doubled = doubled_normals(corner_edges(data.pos, data.face))
        area = doubled.sum() / 2
        centres = data.pos.double()[data.face].mean(dim=0)
        centroid = (doubled[:, None] * centres).sum(dim=0) / (2 * area)
        data.pos = (data.pos - centroid) / area.sqrt()
        data.area = area[None]
        return data


class PrincipalAxes(BaseTransform):  # type: ignore[misc]
    r"""Turn a surface around its centroid into its principal axes.

    They are the eigenvectors of the second moments :math:`\int x x^T` of the surface, the largest
    first, and the third moment :math:`\int x_i^3` along each is not negative. So two isometric
    copies of a mesh become one, as far as their moments differ: where two second moments are equal,
    or a third one vanishes, as for a cylinder or a box, axes or signs are those of rounding.
    """

    def forward(self, data: Data) -> Data:
        """Replace ``pos``."""
        _, doubled = doubled_normals(corner_edges(data.pos, data.face))
        a, b, c = data.pos.double()[data.face]
        share = (doubled / doubled.sum())[:, None]
        centroid = (share * (a + b + c)).sum(dim=0) / 3
        # The midpoints of the sides integrate polynomials of degree two exactly.
        middles = [(p + q) / 2 - centroid for p, q in ((a, b), (b, c), (c, a))]
        _, axes = torch.linalg.eigh(sum((share * x).T @ x for x in middles))
        axes = axes.flip(1)
        third = sum((share * (x @ axes) ** 3).sum(dim=0) for x in middles)
        axes = axes * torch.where(third < 0, -1.0, 1.0)
        data.pos = (data.pos.double() - centroid) @ axes + centroid
        return data


class Coordinates(BaseTransform):  # type: ignore[misc]
    """Start ``x`` with the vertices."""

    def forward(self, data: Data) -> Data:
        """Set ``x`` to ``pos``."""
        check(data.pos, data.face)
        data.x = data.pos.float()
        return data


class VoronoiArea(BaseTransform):  # type: ignore[misc]
    """Append :func:`voronoi_areas` to ``x``, divided by their mean if ``relative``."""

    def __init__(self, *, relative: bool = False) -> None:
        self.relative = relative

    def forward(self, data: Data) -> Data:
        """Append a channel."""
        areas = voronoi_areas(data.pos, data.face)
        areas = areas / areas.mean() if self.relative else areas
        data.x = torch.cat([data.x, areas.float()[:, None]], dim=1)
        return data


class EdgeLength(BaseTransform):  # type: ignore[misc]
    """Set ``edge_weight`` to :func:`normalised_lengths`."""

    def forward(self, data: Data) -> Data:
        """Weigh the edges."""
        data.edge_weight = normalised_lengths(data.pos, data.edge_index).float()
        return data


class GaussMap(BaseTransform):  # type: ignore[misc]
    """Append :func:`gauss_map` to ``x``."""

    def forward(self, data: Data) -> Data:
        """Append three channels."""
        data.x = torch.cat([data.x, gauss_map(data.pos, data.face).float()], dim=1)
        return data


CHANNELS = {"none": 3, "A": 4, "ALG": 7}  # of ``x``, by preset


def encoding(
    name: str,
    *,
    virtual_node: bool = False,
    scale_free: bool = False,
    principal_axes: bool = False,
) -> Compose:
    """Return the transform of a preset: from ``Data(pos, face)`` to ``x`` and ``edge_index``.

    Parameters
    ----------
    name : str
        ``none``, ``A`` or ``ALG``.
    virtual_node : bool
        Whether PyG's ``VirtualNode`` follows: a last row of zeros, joined both ways to every
        vertex by edges of weight 1.
    scale_free : bool
        Not the paper's: :class:`UnitArea` comes first, and Voronoi areas are divided by
        their mean.
    principal_axes : bool
        Not the paper's: :class:`PrincipalAxes` comes next.

    Raises
    ------
    ValueError
        If there is no such preset.

    Examples
    --------
    >>> import torch
    >>> from torch_geometric.data import Data
    >>> tetrahedron = torch.tensor([[0, 0, 0, 1], [2, 1, 3, 2], [1, 3, 2, 3]])
    >>> corners = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    >>> encoding("ALG")(Data(pos=corners, face=tetrahedron)).x.shape
    torch.Size([4, 7])
    """
    if name not in CHANNELS:
        raise ValueError(f"the encoding must be one of {', '.join(CHANNELS)}, got {name!r}")
    steps: list[BaseTransform] = [UnitArea()] if scale_free else []
    if principal_axes:
        steps.append(PrincipalAxes())
    steps += [Coordinates(), FaceToEdge(remove_faces=False)]
    if "A" in name:
        steps.append(VoronoiArea(relative=scale_free))
    if "L" in name:
        steps.append(EdgeLength())
    if "G" in name:
        steps.append(GaussMap())
    if virtual_node:
        steps.append(VirtualNode())
    return Compose(steps)
