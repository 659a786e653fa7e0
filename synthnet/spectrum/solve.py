"""Eigenvalues of the Laplace-Beltrami operator by linear finite elements, with a certificate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse

from synthnet.errors import CertificateError, SpectrumError
from synthnet.spectrum import fem
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.lanczos import Lanczos, RitzPairs
from synthnet.spectrum.ldl import Factor, factorise, solve
from synthnet.spectrum.ordering import Ordering, find_ordering
from synthnet.types import Certificate, Mesh, Spectrum

DENSE, DENSE_FOR = 64, 6  # vertices, and vertices for each pair, up to which a basis is no saving
NEAR_ZERO = 1e-3  # of Weyl's k-th eigenvalue: what is below it is exact to so much of it
SAFETY = 100  # times the rounding errors' first-order effect on the shift of a count


@dataclass(frozen=True, slots=True)
class Setting:
    """How to look for eigenpairs.

    Parameters
    ----------
    shift : float
        Of the operator, in units of what Weyl's law gives for the k-th eigenvalue.
    residual : float
        Largest relative residual that is good enough.
    excused : float
        Largest one to put up with where rounding lets it fall no further, as on very fine
        meshes.
    gap : float
        Least relative gap above the cluster of the k-th eigenvalue in which to count.
    vectors : int
        Most vectors in the basis.
    strict : bool
        Whether to keep the basis orthogonal to rounding at every step.
    seed : int
        Of the vectors to start from.
    """

    shift: float
    residual: float
    excused: float
    gap: float
    vectors: int
    strict: bool
    seed: int


# A shift inside the spectrum needs a quarter fewer steps than one below it; measured on 1.0.
NORMAL = Setting(
    shift=0.7, residual=1e-7, excused=1e-6, gap=1e-3, vectors=161, strict=False, seed=0
)
# Below the spectrum A − σB is definite, so that its factorisation is backward stable.
STRONGER = Setting(
    shift=-0.05, residual=1e-7, excused=np.inf, gap=1e-2, vectors=401, strict=True, seed=1
)
ROUNDS = 8  # of looking for more copies of an eigenvalue than a start of two vectors shows


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

    Examples
    --------
    >>> stiffness, mass = fem_matrices(Mesh(np.eye(3), np.array([[0, 1, 2]])))
    >>> round(float(mass.sum() ** 2), 9)  # the square of the area, √3 / 2
    0.75
    >>> bool(abs(stiffness.sum(axis=0)).max() < 1e-15)  # constants are in its kernel
    True
    """
    matrices = _assemble(mesh)
    shape = (len(mesh.vertices),) * 2
    stiffness, mass = (
        sparse.csc_matrix((values, matrices.indices, matrices.indptr), shape=shape)
        for values in (matrices.stiffness, matrices.mass)
    )
    return stiffness, mass


def _assemble(mesh: Mesh) -> Matrices:
    unused = len(mesh.vertices) - np.count_nonzero(np.bincount(mesh.faces.ravel()))
    if unused:
        raise ValueError(f"{unused} vertices belong to no triangle: remove them first")
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    return fem.assemble(vertices, np.ascontiguousarray(mesh.faces, dtype=np.int32))


