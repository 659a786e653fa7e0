r"""Eigenvalues by multilevel subspace iteration on smoothed aggregates.

The vertices are gathered to aggregates of a handful, these again, down to a few dozen, with a
prolongation P between two levels and the Galerkin matrices :math:`P^T A P`, :math:`P^T B P`. The
coarsest eigenproblem is solved; then, level by level, its vectors X are prolonged, and Ritz values
are taken in the span of X and of one multigrid cycle towards :math:`A^{-1} B X \Lambda`.

Galerkin means that every Ritz value is a Rayleigh quotient of functions on the mesh itself: an
upper bound, but for rounding. How far above, nothing proves; where triangles are flat, cycles
converge slowly or the hierarchy looks bad, the certified solver answers instead: see
:func:`trusted` and docs/real-shapes.md.

References
----------
P. Vaněk, J. Mandel, M. Brezina, "Algebraic multigrid by smoothed aggregation for second and
fourth order elliptic problems", Computing 56 (1996). A. Nasikun, K. Hildebrandt, "The hierarchical
subspace iteration method for Laplace-Beltrami eigenproblems", ACM Trans. Graph. 41 (2022).
A. V. Knyazev, "Toward the optimal preconditioned eigensolver", SIAM J. Sci. Comput. 23 (2001).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import multilevel_kernels as kernels
import numpy as np
from scipy import linalg, sparse

from synthnet import Mesh, spectrum

META = {
    "name": "Multilevel subspace iteration",
    "kind": "classical",
    "paper": "Nasikun, Hildebrandt 2022; Vaněk, Mandel, Brezina 1996",
    "training_data": "none",
    "training_cost": "none",
}
COUNT = 10  # eigenvalues wanted
DEPENDENT = 1e-10  # of a Gram matrix, below which vectors agree
ZERO = 1e-12  # of the largest eigenvalue: that of a constant on a component


@dataclass(frozen=True, slots=True)
class Setting:
    """What the ablation changes.

    Parameters
    ----------
    strength : float
        Share of the largest −a_ij from which neighbours are strong. Not a number that is the
        ratio of two cotangents on a regular grid: rounding would decide.
    weight, least : float
        ω of the prolongation, and the least share of it that is kept.
    coarsest : int
        Vertices from which there is another level.
    vectors : int
        In the subspace, or two more or less, by where the coarsest spectrum has its widest gap.
    sweeps : tuple of int
        Of Gauss-Seidel before a coarse correction, and after it.
    enough : float
        A level is finished when no wanted Ritz value falls by more than this share of itself.
    cycles : int
        Most cycles on a level.
    remember : bool
        Whether the last change of the vectors stays in the space, as in LOBPCG.
    """

    strength: float = 0.24
    weight: float = 2 / 3
    least: float = 0.09
    coarsest: int = 150
    vectors: int = 14
    sweeps: tuple[int, int] = (1, 2)
    enough: float = 0.6
    cycles: int = 12
    remember: bool = True


SETTING = Setting()
FEWEST = 32  # vertices of a coarse level

# Of answers that are trusted. All were chosen on training material alone, solids of seeds 0 to 2 of
# evidence/solids.py and shapes of 2.0's training split: docs/real-shapes.md has what they do
# elsewhere. They are estimates, not bounds.
CERTIFIED = 5_000  # vertices up to which the certified solver takes no longer than a test would
COARSER = replace(SETTING, vectors=24, cycles=2, enough=0.0)  # below the finest level: is cheap
VECTORS, CYCLES = 16, 2  # on the finest level
COARSEST = 512  # vertices of a coarsest level that is solved: the next one may have too few
FLAT = 200  # largest diagonal entry of A, half the cotangents around a vertex: 3.5 if regular
RESIDUAL = 0.0025  # share of a value that a cycle may leave in its residual


@dataclass(frozen=True, slots=True)
class Level:
    """A and B on one pattern, and what leads here from the next coarser level.

    Parameters
    ----------
    pattern : tuple of ndarray, int32
        Start of each row, (n + 1,), and columns, the diagonal first.
    stiffness, mass : ndarray of shape (nnz,), float64
        Values of A (no unit) and B (length²).
    prolongation : tuple of ndarray
        P in CSR: starts, columns, values; ``None`` on the coarsest level.
    """

    pattern: tuple[np.ndarray, np.ndarray]
    stiffness: np.ndarray
    mass: np.ndarray
    prolongation: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None

    def __len__(self) -> int:
        """Return n."""
        return len(self.pattern[0]) - 1

    def diagonal(self) -> np.ndarray:
        """Return the diagonal of A."""
        return self.stiffness[self.pattern[0][:-1]]

    def dense(self) -> tuple[np.ndarray, np.ndarray]:
        """Return A and B as (n, n) arrays."""
        indptr, indices = self.pattern
        shape = (len(self), len(self))
        both = (sparse.csr_matrix((v, indices, indptr), shape) for v in (self.stiffness, self.mass))
        a, b = (matrix.toarray() for matrix in both)
        return a, b


def finest(mesh: Mesh) -> Level:
    """Return the finite element matrices of a mesh.

    Raises
    ------
    ValueError
        If a triangle has no area, or a vertex no triangle.
    """
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    indptr, indices, stiffness, mass, flat, unused = kernels.assemble(vertices, faces)
    if flat:
        raise ValueError(f"{flat} of {len(faces)} faces have no area: remove them first")
    if unused:
        raise ValueError(f"{unused} vertices belong to no triangle: remove them first")
    return Level((indptr, indices), stiffness, mass)


def coarsened(fine: Level, setting: Setting) -> tuple[Level, Level]:
    """Return a level with its prolongation, and the next coarser one."""
    of, count = kernels.aggregates(*fine.pattern, fine.stiffness, setting.strength)
    p = kernels.prolongation(*fine.pattern, fine.stiffness, of, setting.weight, setting.least)
    product = kernels.times_both(*fine.pattern, fine.stiffness, fine.mass, *p, count)
    *pattern, stiffness, mass = kernels.of_both(*kernels.transposed(*p, count), *product)
    return replace(fine, prolongation=p), Level(tuple(pattern), stiffness, mass)


def hierarchy(mesh: Mesh, setting: Setting = SETTING) -> list[Level]:
    """Return the levels, the finest first.

    Raises
    ------
    ValueError
        If the mesh has fewer than eleven vertices, a triangle no area, or a vertex no triangle.
    """
    if len(mesh.vertices) <= COUNT:
        raise ValueError(f"{COUNT} eigenvalues after zero need more than {COUNT} vertices")
    return descent(finest(mesh), setting)


def descent(fine: Level, setting: Setting = SETTING) -> list[Level]:
    """Return a level and all that are coarser."""
    levels = [fine]
    while len(levels[-1]) > setting.coarsest:
        fine, coarse = coarsened(levels[-1], setting)
        if not FEWEST <= len(coarse) < 0.9 * len(fine):
            break
        levels[-1:] = [fine, coarse]
    return levels


def cycle(
    levels: list[Level],
    right: np.ndarray,
    x: np.ndarray,
    inverse: Callable[[np.ndarray], np.ndarray],
    sweeps: tuple[int, int],
) -> None:
    """Improve x towards A x = right on the first of the levels, by one V-cycle."""
    level, *coarser = levels
    if not coarser:
        x[:] = inverse(right)
        return
    for _ in range(sweeps[0]):
        kernels.relax(*level.pattern, level.stiffness, right, x, True)
    defect = np.zeros((len(coarser[0]), x.shape[1]))
    kernels.restrict(*level.pattern, level.stiffness, right, x, *level.prolongation, defect)
    correction = np.zeros_like(defect)
    cycle(coarser, defect, correction, inverse, sweeps)
    kernels.prolong(*level.prolongation, correction, x)
    for _ in range(sweeps[1]):
        kernels.relax(*level.pattern, level.stiffness, right, x, False)


def ritz(stiffness: np.ndarray, gram: np.ndarray, m: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first m Ritz values of a basis, and its combinations that have them."""
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    sizes, directions = np.linalg.eigh(gram * scale * scale[:, None])
    kept = sizes > DEPENDENT * sizes[-1]
    frame = scale[:, None] * directions[:, kept] / np.sqrt(sizes[kept])
    values, turn = np.linalg.eigh(frame.T @ stiffness @ frame)
    return values[:m], frame @ turn[:, :m]


