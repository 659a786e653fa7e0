r"""What rounding did to eigenvalues: the same eigenfunctions, triangle by triangle.

On thin triangles the entries of the stiffness matrix are many times larger than the energies that
they add up to, and so are their rounding errors; a residual, which is computed with that matrix,
cannot show it. The energy of a function on a triangle of edges u, v from one corner, over which it
changes by p and q, needs no such sum:

.. math:: \int_T |\nabla f|^2 = \frac{|p v - q u|^2}{4 |T|},

with a relative error of a few rounding units over the sine of the angle between u and v, the
largest of the triangle. Rayleigh quotients of these energies are exact to the square of the errors
of the eigenfunctions; their distance to the eigenvalues of the matrices is what rounding has done.

Of other elements only the matrices are looked at. The part of an element in A is off by a relative
error, that of its area, and each entry by rounding units of its trace.

References
----------
R.-C. Li, "Matrix perturbation theory" in "Handbook of Linear Algebra" (2006), 15.2, and C.-K. Li,
R.-C. Li, "A note on eigenvalues of perturbed Hermitian matrices", Linear Algebra Appl. 395 (2005):
the error of Ritz values is quadratic in the residual. N. J. Higham, "Accuracy and Stability of
Numerical Algorithms" (2002), chapter 3.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.linalg import lapack

from synthnet.arrays import Floats, Int32s
from synthnet.kernels import kernel, uncounted
from synthnet.spectrum.certificate import Candidate
from synthnet.spectrum.components import unheld
from synthnet.spectrum.fem import FEW, PIECE, Matrices, as_arrays, multiply, pieces
from synthnet.spectrum.operators import Discrete
from synthnet.types import Mesh

UNIT = float(np.finfo(np.float64).eps)
BLOCK = 64  # functions, of many: the products of all pairs would take longer than the solver
# Rounding units in the energy of a triangle, over the sine of its largest angle. In halves of one,
# the slope's first component has 19, the second 6 and the area 7, so the energy at most 47.
OPERATIONS = 24
# Rounding units in an entry of an element's matrices: a sum of 18 products, and of a few elements
ENTRIES = 64
HOPELESS = 0.1  # relative: where areas are off by more, nothing can be said to first order
ALONE = 8  # how many times less than defects of single functions what their mixing adds may be
KEPT = 1e-6  # of an eigenvalue: the largest bound with which eigh's answer is kept; import's limit


def sharpened(
    mesh: Mesh,
    discrete: Discrete,
    candidate: Candidate,
    numbers: Int32s,
    share: float = 1.0,
    *,
    with_vectors: bool = False,
) -> tuple[Floats, Floats, Floats | None]:
    r"""Return Ritz pairs of element energies, and how far each is from an exact eigenvalue at most.

    With the defects :math:`r_j = A\varphi_j - \rho_j B\varphi_j` of B-orthonormal Ritz vectors, all
    other eigenvalues above σ, M the lumped mass, :math:`B \geq cM` and
    :math:`\eta_j^2 = r_j^T M^{-1} r_j / c`,

    .. math:: |\lambda_i - \rho_i| \leq \frac{\sum_j \eta_j^2}{\sigma - \rho_i} ,

    and not more than the root of the sum. Rounding in the energies themselves is added. Where that
    reaches across the gap, nothing says any more that the others are above it, and there is no
    bound. Many vectors are taken in blocks; then the sum is over a block, the distance that to the
    other blocks and to σ, and the root that of the sum over all.

    If a bound is then over a millionth of its eigenvalue, all is computed anew in one block and
    with the slower solver that loses no small eigenvalue beside a large one.

    Parameters
    ----------
    mesh : Mesh
        Of n vertices.
    discrete : synthnet.spectrum.Discrete
        Its linear elements.
    candidate : Candidate
        All eigenvalues between zero and its gap, and the vectors of the first c.
    numbers : ndarray of shape (m,), int32
        The component of each row.
    share : float
        Of the consistent mass in B; the rest is lumped.
    with_vectors : bool
        Whether the vectors are wanted, too.

    Returns
    -------
    values : ndarray of shape (c,), float64
        In 1/length², ascending.
    bounds : ndarray of shape (c,), float64
        In 1/length²; infinite if there is none.
    vectors : ndarray of shape (n, c), float64, or None
        B-orthonormal columns; in blocks, each within its own.
    """
    vertices, faces = as_arrays(mesh)

    def energies(rows: Floats) -> _Energies:
        return _of_triangles(vertices, faces, rows, discrete, numbers, share)

    values, bounds, vectors = _ritz_pairs(energies, discrete, candidate, with_vectors)
    if not (bounds <= KEPT * values).all():
        with suppress(linalg.LinAlgError):  # what is there is kept, with its bounds
            return _ritz_pairs(energies, discrete, candidate, with_vectors, graded=True)
    return values, bounds, vectors


def of_matrices(discrete: Discrete, candidate: Candidate, numbers: Int32s) -> tuple[Floats, Floats]:
    """Return Ritz values of the matrices of other than linear elements, and how far off they are.

    As :func:`sharpened`, but energies are those of the matrices. Their own rounding is added to the
    bounds, to first order: that of an area relative to the element's energy, that of each entry
    relative to the traces of the elements around. Where curved patches lie is taken as it was
    computed, and so are the matrices of the tufted cover.
    """

    def energies(rows: Floats) -> _Energies:
        return _of_entries(rows, discrete, numbers)

    values, bounds, _ = _ritz_pairs(energies, discrete, candidate, with_vectors=False)
    if ENTRIES * UNIT * discrete.condition > HOPELESS:
        bounds[:] = np.inf
    return values, bounds


class _Energies(NamedTuple):
    """What an operator makes of functions.

    Attributes
    ----------
    functions : ndarray of shape (n, c), float64
        At all vertices, or if only their values are wanted, those that are free.
    stiff, weighted : ndarray of shape (m, c), float64
        A f and B f, at the unknowns that are free.
    gram, heavy : ndarray of shape (c, c), float64
        FᵀAF and FᵀBF.
    rough : ndarray of shape (2, c), float64
        To what their rounding errors are relative.
    """

    functions: Floats
    stiff: Floats
    weighted: Floats
    gram: Floats
    heavy: Floats
    rough: Floats


def _ritz_pairs(
    energies: Callable[[Floats], _Energies],
    discrete: Discrete,
    candidate: Candidate,
    with_vectors: bool,
    *,
    graded: bool = False,
) -> tuple[Floats, Floats, Floats | None]:
    """Return what :func:`sharpened` does, by one of the two solvers."""
    count = len(candidate.vectors)
    above = candidate.middle if count == len(candidate.values) else candidate.values[count]
    size = BLOCK if count > 2 * BLOCK and not graded else count
    blocks = [
        _ritz(energies(candidate.vectors[first : first + size]), discrete, with_vectors, graded)
        for first in range(0, count, size)
    ]
    total = float(sum(block.squares for block in blocks))
    values = np.concatenate([block.values for block in blocks])
    bounds = np.concatenate([_bounds(i, blocks, above, total) for i in range(len(blocks))])
    if not candidate.values[-1] + bounds.max() < candidate.gap[1]:
        bounds[:] = np.inf
    order = np.argsort(values, kind="stable")
    vectors = None
    if with_vectors:
        vectors = np.concatenate([block.vectors for block in blocks], axis=1)[:, order]
    return values[order], bounds[order], vectors


class _Block(NamedTuple):
    """Ritz pairs of some functions: the sum of their η², and the rounding of each."""

    values: Floats
    vectors: Floats | None
    squares: float
    rounding: Floats


def _ritz(energies: _Energies, discrete: Discrete, with_vectors: bool, graded: bool) -> _Block:
    """Return the Ritz pairs of functions by their energies."""
    functions, stiff, weighted, gram, heavy, rough = energies
    values, turn = (_graded if graded else linalg.eigh)(gram, heavy)
    squares = _squares(discrete.matrices, stiff, weighted, values, turn, heavy)
    # Of a sum of functions the root is at most the sum of roots (Minkowski)
    energy, mass = (np.square(np.abs(turn).T @ np.sqrt(part)) for part in rough)
    scale = values if graded else values[-1]  # to which the solver's own rounding is relative
    rounding = OPERATIONS * UNIT * (energy + values * mass + scale)
    return _Block(values, functions @ turn if with_vectors else None, squares, rounding)


def _of_triangles(
    vertices: Floats,
    faces: Int32s,
    rows: Floats,
    discrete: Discrete,
    numbers: Int32s,
    share: float,
) -> _Energies:
    """Return energies of functions, rows of unknowns that are free, triangle by triangle."""
    functions = np.array(discrete.at_vertices(rows).T, order="C")
    there = slice(None) if discrete.free is None else discrete.free
    functions[there] -= _means(rows, discrete.matrices, numbers)
    count = functions.shape[1]
    stiff, weighted = np.zeros_like(functions), np.zeros_like(functions)
    gram, heavy, rough = np.zeros((count, count)), np.zeros((count, count)), np.zeros((2, count))
    slopes = np.empty((PIECE, 2, count))
    for part in pieces(len(faces)):
        chunk = faces[part]
        _apply(vertices, chunk, functions, stiff, weighted, slopes, rough)
        flat = slopes[: len(chunk)].reshape(-1, count)
        gram += flat.T @ flat
    kept, stiff, weighted = functions[there], stiff[there], weighted[there]
    if share < 1:  # the lumped mass of the matrices has areas that thin triangles round further off
        areas = _areas(vertices, faces)[there]
        weighted = share * weighted + (1 - share) * areas[:, None] * kept
        rough[1] *= share + 4 * (1 - share)  # on a triangle, M is at most 4 times B
    for part in pieces(len(kept)):
        heavy += kept[part].T @ weighted[part]
    return _Energies(functions, stiff, weighted, gram, heavy, rough)


def _of_entries(rows: Floats, discrete: Discrete, numbers: Int32s) -> _Energies:
    """Return energies of functions, rows of unknowns that are free, by the matrices."""
    matrices = discrete.matrices
    kept = rows - _means(rows, matrices, numbers).T
    stiff = multiply(matrices, matrices.stiffness, kept)
    weighted = multiply(matrices, matrices.mass, kept)
    gram, heavy = kept @ stiff.T, kept @ weighted.T
    squares, times = np.square(kept), ENTRIES / OPERATIONS
    energy = np.maximum(np.diag(gram), 0.0)
    rough = times * np.stack(
        [
            discrete.condition * energy + squares @ discrete.entries,
            discrete.condition * (squares @ matrices.lumped),
        ]
    )
    symmetric = ((gram + gram.T) / 2, (heavy + heavy.T) / 2)
    return _Energies(kept.T, stiff.T, weighted.T, *symmetric, rough)


def _graded(gram: Floats, heavy: Floats) -> tuple[Floats, Floats]:
    r"""Solve G x = λ H x, each eigenvalue to a relative error of rounding, by Jacobi's rotations.

    ``eigh`` leaves an absolute error, a rounding unit of the largest eigenvalue, in which small
    ones are lost. Of functions that are nearly eigenfunctions, :math:`G = D \hat{G} D` with D
    diagonal and :math:`\hat{G}` of ones and little else. With Cholesky factors
    :math:`\hat{G} = R^T R` and :math:`H = L L^T`, an eigenvalue is the square of a singular value
    of :math:`R D L^{-T}`. That is a well-conditioned matrix times D, of which one-sided Jacobi
    rotations find every singular value to a relative error of rounding.

    Raises
    ------
    LinAlgError
        If a matrix is not positive definite, or the rotations do not converge.
    """
    size = np.sqrt(np.diag(gram))
    if not size.all():
        raise linalg.LinAlgError("a function has no energy")
    root = linalg.cholesky(gram / size / size[:, None])
    low = linalg.cholesky(heavy, lower=True)
    factor = linalg.solve_triangular(low, (root * size).T, lower=True).T
    # "C": columns of very different length; "N", "V": right vectors alone; "N": none is dropped
    found, _, turn, work, _, info = lapack.dgejsv(
        factor, joba=0, jobu=3, jobv=0, jobr=0, jobt=0, jobp=0
    )
    if info != 0:
        raise linalg.LinAlgError(f"dgejsv returned {info}")
    values = np.square(found[::-1] * (work[0] / work[1]))
    return values, linalg.solve_triangular(low, turn[:, ::-1], trans="T", lower=True)


def _squares(
    matrices: Matrices, stiff: Floats, weighted: Floats, values: Floats, turn: Floats, heavy: Floats
) -> float:
    r"""Return an upper bound of the sum of η² of the Ritz pairs F T of functions F.

    With :math:`H = T \Lambda T^{-1}` their defects are :math:`(A F - B F H) T`. F is nearly what it
    becomes, so that H is nearly a diagonal matrix D, and no product of long matrices is needed:
    B ≤ M, so the norm of :math:`M^{-1/2} B F (H - D)` is at most that in B of :math:`F (H - D)`.
    """
    whole = (turn * values) @ (turn.T @ heavy)
    diagonal = np.diag(whole).copy()
    off = whole - np.diag(diagonal)
    alone = _norm(stiff, weighted, diagonal, matrices)
    mixed = float(np.sqrt(max(0.0, np.sum(off * (heavy @ off)))))
    if ALONE * mixed > alone:  # the functions are no Ritz vectors yet
        return _norm(stiff, weighted, values, matrices, turn) ** 2 / matrices.least
    # The norm of T, squared, is 1 over the least eigenvalue of FᵀBF, for which Gershgorin's theorem
    # has a bound: near 1
    smallest = float((2 * np.diag(heavy) - np.abs(heavy).sum(axis=1)).min())
    return (alone + mixed) ** 2 / (smallest * matrices.least) if smallest > 0 else np.inf


def _norm(
    stiff: Floats, weighted: Floats, values: Floats, matrices: Matrices, turn: Floats | None = None
) -> float:
    """Return the norm of A f − λ B f over all functions, columns, in that of M⁻¹.

    With ``turn``, the functions are these combinations of the columns.
    """
    inverse, total = 1 / matrices.lumped, 0.0
    for part in pieces(len(stiff)):
        defects, moved = stiff[part], weighted[part]
        if turn is not None:
            defects, moved = defects @ turn, moved @ turn
        defects = defects - moved * values
        total += float(inverse[part] @ np.einsum("ij,ij->i", defects, defects))
    return float(np.sqrt(total))


def _bounds(number: int, blocks: list[_Block], above: float, total: float) -> Floats:
    """Return how far each value of a block is from an exact eigenvalue at most."""
    block = blocks[number]
    apart = above - block.values
    if len(blocks) > 1:
        others = np.concatenate([other.values for other in blocks if other is not block])
        nearest = np.abs(block.values[:, None] - np.sort(others)).min(axis=1)
        # The eigenvalues of what is orthogonal to the block are its neighbours' values, moved by
        # at most the norms of both residuals, once for each value of the block between (Weyl)
        moved = (len(block.values) + 1) * (np.sqrt(total) + np.sqrt(block.squares))
        apart = np.minimum(apart, nearest - moved)
    with np.errstate(divide="ignore", invalid="ignore"):
        missed = np.where(apart > 0, block.squares / apart, np.inf)
    return np.asarray(np.minimum(missed, np.sqrt(total)) + block.rounding)


def _means(vectors: Floats, matrices: Matrices, numbers: Int32s) -> Floats:
    """Return the means of vectors (c, m) on each row's component, (m, c) or (1, c); 0 where held.

    What rounding left of a constant in an eigenfunction adds to its norm and not to its energy, so
    a Ritz value would be too low, and not only by the square: zero is below the gap, too.
    """
    lumped, with_zero = matrices.lumped, unheld(matrices, numbers)
    if len(with_zero) == 1 and len(vectors) > FEW:  # as below, for one component
        return np.where(with_zero, vectors @ lumped / lumped.sum(), 0.0)[None]
    sizes = np.bincount(numbers, lumped)
    means = np.stack([np.bincount(numbers, lumped * vector) / sizes for vector in vectors])
    means = np.where(with_zero, means, 0.0)
    return means.T if len(with_zero) == 1 else means.T[numbers]


@kernel
def _apply(
    vertices: Floats,
    faces: Int32s,
    functions: Floats,
    stiff: Floats,
    weighted: Floats,
    slopes: Floats,
    rough: Floats,
) -> None:
    """Add A f and B f of every function to ``stiff`` and ``weighted``, triangle by triangle.

    ``slopes``, of shape (m, 2, c), is filled with f's slope on each of m triangles, two numbers in
    its plane, so that fᵀ A g is the sum of products of these. The rows of ``rough``, (2, c), add up
    fᵀ A f and fᵀ B f over the sine of each triangle's largest angle.
    """
    # Slices of these are not counted as references: each is for a loop over a few functions
    functions, stiff, weighted = uncounted(functions), uncounted(stiff), uncounted(weighted)
    slopes, rough = uncounted(slopes), uncounted(rough)
    u, v = np.empty(3), np.empty(3)
    for t in range(faces.shape[0]):
        a = _widest(vertices, faces, t)
        i, j, k = faces[t, a], faces[t, (a + 1) % 3], faces[t, (a + 2) % 3]
        uu = 0.0
        uv = 0.0
        vv = 0.0
        for x in range(3):
            u[x] = vertices[j, x] - vertices[i, x]
            v[x] = vertices[k, x] - vertices[i, x]
            uu += u[x] * u[x]
            uv += u[x] * v[x]
            vv += v[x] * v[x]
        nx = u[1] * v[2] - u[2] * v[1]
        ny = u[2] * v[0] - u[0] * v[2]
        nz = u[0] * v[1] - u[1] * v[0]
        doubled = np.sqrt(nx * nx + ny * ny + nz * nz)  # the area, twice
        sine = doubled / np.sqrt(uu * vv)
        # In the plane, u = (along, 0) and v = (beside, aside), scaled to the triangle's energy
        along = np.sqrt(uu / (2 * doubled))
        beside = uv / np.sqrt(2 * doubled * uu)
        aside = np.sqrt(doubled / (2 * uu))
        fi, fj, fk = functions[i], functions[j], functions[k]
        first, second = slopes[t, 0], slopes[t, 1]
        _slope(fi, fj, fk, beside, along, aside, first, second)
        _add(stiff[j], first, beside, second, aside)
        _add(stiff[k], first, -along, second, 0.0)
        _add(stiff[i], first, along - beside, second, -aside)
        _add_squares(rough[0], first, second, 1 / sine)
        _add_mass(weighted[i], fi, fj, fk, doubled / 24)
        _add_mass(weighted[j], fj, fk, fi, doubled / 24)
        _add_mass(weighted[k], fk, fi, fj, doubled / 24)
        _add_mass_squares(rough[1], fi, fj, fk, doubled / (24 * sine))


@kernel
def _areas(vertices: Floats, faces: Int32s) -> Floats:
    """Return a third of the area around each vertex, by edges at each triangle's largest angle."""
    areas = np.zeros(vertices.shape[0])
    u, v = np.empty(3), np.empty(3)
    for t in range(faces.shape[0]):
        a = _widest(vertices, faces, t)
        i, j, k = faces[t, a], faces[t, (a + 1) % 3], faces[t, (a + 2) % 3]
        for x in range(3):
            u[x] = vertices[j, x] - vertices[i, x]
            v[x] = vertices[k, x] - vertices[i, x]
        nx = u[1] * v[2] - u[2] * v[1]
        ny = u[2] * v[0] - u[0] * v[2]
        nz = u[0] * v[1] - u[1] * v[0]
        area = np.sqrt(nx * nx + ny * ny + nz * nz) / 6
        areas[i] += area
        areas[j] += area
        areas[k] += area
    return areas


