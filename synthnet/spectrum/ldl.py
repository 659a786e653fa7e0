"""LDLᵀ of A − σB by dense fronts, solutions with it, and the count of negative pivots.

References
----------
I. S. Duff, J. K. Reid, "The multifrontal solution of indefinite sparse symmetric linear
equations", ACM Trans. Math. Software 9 (1983).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synthnet.kernels import kernel, uncounted
from synthnet.processes import threads
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ordering import Ordering

PANEL = 48  # columns whose part is subtracted from four rows while these are in the cache
Four = tuple[float, float, float, float]
Vector = NDArray[np.float64]


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
        diagonal entry of ``M⁻¹ |L| |D| |Lᵀ|``, M a quarter of the lumped mass (below B), times
        the rounding unit. No bound: the norm of that matrix is a few times larger.
    """

    pivots: NDArray[np.float64]
    panels: NDArray[np.float64]
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
        Whether to leave out the panels, which only :func:`solve` needs.
    """
    pivots = np.empty(len(ordering.order))
    panels = np.empty(0 if pivots_only else ordering.panel[-1])
    stack = np.empty(ordering.stack[-1])  # what fronts have yet to add to their parents
    at = np.zeros(len(ordering.child), np.int64)

    def work(portion: int) -> NDArray[np.float64]:
        return _factorise(*matrices[:4], ordering, sigma, pivots, panels, stack, at, portion)

    size = sum(_in_turn(work, ordering))
    largest = float(np.max(size / matrices.lumped[ordering.order]))
    return Factor(pivots, panels, 4 * float(np.finfo(np.float64).eps) * largest)


def _in_turn(
    work: Callable[[int], NDArray[np.float64]], ordering: Ordering
) -> Iterator[NDArray[np.float64]]:
    """Yield what work on each portion returns, in order; it is done in threads where there is room.

    Subtrees are worked on side by side, and then each front above them after its children.
    """
    count = len(ordering.portions)
    workers = min(threads(), count)
    if workers == 1:
        yield from map(work, range(count))
        return
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(work, range(ordering.subtrees))
        fronts = ordering.portions[ordering.subtrees :, 0].tolist()
        futures: dict[int, Future[NDArray[np.float64]]] = {}

        def after_children(portion: int, front: int) -> NDArray[np.float64]:
            child = ordering.child[front]
            while child >= 0:
                if child in futures:
                    futures[child].result()
                child = ordering.sibling[child]
            return work(portion)

        for portion, front in enumerate(fronts, ordering.subtrees):  # waits for earlier ones only
            futures[front] = pool.submit(after_children, portion, front)
        for front in fronts:
            yield futures[front].result()


@kernel
def _factorise(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    stiffness: NDArray[np.float64],
    mass: NDArray[np.float64],
    ordering: Ordering,
    sigma: float,
    pivots: NDArray[np.float64],
    panels: NDArray[np.float64],
    stack: NDArray[np.float64],
    at: NDArray[np.int64],
    portion: int,
) -> NDArray[np.float64]:
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
def _add_child(
    front: NDArray[np.float64],
    local: NDArray[np.int32],
    rows: NDArray[np.int32],
    stack: NDArray[np.float64],
    start: int,
) -> None:
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
    front: NDArray[np.float64],
    width: int,
    begin: int,
    rows: NDArray[np.int32],
    pivots: NDArray[np.float64],
    panels: NDArray[np.float64],
    first: int,
    absolute: NDArray[np.float64],
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
def _eliminate(front: NDArray[np.float64], width: int) -> None:
    """Eliminate the first columns of a symmetric matrix, given by its upper triangle."""
    front = uncounted(front)
    size = front.shape[0]
    fours = width - width % 4
    for first in range(0, fours, PANEL):
        last = min(first + PANEL, fours)
        for k in range(first, last, 4):
            for t in range(k, k + 4):
                for s in range(t + 1, k + 4):
                    _subtract(front[s, s:], front[t, s:], front[t, s] / front[t, t])
            for i in range(k + 4, last, 4):
                _subtract_products(front, k, i)
        single = size - (size - last) % 4
        for i in range(last, single, 4):
            for k in range(first, last, 4):
                _subtract_products(front, k, i)
        for i in range(single, size):
            for t in range(first, last):
                _subtract(front[i, i:], front[t, i:], front[t, i] / front[t, t])
    for t in range(fours, width):
        for i in range(t + 1, size):
            _subtract(front[i, i:], front[t, i:], front[t, i] / front[t, t])


def solve(factor: Factor, ordering: Ordering, rows: NDArray[np.float64]) -> None:
    """Overwrite each row x of a (c, n) array by the solution y of (A − σB) y = x."""
    count = len(rows)
    for i in range(0, count - 1, 2):
        solve_two(ordering, factor.pivots, factor.panels, rows[i : i + 2])
    if count % 2:
        twice = np.stack([rows[-1], rows[-1]])
        solve_two(ordering, factor.pivots, factor.panels, twice)
        rows[-1] = twice[0]


@kernel
def solve_two(
    ordering: Ordering,
    pivots: NDArray[np.float64],
    panels: NDArray[np.float64],
    x: NDArray[np.float64],
) -> None:
    """Solve for the two rows of x in place: L first, from the leaves up, then D Lᵀ down again."""
    fronts = ordering.child.shape[0]
    x0, x1 = x[0], x[1]
    y = np.empty(ordering.widest)
    z = np.empty(ordering.widest)
    for k in range(fronts):
        begin = ordering.begin[k]
        width = ordering.begin[k + 1] - begin
        rows = ordering.row_vertices[ordering.first_row[k] : ordering.first_row[k + 1]]
        size = width + rows.shape[0]
        u = panels[ordering.panel[k] : ordering.panel[k + 1]].reshape(width, size)
        for p in range(width):
            i = ordering.order[begin + p]
            y[p] = x0[i]
            z[p] = x1[i]
        y[width:size] = 0.0
        z[width:size] = 0.0
        _forward(u, y, z, width, size)
        for p in range(width):
            i = ordering.order[begin + p]
            x0[i] = y[p]
            x1[i] = z[p]
        for p in range(rows.shape[0]):
            i = rows[p]
            x0[i] += y[width + p]
            x1[i] += z[width + p]
    for k in range(fronts - 1, -1, -1):
        begin = ordering.begin[k]
        width = ordering.begin[k + 1] - begin
        rows = ordering.row_vertices[ordering.first_row[k] : ordering.first_row[k + 1]]
        size = width + rows.shape[0]
        u = panels[ordering.panel[k] : ordering.panel[k + 1]].reshape(width, size)
        for p in range(width):
            i = ordering.order[begin + p]
            y[p] = x0[i] / pivots[begin + p]
            z[p] = x1[i] / pivots[begin + p]
        for p in range(rows.shape[0]):
            i = rows[p]
            y[width + p] = x0[i]
            z[width + p] = x1[i]
        _backward(u, y, z, width, size)
        for p in range(width):
            i = ordering.order[begin + p]
            x0[i] = y[p]
            x1[i] = z[p]


@kernel
def _forward(u: NDArray[np.float64], y: Vector, z: Vector, width: int, size: int) -> None:
    """Solve for a front's columns, first in y and z, and subtract them from what follows.

    The rows of u, of shape (width, size), are those of Lᵀ.
    """
    u, y, z = uncounted(u), uncounted(y), uncounted(z)
    t = 0
    while t + 4 <= width:
        for s in range(t, t + 3):
            for r in range(s + 1, t + 4):
                y[r] -= u[s, r] * y[s]
                z[r] -= u[s, r] * z[s]
        subtract_four(
            y[t + 4 : size],
            z[t + 4 : size],
            u[t, t + 4 :],
            u[t + 1, t + 4 :],
            u[t + 2, t + 4 :],
            u[t + 3, t + 4 :],
            (y[t], y[t + 1], y[t + 2], y[t + 3]),
            (z[t], z[t + 1], z[t + 2], z[t + 3]),
        )
        t += 4
    while t < width:
        _subtract(y[t + 1 : size], u[t, t + 1 :], y[t])
        _subtract(z[t + 1 : size], u[t, t + 1 :], z[t])
        t += 1


@kernel
def _backward(u: NDArray[np.float64], y: Vector, z: Vector, width: int, size: int) -> None:
    """Solve for a front's columns, first in y and z, from what follows, which is solved."""
    u, y, z = uncounted(u), uncounted(y), uncounted(z)
    t = width
    while t >= 4:
        t -= 4
        a, b = dot_four(
            y[t + 4 : size],
            z[t + 4 : size],
            u[t, t + 4 :],
            u[t + 1, t + 4 :],
            u[t + 2, t + 4 :],
            u[t + 3, t + 4 :],
        )
        for s in range(3, -1, -1):
            dy, dz = a[s], b[s]
            for r in range(s + 1, 4):
                dy += u[t + s, t + r] * y[t + r]
                dz += u[t + s, t + r] * z[t + r]
            y[t + s] -= dy
            z[t + s] -= dz
    while t > 0:
        t -= 1
        dy = 0.0
        dz = 0.0
        for r in range(t + 1, size):
            dy += u[t, r] * y[r]
            dz += u[t, r] * z[r]
        y[t] -= dy
        z[t] -= dz