def bordered(matrix: np.ndarray, basis: list[np.ndarray], image: np.ndarray) -> np.ndarray:
    """Return a basis' matrix of products once its last block is there, with that one's image."""
    columns = np.concatenate([block.T @ image for block in basis])
    old = len(matrix)
    return np.block([[matrix, columns[:old]], [columns[:old].T, columns[old:]]])


def combined(basis: list[np.ndarray], weights: np.ndarray) -> np.ndarray:
    """Return the linear combinations of the blocks of a basis, by the columns of weights."""
    parts = np.split(weights, len(basis))
    return sum(block @ part for block, part in zip(basis, parts, strict=True))


def improved(
    levels: list[Level],
    values: np.ndarray,
    x: np.ndarray,
    inverse: Callable[[np.ndarray], np.ndarray],
    setting: Setting,
) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """Return better Ritz values on the first of the levels; a basis, and weights of the vectors."""
    wanted = slice(min(COUNT, x.shape[1]))
    cycles = enumerate(iterated(levels, values, x, inverse, setting), start=1)
    for number, (before, after, basis, turn) in cycles:
        fall = (before - after)[wanted] - setting.enough * after[wanted]
        if number == setting.cycles or fall.max() <= ZERO * after[-1]:
            return after, basis, turn
    raise ValueError("a level needs at least one cycle")


