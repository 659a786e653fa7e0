"""Eigenvalues of the Laplace-Beltrami operator by linear finite elements."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from synthnet import geometry
from synthnet.errors import SpectrumError
from synthnet.types import Mesh, Spectrum

START_SEED = 0  # of the start vector: the same mesh gives the same digits
DENSE = 40  # vertices up to which ARPACK's subspace would be most of the space


def fem_matrices(mesh: Mesh) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    r"""Assemble stiffness and consistent mass of linear finite elements.

    .. math::
        A_{ij} = \int_S \nabla\varphi_i \cdot \nabla\varphi_j, \qquad
        B_{ij} = \int_S \varphi_i \varphi_j

    With :math:`e_i` the edge opposite corner i and :math:`|T|` the area, a triangle adds
    :math:`e_i \cdot e_j / 4|T|` to A and :math:`|T| (1 + \delta_{ij}) / 12` to B. No
    boundary term is added: the natural (Neumann) condition holds on a boundary. These
    are the matrices of ``lapy.Solver(..., lump=False)``.

    Parameters
    ----------
    mesh : Mesh
        Its vertices are taken as float64.

    Returns
    -------
    stiffness, mass : csc_matrix of shape (n, n), float64
        Symmetric; the mass is in length², the stiffness has no unit.

    Raises
    ------
    ValueError
        If a triangle has no area, or a vertex no triangle.

    References
    ----------
    M. Reuter, F.-E. Wolter, N. Peinecke, "Laplace-Beltrami spectra as 'Shape-DNA' of
    surfaces and solids", Computer-Aided Design 38 (2006).
    """
    unused = len(mesh.vertices) - len(np.unique(mesh.faces))
    if unused:
        raise ValueError(f"{unused} vertices belong to no triangle: remove them first")
    edges = geometry.corner_edges(mesh)
    areas = geometry.areas_of_edges(edges)
    if not (areas > 0).all():
        bad = int(np.count_nonzero(~(areas > 0)))
        raise ValueError(f"{bad} of {len(areas)} faces have no area: remove them first")
    local_stiffness = np.einsum("fid,fjd->fij", edges, edges) / (4 * areas)[:, None, None]
    local_mass = areas[:, None, None] * (np.ones((3, 3)) + np.eye(3)) / 12
    rows = np.repeat(mesh.faces, 3, axis=1).ravel()
    columns = np.tile(mesh.faces, (1, 3)).ravel()
    shape = (len(mesh.vertices),) * 2
    stiffness = sparse.csc_matrix((local_stiffness.ravel(), (rows, columns)), shape=shape)
    mass = sparse.csc_matrix((local_mass.ravel(), (rows, columns)), shape=shape)
    return stiffness, mass


def compute(mesh: Mesh, k: int = 10, *, shift: float = -1.0, tolerance: float = 0.0) -> Spectrum:
    r"""Compute the first k eigenvalues after the trivial zero, Neumann on a boundary.

    Solves :math:`A\varphi = \lambda B\varphi` by shift-invert Lanczos from a fixed start
    vector. The relative residual of a pair is
    :math:`\|A\varphi - \lambda B\varphi\|_2 / (\max(\lambda, \lambda_1) \|B\varphi\|_2)`.

    Parameters
    ----------
    mesh : Mesh
        Connected, without degenerate triangles. A mesh of several components has a zero
        for each, and only the first is left out.
    k : int
        Number of eigenvalues.
    shift : float
        Shift in units of 1/area, negative so that A − σB is positive definite. In this
        unit a scaled copy is solved by the same steps.
    tolerance : float
        Of ARPACK; 0 is machine precision. Looser values can miss one of a pair of equal
        eigenvalues.

    Returns
    -------
    Spectrum
        Eigenvalues in 1/length², float64, ascending.

    Raises
    ------
    ValueError
        If k is not between 1 and n − 1, the shift is not negative, a triangle has no area,
        or a vertex no triangle.
    SpectrumError
        If the factorisation or the iteration fails.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 40})
    >>> compute(sphere, k=3).eigenvalues.round(1)  # the smooth sphere has 2, 2, 2
    array([2., 2., 2.])
    """
    n = len(mesh.vertices)
    if not 1 <= k <= n - 1:
        raise ValueError(f"k must be between 1 and {n - 1} for {n} vertices, got {k}")
    if not shift < 0:
        raise ValueError(f"shift must be negative, got {shift}")
    stiffness, mass = fem_matrices(mesh)
    if n <= max(DENSE, 2 * (k + 1) + 1):
        values, vectors = _dense(stiffness, mass, k + 1)
    else:
        sigma = shift / geometry.area(mesh)
        values, vectors = _shift_invert(stiffness, mass, k + 1, sigma, tolerance)
    order = np.argsort(values, kind="stable")
    values, vectors = values[order], vectors[:, order]
    return Spectrum(
        eigenvalues=values[1:],
        trivial=float(values[0]),
        residual=_relative_residual(stiffness, mass, values, vectors),
        eigenvectors=vectors[:, 1:],
    )


def _dense(
    stiffness: sparse.csc_matrix, mass: sparse.csc_matrix, count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    try:
        values, vectors = linalg.eigh(
            stiffness.toarray(), mass.toarray(), subset_by_index=[0, count - 1]
        )
    except linalg.LinAlgError as error:
        raise SpectrumError(f"dense eigenvalue solver failed: {error}") from error
    return values, vectors


def _shift_invert(
    stiffness: sparse.csc_matrix,
    mass: sparse.csc_matrix,
    count: int,
    sigma: float,
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    n = stiffness.shape[0]
    try:
        # Positive definite: no pivoting. This ordering halves the fill of SuperLU's
        # default, but its supernodes suit panels badly: on subdivided boxes the
        # factorisation is 14 times slower unless both are of one column.
        factor = splu(
            stiffness - sigma * mass,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            relax=1,
            panel_size=1,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise SpectrumError(f"factorisation failed: {error}") from error
    inverse = LinearOperator((n, n), matvec=factor.solve, dtype=np.float64)
    start = np.random.default_rng(START_SEED).random(n) - 0.5
    try:
        values, vectors = eigsh(
            stiffness, count, mass, sigma=sigma, OPinv=inverse, v0=start, tol=tolerance
        )
    except ArpackError as error:
        raise SpectrumError(f"Lanczos iteration failed: {error}") from error
    return values, vectors


def _relative_residual(
    stiffness: sparse.csc_matrix,
    mass: sparse.csc_matrix,
    values: NDArray[np.float64],
    vectors: NDArray[np.float64],
) -> float:
    weighted = mass @ vectors
    residuals = np.linalg.norm(stiffness @ vectors - weighted * values, axis=0)
    with warnings.catch_warnings():
        # A spectrum that is not finite is for the filters to name, not for NumPy.
        warnings.simplefilter("ignore", RuntimeWarning)
        scale = np.maximum(values, values[1]) * np.linalg.norm(weighted, axis=0)
        return float(np.max(residuals / scale))