def compute(mesh: Mesh, k: int = 10) -> Spectrum:
    r"""Compute the first k eigenvalues after the trivial zero, Neumann on a boundary.

    Solves :math:`A\varphi = \lambda B\varphi` by block Lanczos around a shift inside the
    spectrum, and certifies the answer. With :math:`r = A\varphi - \lambda B\varphi` and M the
    lumped mass, the relative residual of a pair is

    .. math::
        \frac{2}{\lambda} \sqrt{\frac{r^T M^{-1} r}{\varphi^T B \varphi}}

    and at least one eigenvalue is within so much of λ, relative to it, because B ≥ M/4 for
    triangles. A factorisation :math:`A - \sigma B = L D L^T`, σ in a gap above the k-th
    eigenvalue and all that are as good as equal to it, has as many negative pivots as there
    are eigenvalues below σ (Sylvester's law of inertia): none was missed if that is the
    number of pairs found. More are searched for beside them as long as some are missing;
    an answer without certificate is looked for again by a stronger setting. Next to zero,
    below a thousandth of Weyl's k-th eigenvalue, the residual is relative to that instead.

    Parameters
    ----------
    mesh : Mesh
        Connected, without degenerate triangles. A mesh of several components has a zero
        for each, and only the first is left out.
    k : int
        Number of eigenvalues.

    Returns
    -------
    Spectrum
        Eigenvalues in 1/length², float64, ascending, with their certificate.

    Raises
    ------
    ValueError
        If k is not between 1 and n − 1, a triangle has no area, or a vertex no triangle.
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
    n = len(mesh.vertices)
    if not 1 <= k <= n - 1:
        raise ValueError(f"k must be between 1 and {n - 1} for {n} vertices, got {k}")
    matrices = _assemble(mesh)
    ordering = find_ordering(matrices.indptr, matrices.indices)
    try:
        return _certified(matrices, ordering, k, NORMAL)
    except SpectrumError:
        return _certified(matrices, ordering, k, STRONGER)


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
    matrices = _assemble(mesh)
    ordering = find_ordering(matrices.indptr, matrices.indices)
    return [_inertia(matrices, ordering, shift).negative for shift in shifts]


def _inertia(matrices: Matrices, ordering: Ordering, shift: float) -> Factor:
    factor = factorise(matrices, ordering, shift, pivots_only=True)
    if not factor.finite:
        raise SpectrumError(f"a pivot of A - {shift:g} B is zero")
    return factor


@dataclass(frozen=True, slots=True)
class _Candidate:
    """Pairs below a gap: vectors as B-orthonormal rows, and the gap."""

    values: NDArray[np.float64]
    vectors: NDArray[np.float64]
    residual: float
    gap: tuple[float, float]


def _certified(matrices: Matrices, ordering: Ordering, k: int, setting: Setting) -> Spectrum:
    n = len(matrices.lumped)
    if n <= max(DENSE, DENSE_FOR * (k + 1)):
        found = _dense(matrices, k, setting)
        certificate = _certify(found, _inertia(matrices, ordering, _middle(found)))
    else:
        found, certificate = _searched(matrices, ordering, k, setting)
    area = float(matrices.lumped.sum())
    return Spectrum(
        eigenvalues=found.values[:k],
        trivial=float(matrices.stiffness.sum()) / area,
        certificate=certificate,
        eigenvectors=found.vectors[:k].T,
    )


def _middle(found: _Candidate) -> float:
    return sum(found.gap) / 2


def _certify(found: _Candidate, counted: Factor) -> Certificate:
    """Return the certificate, or raise an error that says why there is none."""
    (low, high), shift = found.gap, _middle(found)
    if SAFETY * counted.uncertainty > (high - low) / 2:
        raise CertificateError(
            f"rounding moves the shift {shift:g} of the count by {counted.uncertainty:.2g}, "
            f"too much for the gap from {low:g} to {high:g}"
        )
    if counted.negative != len(found.values) + 1:
        raise CertificateError(
            f"{counted.negative} eigenvalues are below {shift:g}, but "
            f"{len(found.values) + 1} were found"
        )
    # B-orthonormal vectors have as many different eigenvalues within the norm of all their
    # residuals together, at most the root of their number times the largest (Kahan).
    together = np.sqrt(len(found.values)) * found.residual
    if not found.values[-1] * (1 + together) < shift:
        raise CertificateError(
            f"an eigenvalue of residual {found.residual:.2g} may be above {shift:g}"
        )
    return Certificate(counted.negative, shift, found.residual)


def _dense(matrices: Matrices, k: int, setting: Setting) -> _Candidate:
    n = len(matrices.lumped)
    stiffness, mass = (
        sparse.csc_matrix((values, matrices.indices, matrices.indptr), shape=(n, n)).toarray()
        for values in (matrices.stiffness, matrices.mass)
    )
    try:
        values, vectors = linalg.eigh(stiffness, mass)
    except linalg.LinAlgError as error:
        raise SpectrumError(f"dense eigenvalue solver failed: {error}") from error
    values, rows = values[1:], vectors[:, 1:].T
    gaps = np.append(np.diff(values), values[-1]) > setting.gap * np.abs(values)
    last = k - 1 + int(np.argmax(gaps[k - 1 :]))
    high = float(values[last + 1]) if last + 1 < len(values) else 2 * float(values[last])
    rows = rows[: last + 1]
    low = float(values[last])
    values = values[: last + 1]
    residual = _largest_residual(
        matrices, rows @ stiffness - values[:, None] * (rows @ mass), values
    )
    return _Candidate(values, rows, residual, (low, high))


def _searched(
    matrices: Matrices, ordering: Ordering, k: int, setting: Setting
) -> tuple[_Candidate, Certificate]:
    """Search; while more are counted than found, search beside what has been found.

    From two vectors, Lanczos sees two copies of an eigenvalue; the third and fourth that
    symmetric shapes have show up by rounding only, and later.
    """
    sigma = setting.shift * 4 * np.pi * k / float(matrices.lumped.sum())
    factor = factorise(matrices, ordering, sigma)
    if not factor.finite:
        raise SpectrumError(f"a pivot of A - {sigma:g} B is zero")
    found = _lanczos(matrices, ordering, factor, sigma, k, setting)
    counted = _inertia(matrices, ordering, _middle(found))
    for seed in range(1, ROUNDS + 1):
        missing = counted.negative - 1 - len(found.values)
        if missing <= 0:
            break
        more = _lanczos(matrices, ordering, factor, sigma, missing, setting, found, seed)
        if len(more.values) == len(found.values):
            break
        found = more
    return found, _certify(found, counted)


def _lanczos(
    matrices: Matrices,
    ordering: Ordering,
    factor: Factor,
    sigma: float,
    k: int,
    setting: Setting,
    known: _Candidate | None = None,
    seed: int = 0,
) -> _Candidate:
    """Find k pairs and those of their cluster; or those below the gap beside the known ones."""
    room_for = len(matrices.lumped) - 1 - (0 if known is None else len(known.values))
    search = Lanczos(
        matrices,
        ordering,
        factor,
        sigma,
        limit=min(setting.vectors + 8 * k, room_for),
        known=None if known is None else known.vectors,
        strict=setting.strict,
        seed=setting.seed + 100 * seed,
    )
    tolerance, best = setting.residual, None
    steps, room = k + 2, True
    while room:
        room = search.extend(steps)
        steps = 2
        pairs = search.ritz()
        if known is None:
            cut = _gap_above(pairs, k, tolerance, setting.gap, sigma)
        else:
            cut = _below_gap(pairs, known.gap, tolerance, sigma)
        if cut is None:
            continue
        count, gap = cut
        rows = search.vectors(pairs, count)
        if known is not None:
            weighted = search.weighted[1 : search.first]
            rows = np.concatenate([known.vectors, rows[0]]), np.concatenate([weighted, rows[1]])
        values, vectors, residual = _polished(matrices, ordering, factor, rows, setting.residual)
        found = _Candidate(values, vectors, residual, gap)
        if residual <= setting.residual:
            return found
        if best is not None and residual > best.residual / 2:  # rounding, then
            break
        if best is None or residual < best.residual:
            best = found
        tolerance /= 10
    if best is None or best.residual > setting.excused:
        raise SpectrumError(f"no convergence in {search.size} Lanczos vectors")
    return best


def _below_gap(
    pairs: RitzPairs, gap: tuple[float, float], tolerance: float, sigma: float
) -> tuple[int, tuple[float, float]] | None:
    """Return the pairs below a gap, if there are any and all have converged."""
    below = pairs.values < sum(gap) / 2
    count = int(np.count_nonzero(below))
    converged = pairs.errors <= tolerance * np.maximum(pairs.values, NEAR_ZERO * abs(sigma))
    return (count, gap) if count and converged[below].all() else None


def _polished(
    matrices: Matrices,
    ordering: Ordering,
    factor: Factor,
    rows: tuple[NDArray[np.float64], NDArray[np.float64]],
    enough: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Rayleigh–Ritz, with one correction where the residual is not small enough."""
    values, vectors, defects = _rayleigh_ritz(matrices, *rows)
    residual = _largest_residual(matrices, defects, values)
    if residual <= enough:
        return values, vectors, residual
    # A step of inverse iteration, as a correction: rounding in the factor is undone.
    vectors = vectors - solve(factor, ordering, defects)
    weighted = fem.multiply(matrices, matrices.mass, vectors)
    values, vectors, defects = _rayleigh_ritz(matrices, vectors, weighted)
    return values, vectors, _largest_residual(matrices, defects, values)