def iterated(
    levels: list[Level],
    values: np.ndarray,
    x: np.ndarray,
    inverse: Callable[[np.ndarray], np.ndarray],
    setting: Setting,
) -> Iterator[tuple[np.ndarray, np.ndarray, list[np.ndarray], np.ndarray]]:
    """Yield, after each cycle, the Ritz values before and after it, a basis, and weights.

    The basis is X, what last changed it, and the cycle's correction: three blocks, of which the
    products of the first two follow from those of the step before.
    """
    level, m = levels[0], x.shape[1]
    basis, stiffness, gram = [x], np.diag(values), np.eye(m)
    right, a_step, b_step = (np.empty_like(x) for _ in range(3))
    area = level.mass.sum()
    while True:
        kernels.multiply(*level.pattern, level.mass, basis[0], values, right)
        step = basis[0].copy()
        cycle(levels, right, step, inverse, setting.sweeps)
        step -= basis[0]
        kernels.multiply_both(*level.pattern, level.stiffness, level.mass, step, a_step, b_step)
        step -= b_step.sum(axis=0) / area  # so that its integral is zero
        basis.append(step)
        stiffness, gram = bordered(stiffness, basis, a_step), bordered(gram, basis, b_step)
        before = values
        values, turn = ritz(stiffness, gram, m)
        yield before, values, basis, turn
        change = np.vstack([np.zeros((m, m)), turn[m:]])
        both = np.hstack([turn, change]) if setting.remember else turn
        stiffness, gram = both.T @ stiffness @ both, both.T @ gram @ both
        moved = combined(basis[1:], turn[m:])
        basis = [basis[0] @ turn[:m] + moved] + [moved] * setting.remember


class Coarsest:
    """The problem of the coarsest level, solved.

    Parameters
    ----------
    level : Level
        Small enough for dense matrices.
    """

    def __init__(self, level: Level) -> None:
        self.values, self.vectors = linalg.eigh(*level.dense(), check_finite=False)
        self.good = self.values > ZERO * self.values[-1]
        self.frame = self.vectors[:, self.good]

    def inverse(self, right: np.ndarray) -> np.ndarray:
        """Return the solution of A x = right without a constant."""
        return self.frame @ ((self.frame.T @ right) / self.values[self.good, None])


