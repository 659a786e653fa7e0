"""The order of elimination, and the tree of dense fronts.

References
----------
C. Ashcraft, R. Grimes, "The influence of relaxed supernode partitions on the multifrontal
method", ACM Trans. Math. Software 15 (1989).
"""

from typing import NamedTuple

import numpy as np

from synthnet.arrays import Int32s, Int64s
from synthnet.kernels import kernel
from synthnet.spectrum.degree import minimum_degree
from synthnet.spectrum.dissection import dissect
from synthnet.spectrum.fem import grouped

LARGE = 500_000  # vertices from which on a graph is dissected first, and fronts cut into portions
PORTION = 1 / 8  # of all work, which a portion hardly exceeds
WIDE = 16  # a merged front may be half zeros up to so many columns, 1/16 zeros beyond: measured


class Ordering(NamedTuple):
    """Columns in the order of elimination, cut into fronts; children come before parents.

    Front k eliminates the vertices ``order[begin[k]:begin[k + 1]]`` and touches, below
    them, the positions ``rows[first_row[k]:first_row[k + 1]]`` of later columns.

    Attributes
    ----------
    order, position : ndarray of shape (n,), int32
        The vertex of each column, and the column of each vertex.
    begin : ndarray of shape (fronts + 1,), int32
        First column of each front.
    first_row : ndarray of shape (fronts + 1,), int64
        Start of each front in ``rows``.
    rows, row_vertices : ndarray, int32
        Columns below each front, ascending, and their vertices.
    panel : ndarray of shape (fronts + 1,), int64
        Start of each front's rows of the factor.
    child, sibling : ndarray of shape (fronts,), int32
        First child, and next child of the same parent; −1 for none.
    widest : int
        Largest order of a front.
    portions : ndarray of shape (portions, 2), int32
        First front of each portion, and the end. First come those that need no front outside
        them, then single fronts, children before parents.
    subtrees : int
        How many portions need no front outside them.
    stack : ndarray of shape (portions + 1,), int64
        Where each portion keeps the numbers that wait to be added to parents.
    """

    order: Int32s
    position: Int32s
    begin: Int32s
    first_row: Int64s
    rows: Int32s
    row_vertices: Int32s
    panel: Int64s
    child: Int32s
    sibling: Int32s
    widest: int
    portions: Int32s
    subtrees: int
    stack: Int64s

    @property
    def whole(self) -> bool:
        """Whether no front stands above the subtrees, so that nothing is worked on apart."""
        return self.subtrees == len(self.portions)


def find_ordering(indptr: Int32s, indices: Int32s) -> Ordering:
    """Order the columns of a symmetric pattern with little fill, a function of it alone.

    Parameters
    ----------
    indptr : ndarray of shape (n + 1,), int32
        Start of each row.
    indices : ndarray of shape (nnz,), int32
        Columns of each row, the diagonal among them.
    """
    n = len(indptr) - 1
    stages = dissect(indptr, indices) if n >= LARGE else np.zeros(n, np.int32)
    owner, pivots, size, below = minimum_degree(indptr, indices, stages)
    order, begin, parent = _fronts(owner, pivots, size, below)
    position = np.empty_like(order)
    position[order] = np.arange(len(order), dtype=np.int32)
    child, sibling = _children(parent)
    first_row, rows = _rows_below(order, position, begin, child, sibling, indptr, indices)
    portions, subtrees = _portions(begin, first_row, parent, PORTION if n >= LARGE else 1.0)
    widths = np.diff(begin)
    sizes = widths + np.diff(first_row)  # of the fronts, as dense matrices
    panel = np.concatenate([[0], np.cumsum(widths * sizes)])
    stack = _stacks(first_row, child, sibling, portions)
    return Ordering(
        order,
        position,
        begin,
        first_row,
        rows,
        order[rows],
        panel,
        child,
        sibling,
        int(sizes.max()),
        portions,
        subtrees,
        stack,
    )


