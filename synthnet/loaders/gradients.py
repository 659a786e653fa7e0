"""Eigenvalues of a mesh as a differentiable function of its vertices, in PyTorch."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet import spectrum
from synthnet.arrays import Int64s
from synthnet.errors import needed_by
from synthnet.mesh.geometry import MeshFacts
from synthnet.spectrum.derivative import clusters, vertex_gradient
from synthnet.spectrum.inputs import as_count
from synthnet.types import Mesh, Spectrum

with needed_by("synthnet.torch"):
    import torch
    from torch import Tensor
    from torch.autograd.function import once_differentiable

# The solver accepts a relative residual of 1e-7, and an eigenvector is off by residual over gap.
TOLERANCE = 1e-5


def eigenvalues(
    vertices: Tensor | Sequence[Tensor],
    faces: Tensor | NDArray[Any] | Sequence[Tensor | NDArray[Any]],
    k: int = 10,
    *,
    tolerance: float = TOLERANCE,
) -> Tensor:
    r"""Compute the first k non-zero eigenvalues, differentiable with respect to the vertices.

    The values are those of :func:`synthnet.spectrum.compute`: linear finite elements, Neumann on a
    boundary, certified, on the CPU. The gradient is that of the discrete problem,

    .. math::
        d\lambda = \varphi^T (dA - \lambda\, dB)\, \varphi ,

    by the derivatives of each triangle's matrices; the backward pass solves no system. It cannot be
    differentiated once more.

    A multiple eigenvalue has no gradient of its own. Neighbours whose relative gap is at most
    ``tolerance`` are a cluster, and each eigenvalue of a cluster gets the gradient of the cluster's
    mean, that part of the cluster included which lies past the k-th. The gradient of a loss is
    therefore exact, to the relative width of the cluster, if the loss has the same derivative
    with respect to all eigenvalues of a cluster, as a sum or a heat trace has; for another loss it
    is that of the loss with each eigenvalue replaced by its cluster's mean.

    Parameters
    ----------
    vertices : tensor of shape (n, 3), float32 or float64, or a list of B of them
        Coordinates, on any device. A list is a batch of meshes, of any sizes.
    faces : tensor or ndarray of shape (m, 3), integer, or a list of B of them
        Corners of the triangles. PyG's ``data.face`` has to be transposed.
    k : int
        Number of eigenvalues, at most the vertices less the components.
    tolerance : float
        Largest relative gap inside a cluster, at least 0 and below 1. The error of a single
        eigenvalue's gradient is about the residual, at most 1e-7, divided by its relative gap.

    Returns
    -------
    tensor of shape (k,), or (B, k) for a batch, float64
        Ascending, in 1/length², on the device of the vertices. The gradient of the vertices has
        their dtype.

    Raises
    ------
    ValueError
        If it is no mesh, or a coordinate is not finite; if k or the tolerance is out of range, a
        triangle has no area, or a vertex has no triangle; if the two lists differ in length.
    CertificateError
        If the eigenvalues cannot be certified.
    SpectrumError
        If the iteration does not converge or a factorisation breaks down.

    Examples
    --------
    An eigenvalue scales as 1/length², so that :math:`\sum_v v \cdot d\lambda/dv = -2 \lambda`.

    >>> faces = torch.tensor([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], requires_grad=True)
    >>> values = eigenvalues(vertices, faces, k=1)
    >>> values.sum().backward()
    >>> round(((vertices * vertices.grad).sum() / values[0]).item(), 4)
    -2.0
    """
    k = as_count(k)
    if k < 1:
        raise ValueError(f"k must be at least 1, got {k}")
    if not 0 <= tolerance < 1:
        raise ValueError(f"tolerance must be at least 0 and below 1, got {tolerance}")
    if isinstance(vertices, Tensor):
        return _of_one(vertices, faces, k, tolerance)
    if not isinstance(vertices, list | tuple) or not isinstance(faces, list | tuple):
        raise ValueError(  # noqa: TRY004 - one kind of error for all bad input
            "vertices and faces must be a tensor each, or a list of them each, "
            f"got {type(vertices).__name__} and {type(faces).__name__}"
        )
    if len(vertices) != len(faces) or not vertices:
        raise ValueError(
            "a batch has as many vertices as faces, and one mesh at least, "
            f"got lists of {len(vertices)} and {len(faces)}"
        )
    pairs = zip(vertices, faces, strict=True)
    return torch.stack([_of_one(*pair, k, tolerance) for pair in pairs])


def _of_one(vertices: Tensor, faces: Any, k: int, tolerance: float) -> Tensor:
    if not isinstance(vertices, Tensor) or vertices.dtype not in (torch.float32, torch.float64):
        kind = vertices.dtype if isinstance(vertices, Tensor) else type(vertices).__name__
        raise ValueError(f"vertices must be a tensor of float32 or float64, got {kind}")
    corners = faces.detach().cpu().numpy() if isinstance(faces, Tensor) else np.asarray(faces)
    if corners.ndim == 2 and corners.shape[0] == 3 != corners.shape[1]:
        raise ValueError(
            f"faces must have shape (m, 3), got {corners.shape}: transpose PyG's data.face"
        )
    mesh = Mesh(vertices.detach().cpu().numpy().astype(np.float64), corners)  # a copy
    spectrum.check(mesh)
    values: Tensor = _Eigenvalues.apply(vertices, mesh, k, tolerance)  # type: ignore[no-untyped-call]
    return values


class _Eigenvalues(torch.autograd.Function):
    """The eigenvalues of a mesh whose vertices are a tensor."""

    @staticmethod
    def forward(ctx: Any, vertices: Tensor, mesh: Mesh, k: int, tolerance: float) -> Tensor:
        """Solve, and keep the eigenpairs of the first k and of the last one's cluster."""
        solved, cluster = _with_whole_clusters(mesh, k, tolerance)
        ctx.mesh, ctx.solved, ctx.cluster = mesh, solved, cluster
        ctx.like = (vertices.dtype, vertices.device)
        return torch.from_numpy(solved.eigenvalues[:k].copy()).to(vertices.device)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, outer: Tensor) -> tuple[Tensor, None, None, None]:
        """Weight the derivative of each eigenvalue by its cluster's mean of the outer gradient."""
        weights = np.zeros(len(ctx.cluster))
        weights[: len(outer)] = outer.cpu().numpy()
        means = np.bincount(ctx.cluster, weights) / np.bincount(ctx.cluster)
        inner = vertex_gradient(ctx.mesh, ctx.solved, means[ctx.cluster])
        dtype, device = ctx.like
        return torch.from_numpy(inner).to(dtype=dtype, device=device), None, None, None


def _with_whole_clusters(mesh: Mesh, k: int, tolerance: float) -> tuple[Spectrum, Int64s]:
    """Return at least k eigenpairs, the whole cluster of the k-th included, and their clusters."""
    most = len(mesh.vertices) - MeshFacts(mesh).n_components
    more = 1
    while True:
        solved = spectrum.compute(mesh, max(k, min(k + more, most)))
        cluster = clusters(solved.eigenvalues, tolerance)
        if cluster[-1] > cluster[k - 1] or len(cluster) >= most:
            return solved, cluster
        more *= 2