def ascent(
    levels: list[Level], setting: Setting = SETTING, coarsest: Coarsest | None = None
) -> Iterator[tuple[np.ndarray, list[np.ndarray], np.ndarray]]:
    """Yield, level by level up to the finest, Ritz values, a basis, and weights of the vectors.

    Values are upper bounds of those after zero, in 1/length²; the vectors are the combinations of
    the basis.
    """
    coarsest = Coarsest(levels[-1]) if coarsest is None else coarsest
    every, vectors = coarsest.values, coarsest.vectors
    values, m = every[1:], len(every) - 1
    if len(levels) > 1:
        cuts = np.arange(setting.vectors - 2, setting.vectors + 3)
        m = cuts[np.argmax(values[cuts] / values[cuts - 1])]
    values, basis, turn = values[:m], [np.ascontiguousarray(vectors[:, 1 : m + 1])], np.eye(m)
    least = ZERO * every[-1]  # components make more zeros
    yield np.maximum(values, least), basis, turn
    for k in range(len(levels) - 2, -1, -1):
        x = prolonged(levels[k], combined(basis, turn))
        values, basis, turn = improved(levels[k:], values, x, coarsest.inverse, setting)
        yield np.maximum(values, least), basis, turn


def prolonged(level: Level, vectors: np.ndarray) -> np.ndarray:
    """Return vectors of the next coarser level on this one."""
    x = np.zeros((len(level), vectors.shape[1]))
    kernels.prolong(*level.prolongation, vectors, x)
    return x


def ritz_values(mesh: Mesh, setting: Setting = SETTING) -> np.ndarray:
    """Return upper bounds of the first ten eigenvalues after zero, in 1/length².

    Raises
    ------
    ValueError
        If the mesh has fewer than eleven vertices, a triangle no area, or a vertex no triangle.
    """
    *_, (values, _, _) = ascent(hierarchy(mesh, setting), setting)
    return values[:COUNT]


def trusted(mesh: Mesh) -> np.ndarray | None:
    r"""Return Ritz values that look near enough to the first ten eigenvalues, or None.

    There is no answer where a triangle is so flat that a function constant on an aggregate may have
    most of its energy there, and none where the hierarchy looks bad: several components, or a
    coarsest level that did not get small. On the finest level there are one or two cycles, until
    with the diagonal D of A

    .. math:: r^T D^{-1} r \leq \text{RESIDUAL} \cdot \theta, \qquad r = A u - \theta B u

    for every wanted pair (θ, u), u of norm 1: what smoothing could still take away.

    Parameters
    ----------
    mesh : Mesh
        Of more vertices than a coarsest level has.

    Returns
    -------
    ndarray of shape (10,), float64, or None
        In 1/length², ascending.

    Raises
    ------
    ValueError
        If a triangle has no area, or a vertex no triangle.
    """
    fine = finest(mesh)
    if fine.diagonal().max() > FLAT:
        return None
    fine, *_ = levels = descent(fine)
    if len(levels[-1]) > COARSEST:
        return None
    coarsest = Coarsest(levels[-1])
    if np.count_nonzero(~coarsest.good) > 1:
        return None
    *_, (values, basis, turn) = ascent(levels[1:], COARSER, coarsest)
    x = prolonged(fine, combined(basis, turn[:, :VECTORS]))
    cycles = iterated(levels, values[:VECTORS], x, coarsest.inverse, SETTING)
    for _, values, basis, turn in islice(cycles, CYCLES):
        if residual(fine, values[:COUNT], combined(basis, turn[:, :COUNT])) <= RESIDUAL:
            return values[:COUNT]
    return None


def residual(level: Level, values: np.ndarray, vectors: np.ndarray) -> float:
    """Return the largest of the residuals of Ritz pairs, in the norm of D⁻¹, as share of θ."""
    stiff, weighted = np.empty_like(vectors), np.empty_like(vectors)
    kernels.multiply_both(*level.pattern, level.stiffness, level.mass, vectors, stiff, weighted)
    squares = (stiff - weighted * values) ** 2 / level.diagonal()[:, None]
    return float((squares.sum(axis=0) / values).max())


def eigenvalues(mesh: Mesh) -> tuple[np.ndarray, bool]:
    """Return the first ten eigenvalues after zero, and whether the certified solver has them.

    Raises
    ------
    ValueError, SpectrumError
        As :func:`synthnet.spectrum.compute`.
    """
    if len(mesh.vertices) > CERTIFIED:
        values = trusted(mesh)
        if values is not None:
            return values, False
    return spectrum.compute(mesh).eigenvalues, True


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues, shape (B, 10)."""
    return np.array([eigenvalues(mesh)[0] for mesh in meshes])