# These loops take most of the time: they read a vector once for several others.


@kernel
def _subtract(y: Vector, x: Vector, factor: float) -> None:
    for j in range(y.shape[0]):
        y[j] -= factor * x[j]


@kernel
def _subtract_products(front: NDArray[np.float64], k: int, i: int) -> None:
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


@kernel
def subtract_four(
    y: Vector, z: Vector, x0: Vector, x1: Vector, x2: Vector, x3: Vector, a: Four, b: Four
) -> None:
    """Subtract two combinations of four vectors: y −= Σ aᵢ xᵢ, z −= Σ bᵢ xᵢ."""
    a0, a1, a2, a3 = a
    b0, b1, b2, b3 = b
    for j in range(y.shape[0]):
        p, q, r, s = x0[j], x1[j], x2[j], x3[j]
        y[j] -= a0 * p + a1 * q + a2 * r + a3 * s
        z[j] -= b0 * p + b1 * q + b2 * r + b3 * s


@kernel
def dot_four(
    y: Vector, z: Vector, x0: Vector, x1: Vector, x2: Vector, x3: Vector
) -> tuple[Four, Four]:
    """Return the products of y, and of z, with four vectors."""
    a0 = a1 = a2 = a3 = 0.0
    b0 = b1 = b2 = b3 = 0.0
    for j in range(y.shape[0]):
        p, q = y[j], z[j]
        a0 += x0[j] * p
        a1 += x1[j] * p
        a2 += x2[j] * p
        a3 += x3[j] * p
        b0 += x0[j] * q
        b1 += x1[j] * q
        b2 += x2[j] * q
        b3 += x3[j] * q
    return (a0, a1, a2, a3), (b0, b1, b2, b3)
