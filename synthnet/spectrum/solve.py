"""Eigenvalues of the Laplace-Beltrami operator by linear finite elements, with a certificate."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from synthnet.errors import SpectrumError
from synthnet.spectrum import components, fem
from synthnet.spectrum.certificate import Candidate, certify, inertia, largest_residual
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.inputs import as_mesh, check
from synthnet.spectrum.ordering import Ordering, find_ordering
from synthnet.spectrum.rounding import sharpened
from synthnet.spectrum.search import Setting, search
from synthnet.types import Certificate, Mesh, Spectrum

# Up to so many vertices, or vertices for each pair, a dense solver is as fast.
DENSE, DENSE_FOR = 64, 6


# A shift inside the spectrum needs a quarter fewer steps than one below it; measured on 1.0.
NORMAL = Setting(
    shift=0.7, residual=1e-7, excused=1e-6, gap=1e-3, vectors=161, strict=False, seed=0
)
# Below the spectrum A − σB is definite, so that its factorisation is backward stable.
STRONGER = Setting(
    shift=-0.05, residual=1e-7, excused=np.inf, gap=1e-2, vectors=401, strict=True, seed=1
)


def fem_matrices(mesh: Mesh) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    r"""Assemble stiffness and consistent mass of linear finite elements.

    .. math::
        A_{ij} = \int_S \nabla\varphi_i \cdot \nabla\varphi_j,
        \qquad B_{ij} = \int_S \varphi_i \varphi_j

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

    Examples
    --------
    >>> stiffness, mass = fem_matrices(Mesh(np.eye(3), np.array([[0, 1, 2]])))
    >>> round(float(mass.sum() ** 2), 9)  # the square of the area, √3 / 2
    0.75
    >>> bool(abs(stiffness.sum(axis=0)).max() < 1e-15)  # constants are in its kernel
    True
    """
    return as_sparse(assemble(mesh))


def as_sparse(matrices: Matrices) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    """Return stiffness and mass as matrices of SciPy, with arrays of their own."""
    shape = (len(matrices.lumped),) * 2
    stiffness, mass = (
        sparse.csc_matrix((values, matrices.indices, matrices.indptr), shape=shape, copy=True)
        for values in (matrices.stiffness, matrices.mass)
    )
    return stiffness, mass


def assemble(mesh: Mesh) -> Matrices:
    """Return the matrices of :func:`fem_matrices` in the form that the solver takes.

    Raises
    ------
    ValueError
        If there are no triangles, a coordinate is not finite, the size has no square in float64, a
        triangle has no area, or a vertex no triangle.
    """
    check(mesh)
    unused = len(mesh.vertices) - np.count_nonzero(np.bincount(mesh.faces.ravel()))
    if unused:
        raise ValueError(f"{unused} vertices belong to no triangle: remove them first")
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    return fem.assemble(vertices, np.ascontiguousarray(mesh.faces, dtype=np.int32))


def _say_what_is_odd(mesh: Mesh) -> None:
    """Warn of edges of more than two faces: the problem is well posed, but of no surface."""
    tails, heads = mesh.faces.astype(np.int64), np.roll(mesh.faces, -1, axis=1).astype(np.int64)
    keys = np.sort(
        (np.minimum(tails, heads) * len(mesh.vertices) + np.maximum(tails, heads)).ravel()
    )
    many = len(np.unique(keys[2:][keys[2:] == keys[:-2]]))
    if many:
        warnings.warn(
            f"{many} edges have more than two faces: eigenfunctions are those of all sheets joined "
            "there, which is no surface; `synthnet import` cuts where sheets are clearly pairs",
            stacklevel=3,
        )


def compute(mesh: Any, k: int = 10, *, sharp: bool = False) -> Spectrum:
    r"""Compute the first k eigenvalues after the trivial zero, Neumann on a boundary.

    Solves :math:`A\varphi = \lambda B\varphi` by block Lanczos around a shift inside the
    spectrum, and certifies the answer. With :math:`r = A\varphi - \lambda B\varphi` and M the
    lumped mass, the relative residual of a pair is

    .. math::
        \frac{2}{\lambda} \sqrt{\frac{r^T M^{-1} r}{\varphi^T B \varphi}}

    and at least one eigenvalue is within so much of λ, relative to it, because B ≥ M/4 for
    triangles. A factorisation :math:`A - \sigma B = L D L^T`, σ in a gap above the k-th
    eigenvalue and its cluster, has as many negative pivots as there are eigenvalues below σ
    (Sylvester's law of inertia): none was missed if that is the number of pairs found. While
    some are missing the search goes on beside those found; if the answer cannot be certified,
    a stronger setting searches again. Next to zero, below a thousandth of Weyl's k-th
    eigenvalue, the residual is relative to that instead. The same problem stands in NumPy and
    SciPy alone in :mod:`synthnet.spectrum.reference`.

    Parameters
    ----------
    mesh : Mesh or other
        Ours, or one of trimesh, Open3D, LaPy, PyVista or PyTorch Geometric, or a pair of arrays
        (vertices, faces); see :func:`synthnet.spectrum.as_mesh`. Without degenerate triangles. A
        mesh of several components has a zero for each; all of them are left out, and each
        component is solved by itself.
    k : int
        Number of eigenvalues, at most the vertices less the components.
    sharp : bool
        Return Ritz values of energies that are added up triangle by triangle, see
        :mod:`synthnet.spectrum.rounding`: on thin triangles the rounding of the matrices moves
        them less. On others they agree to rounding. The residual is that of the matrices.

    Returns
    -------
    Spectrum
        Eigenvalues in 1/length², float64, ascending, with their certificate; eigenvectors whose
        entry of largest size is positive, the first such entry if there are several. Within a
        cluster of eigenvalues that agree to rounding, any orthonormal basis is one of eigenvectors:
        which one comes out depends on the order of vertices and on the processor.

    Raises
    ------
    ValueError
        If it is no mesh, is empty, has a vertex that is not finite or without a triangle or a
        triangle without area, overflows, or k is not between 1 and the vertices less the
        components.
    CertificateError
        If the stronger setting's answer cannot be certified either.
    SpectrumError
        If the iteration does not converge or a factorisation breaks down.

    References
    ----------
    B. N. Parlett, "The Symmetric Eigenvalue Problem" (1998), sections 3.3, 11.5 and 15.9. A. J.
    Wathen, "Realistic eigenvalue bounds for the Galerkin mass matrix", IMA J. Numer. Anal. 7
    (1987).

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 40})
    >>> spectrum = compute(sphere, k=3)
    >>> spectrum.eigenvalues.round(1)  # the smooth sphere has 2, 2, 2
    array([2., 2., 2.])
    >>> spectrum.certificate.count  # zero and these three are all that is below the shift
    4
    """
    mesh = as_mesh(mesh)
    matrices = assemble(mesh)
    _say_what_is_odd(mesh)
    candidate, certificate, pieces = _solved(matrices, k)
    numbers = None if pieces == 1 else components.components(matrices)[1]
    values, bounds, vectors = sharpened(mesh, matrices.lumped, candidate, numbers)
    if not sharp:
        bounds = np.abs(values - candidate.values[: len(values)]) + bounds
    certificate = replace(certificate, error_bound=bounds[:k])
    found = _spectrum(matrices, k, candidate, certificate, pieces)
    if not sharp:
        return found
    # A constant changes over no triangle: its energy, added up that way, is exactly zero
    return replace(found, eigenvalues=values[:k], eigenvectors=vectors[:, :k], trivial=0.0)


def of_matrices(matrices: Matrices, k: int = 10) -> Spectrum:
    """Compute the first k eigenvalues after the trivial zero of other elements, or another mass.

    As :func:`compute`, but that M is at most 15 B for quadratic elements, in Bernstein's form, so
    that there an eigenvalue is within twice a pair's residual of λ.

    Parameters
    ----------
    matrices : Matrices
        The constant 1 is the vector of ones.
    k : int
        Number of eigenvalues, below the number of unknowns.

    Raises
    ------
    CertificateError
        If the stronger setting's answer cannot be certified either.
    SpectrumError
        If the iteration does not converge or a factorisation breaks down.
    """
    return _spectrum(matrices, k, *_solved(matrices, k))


def smallest(matrices: Matrices, k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the k smallest eigenpairs, the zeros among them; the others by :func:`of_matrices`.

    Parameters
    ----------
    matrices : Matrices
        As in :func:`of_matrices`, of one component or several.
    k : int
        From one to the number of unknowns.

    Returns
    -------
    eigenvalues : ndarray of shape (k,), float64
        In 1/length², ascending, first an exact zero for each component.
    eigenvectors : ndarray of shape (n, k), float64
        Orthonormal in the mass matrix; those of zeros are constant on a component.

    Raises
    ------
    ValueError
        If k is out of range.
    CertificateError, SpectrumError
        As in :func:`of_matrices`.
    """
    count, numbers = components.components(matrices)
    n = len(numbers)
    if not 1 <= k <= n:
        raise ValueError(f"k must be from 1 to {n}, the number of vertices, got {k}")
    areas = np.bincount(numbers, weights=matrices.lumped)
    constants = (numbers[:, None] == np.arange(count)) / np.sqrt(areas)
    if k <= count:
        return np.zeros(k), constants[:, :k]
    found = of_matrices(matrices, k - count)
    values = np.concatenate([np.zeros(count), found.eigenvalues])
    return values, np.hstack([constants, found.eigenvectors])


