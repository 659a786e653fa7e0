"""Eigenvalues of the Laplace-Beltrami operator by linear finite elements, with a certificate."""

import contextlib
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from scipy import linalg

from synthnet.arrays import Floats, Int32s
from synthnet.errors import SpectrumError
from synthnet.mesh.geometry import MeshFacts
from synthnet.mesh.repair import Repaired
from synthnet.processes import keep_freed_memory
from synthnet.spectrum import components, rounding
from synthnet.spectrum.certificate import (
    Candidate,
    certify,
    count_in_gap,
    inertia,
    largest_residual,
    near_zero,
)
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.inputs import as_count, as_mesh, as_number, repaired
from synthnet.spectrum.operators import (
    PLAIN,
    Discrete,
    Operator,
    as_sparse,
    check_operator,
    discretise,
)
from synthnet.spectrum.ordering import Ordering, find_ordering
from synthnet.spectrum.search import Setting, search, shift_amid
from synthnet.spectrum.sheets import warn_of_sheets
from synthnet.spectrum.slices import LONG, search_in_slices
from synthnet.spectrum.warned import warn
from synthnet.types import Certificate, Mesh, Spectrum

# Up to so many vertices, or vertices for each pair up to so many, a dense solver is as fast; and of
# nearly all pairs the iteration may not find the last ones.
DENSE, DENSE_FOR, DENSE_AT_MOST = 64, 6, 1500
NEARLY_ALL = 0.95  # of the rows
ROUGH = 1e-2  # of an eigenvalue: where rounding may have moved it by more, two digits are left
THIN = 1e-6  # altitude / longest edge: of such triangles, rounding is what a search fails by
UNMOVED = 1e-6  # relative: a shift that rounding moves by no more is counted at once
# What helps where rounding has spoilt an eigenvalue, and what does where that has been done.
SHARP = "sharp=True computes it from the energies of triangles"
REMESH = "remesh, some triangles are too thin"


# A shift inside the spectrum needs a quarter fewer steps than one below it; measured on 1.0.
NORMAL = Setting(
    shift=0.7, residual=1e-7, excused=1e-6, gap=1e-3, vectors=161, strict=False, seed=0
)
# From so many pairs on, the shift is nearly amid their eigenvalues. From so many entries of all
# eigenvectors on, a basis and its products with B would not stay in the processor's cache.
MANY_FROM, LARGE_FROM = 24, 1_000_000
MANY = replace(NORMAL, shift=0.62, amid=True)
# Below the spectrum A − σB is definite, so that its factorisation is backward stable.
STRONGER = Setting(
    shift=-0.05, residual=1e-7, excused=np.inf, gap=1e-2, vectors=401, strict=True, seed=1
)
# The shift is placed by counts: for a spectrum that is not at all as Weyl's law has it.
PLACED = replace(STRONGER, gap=1e-3, seed=2)


