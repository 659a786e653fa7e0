"""LDLᵀ of A − σB by dense fronts, and the count of negative pivots.

References
----------
I. S. Duff, J. K. Reid, "The multifrontal solution of indefinite sparse symmetric linear
equations", ACM Trans. Math. Software 9 (1983).
"""

from dataclasses import dataclass

import numpy as np

from synthnet.arrays import Floats, Int32s, Int64s
from synthnet.kernels import kernel, uncounted
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ordering import Ordering
from synthnet.spectrum.portions import in_turn
from synthnet.spectrum.vectors import subtract

PANEL = 48  # columns whose part is subtracted from four rows while these are in the cache


@dataclass(frozen=True, slots=True)
class Factor:
    """A − σB = L D Lᵀ without pivoting, in the order of an :class:`Ordering`.

    Parameters
    ----------
    pivots : ndarray of shape (n,), float64
        The diagonal D.
    panels : ndarray, float64
        Rows of Lᵀ, front by front; empty if only the pivots are kept.
    uncertainty : float
        An estimate of how far rounding moves the eigenvalues, in their unit: the largest
        diagonal entry of ``(cM)⁻¹ |L| |D| |Lᵀ|``, with the lumped mass M and B ≥ cM, times the
        rounding unit. No bound: the norm of that matrix is a few times larger.
    """

    pivots: Floats
    panels: Floats
    uncertainty: float

    @property
    def negative(self) -> int:
        """How many pivots are negative: by Sylvester's law, the eigenvalues below σ."""
        return int(np.count_nonzero(self.pivots < 0))

    @property
    def finite(self) -> bool:
        """Whether no pivot was zero and nothing overflowed."""
        return bool(np.isfinite(self.pivots).all() and np.isfinite(self.uncertainty))


def factorise(
    matrices: Matrices, ordering: Ordering, sigma: float, *, pivots_only: bool = False
) -> Factor:
    """Factorise A − σB, on as many threads as a mesh so large needs and this process may use.

    The answer is the same, to the byte, on any number of them.

    Parameters
    ----------
    matrices : Matrices
        A and B.
    ordering : Ordering
        The order of elimination for their pattern.
    sigma : float
        The shift, in the unit of the eigenvalues.
    pivots_only : bool
        Whether to leave out the panels, which only solutions need
        (:mod:`synthnet.spectrum.substitution`).
    """
    pivots = np.empty(len(ordering.order))
    panels = np.empty(0 if pivots_only else ordering.panel[-1])
    stack = np.empty(ordering.stack[-1])  # what fronts have yet to add to their parents
    at = np.zeros(len(ordering.child), np.int64)

    def work(portion: int) -> Floats:
        return _factorise(*matrices[:4], ordering, sigma, pivots, panels, stack, at, portion)

    size = sum(in_turn(work, ordering))
    largest = float(np.max(size / matrices.lumped[ordering.order]))
    return Factor(pivots, panels, float(np.finfo(np.float64).eps) * largest / matrices.least)


@kernel
def _factorise(
    indptr: Int32s,
    indices: Int32s,
    stiffness: Floats,
    mass: Floats,
    ordering: Ordering,
    sigma: float,
    pivots: Floats,
    panels: Floats,
    stack: Floats,
    at: Int64s,
    portion: int,
) -> Floats:
    """Fill pivots and panels of a portion; return what it adds to the diagonal of |L| |D| |Lᵀ|.

    ``at`` is where each front's numbers are on the stack.
    """
    n = pivots.shape[0]
    memory = np.empty(ordering.widest * ordering.widest)
    local = np.empty(n, np.int32)  # the row in the front of each column
    absolute = np.zeros(n)
    first_front, end = ordering.portions[portion]
    top = ordering.stack[portion]
    for k in range(first_front, end):
        begin = ordering.begin[k]
        rows = ordering.rows[ordering.first_row[k] : ordering.first_row[k + 1]]
        width = ordering.begin[k + 1] - begin
        size = width + rows.shape[0]
        front = memory[: size * size].reshape(size, size)  # its upper triangle
        for p in range(size):
            front[p, p:] = 0.0
        for p in range(width):
            local[begin + p] = p
        for p in range(rows.shape[0]):
            local[rows[p]] = width + p
        for column in range(begin, begin + width):
            i = ordering.order[column]
            for p in range(indptr[i], indptr[i + 1]):
                j = ordering.position[indices[p]]
                if j >= column:
                    front[column - begin, local[j]] = stiffness[p] - sigma * mass[p]
                    if j == column:
                        absolute[column] += stiffness[p] - sigma * mass[p]
        child = ordering.child[k]
        while child >= 0:
            theirs = ordering.rows[ordering.first_row[child] : ordering.first_row[child + 1]]
            _add_child(front, local, theirs, stack, at[child])
            if child >= first_front:
                top = min(top, at[child])
            child = ordering.sibling[child]
        _eliminate(front, width)
        _keep_columns(front, width, begin, rows, pivots, panels, ordering.panel[k], absolute)
        at[k] = top
        for p in range(width, size):
            stack[top : top + size - p] = front[p, p:]
            top += size - p
    return absolute