@kernel
def _fronts(
    owner: Int32s, pivots: Int32s, size: Int32s, below: Int32s
) -> tuple[Int32s, Int32s, Int32s]:
    """Merge small elements into their parents and number columns in postorder.

    Returns the vertex of each column, the first column of each front and each front's
    parent, −1 at the roots.
    """
    m = pivots.shape[0]
    element = np.full(owner.shape[0], -1, np.int32)
    element[pivots] = np.arange(m)
    parent, into, columns = _merge_small(owner, pivots, size, below, element)
    number, count = _postorder(parent, into)
    begin = np.zeros(count + 1, np.int32)
    front_parent = np.full(count, -1, np.int32)
    for k in range(m):
        if into[k] == k:
            begin[number[k] + 1] = columns[k]
            if parent[k] >= 0:
                front_parent[number[k]] = number[into[parent[k]]]
    for k in range(count):
        begin[k + 1] += begin[k]
    return _columns(owner, element, number[into], begin), begin, front_parent


@kernel
def _merge_small(
    owner: Int32s, pivots: Int32s, size: Int32s, below: Int32s, element: Int32s
) -> tuple[Int32s, Int64s, Int64s]:
    """Merge elements into their parents while the dense front has few zeros.

    Returns each element's parent, −1 at the roots; the element whose front it belongs to; and
    the columns of that front.
    """
    m = pivots.shape[0]
    parent = np.full(m, -1, np.int32)
    into = np.arange(m)
    columns = size[pivots].astype(np.int64)
    rows = below[pivots].astype(np.int64)
    zeros = np.zeros(m, np.int64)
    for k in range(m):
        if owner[pivots[k]] < 0:
            continue
        p = element[owner[pivots[k]]]
        parent[k] = p
        added = zeros[k] + zeros[p] + columns[k] * (columns[p] + rows[p] - rows[k])
        width = columns[k] + columns[p]
        entries = width * (width + 1) // 2 + width * rows[p]
        if WIDE * added <= entries or (width <= WIDE and 2 * added <= entries):
            into[k] = p
            columns[p] = width
            zeros[p] = added
    for k in range(m - 1, -1, -1):
        into[k] = into[into[k]]  # parents come later, and know where they belong by now
    return parent, into, columns


@kernel
def _postorder(parent: Int32s, into: Int64s) -> tuple[Int32s, int]:
    """Number the fronts so that children come before parents; return also how many there are."""
    m = parent.shape[0]
    above = np.full(m, m, np.int64)  # the parent's front; m at the roots
    sizes = np.zeros(m + 1, np.int64)  # fronts in each subtree, and m's: all of them
    for k in range(m):
        if into[k] == k:
            if parent[k] >= 0:
                above[k] = into[parent[k]]
            sizes[k] += 1
            sizes[above[k]] += sizes[k]
    number = np.full(m, -1, np.int32)
    last = np.full(m + 1, sizes[m] - 1)  # number of the last child that has none yet
    for k in range(m - 1, -1, -1):
        if into[k] == k:
            number[k] = last[above[k]]
            last[above[k]] -= sizes[k]
            last[k] = number[k] - 1
    return number, int(sizes[m])


@kernel
def _columns(owner: Int32s, element: Int32s, front: Int32s, begin: Int32s) -> Int32s:
    """Return the vertex of each column; a front's follow the order in which elements were made.

    ``front`` is the front of each element, and ``begin`` the first column of each front.
    """
    n, m = owner.shape[0], front.shape[0]
    home = np.empty(n, np.int32)  # the element that each vertex was eliminated with
    for i in range(n):
        j = i
        while element[j] < 0:
            j = owner[j]
        home[i] = element[j]
    start, members = grouped(home, m)
    order = np.empty(n, np.int32)
    column = begin[:-1].copy()
    for k in range(m):
        for p in range(start[k], start[k + 1]):
            order[column[front[k]]] = members[p]
            column[front[k]] += 1
    return order