def compute(
    mesh: Any,
    k: int = 10,
    *,
    operator: Operator = PLAIN,
    sharp: bool = False,
    repair: bool = False,
) -> Spectrum:
    r"""Compute the first k eigenvalues after the zeros: linear elements, Neumann on a boundary.

    Solves :math:`A\varphi = \lambda B\varphi` by block Lanczos around a shift inside the
    spectrum, and certifies the answer. With :math:`r = A\varphi - \lambda B\varphi` and M the
    lumped mass, the relative residual of a pair is

    .. math::
        \frac{2}{\lambda} \sqrt{\frac{r^T M^{-1} r}{\varphi^T B \varphi}}

    and at least one eigenvalue is within so much of λ, relative to it, because B ≥ M/4 for
    linear elements and consistent mass (another operator has a constant of its own). A
    factorisation :math:`A - \sigma B = L D L^T`, σ in a gap above the k-th
    eigenvalue and its cluster, has as many negative pivots as there are eigenvalues below σ
    (Sylvester's law of inertia): none was missed if that is the number of pairs found. While
    some are missing the search goes on beside those found; if the answer cannot be certified,
    a stronger setting searches again, and at last one whose shift is placed by counts. Next to
    zero, below a thousandth of Weyl's k-th eigenvalue, the residual is relative to that instead.
    The same problem stands in NumPy and SciPy alone in :mod:`synthnet.spectrum.reference`.

    Parameters
    ----------
    mesh : Mesh or other
        Ours, or one of trimesh, Open3D, LaPy, PyVista or PyTorch Geometric, or a pair of arrays
        (vertices, faces); see :func:`synthnet.spectrum.as_mesh`. Without degenerate triangles. A
        mesh of several components has a zero for each; all of them are left out, and each
        component is solved by itself.
    k : int
        Number of eigenvalues, at most the vertices less the components.
    operator : Operator
        Another boundary condition, mass matrix or kind of elements, see
        :class:`synthnet.spectrum.Operator`. With functions held at zero, a component that is held
        somewhere has no zero eigenvalue, and counts are those of the vertices that are free.
    sharp : bool
        Return Ritz values of energies that are added up triangle by triangle, see
        :mod:`synthnet.spectrum.rounding`: on thin triangles the rounding of the matrices moves
        them less. On others they agree to rounding. The residual is that of the matrices. Linear
        elements only.
    repair : bool
        Repair the mesh first as ``synthnet import`` does: vertices are merged, faces without area
        are flipped or dropped, and so on. ``spectrum.repairs`` says what was done, and
        ``spectrum.mesh`` is the mesh that eigenvectors belong to.

    Returns
    -------
    Spectrum
        Eigenvalues in 1/length², float64, ascending, with their certificate; eigenvectors whose
        entry of largest size is positive, the first such entry if there are several. Within a
        cluster of eigenvalues that agree to rounding, any orthonormal basis is one of eigenvectors:
        which one comes out depends on the order of vertices and on the processor. Of quadratic
        elements they are the values at the vertices.

    Raises
    ------
    ValueError
        If it is no mesh, is empty, has a vertex that is not finite or without a triangle or a
        triangle without area, overflows, or k is not between 1 and the vertices less the
        components; if the operator does not fit the mesh.
    Refused
        If it is to be repaired, and is no surface by a rule of :mod:`synthnet.mesh.repair`.
    CertificateError
        If the stronger setting's answer cannot be certified either.
    SpectrumError
        If the iteration does not converge or a factorisation breaks down.

    Warns
    -----
    RuntimeWarning
        If rounding on thin triangles may have moved an eigenvalue by more than a hundredth of it,
        by its ``certificate.error_bound``: ``sharp`` is for such meshes. On a mesh whose triangles
        are too thin for that as well, sharp values come with the same warning.
    UserWarning
        If the mesh is no surface, or looks like another than it is: see
        :mod:`synthnet.spectrum.sheets`. Of several components ``spectrum.components`` says it.

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
    k = as_count(k)
    check_operator(operator)
    if sharp and operator.elements != "linear":
        raise ValueError(f"sharp is for linear elements, not {operator.elements} ones")
    mended = Repaired(mesh)
    if repair:
        mended = repaired(mesh)
        operator.check_repairs(mended.repairs)
        mesh = as_mesh(mended.mesh)
    keep_freed_memory()
    discrete = discretise(mesh, operator)
    warn_of_sheets(mesh, operator.elements, stacklevel=3)
    spectrum = _of_discrete(mesh, discrete, k, operator, sharp=sharp)
    if repair:
        spectrum = replace(spectrum, mesh=mended.mesh, repairs=mended.repairs)
    _warn_of_rounding(spectrum, SHARP if operator.elements == "linear" and not sharp else REMESH)
    return spectrum


def unwarned(mesh: Mesh, k: int, operator: Operator, *, sharp: bool) -> Spectrum:
    """As :func:`compute`, of arguments that are checked; rounding shows in the bound alone."""
    keep_freed_memory()
    return _of_discrete(mesh, discretise(mesh, operator), k, operator, sharp=sharp)


@contextlib.contextmanager
def thinness_named(mesh: Mesh) -> Iterator[None]:
    """Let what rounding prevents say so, if a mesh has triangles that are too thin."""
    try:
        yield
    except SpectrumError as error:
        thinnest = float(MeshFacts(mesh).relative_altitudes.min())
        if not thinnest < THIN:
            raise
        cause = f"some triangles are too thin, with an altitude {thinnest:.2g} of the longest edge"
        raise type(error)(f"{error}: {cause}: remesh") from error


def _of_discrete(
    mesh: Mesh, discrete: Discrete, k: int, operator: Operator, *, sharp: bool
) -> Spectrum:
    unknowns = "unknowns" if operator.on_edges else "vertices"
    with thinness_named(mesh):
        candidate, certificate, numbers = _solved(discrete.matrices, k, unknowns)
    vectors = None
    if operator.elements == "linear":
        values, bounds, vectors = rounding.sharpened(
            mesh, discrete, candidate, numbers, operator.share, with_vectors=sharp
        )
    else:
        values, bounds = rounding.of_matrices(discrete, candidate, numbers)
    if not sharp:
        bounds = np.abs(values - candidate.values[: len(values)]) + bounds
    certificate = replace(certificate, error_bound=bounds[:k])
    spectrum = _spectrum(discrete, k, candidate, certificate, numbers)
    if vectors is None:
        return spectrum
    # A constant changes over no triangle: its energy, added up that way, is exactly zero
    trivial = 0.0 if discrete.free is None else np.nan
    vectors = _turned(vectors.T[:k]).T
    return replace(spectrum, eigenvalues=values[:k], eigenvectors=vectors, trivial=trivial)


def _warn_of_rounding(spectrum: Spectrum, advice: str) -> None:
    """Warn where rounding has left an eigenvalue no more than a digit or two."""
    values, bounds = spectrum.eigenvalues, spectrum.certificate.error_bound
    if bounds is None:
        return
    rough = np.flatnonzero(~(bounds <= ROUGH * np.abs(values)))
    if len(rough):
        i = int(rough[0])
        warn(
            f"rounding on thin triangles may have moved λ{i + 1} = {values[i]:.6g} by up to "
            f"{bounds[i]:.2g}: {advice}",
            RuntimeWarning,
            stacklevel=3,
        )


def of_matrices(matrices: Matrices, k: int = 10) -> Spectrum:
    """Compute the first k eigenvalues after the trivial zero of other elements, or another mass.

    As :func:`compute`. Where ``least`` is that of linear elements and M is at most 15 B, as of
    quadratic ones in Bernstein's form, an eigenvalue is within twice a pair's residual of λ.

    Parameters
    ----------
    matrices : Matrices
        The constant 1 is the vector of ones, unless something is held at zero.
    k : int
        Number of eigenvalues, below the number of unknowns.

    Raises
    ------
    ValueError
        If k is no integer, or not between 1 and the number of unknowns less the zeros.
    CertificateError
        If the stronger setting's answer cannot be certified either.
    SpectrumError
        If the iteration does not converge or a factorisation breaks down.
    """
    k = as_count(k)
    discrete = Discrete(matrices, None, len(matrices.lumped))
    return _spectrum(discrete, k, *_solved(matrices, k))


def smallest(matrices: Matrices, k: int) -> tuple[Floats, Floats]:
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
        In 1/length², ascending, first an exact zero for each component of which nothing is held.
    eigenvectors : ndarray of shape (n, k), float64
        Orthonormal in the mass matrix; those of zeros are constant on a component.

    Raises
    ------
    ValueError
        If k is no integer or out of range.
    CertificateError, SpectrumError
        As in :func:`of_matrices`.
    """
    k = as_count(k)
    _, numbers = components.components(matrices)
    n = len(numbers)
    if not 1 <= k <= n:
        raise ValueError(f"k must be from 1 to {n}, the number of vertices, got {k}")
    unheld = np.flatnonzero(components.unheld(matrices, numbers))
    areas = np.bincount(numbers, weights=matrices.lumped)[unheld]
    constants = (numbers[:, None] == unheld) / np.sqrt(areas)
    if k <= (count := len(unheld)):
        return np.zeros(k), constants[:, :k]
    spectrum = of_matrices(matrices, k - count)
    values = np.concatenate([np.zeros(count), spectrum.eigenvalues])
    return values, np.hstack([constants, spectrum.eigenvectors])