def _gap_above(
    pairs: RitzPairs, k: int, tolerance: float, gap: float, sigma: float
) -> tuple[int, tuple[float, float]] | None:
    """Find the first gap above k pairs of which all below it have converged."""
    values, errors = pairs.values, pairs.errors
    converged = errors <= tolerance * np.maximum(values, NEAR_ZERO * abs(sigma))
    good = len(values) if converged.all() else int(np.argmin(converged))
    for count in range(k, min(good + 1, len(values))):
        low, high = float(values[count - 1]), float(values[count] - errors[count])
        if high > low * (1 + gap):
            return count, (low, high)
    return None


def _rayleigh_ritz(
    matrices: Matrices, vectors: NDArray[np.float64], weighted: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """In the span of the rows: values, B-orthonormal rows, and their defects A φ − λ B φ."""
    stiff = fem.multiply(matrices, matrices.stiffness, vectors)
    try:
        values, turn = linalg.eigh(vectors @ stiff.T, vectors @ weighted.T, check_finite=False)
    except linalg.LinAlgError as error:
        raise SpectrumError(f"the eigenvectors found are not independent: {error}") from error
    defects = turn.T @ stiff - values[:, None] * (turn.T @ weighted)
    return values, turn.T @ vectors, defects


def _largest_residual(
    matrices: Matrices, defects: NDArray[np.float64], values: NDArray[np.float64]
) -> float:
    """Of B-orthonormal vectors; see :func:`compute`. Next to zero it is relative to a floor."""
    bounds = 2 * np.sqrt(np.square(defects) @ (1 / matrices.lumped))
    floor = NEAR_ZERO * 4 * np.pi * len(values) / matrices.lumped.sum()
    return float(np.max(bounds / np.maximum(values, floor)))
