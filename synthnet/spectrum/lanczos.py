r"""Block Lanczos with two vectors a step for :math:`(A - \sigma B)^{-1} B`.

The operator is self-adjoint in the inner product of B; its eigenvalue θ belongs to
:math:`\lambda = \sigma + 1/\theta`. The constant function, whose λ is zero where nothing is held
at zero, is the first vector of the basis, so the search never returns it.

References
----------
R. G. Grimes, J. G. Lewis, H. D. Simon, "A shifted block Lanczos algorithm for solving sparse
symmetric generalized eigenproblems", SIAM J. Matrix Anal. Appl. 15 (1994). H. D. Simon, "The
Lanczos algorithm with partial reorthogonalization", Math. Comp. 42 (1984).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import linalg

from synthnet.arrays import Floats, Int32s
from synthnet.kernels import kernel
from synthnet.spectrum.fem import Matrices, multiply, multiply_two
from synthnet.spectrum.ldl import Factor
from synthnet.spectrum.ordering import Ordering
from synthnet.spectrum.substitution import solve_pair, solve_two
from synthnet.spectrum.vectors import dot_four, subtract_four

LOST = 1e-8  # relative; eigenvalues are as good as from a basis orthogonal to 1e-16 (Simon)
FAR = 100  # times as much: one step less without a correction would not be enough


@dataclass(frozen=True, slots=True)
class RitzPairs:
    """Approximations of the eigenpairs around the shift, by ascending eigenvalue.

    Parameters
    ----------
    values : ndarray of shape (m,), float64
        The eigenvalues, the zero of the constant function left out.
    errors : ndarray of shape (m,), float64
        First-order bounds of their distance to an eigenvalue.
    inside, outside : ndarray, float64
        The eigenvectors, as columns, in the basis without its newest two vectors, and what
        the operator adds to them in the direction of these.
    """

    values: Floats
    errors: Floats
    inside: Floats
    outside: Floats

    def above(self, low: float) -> RitzPairs:
        """Return those above a value."""
        first = int(np.searchsorted(self.values, low))
        return RitzPairs(
            self.values[first:],
            self.errors[first:],
            self.inside[:, first:],
            self.outside[:, first:],
        )


class _Basis(NamedTuple):
    """A basis as kernels take it: B; the vectors, and their products with B and the operator."""

    indptr: Int32s
    indices: Int32s
    mass: Floats
    vectors: Floats
    weighted: Floats
    projected: Floats
    first: int
    lean: bool


class Lanczos:
    """A growing basis for the eigenvectors around σ.

    Parameters
    ----------
    matrices : Matrices
        A and B.
    ordering : Ordering
        The order of elimination for their pattern.
    factor : Factor
        The factorisation of A − σB.
    sigma : float
        The shift.
    limit : int
        Most vectors in the basis: at least the zeros and two.
    known : ndarray of shape (m, n), float64
        B-orthonormal eigenvectors; the basis stays orthogonal to them and finds others.
    strict : bool
        Whether to make every vector orthogonal to all before it, instead of two of four
        until a loss is seen.
    lean : bool
        Whether to keep the basis alone, and of its products with B those of the newest two. Two
        more products a step take less time than reading a second long basis.
    seed : int
        Seed of the two vectors to start from.
    """

    def __init__(
        self,
        matrices: Matrices,
        ordering: Ordering,
        factor: Factor,
        sigma: float,
        *,
        limit: int,
        known: Floats,
        strict: bool = False,
        lean: bool = False,
        seed: int = 0,
    ) -> None:
        n = len(matrices.lumped)
        zeros = matrices.zeros
        self.first = first = zeros + len(known)  # the basis proper begins here
        self.matrices, self.ordering, self.factor, self.sigma = matrices, ordering, factor, sigma
        self.lean, self.limit = lean, limit + len(known)
        self.skipped = 0 if strict else 2  # steps after each two that are orthogonal to all
        self.size = first + 2
        self.basis = np.empty((self.size, n))
        self.weighted = np.empty((2 if lean else self.size, n))  # B times the basis
        self.projected = np.zeros((self.size, self.size))
        area = matrices.lumped.sum()
        self.basis[:zeros] = 1 / np.sqrt(area)
        self.basis[zeros:first] = known
        if not lean:
            self.weighted[:zeros] = matrices.lumped / np.sqrt(area)
            self.weighted[zeros:first] = multiply(matrices, matrices.mass, known)
        self.basis[first:] = np.random.default_rng(seed).random((2, n)) - 0.5
        _start(self._grown())

    def extend(self, steps: int) -> bool:
        """Add two vectors a step; return whether there was room for all of them."""
        steps = max(0, min(steps, (self.limit - self.size) // 2))
        self._make_room(self.size + 2 * steps)
        grown = self._grown()
        if self.ordering.whole:
            factors = self.factor.pivots, self.factor.panels
            self.skipped = _extend(self.ordering, *factors, grown, self.size, steps, self.skipped)
            self.size += 2 * steps
        else:
            for _ in range(steps):
                solve_pair(self.factor, self.ordering, _newest(grown, self.size))
                self.skipped = _append(grown, self.size, self.skipped)
                self.size += 2
        return self.size + 2 <= self.limit

    def _make_room(self, size: int) -> None:
        """Make the arrays long enough for so many vectors, and for half as many more.

        Arrays for as many vectors as the limit allows would be too long for memory to be kept
        from one solve to the next, see :func:`synthnet.processes.keep_freed_memory`.
        """
        if size <= len(self.basis):
            return
        rows, columns = min(self.limit, size + size // 2), self.basis.shape[1]
        self.basis = _longer(np.empty((rows, columns)), self.basis)
        if not self.lean:
            self.weighted = _longer(np.empty((rows, columns)), self.weighted)
        self.projected = _longer(np.zeros((rows, rows)), self.projected)

    def _grown(self) -> _Basis:
        b = self.matrices.indptr, self.matrices.indices, self.matrices.mass
        arrays = self.basis, self.weighted, self.projected
        return _Basis(*b, *arrays, self.first, self.lean)

    def ritz(self) -> RitzPairs:
        """Return the eigenpairs of the projected operator that may be positive eigenvalues."""
        first, last = self.first, self.size - 2  # the newest two only measure the error
        bands = np.zeros((3, last - first))
        for band in range(3):
            bands[band, : last - first - band] = np.diagonal(
                self.projected[first:last, first:last], band
            )
        thetas, vectors = linalg.eig_banded(bands, lower=True, check_finite=False)
        values = self.sigma + 1 / thetas
        order = np.argsort(values)
        order = order[values[order] > -1e-9 * abs(self.sigma)]
        thetas, vectors, values = thetas[order], vectors[:, order], values[order]
        outside = self.projected[last : self.size, last - 2 : last] @ vectors[-2:]
        errors = np.hypot(outside[0], outside[1]) * (values - self.sigma) ** 2
        inside: Floats = np.multiply(vectors, thetas)
        return RitzPairs(values, errors, inside, outside)

    def vectors(self, pairs: RitzPairs, count: int) -> tuple[Floats, Floats]:
        """Return the first eigenvectors as rows of shape (count, n), and their products with B.

        They are the Ritz vectors after one more product with the operator, which costs nothing and
        damps their errors.
        """
        weights = np.concatenate([pairs.inside[:, :count], pairs.outside[:, :count]]).T
        used = slice(self.first, self.size)
        vectors = weights @ self.basis[used]
        if self.lean:
            return vectors, multiply(self.matrices, self.matrices.mass, vectors)
        return vectors, weights @ self.weighted[used]


def _longer(longer: Floats, array: Floats) -> Floats:
    """Return the longer array, which begins with the other one now."""
    longer[: array.shape[0], : array.shape[1]] = array
    return longer


@kernel
def _start(basis: _Basis) -> None:
    """Make the first two vectors orthogonal to those that are known."""
    coefficients = np.empty((2, basis.first))
    new, product, left, right = _two(basis, basis.first)
    for _ in range(2):
        if basis.lean:
            multiply_two(basis.indptr, basis.indices, basis.mass, new, product)
        _project(basis.vectors, left, right, new, 0, basis.first, coefficients)
    multiply_two(basis.indptr, basis.indices, basis.mass, new, product)
    _orthonormalise(new, product)


@kernel
def _two(basis: _Basis, m: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the two rows after m vectors, those for B times them, and what to project by."""
    new = basis.vectors[m : m + 2]
    if basis.lean:
        return new, basis.weighted[:2], basis.vectors, basis.weighted[:2]
    return new, basis.weighted[m : m + 2], basis.weighted, new