def compile_solver() -> None:
    """Make sure that the solver's machine code is in the cache: a quarter of a minute, once."""
    side = np.linspace(0.0, 1.0, 9)
    points = np.stack([*np.meshgrid(side, side), np.zeros((9, 9))], axis=-1).reshape(-1, 3)
    corner = np.arange(72)[np.arange(72) % 9 < 8]
    below = np.stack([corner, corner + 1, corner + 10], axis=1)
    above = np.stack([corner, corner + 10, corner + 9], axis=1)
    compute(Mesh(points, np.concatenate([below, above])))


def count_below(mesh: Mesh, *shifts: float) -> list[int]:
    """Return how many eigenvalues, the zero included, are below each shift in 1/length².

    By the law of inertia, with no eigenvalue computed.

    Raises
    ------
    ValueError
        If a triangle has no area, or a vertex no triangle.
    SpectrumError
        If a shift is so close to an eigenvalue that a pivot is zero.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 40})
    >>> count_below(sphere, 1.0, 4.0, 9.0)  # of 0, then 2 three times, then 6 five times
    [1, 4, 9]
    """
    matrices = assemble(mesh)
    ordering = find_ordering(matrices.indptr, matrices.indices)
    return [inertia(matrices, ordering, shift).negative for shift in shifts]