@kernel
def _add_child(front: Floats, local: Int32s, rows: Int32s, stack: Floats, start: int) -> None:
    """Add what a child, with these rows, left on the stack: an upper triangle row by row."""
    front, stack = uncounted(front), uncounted(stack)
    for p in range(rows.shape[0]):
        target = front[local[rows[p]]]
        source = stack[start : start + rows.shape[0] - p]
        for q in range(source.shape[0]):
            target[local[rows[p + q]]] += source[q]
        start += source.shape[0]


@kernel
def _keep_columns(
    front: Floats,
    width: int,
    begin: int,
    rows: Int32s,
    pivots: Floats,
    panels: Floats,
    first: int,
    absolute: Floats,
) -> None:
    """Keep the eliminated columns: pivots; rows of Lᵀ, from ``first`` in the panels, if any.

    The negative pivots change the diagonal of |L| |D| |Lᵀ|: with signs, its terms add up to the
    diagonal of A − σB.
    """
    panels = uncounted(panels)
    size = front.shape[0]
    for p in range(width):
        pivot = front[p, p]
        pivots[begin + p] = pivot
        scale = 1.0 / pivot
        if panels.shape[0] > 0:
            start = first + p * size
            panel = panels[start : start + size]
            for q in range(p + 1, size):
                panel[q] = front[p, q] * scale
        if pivot < 0.0:
            absolute[begin + p] -= 2 * pivot
            for q in range(p + 1, width):
                absolute[begin + q] -= 2 * front[p, q] * front[p, q] * scale
            for q in range(width, size):
                absolute[rows[q - width]] -= 2 * front[p, q] * front[p, q] * scale


@kernel
def _eliminate(front: Floats, width: int) -> None:
    """Eliminate the first columns of a symmetric matrix, given by its upper triangle."""
    front = uncounted(front)
    size = front.shape[0]
    fours = width - width % 4
    for first in range(0, fours, PANEL):
        last = min(first + PANEL, fours)
        for k in range(first, last, 4):
            for t in range(k, k + 4):
                for s in range(t + 1, k + 4):
                    subtract(front[s, s:], front[t, s:], front[t, s] / front[t, t])
            for i in range(k + 4, last, 4):
                _subtract_products(front, k, i)
        single = size - (size - last) % 4
        for i in range(last, single, 4):
            for k in range(first, last, 4):
                _subtract_products(front, k, i)
        for i in range(single, size):
            for t in range(first, last):
                subtract(front[i, i:], front[t, i:], front[t, i] / front[t, t])
    for t in range(fours, width):
        for i in range(t + 1, size):
            subtract(front[i, i:], front[t, i:], front[t, i] / front[t, t])


@kernel
def _subtract_products(front: Floats, k: int, i: int) -> None:
    """Subtract from rows i to i + 3, right of column i, what pivots k to k + 3 add to them."""
    x0, x1, x2, x3 = front[k, i:], front[k + 1, i:], front[k + 2, i:], front[k + 3, i:]
    y0, y1, y2, y3 = front[i, i:], front[i + 1, i:], front[i + 2, i:], front[i + 3, i:]
    d0, d1 = 1.0 / front[k, k], 1.0 / front[k + 1, k + 1]
    d2, d3 = 1.0 / front[k + 2, k + 2], 1.0 / front[k + 3, k + 3]
    a0, a1, a2, a3 = x0[0] * d0, x1[0] * d1, x2[0] * d2, x3[0] * d3
    b0, b1, b2, b3 = x0[1] * d0, x1[1] * d1, x2[1] * d2, x3[1] * d3
    c0, c1, c2, c3 = x0[2] * d0, x1[2] * d1, x2[2] * d2, x3[2] * d3
    e0, e1, e2, e3 = x0[3] * d0, x1[3] * d1, x2[3] * d2, x3[3] * d3
    for j in range(y0.shape[0]):  # also below the diagonal, which is never read
        p, q, r, s = x0[j], x1[j], x2[j], x3[j]
        y0[j] -= a0 * p + a1 * q + a2 * r + a3 * s
        y1[j] -= b0 * p + b1 * q + b2 * r + b3 * s
        y2[j] -= c0 * p + c1 * q + c2 * r + c3 * s
        y3[j] -= e0 * p + e1 * q + e2 * r + e3 * s