@kernel
def _extend(
    ordering: Ordering,
    pivots: Floats,
    panels: Floats,
    basis: _Basis,
    size: int,
    steps: int,
    skipped: int,
) -> int:
    """Add two vectors a step; return how many steps are now skipped after each two."""
    for m in range(size, size + 2 * steps, 2):
        solve_two(ordering, pivots, panels, _newest(basis, m))
        skipped = _append(basis, m, skipped)
    return skipped


@kernel
def _newest(basis: _Basis, m: int) -> Floats:
    """Return the two rows after a basis of m vectors, filled with B times the two before."""
    new = basis.vectors[m : m + 2]
    new[:] = basis.weighted[:2] if basis.lean else basis.weighted[m - 2 : m]
    return new


@kernel
def _append(basis: _Basis, m: int, skipped: int) -> int:
    """Make the two solutions that follow a basis of m vectors part of it.

    The sub-blocks of ``projected`` are those of the block tridiagonal matrix. Returns how many
    steps are now skipped after each two.
    """
    vectors, projected = basis.vectors, basis.projected
    coefficients = np.empty((2, vectors.shape[0]))
    new, product, left, right = _two(basis, m)
    near = max(m - 4, 0)
    if basis.lean:
        multiply_two(basis.indptr, basis.indices, basis.mass, new, product)
    _project(vectors, left, right, new, near, m, coefficients)
    for i in range(2):
        for j in range(2):
            projected[m - 2 + i, m - 2 + j] = coefficients[j, m - 2 + i - near]
    off = 0.5 * (projected[m - 2, m - 1] + projected[m - 1, m - 2])
    projected[m - 2, m - 1] = projected[m - 1, m - 2] = off
    # What is left of earlier vectors by rounding: all of them in two steps of four, at first.
    lost = 0.0
    if basis.lean:
        multiply_two(basis.indptr, basis.indices, basis.mass, new, product)
    if m < basis.first + 8 or (m // 2) % (2 + skipped) < 2:
        _project(vectors, left, right, new, 0, m, coefficients)
        for i in range(2):
            for j in range(near):
                lost = max(lost, abs(coefficients[i, j]))
    else:
        _project(vectors, left, right, new, near, m, coefficients)
        _project(vectors, left, right, new, 0, basis.first, coefficients)
    multiply_two(basis.indptr, basis.indices, basis.mass, new, product)
    r, s, t = _orthonormalise(new, product)
    projected[m, m - 2] = projected[m - 2, m] = r
    projected[m, m - 1] = projected[m - 1, m] = s
    projected[m + 1, m - 1] = projected[m - 1, m + 1] = t
    lost /= max(r, t)
    if lost > LOST:
        skipped = skipped // 2 if basis.lean and lost < FAR * LOST else 0
    return skipped


@kernel
def _project(
    basis: Floats,
    left: Floats,
    right: Floats,
    new: Floats,
    low: int,
    high: int,
    coefficients: Floats,
) -> None:
    """Make two vectors B-orthogonal to the basis from ``low`` to ``high``.

    The products of the two with the basis are those of ``left`` and ``right``: B times the basis
    and the two, or the basis and B times the two.
    """
    y, z = right[0], right[1]
    k = low
    while k + 4 <= high:
        a, b = dot_four(y, z, left[k], left[k + 1], left[k + 2], left[k + 3])
        for i in range(4):
            coefficients[0, k - low + i] = a[i]
            coefficients[1, k - low + i] = b[i]
        k += 4
    while k < high:
        coefficients[0, k - low] = _dot(y, left[k])
        coefficients[1, k - low] = _dot(z, left[k])
        k += 1
    y, z = new[0], new[1]
    k = low
    while k + 4 <= high:
        a0, a1, a2, a3 = coefficients[0, k - low : k - low + 4]
        b0, b1, b2, b3 = coefficients[1, k - low : k - low + 4]
        x0, x1, x2, x3 = basis[k], basis[k + 1], basis[k + 2], basis[k + 3]
        subtract_four(y, z, x0, x1, x2, x3, (a0, a1, a2, a3), (b0, b1, b2, b3))
        k += 4
    while k < high:
        y -= coefficients[0, k - low] * basis[k]
        z -= coefficients[1, k - low] * basis[k]
        k += 1


@kernel
def _orthonormalise(new: Floats, weighted: Floats) -> tuple[float, float, float]:
    """Make two vectors B-orthonormal; they were y = r y', z = s y' + t z'."""
    y, z, by, bz = new[0], new[1], weighted[0], weighted[1]
    r = np.sqrt(_dot(y, by))
    y /= r
    by /= r
    s = _dot(y, bz)
    z -= s * y
    bz -= s * by
    t = np.sqrt(_dot(z, bz))
    z /= t
    bz /= t
    return r, s, t


@kernel
def _dot(x: Floats, y: Floats) -> float:
    total = 0.0
    for i in range(x.shape[0]):
        total += x[i] * y[i]
    return total