def _solved(matrices: Matrices, k: int) -> tuple[Candidate, Certificate, int]:
    """Return at least k certified pairs, their certificate, and the number of components."""
    pieces, numbers = components.components(matrices)
    n = len(matrices.lumped)
    if not 1 <= k <= n - pieces:
        of = f"{n} vertices" if pieces == 1 else f"{n} vertices in {pieces} components"
        raise ValueError(f"k must be between 1 and {n - pieces} for {of}, got {k}")
    if pieces > 1:
        return *components.solve(matrices, numbers, k, _connected), pieces
    ordering = find_ordering(matrices.indptr, matrices.indices)
    return *_connected(matrices, ordering, k), pieces


def _connected(matrices: Matrices, ordering: Ordering, k: int) -> tuple[Candidate, Certificate]:
    """Return at least k certified pairs of matrices of one component."""
    try:
        return _certified(matrices, ordering, k, NORMAL)
    except SpectrumError:
        return _certified(matrices, ordering, k, STRONGER)


def _certified(
    matrices: Matrices, ordering: Ordering, k: int, setting: Setting
) -> tuple[Candidate, Certificate]:
    n = len(matrices.lumped)
    if n <= max(DENSE, DENSE_FOR * (k + 1)):
        candidate = _dense(matrices, k, setting)
        counted = inertia(matrices, ordering, candidate.middle)
    else:
        candidate, counted = search(matrices, ordering, k, setting)
    return candidate, certify(candidate, counted)


def _spectrum(
    matrices: Matrices, k: int, candidate: Candidate, certificate: Certificate, pieces: int
) -> Spectrum:
    return Spectrum(
        eigenvalues=candidate.values[:k],
        trivial=float(matrices.stiffness.sum()) / float(matrices.lumped.sum()),
        certificate=certificate,
        eigenvectors=_turned(candidate.vectors[:k]).T,
        components=pieces,
    )


def _turned(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rows whose entry of largest size is positive."""
    largest = np.abs(rows).argmax(axis=1)
    signs: NDArray[np.float64] = np.sign(rows[np.arange(len(rows)), largest])
    return rows * signs[:, None]


def _dense(matrices: Matrices, k: int, setting: Setting) -> Candidate:
    """Return k pairs and those of their cluster, by LAPACK."""
    stiffness, mass = (matrix.toarray() for matrix in as_sparse(matrices))
    try:
        values, vectors = linalg.eigh(stiffness, mass)
    except linalg.LinAlgError as error:
        raise SpectrumError(f"dense eigenvalue solver failed: {error}") from error
    values, rows = values[1:], vectors[:, 1:].T
    gaps = np.append(np.diff(values), values[-1]) > setting.gap * np.abs(values)
    last = k - 1 + int(np.argmax(gaps[k - 1 :]))
    low = float(values[last])
    high = float(values[last + 1]) if last + 1 < len(values) else 2 * low
    values, rows = values[: last + 1], rows[: last + 1]
    defects = rows @ stiffness - values[:, None] * (rows @ mass)
    return Candidate(values, rows, largest_residual(matrices, defects, values), (low, high))