def compile_solver() -> None:
    """Make sure that the solver's machine code is in the cache: a quarter of a minute, once."""
    side = np.linspace(0.0, 1.0, 9)
    points = np.stack([*np.meshgrid(side, side), np.zeros((9, 9))], axis=-1).reshape(-1, 3)
    corner = np.arange(72)[np.arange(72) % 9 < 8]
    below = np.stack([corner, corner + 1, corner + 10], axis=1)
    above = np.stack([corner, corner + 10, corner + 9], axis=1)
    compute(Mesh(points, np.concatenate([below, above])))


def count_below(mesh: Any, *shifts: float, operator: Operator = PLAIN) -> list[int]:
    """Return how many eigenvalues, zeros included, are below each shift in 1/length².

    By the law of inertia, in each component by itself, with no eigenvalue computed. The mesh is as
    of :func:`compute`.

    Raises
    ------
    ValueError
        See :func:`compute`; if a shift is no finite number.
    SpectrumError
        If a shift is so close to an eigenvalue that a pivot is zero, or if rounding on thin
        triangles moves it past eigenvalues.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 40})
    >>> count_below(sphere, 1.0, 4.0, 9.0)  # of 0, then 2 three times, then 6 five times
    [1, 4, 9]
    """
    numbers = [as_number(shift, "a shift") for shift in shifts]
    if not np.isfinite(numbers).all():
        raise ValueError(
            f"shifts must be finite, got {', '.join(f'{shift:g}' for shift in numbers)}"
        )
    mesh = as_mesh(mesh)
    matrices = discretise(mesh, operator).matrices
    warn_of_sheets(mesh, operator.elements, stacklevel=3)
    blocks = list(components.split(matrices, components.components(matrices)[1]))
    return [sum(_count_in_component(block, shift) for block in blocks) for shift in numbers]


