"""Solutions with LDLᵀ: through L from the leaves up, and through D Lᵀ down again."""

import numpy as np

from synthnet.arrays import Floats, Int32s
from synthnet.kernels import kernel, uncounted
from synthnet.spectrum.ldl import Factor
from synthnet.spectrum.ordering import Ordering
from synthnet.spectrum.portions import side_by_side
from synthnet.spectrum.vectors import dot_four, subtract, subtract_four


def solve(factor: Factor, ordering: Ordering, rows: Floats) -> None:
    """Overwrite each row x of a (c, n) array by the solution y of (A − σB) y = x."""
    count = len(rows)
    for i in range(0, count - 1, 2):
        solve_pair(factor, ordering, rows[i : i + 2])
    if count % 2:
        twice = np.stack([rows[-1], rows[-1]])
        solve_pair(factor, ordering, twice)
        rows[-1] = twice[0]


def solve_pair(factor: Factor, ordering: Ordering, x: Floats) -> None:
    """Solve for the two rows of x in place, on as many threads as a mesh so large needs.

    The answer is the same, to the byte, on any number of them: what a subtree subtracts from the
    fronts above is kept apart, and summed in the order of the subtrees. So it differs by rounding
    from that of :func:`solve_two`.
    """
    if ordering.whole:
        solve_two(ordering, factor.pivots, factor.panels, x)
        return
    subtrees, portions = ordering.subtrees, ordering.portions.tolist()
    above = ordering.portions[subtrees:, 0]
    columns = [slice(*ordering.begin[front : front + 2]) for front in above]
    vertices = np.concatenate([ordering.order[of_front] for of_front in columns])
    sums = np.zeros((subtrees, 2, len(vertices)))

    def up(portion: int) -> None:
        first, end = portions[portion]
        _up(ordering, factor.panels, x, sums[portion], first, end)

    def down(portion: int) -> None:
        first, end = portions[portion]
        _down(ordering, factor.pivots, factor.panels, x, first, end)

    list(side_by_side(up, ordering))
    x[:, vertices] += sums.sum(axis=0)
    none = np.empty((2, 0))
    for first, end in portions[subtrees:]:
        _up(ordering, factor.panels, x, none, first, end)
    for first, end in reversed(portions[subtrees:]):
        _down(ordering, factor.pivots, factor.panels, x, first, end)
    list(side_by_side(down, ordering))


@kernel
def solve_two(ordering: Ordering, pivots: Floats, panels: Floats, x: Floats) -> None:
    """Solve for the two rows of x in place, on one thread."""
    fronts = ordering.child.shape[0]
    _up(ordering, panels, x, np.empty((2, 0)), 0, fronts)
    _down(ordering, pivots, panels, x, 0, fronts)


@kernel
def _up(ordering: Ordering, panels: Floats, x: Floats, sums: Floats, first: int, end: int) -> None:
    """Solve L y = x for the columns of some fronts, children before parents.

    What they subtract from columns of fronts above them goes to ``sums``, of shape (2, m): the m
    columns of the fronts that belong to no subtree. If that has no columns, it goes to x itself.
    """
    apart = sums.shape[1] > 0
    x0, x1 = x[0], x[1]
    y = np.empty(ordering.widest)
    z = np.empty(ordering.widest)
    last = ordering.begin[end] if apart else ordering.order.shape[0]
    for k in range(first, end):
        begin = ordering.begin[k]
        width = ordering.begin[k + 1] - begin
        below = slice(ordering.first_row[k], ordering.first_row[k + 1])
        rows = ordering.row_vertices[below]
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
        inside = rows.shape[0]
        if apart:
            inside = np.searchsorted(ordering.rows[below], last)
        for p in range(inside):
            i = rows[p]
            x0[i] += y[width + p]
            x1[i] += z[width + p]
        if inside < rows.shape[0]:
            outside = ordering.rows[below][inside:]
            _add_apart(ordering, outside, y[width + inside :], z[width + inside :], sums)


@kernel
def _add_apart(ordering: Ordering, columns: Int32s, y: Floats, z: Floats, sums: Floats) -> None:
    """Add y and z to the sums of ascending columns of the fronts that belong to no subtree."""
    portion = ordering.subtrees
    begin, end, offset = 0, 0, 0  # of a front's columns, and where they are in sums
    for p in range(columns.shape[0]):
        while columns[p] >= end:
            offset += end - begin
            front = ordering.portions[portion, 0]
            begin, end = ordering.begin[front], ordering.begin[front + 1]
            portion += 1
        sums[0, offset + columns[p] - begin] += y[p]
        sums[1, offset + columns[p] - begin] += z[p]


@kernel
def _down(
    ordering: Ordering, pivots: Floats, panels: Floats, x: Floats, first: int, end: int
) -> None:
    """Solve D Lᵀ y = x for the columns of some fronts, parents before children."""
    x0, x1 = x[0], x[1]
    y = np.empty(ordering.widest)
    z = np.empty(ordering.widest)
    for k in range(end - 1, first - 1, -1):
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
def _forward(u: Floats, y: Floats, z: Floats, width: int, size: int) -> None:
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
        subtract(y[t + 1 : size], u[t, t + 1 :], y[t])
        subtract(z[t + 1 : size], u[t, t + 1 :], z[t])
        t += 1


@kernel
def _backward(u: Floats, y: Floats, z: Floats, width: int, size: int) -> None:
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
