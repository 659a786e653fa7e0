"""The certified solver as geomfum's eigensolver. geomfum need not be installed."""

from typing import Any

import numpy as np
from scipy import sparse

from synthnet.arrays import Floats
from synthnet.errors import counted
from synthnet.spectrum import smallest
from synthnet.spectrum.certificate import inertia
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ordering import find_ordering

ROUNDING = 1e-10  # what float64 leaves of a Laplacian's zeros, relative to its largest entry


class CertifiedEigsh:
    """Smallest eigenpairs, in place of ``geomfum.numerics.eig.ScipyEigsh``.

    It is the ``eig_solver`` of a ``LaplacianSpectrumFinder`` and takes the matrices of any of
    geomfum's Laplacians whose mass is diagonal, as those of meshes are, from either backend.

    Parameters
    ----------
    spectrum_size : int
        Number of eigenpairs, the zeros included.

    Examples
    --------
    A path of three vertices with unit masses has the eigenvalues 0, 1 and 3.

    >>> laplacian = sparse.csc_matrix([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    >>> CertifiedEigsh(3)(laplacian, M=sparse.identity(3))[0].round(12)
    array([0., 1., 3.])
    """

    def __init__(self, spectrum_size: int = 6) -> None:
        self.spectrum_size = spectrum_size

    def __call__(self, A: Any, M: Any) -> tuple[Any, Any]:
        r"""Solve :math:`A\varphi = \lambda M\varphi`.

        Parameters
        ----------
        A : sparse matrix of shape (n, n), of SciPy, or of PyTorch in its csc layout, float64
            Stiffness: symmetric and positive semidefinite, its rows add up to zero. Without a unit.
        M : sparse matrix of shape (n, n), of the same kind
            Mass: diagonal and positive, in length².

        Returns
        -------
        eigenvalues : ndarray or tensor of shape (spectrum_size,), float64
            In 1/length², ascending, first an exact zero for each component, certified.
        eigenvectors : ndarray or tensor of shape (n, spectrum_size), float64
            Orthonormal in M. Tensors are returned where tensors are given.

        Raises
        ------
        ValueError
            If the matrices are not such, or the spectrum's size is not between 1 and n.
        CertificateError, SpectrumError
            See :func:`synthnet.spectrum.of_matrices`.
        """
        stiffness = _scipy(A)
        matrices = _matrices(stiffness, _scipy(M))
        _check_semidefinite(matrices, stiffness.diagonal())
        values, vectors = smallest(matrices, self.spectrum_size)
        if sparse.issparse(A):
            return values, vectors
        return A.values().new_tensor(values), A.values().new_tensor(vectors)


def _scipy(matrix: Any) -> sparse.csr_matrix:
    if not sparse.issparse(matrix):
        if str(getattr(matrix, "layout", None)) != "torch.sparse_csc":
            raise ValueError(
                "matrices must be sparse ones of SciPy, or tensors of PyTorch's layout sparse_csc, "
                f"got {getattr(matrix, 'layout', type(matrix).__name__)}"
            )
        parts = (matrix.values(), matrix.row_indices(), matrix.ccol_indices())
        arrays = tuple(part.detach().cpu().numpy() for part in parts)
        matrix = sparse.csc_matrix(arrays, shape=tuple(matrix.shape))
    return sparse.csr_matrix(matrix)


def _matrices(stiffness: sparse.csr_matrix, mass: sparse.csr_matrix) -> Matrices:
    """Return both in the form that the solver takes, checked."""
    n = stiffness.shape[0]
    if not stiffness.shape == mass.shape == (n, n):
        raise ValueError(
            "stiffness and mass must be square and of one size, "
            f"got {stiffness.shape} and {mass.shape}"
        )
    for name, matrix in (("stiffness", stiffness), ("mass", mass)):
        if not np.isfinite(matrix.data).all():
            raise ValueError(
                f"the {name} matrix has entries that are NaN or infinite: look for triangles "
                "without area, and for vertices that are not finite"
            )
    masses = mass.diagonal()
    if abs(mass - sparse.diags(masses)).sum() != 0:
        raise ValueError("the mass matrix is not diagonal: take a Laplacian with a lumped mass")
    without = np.flatnonzero(~(masses > 0))
    if len(without):
        raise ValueError(
            f"{len(without)} vertices have no positive mass, the first is vertex {without[0]}: "
            "remove vertices without a triangle"
        )
    bound = ROUNDING * abs(stiffness).max()
    defect = max(abs(stiffness - stiffness.T).max(), np.abs(stiffness.sum(axis=1)).max())
    if not defect <= bound:
        raise ValueError(
            "the stiffness matrix is no Laplacian in float64: it is not symmetric, or its rows do "
            f"not add up to zero; they are off by {defect:.1g}"
        )
    pattern = sparse.csr_matrix(abs(stiffness) + sparse.identity(n))
    pattern.sort_indices()
    rows = np.repeat(np.arange(n), np.diff(pattern.indptr))
    columns = pattern.indices
    return Matrices(
        pattern.indptr.astype(np.int32),
        columns.astype(np.int32),
        np.asarray(stiffness[rows, columns], dtype=np.float64).ravel(),
        np.where(rows == columns, masses[rows], 0.0),
        np.asarray(masses, dtype=np.float64),
        least=1.0,
    )


def _check_semidefinite(matrices: Matrices, diagonal: Floats) -> None:
    """Refuse a stiffness of this diagonal with an eigenvalue below zero by more than rounding."""
    steepest = float((np.abs(diagonal) / matrices.lumped).max())
    if steepest == 0:
        return
    ordering = find_ordering(matrices.indptr, matrices.indices)
    below = inertia(matrices, ordering, -ROUNDING * steepest).negative
    if below:
        raise ValueError(
            f"the stiffness matrix has {counted(below, 'negative eigenvalue')}: give -A if the "
            "Laplacian is negative semidefinite"
        )