def _count_in_component(block: components.Component, shift: float) -> int:
    """Count a component's eigenvalues below a shift; beside it too where rounding moves it far."""
    if shift <= 0:  # none is negative
        return 0
    if shift > components.above_all(block.matrices):
        return len(block.matrices.lumped)
    count, moved = components.count_and_shift_error(block, shift, UNMOVED * shift)
    if moved <= UNMOVED * shift:
        return count
    given = block.matrices, block.ordering
    least, most = (inertia(*given, shift + side * moved).negative for side in (-1, 1))
    if least != most:
        raise SpectrumError(
            f"rounding moves the shift {shift:g} by up to {moved:.2g}, so {least} to {most} "
            "eigenvalues may be below it"
        )
    return least


def _solved(
    matrices: Matrices, k: int, unknowns: str = "unknowns"
) -> tuple[Candidate, Certificate, Int32s]:
    """Return at least k certified pairs, their certificate, and the component of each row.

    ``unknowns`` is what a message calls the rows.
    """
    pieces, numbers = components.components(matrices)
    n, zeros = len(matrices.lumped), int(components.unheld(matrices, numbers).sum())
    if not 1 <= k <= n - zeros:
        of = f"{n} {unknowns}" if matrices.anchored is None else f"{n} free {unknowns}"
        of += "" if pieces == 1 else f" in {pieces} components"
        raise ValueError(f"k must be between 1 and {n - zeros} for {of}, got {k}")
    if pieces > 1:
        return *components.solve(matrices, numbers, k, _connected), numbers
    ordering = find_ordering(matrices.indptr, matrices.indices)
    return *_connected(matrices, ordering, k), numbers