@kernel
def _slope(
    at_i: Floats,
    at_j: Floats,
    at_k: Floats,
    beside: float,
    along: float,
    aside: float,
    first: Floats,
    second: Floats,
) -> None:
    """Set the two components of the slopes of functions by their values at the corners."""
    for c in range(at_i.shape[0]):
        p = at_j[c] - at_i[c]
        q = at_k[c] - at_i[c]
        first[c] = p * beside - q * along
        second[c] = p * aside


@kernel
def _add(y: Floats, first: Floats, a: float, second: Floats, b: float) -> None:
    """Add a combination of two vectors: y += a first + b second."""
    for c in range(y.shape[0]):
        y[c] += a * first[c] + b * second[c]


@kernel
def _add_squares(y: Floats, first: Floats, second: Floats, factor: float) -> None:
    """Add a multiple of the squares of two vectors."""
    for c in range(y.shape[0]):
        y[c] += factor * (first[c] * first[c] + second[c] * second[c])


@kernel
def _add_mass(y: Floats, here: Floats, second: Floats, third: Floats, share: float) -> None:
    """Add a triangle's part of B f at one of its corners."""
    for c in range(y.shape[0]):
        y[c] += share * (2 * here[c] + second[c] + third[c])


@kernel
def _add_mass_squares(y: Floats, fi: Floats, fj: Floats, fk: Floats, share: float) -> None:
    """Add a triangle's part of fᵀ B f."""
    for c in range(y.shape[0]):
        p, q, r = fi[c], fj[c], fk[c]
        total = p + q + r
        y[c] += share * (total * total + p * p + q * q + r * r)


@kernel
def _widest(vertices: Floats, faces: Int32s, t: int) -> int:
    """Return the corner opposite to the longest edge of a triangle."""
    widest = 0
    longest = -1.0
    for a in range(3):
        square = 0.0
        for x in range(3):
            edge = vertices[faces[t, (a + 1) % 3], x] - vertices[faces[t, (a + 2) % 3], x]
            square += edge * edge
        if square > longest:
            longest = square
            widest = a
    return widest
