"""The operators of DiffusionNet, with certified eigenpairs. DiffusionNet need not be installed."""

from __future__ import annotations

from typing import Any

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.errors import needed_by
from synthnet.mesh.geometry import corner_edges
from synthnet.spectrum import Operator, as_mesh, discretise, smallest
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.sheets import warn_of_sheets
from synthnet.types import Mesh

with needed_by("synthnet.adapters.diffusionnet"):
    import torch
    from torch import Tensor

REGULAR = 1e-5  # DiffusionNet adds it to the least squares of a gradient, in length²
NEXT = 0.9  # with a normal so far along x, DiffusionNet's frame begins with y
CANCELLED = 1e-9  # length of a sum of unit normals that is rounding alone


def compute_operators(
    verts: Tensor, faces: Tensor, k_eig: int, normals: Tensor | None = None
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor, Tensor, Tensor]:
    r"""Return what ``diffusion_net.geometry.compute_operators`` returns for a triangle mesh.

    Linear elements with the lumped mass, Neumann on a boundary. The gradient at vertex i is the
    least squares fit to the differences along its edges,

    .. math::
        g_i = (\sum_j t_{ij} t_{ij}^T + 10^{-5} I)^{-1} \sum_j t_{ij} (f_j - f_i) ,

    :math:`t_{ij}` the edge in the tangent plane. DiffusionNet's constant has the unit of length²,
    so that gradients depend on the scale: normalise a mesh before, as DiffusionNet does. Nothing
    is differentiated, and everything is computed in float64 on the CPU. DiffusionNet's other small
    constants, in areas, normals and matrices, are left out, and what they hide is an error here.

    Parameters
    ----------
    verts : tensor of shape (n, 3), float32 or float64
        Coordinates, on any device.
    faces : tensor of shape (m, 3), integer
        Corners of the triangles. Point clouds are refused.
    k_eig : int
        Number of eigenpairs, the zeros included, from none to n.
    normals : tensor of shape (n, 3), optional
        Unit normals of the vertices; by default the mean of the faces' unit normals, normalised.

    Returns
    -------
    frames : tensor of shape (n, 3, 3)
        At each vertex, as rows: two tangents and the normal, of length one.
    massvec : tensor of shape (n,)
        Diagonal of the lumped mass, in length².
    L : sparse tensor of shape (n, n)
        Stiffness, positive semidefinite, without a unit.
    evals : tensor of shape (k_eig,)
        In 1/length², ascending, first an exact zero for each component, certified.
    evecs : tensor of shape (n, k_eig)
        Orthonormal in the lumped mass.
    gradX, gradY : sparse tensor of shape (n, n)
        The gradient's two components in the frames, in 1/length; the pattern is that of L.
        All have the dtype and the device of ``verts``, and sparse ones are coalesced.

    Raises
    ------
    ValueError
        If it is no mesh with a spectrum, see :func:`synthnet.spectrum.compute`, the vertices or the
        normals are no such tensor, or the faces around a vertex cancel, so that it has no normal.
    CertificateError, SpectrumError
        See :func:`synthnet.spectrum.compute`.

    References
    ----------
    N. Sharp, S. Attaiki, K. Crane, M. Ovsjanikov, "DiffusionNet: Discretization agnostic learning
    on surfaces", ACM Transactions on Graphics 41 (2022).

    Examples
    --------
    >>> square = torch.tensor([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> operators = compute_operators(square, torch.tensor([[0, 1, 2], [0, 2, 3]]), k_eig=2)
    >>> frames, massvec, L, evals, evecs, gradX, gradY = operators
    >>> massvec, evals
    (tensor([0.3333, 0.1667, 0.3333, 0.1667]), tensor([0., 3.]))
    >>> (gradX @ square[:, :2]).round(decimals=3)  # of the functions x and y
    tensor([[1., 0.],
            [1., 0.],
            [1., 0.],
            [1., 0.]])
    """
    if not isinstance(verts, Tensor) or not verts.is_floating_point():
        kind = verts.dtype if isinstance(verts, Tensor) else type(verts).__name__
        raise ValueError(f"verts must be a tensor of float32 or float64, got {kind}")
    mesh = as_mesh((verts, faces))
    operator = Operator(mass="lumped")
    matrices = discretise(mesh, operator).matrices
    warn_of_sheets(mesh, operator.elements, stacklevel=3)
    n = len(matrices.lumped)
    values, vectors = smallest(matrices, k_eig) if k_eig else (np.zeros(0), np.zeros((n, 0)))
    frames = _frames(_normals(mesh) if normals is None else _given(normals, n))
    rows = np.repeat(np.arange(n), np.diff(matrices.indptr))
    where = torch.as_tensor(np.stack([rows, matrices.indices]))
    dense = [
        torch.as_tensor(array).to(verts) for array in (frames, matrices.lumped, values, vectors)
    ]
    stiffness, grad_x, grad_y = (
        torch.sparse_coo_tensor(where, torch.as_tensor(array), (n, n), check_invariants=True)
        .to(verts)
        .coalesce()
        for array in (matrices.stiffness, *_gradients(mesh, frames, matrices, rows))
    )
    return dense[0], dense[1], stiffness, dense[2], dense[3], grad_x, grad_y


def _given(normals: Any, n: int) -> Floats:
    """Return normals as an array, checked."""
    array = np.asarray(torch.as_tensor(normals).detach().cpu(), dtype=np.float64)
    if array.shape != (n, 3) or not np.allclose(np.linalg.norm(array, axis=1), 1, atol=1e-3):
        raise ValueError(f"normals must be {n} vectors of length one, got shape {array.shape}")
    return array


def _normals(mesh: Mesh) -> Floats:
    """Return the normalised sum of the unit normals of each vertex's faces, (n, 3)."""
    edges = corner_edges(mesh)
    normals = np.cross(edges[:, 0], edges[:, 1])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sums = np.zeros_like(mesh.vertices)
    np.add.at(sums, mesh.faces, normals[:, None])
    lengths = np.linalg.norm(sums, axis=1, keepdims=True)
    cancelled = np.flatnonzero(lengths < CANCELLED)
    if len(cancelled):
        raise ValueError(
            f"the faces around {len(cancelled)} vertices cancel, so that these have no normal, the "
            f"first is vertex {cancelled[0]}: orient the faces alike, or give normals"
        )
    unit: Floats = sums / lengths
    return unit


def _frames(normals: Floats) -> Floats:
    """Return a frame for each normal, which is its last row: the first is near x, or near y."""
    axes = np.where(np.abs(normals[:, :1]) < NEXT, np.eye(3)[0], np.eye(3)[1])
    first = axes - np.einsum("ij,ij->i", axes, normals)[:, None] * normals
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first), normals], axis=1)


def _gradients(
    mesh: Mesh, frames: Floats, matrices: Matrices, rows: Int64s
) -> tuple[Floats, Floats]:
    """Return the entries of the gradient's two components, in the pattern of the matrices."""
    edges = mesh.vertices[matrices.indices] - mesh.vertices[rows]  # zero on the diagonal
    tangents = np.einsum("ecx,ex->ec", frames[rows, :2], edges)
    start = matrices.indptr[:-1]
    squares = np.add.reduceat(tangents[:, :, None] * tangents[:, None], start)
    squares += REGULAR * np.eye(2)
    entries = np.linalg.solve(squares[rows], tangents[:, :, None])[:, :, 0]
    entries[rows == matrices.indices] = -np.add.reduceat(entries, start)
    return entries[:, 0], entries[:, 1]
