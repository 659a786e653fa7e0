"""The search for eigenpairs: Lanczos until all below a gap have converged, then a count of them."""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from synthnet.arrays import Booleans, Floats
from synthnet.errors import SpectrumError
from synthnet.spectrum import fem
from synthnet.spectrum.certificate import (
    NEAR_ZERO,
    Candidate,
    count_in_gap,
    largest_residual,
    near_zero,
)
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.lanczos import Lanczos, RitzPairs
from synthnet.spectrum.ldl import Factor, factorise
from synthnet.spectrum.ordering import Ordering
from synthnet.spectrum.substitution import solve

MIDDLE = 0.5  # of a window: where its shift lies
PLACINGS = 40  # most counts that place a shift
ASIDE, CLOSE = 1e-3, 1.1  # a shift at an eigenvalue is moved so far; two so close need no other
ROUNDS = 8  # most searches for further copies of an eigenvalue: a start of two vectors shows two


@dataclass(frozen=True, slots=True)
class Setting:
    """How to look for eigenpairs.

    Parameters
    ----------
    shift : float
        Shift of the operator, in units of what Weyl's law gives for the k-th eigenvalue.
    residual : float
        Largest relative residual at which the search ends.
    excused : float
        Largest relative residual that is accepted where rounding keeps it from falling further,
        as on very fine meshes.
    gap : float
        Least relative gap above the cluster of the k-th eigenvalue in which to count.
    vectors : int
        Most vectors in the basis, before 8 more for each eigenvalue that is asked for.
    strict : bool
        Whether to keep the basis orthogonal to rounding at every step, and to count in other
        places than the middle of the gap if rounding moves that count too far.
    seed : int
        Seed of the vectors to start from.
    lean : bool
        Whether to keep only the basis, and not its products with B.
    amid : bool
        Whether the shift of a first search lies amid the eigenvalues, which need fewer steps then.
    """

    shift: float
    residual: float
    excused: float
    gap: float
    vectors: int
    strict: bool
    seed: int
    lean: bool = False
    amid: bool = False


@dataclass(frozen=True, slots=True)
class Window:
    """Where a search begins: nothing that it looks for is below.

    Parameters
    ----------
    low : float
        A shift in a gap, in 1/length².
    count : int
        Eigenvalues below it, zeros included.
    deflated : ndarray of shape (d, n), float64
        Eigenvectors of the last of these, B-orthonormal: the search stays orthogonal to them.
    spacing : float
        About the distance of one eigenvalue to the next, in 1/length².
    """

    low: float
    count: int
    deflated: Floats
    spacing: float


@dataclass(frozen=True, slots=True)
class _Problem:
    """What stays the same during a search: the matrices, and A − σB factorised at its shift σ."""

    matrices: Matrices
    ordering: Ordering
    factor: Factor
    sigma: float
    setting: Setting
    window: Window

    def converged(self, pairs: RitzPairs, tolerance: float) -> Booleans:
        """Return which pairs have an error below the tolerance, relative to their value."""
        scale = np.maximum(pairs.values, NEAR_ZERO * abs(self.sigma))
        return np.asarray(pairs.errors <= tolerance * scale, dtype=np.bool_)


def search(
    matrices: Matrices, ordering: Ordering, k: int, setting: Setting, window: Window | None = None
) -> tuple[Candidate, Factor]:
    """Search for k pairs; while more are counted than found, search beside what is known.

    From two vectors, Lanczos sees two copies of an eigenvalue; the third and fourth that
    symmetric shapes have show up by rounding only, and later.

    Parameters
    ----------
    matrices, ordering : Matrices, Ordering
        Of one component.
    k : int
        Number of pairs.
    setting : Setting
        How to look for them.
    window : Window, optional
        Above which they are; by default, above the zeros.

    Returns
    -------
    Candidate
        At least k pairs, the first ones of the window.
    Factor
        The pivots in the middle of its gap, to certify it with.

    Raises
    ------
    SpectrumError
        If the iteration does not converge, or a pivot is zero.
    """
    if window is None:
        sigma = setting.shift * 4 * np.pi * k / float(matrices.lumped.sum())
        window = Window(-np.inf, matrices.zeros, np.empty((0, len(matrices.lumped))), sigma / k)
    else:
        sigma = window.low + MIDDLE * window.spacing * k
    factor = factorise(matrices, ordering, sigma)
    if not factor.finite:
        raise SpectrumError(f"a pivot of A - {sigma:g} B is zero")
    problem = _Problem(matrices, ordering, factor, sigma, setting, window)
    candidate = _find(problem, k)
    candidate, counted = count_in_gap(matrices, ordering, candidate, elsewhere=setting.strict)
    for seed in range(1, ROUNDS + 1):
        missing = counted.negative - window.count - len(candidate.values)
        if missing <= 0:
            break
        candidate = _find(problem, missing, candidate, seed)
    return candidate, counted


def shift_amid(matrices: Matrices, ordering: Ordering, k: int) -> float:
    """Return a shift below which k/2 to k eigenvalues after the zeros are, by counts.

    Below a cluster that has more, it is at most a tenth below. Weyl's law says nothing of where
    eigenvalues are if triangles are large beside the surface, or parts hang together by necks.

    Parameters
    ----------
    matrices, ordering : Matrices, Ordering
        Of one component.
    k : int
        Number of eigenvalues that are looked for.

    Returns
    -------
    float
        In 1/length².
    """
    low, high = 0.0, np.inf
    shift = 4 * np.pi * k / float(matrices.lumped.sum())
    for _ in range(PLACINGS):
        counted = factorise(matrices, ordering, shift, pivots_only=True)
        if not counted.finite:
            shift *= 1 + ASIDE
            continue
        below = counted.negative - matrices.zeros
        if k <= 2 * below <= 2 * k:
            break
        low, high = (low, shift) if below > k else (shift, high)
        if low > 0 and high < CLOSE * low:
            return low
        shift = 2 * low if high == np.inf else high / 4 if low == 0 else np.sqrt(low * high)
    return float(shift)