def _connected(matrices: Matrices, ordering: Ordering, k: int) -> tuple[Candidate, Certificate]:
    """Return at least k certified pairs of matrices of one component."""
    try:
        lean = k * len(matrices.lumped) >= LARGE_FROM
        setting = replace(NORMAL if k < MANY_FROM else MANY, lean=lean)
        return _certified(matrices, ordering, k, setting)
    except SpectrumError:
        pass
    try:
        return _certified(matrices, ordering, k, STRONGER)
    except SpectrumError:
        if _is_dense(len(matrices.lumped), k):
            raise
    weyl = 4 * np.pi * k / float(matrices.lumped.sum())
    shift = shift_amid(matrices, ordering, k) / weyl
    return _certified(matrices, ordering, k, replace(PLACED, shift=shift))


def _is_dense(n: int, k: int) -> bool:
    """Return whether the dense solver is asked for k pairs of n rows."""
    return n <= max(DENSE, min(DENSE_FOR * (k + 1), DENSE_AT_MOST)) or k > NEARLY_ALL * n


def _certified(
    matrices: Matrices, ordering: Ordering, k: int, setting: Setting
) -> tuple[Candidate, Certificate]:
    if _is_dense(len(matrices.lumped), k):
        found = _dense(matrices, k, setting)
        candidate, counted = count_in_gap(matrices, ordering, found, elsewhere=setting.strict)
    elif k > LONG and not setting.strict:
        return search_in_slices(matrices, ordering, k, setting)
    else:
        candidate, counted = search(matrices, ordering, k, setting)
    return candidate, certify(candidate, counted, matrices.zeros)


def _spectrum(
    discrete: Discrete, k: int, candidate: Candidate, certificate: Certificate, numbers: Int32s
) -> Spectrum:
    matrices = discrete.matrices
    zero = float(matrices.stiffness.sum()) / float(matrices.lumped.sum())
    return Spectrum(
        eigenvalues=candidate.values[:k],
        trivial=zero if matrices.anchored is None else np.nan,
        certificate=certificate,
        eigenvectors=_turned(discrete.at_vertices(candidate.vectors[:k])).T,
        components=int(numbers.max()) + 1,
    )


def _turned(rows: Floats) -> Floats:
    """Give rows the sign with which their entry of largest size is positive; return them."""
    for row in rows:
        if row[np.abs(row).argmax()] < 0:
            np.negative(row, out=row)
    return rows


def _dense(matrices: Matrices, k: int, setting: Setting) -> Candidate:
    """Return k pairs and those of their cluster, by LAPACK."""
    stiffness, mass = (matrix.toarray() for matrix in as_sparse(matrices))
    try:
        values, vectors = linalg.eigh(stiffness, mass)
    except linalg.LinAlgError as error:
        raise SpectrumError(f"dense eigenvalue solver failed: {error}") from error
    values, rows = values[matrices.zeros :], vectors[:, matrices.zeros :].T
    gaps = np.append(np.diff(values), values[-1]) > setting.gap * np.abs(values)
    last = k - 1 + int(np.argmax(gaps[k - 1 :]))
    low = float(values[last])
    high = float(values[last + 1]) if last + 1 < len(values) else 2 * low
    values, rows = values[: last + 1], rows[: last + 1]
    defects = rows @ stiffness - values[:, None] * (rows @ mass)
    residual, floor = largest_residual(matrices, defects, values), near_zero(matrices, len(values))
    return Candidate(values, rows, residual, (low, high), floor)