@kernel
def _children(parent: Int32s) -> tuple[Int32s, Int32s]:
    """Return each front's first child, and its next sibling; −1 for none."""
    child = np.full(parent.shape[0], -1, np.int32)
    sibling = np.full(parent.shape[0], -1, np.int32)
    for k in range(parent.shape[0]):
        if parent[k] >= 0:
            sibling[k] = child[parent[k]]
            child[parent[k]] = k
    return child, sibling


@kernel
def _rows_below(
    order: Int32s,
    position: Int32s,
    begin: Int32s,
    child: Int32s,
    sibling: Int32s,
    indptr: Int32s,
    indices: Int32s,
) -> tuple[Int64s, Int32s]:
    """Find the rows below each front: those of its columns, and those of its children."""
    n, fronts = order.shape[0], child.shape[0]
    first_row = np.zeros(fronts + 1, np.int64)
    rows = np.empty(16 * n + 1024, np.int32)
    seen = np.full(n, -1, np.int32)
    for k in range(fronts):
        end = begin[k + 1]
        count = first_row[k]
        if count + n > rows.shape[0]:
            longer = np.empty(2 * rows.shape[0] + n, np.int32)
            longer[:count] = rows[:count]
            rows = longer
        for c in range(begin[k], end):
            i = order[c]
            for p in range(indptr[i], indptr[i + 1]):
                j = position[indices[p]]
                if j >= end and seen[j] != k:
                    seen[j] = k
                    rows[count] = j
                    count += 1
        c = child[k]
        while c >= 0:
            for p in range(first_row[c], first_row[c + 1]):
                j = rows[p]
                if j >= end and seen[j] != k:
                    seen[j] = k
                    rows[count] = j
                    count += 1
            c = sibling[c]
        rows[first_row[k] : count].sort()
        first_row[k + 1] = count
    return first_row, rows[: first_row[fronts]].copy()


@kernel
def _portions(begin: Int32s, first_row: Int64s, parent: Int32s, share: float) -> tuple[Int32s, int]:
    """Cut the fronts where a front and those below it take more than a share of all work.

    Returns first and end of each portion, and how many need no front outside them: runs of whole
    subtrees. The fronts above them are portions of their own.
    """
    fronts = parent.shape[0]
    work = np.zeros(fronts)  # of a front and all below it
    total = 0.0
    for k in range(fronts):
        m = first_row[k + 1] - first_row[k]
        order = m + begin[k + 1] - begin[k]
        own = float(order) ** 3 - float(m) ** 3
        total += own
        work[k] += own
        if parent[k] >= 0:
            work[parent[k]] += work[k]
    above = work > share * total
    portions = np.empty((fronts, 2), np.int32)
    subtrees = 0
    first = 0
    done = 0.0
    for k in range(fronts):
        root = not above[k] and (parent[k] < 0 or above[parent[k]])
        if root:
            done += work[k]
        if above[k] or (root and done > share * total) or k == fronts - 1:
            end = k if above[k] else k + 1
            if end > first:
                portions[subtrees] = first, end
                subtrees += 1
            first = k + 1
            done = 0.0
    count = subtrees
    for k in range(fronts):
        if above[k]:
            portions[count] = k, k + 1
            count += 1
    return portions[:count].copy(), subtrees


@kernel
def _stacks(first_row: Int64s, child: Int32s, sibling: Int32s, portions: Int32s) -> Int64s:
    """Return where the stack of each portion begins, and the end of the last.

    A stack holds, of each front of a portion that waits for its parent, a triangle of numbers.
    """
    stack = np.zeros(portions.shape[0] + 1, np.int64)
    for portion in range(portions.shape[0]):
        first, end = portions[portion]
        waiting = 0
        most = 0
        for k in range(first, end):
            c = child[k]
            while c >= 0:
                if c >= first:
                    m = first_row[c + 1] - first_row[c]
                    waiting -= m * (m + 1) // 2
                c = sibling[c]
            m = first_row[k + 1] - first_row[k]
            waiting += m * (m + 1) // 2
            most = max(most, waiting)
        stack[portion + 1] = stack[portion] + most
    return stack