def _find(problem: _Problem, k: int, known: Candidate | None = None, seed: int = 0) -> Candidate:
    """Find k pairs and those of their cluster; or those below the gap beside the known ones."""
    setting, deflated = problem.setting, problem.window.deflated
    if known is not None:
        deflated = np.concatenate([deflated, known.vectors])
    most = len(problem.matrices.lumped) - problem.matrices.zeros - len(deflated)
    lanczos = Lanczos(
        problem.matrices,
        problem.ordering,
        problem.factor,
        problem.sigma,
        limit=min(setting.vectors + 8 * k, most),
        known=deflated,
        strict=setting.strict,
        lean=setting.lean,
        seed=setting.seed + 100 * seed,
    )
    tolerance, best = setting.residual, None
    steps, room = k + 2, True
    if setting.amid and not len(deflated):
        steps = k - k // 8  # around a shift amid the eigenvalues, nearly enough
    while room:
        room = lanczos.extend(steps)
        steps = 2
        pairs = lanczos.ritz().above(problem.window.low)
        converged = problem.converged(pairs, tolerance)
        if known is None:
            cut = _gap_above(pairs, converged, k, setting.gap)
        else:
            cut = _below_gap(pairs, converged, known)
        if cut is None:
            continue
        count, gap = cut
        candidate = _polished(problem, *_vectors(lanczos, pairs, count, known), gap)
        if candidate.residual <= setting.residual:
            return candidate
        if best is not None and candidate.residual > best.residual / 2:
            break  # only rounding is left
        if best is None or candidate.residual < best.residual:
            best = candidate
        tolerance /= 10
    if best is None or best.residual > setting.excused:
        raise SpectrumError(f"no convergence in {lanczos.size} Lanczos vectors")
    return best


def _gap_above(
    pairs: RitzPairs, converged: Booleans, k: int, least: float
) -> tuple[int, tuple[float, float]] | None:
    """Return the number of pairs below the first gap above k of which all have converged."""
    values, errors = pairs.values, pairs.errors
    good = len(values) if converged.all() else int(np.argmin(converged))
    for count in range(k, min(good + 1, len(values))):
        low, high = float(values[count - 1]), float(values[count] - errors[count])
        if high > low * (1 + least):
            return count, (low, high)
    return None


def _below_gap(
    pairs: RitzPairs, converged: Booleans, known: Candidate
) -> tuple[int, tuple[float, float]] | None:
    """Return the number of pairs below a known gap, if there are any and all have converged."""
    below = pairs.values < known.middle
    count = int(np.count_nonzero(below))
    return (count, known.gap) if count and converged[below].all() else None


def _vectors(
    lanczos: Lanczos, pairs: RitzPairs, count: int, known: Candidate | None
) -> tuple[Floats, Floats]:
    """Return the known vectors and the first ones of a search, and their products with B."""
    vectors, weighted = lanczos.vectors(pairs, count)
    if known is None:
        return vectors, weighted
    before = fem.multiply(lanczos.matrices, lanczos.matrices.mass, known.vectors)
    return np.concatenate([known.vectors, vectors]), np.concatenate([before, weighted])


def _polished(
    problem: _Problem, vectors: Floats, weighted: Floats, gap: tuple[float, float]
) -> Candidate:
    """Rayleigh–Ritz, with one correction where the residual is not small enough."""
    matrices = problem.matrices
    values, defects = _rayleigh_ritz(matrices, vectors, weighted)
    residual = largest_residual(matrices, defects, values)
    if residual > problem.setting.residual:
        # A step of inverse iteration, as a correction: it undoes rounding in the factor.
        solve(problem.factor, problem.ordering, defects)
        vectors -= defects
        weighted = fem.multiply(matrices, matrices.mass, vectors)
        values, defects = _rayleigh_ritz(matrices, vectors, weighted)
        residual = largest_residual(matrices, defects, values)
    return Candidate(values, vectors, residual, gap, near_zero(matrices, len(values)))


def _rayleigh_ritz(matrices: Matrices, vectors: Floats, weighted: Floats) -> tuple[Floats, Floats]:
    """Overwrite rows by the Ritz vectors of their span; ``weighted`` are their products with B.

    Returns the values, and the defects A φ − λ B φ.
    """
    stiff = fem.multiply(matrices, matrices.stiffness, vectors)
    count, n = vectors.shape
    many = count > fem.FEW or n > fem.FINE  # then what a piece needs stays in the cache
    parts, none = fem.pieces(n) if many else [slice(n)], np.zeros((count, count))
    energies = sum((vectors[:, part] @ stiff[:, part].T for part in parts), none)
    products = sum((vectors[:, part] @ weighted[:, part].T for part in parts), none)
    try:
        values, turn = linalg.eigh(energies, products, check_finite=False)
    except linalg.LinAlgError as error:
        raise SpectrumError(f"the eigenvectors found are not independent: {error}") from error
    for part in parts:
        stiff[:, part] = turn.T @ stiff[:, part]
        moved = turn.T @ weighted[:, part]
        moved *= values[:, None]
        stiff[:, part] -= moved
        vectors[:, part] = turn.T @ vectors[:, part]
    return values, stiff
