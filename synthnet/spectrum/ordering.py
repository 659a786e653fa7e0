"""The order of elimination: approximate minimum degree, and the tree of dense fronts.

References
----------
P. R. Amestoy, T. A. Davis, I. S. Duff, "An approximate minimum degree ordering algorithm",
SIAM J. Matrix Anal. Appl. 17 (1996). C. Ashcraft, R. Grimes, "The influence of relaxed
supernode partitions on the multifrontal method", ACM Trans. Math. Software 15 (1989).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from synthnet.kernels import kernel, part

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
    widest, stack : int
        Largest order of a front, and most numbers waiting to be added to parents.
    """

    order: NDArray[np.int32]
    position: NDArray[np.int32]
    begin: NDArray[np.int32]
    first_row: NDArray[np.int64]
    rows: NDArray[np.int32]
    row_vertices: NDArray[np.int32]
    panel: NDArray[np.int64]
    child: NDArray[np.int32]
    sibling: NDArray[np.int32]
    widest: int
    stack: int


def find_ordering(indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> Ordering:
    """Order the columns of a symmetric pattern with little fill, a function of it alone.

    Parameters
    ----------
    indptr : ndarray of shape (n + 1,), int32
        Start of each row.
    indices : ndarray of shape (nnz,), int32
        Columns of each row, the diagonal among them.
    """
    owner, pivots, size, below = minimum_degree(indptr, indices)
    order, begin, parent = _fronts(owner, pivots, size, below)
    position = np.empty_like(order)
    position[order] = np.arange(len(order), dtype=np.int32)
    child, sibling = _children(parent)
    first_row, rows = _rows_below(order, position, begin, child, sibling, indptr, indices)
    panel, widest, stack = _room(begin, first_row, child, sibling)
    return Ordering(
        order, position, begin, first_row, rows, order[rows], panel, child, sibling, widest, stack
    )


class _Quotient(NamedTuple):
    """The graph of what is left: vertices, and elements (cliques of eliminated vertices).

    A number i below n is a vertex until it is a pivot, and an element from then on. Its list
    holds a vertex's elements and then its neighbours, or an element's vertices. All arrays have
    shape (n,).

    Attributes
    ----------
    start, length : ndarray, int64 and int32
        Where each list begins, and its length.
    elements : ndarray, int32
        How many elements come first in a vertex's list.
    size : ndarray, int32
        Vertices merged into this one, itself included; 0: merged away; negative: it belongs to
        the element being made.
    degree : ndarray, int32
        A bound of the vertices around a vertex, or the number of an element's.
    mark : ndarray, int64
        0: the element was absorbed by another; otherwise see :func:`_count_outside`.
    owner : ndarray, int32
        What a vertex was merged into, or what element absorbed the element; −1 at the roots.
    head, after, before : ndarray, int32
        The vertices of each degree as a doubly linked list; −1 at its ends.
    bucket, chain, hashes : ndarray, int32
        The vertices of each hash as a linked list, and each vertex's hash.
    """

    start: NDArray[np.int64]
    length: NDArray[np.int32]
    elements: NDArray[np.int32]
    size: NDArray[np.int32]
    degree: NDArray[np.int32]
    mark: NDArray[np.int64]
    owner: NDArray[np.int32]
    head: NDArray[np.int32]
    after: NDArray[np.int32]
    before: NDArray[np.int32]
    bucket: NDArray[np.int32]
    chain: NDArray[np.int32]
    hashes: NDArray[np.int32]


@kernel
def minimum_degree(
    indptr: NDArray[np.int32], indices: NDArray[np.int32]
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
    """Eliminate vertices in the order of approximate external degree.

    The graph of what is left is kept as vertices and elements (cliques of eliminated
    vertices). Vertices with the same neighbours are merged and eliminated together.

    Returns
    -------
    owner : ndarray of shape (n,), int32
        What a vertex was merged into, or what element absorbed the element it had become;
        −1 at the roots.
    pivots : ndarray, int32
        The vertices that became elements, in order.
    size : ndarray of shape (n,), int32
        Vertices eliminated together with each pivot.
    below : ndarray of shape (n,), int32
        Columns in each pivot's clique after its own.
    """
    n = indptr.shape[0] - 1
    graph, lists, free = _quotient(indptr, indices)
    size, head = graph.size, graph.head
    below = np.zeros(n, np.int32)
    pivots = np.empty(n, np.int32)
    n_pivots = eliminated = least = largest = 0
    stamp = 2
    while eliminated < n:
        while head[least] < 0:
            least += 1
        pivot = head[least]
        _unlink(graph, pivot)
        eliminated += size[pivot]
        if free + n > lists.shape[0]:
            longer = np.empty(2 * lists.shape[0] + n, np.int32)
            longer[:free] = lists[:free]
            lists = longer

        new = free  # the new element's list begins here
        free, clique = _make_element(graph, lists, pivot, new)
        _count_outside(graph, lists[new:free], lists, stamp)
        alone = _update_degrees(graph, lists[new:free], lists, pivot, stamp)
        clique -= alone
        eliminated += alone
        largest = max(largest, clique)
        stamp = _merge_twins(graph, lists[new:free], lists, stamp + largest + 1)
        free, least = _link_again(graph, lists, new, free, clique, n - eliminated, least)

        graph.start[pivot] = new
        graph.length[pivot] = free - new
        graph.degree[pivot] = clique
        size[pivot] = alone - size[pivot]
        below[pivot] = clique
        if free == new:
            graph.mark[pivot] = 0
        pivots[n_pivots] = pivot
        n_pivots += 1
    return graph.owner, pivots[:n_pivots].copy(), size, below


@part
def _quotient(
    indptr: NDArray[np.int32], indices: NDArray[np.int32]
) -> tuple[_Quotient, NDArray[np.int32], int]:
    """Return the graph before the first pivot, its lists with room to grow, and their end."""
    n = indptr.shape[0] - 1
    lists = np.empty(indptr[n] + 12 * n + 64, np.int32)
    graph = _Quotient(
        np.empty(n, np.int64),
        np.empty(n, np.int32),
        np.zeros(n, np.int32),
        np.ones(n, np.int32),
        np.empty(n, np.int32),
        np.ones(n, np.int64),
        np.full(n, -1, np.int32),
        np.full(n, -1, np.int32),
        np.full(n, -1, np.int32),
        np.full(n, -1, np.int32),
        np.full(n, -1, np.int32),
        np.full(n, -1, np.int32),
        np.empty(n, np.int32),
    )
    free = 0
    for i in range(n):
        graph.start[i] = free
        for p in range(indptr[i], indptr[i + 1]):
            if indices[p] != i:
                lists[free] = indices[p]
                free += 1
        graph.length[i] = free - graph.start[i]
    for i in range(n - 1, -1, -1):
        _link(graph, i, graph.length[i])
    return graph, lists, free


@part
def _link(graph: _Quotient, i: int, degree: int) -> None:
    """Put a vertex first in the list of a degree."""
    first = graph.head[degree]
    if first >= 0:
        graph.before[first] = i
    graph.after[i] = first
    graph.before[i] = -1
    graph.head[degree] = i
    graph.degree[i] = degree


@part
def _unlink(graph: _Quotient, i: int) -> None:
    """Take a vertex out of the list of its degree."""
    after, before = graph.after[i], graph.before[i]
    if after >= 0:
        graph.before[after] = before
    if before >= 0:
        graph.after[before] = after
    else:
        graph.head[graph.degree[i]] = after


@part
def _make_element(
    graph: _Quotient, lists: NDArray[np.int32], pivot: int, free: int
) -> tuple[int, int]:
    """Turn a pivot into an element of its neighbours and those of the elements it absorbs.

    Its list is written from ``free``. Returns the end of the list and how many vertices it has.
    """
    start, length, size = graph.start, graph.length, graph.size
    elements = graph.elements[pivot]
    size[pivot] = -size[pivot]
    clique = 0
    for q in range(elements + 1):
        if q < elements:
            element = lists[start[pivot] + q]
            low, high = start[element], start[element] + length[element]
            graph.owner[element] = pivot
            graph.mark[element] = 0
        else:
            low, high = start[pivot] + elements, start[pivot] + length[pivot]
        for p in range(low, high):
            i = lists[p]
            if size[i] > 0:
                clique += size[i]
                size[i] = -size[i]
                _unlink(graph, i)
                lists[free] = i
                free += 1
    return free, clique


@part
def _count_outside(
    graph: _Quotient, members: NDArray[np.int32], lists: NDArray[np.int32], stamp: int
) -> None:
    """Set mark[e] − stamp to the number of e's vertices outside the new element, of each e near."""
    mark, size = graph.mark, graph.size
    for i in members:
        for q in range(graph.start[i], graph.start[i] + graph.elements[i]):
            element = lists[q]
            if mark[element] >= stamp:
                mark[element] += size[i]
            elif mark[element] != 0:
                mark[element] = graph.degree[element] + stamp + size[i]


@part
def _update_degrees(
    graph: _Quotient,
    members: NDArray[np.int32],
    lists: NDArray[np.int32],
    pivot: int,
    stamp: int,
) -> int:
    """Put the new element into its vertices' lists, and bound their degrees outside it.

    Elements inside the new one are absorbed. Vertices with no neighbour outside are eliminated
    with the pivot. Returns how many these are.
    """
    start, elements, size, mark = graph.start, graph.elements, graph.size, graph.mark
    n = start.shape[0]
    alone = 0
    for i in members:
        low = start[i]
        middle = low + elements[i]
        keep = low
        key = 0
        external = 0
        for q in range(low, middle):
            element = lists[q]
            if mark[element] != 0:
                outside = mark[element] - stamp
                if outside > 0:
                    external += outside
                    lists[keep] = element
                    keep += 1
                    key += element
                else:
                    graph.owner[element] = pivot
                    mark[element] = 0
        first_vertex = keep
        for q in range(middle, low + graph.length[i]):
            j = lists[q]
            if size[j] > 0:
                external += size[j]
                lists[keep] = j
                keep += 1
                key += j
        if keep == low:
            graph.owner[i] = pivot
            alone -= size[i]
            size[i] = 0
        else:
            elements[i] = first_vertex - low + 1
            graph.degree[i] = min(graph.degree[i], external)
            lists[keep] = lists[first_vertex]
            lists[first_vertex] = lists[low]
            lists[low] = pivot
            graph.length[i] = keep - low + 1
            graph.hashes[i] = key % n
            graph.chain[i] = graph.bucket[graph.hashes[i]]
            graph.bucket[graph.hashes[i]] = i
    return alone


@part
def _merge_twins(
    graph: _Quotient, members: NDArray[np.int32], lists: NDArray[np.int32], stamp: int
) -> int:
    """Merge vertices of the new element that have the same list; return the next free stamp."""
    start, length, size, chain = graph.start, graph.length, graph.size, graph.chain
    mark = graph.mark
    for member in members:
        if size[member] >= 0:
            continue
        i = graph.bucket[graph.hashes[member]]
        graph.bucket[graph.hashes[member]] = -1
        while i >= 0 and chain[i] >= 0:
            for q in range(start[i] + 1, start[i] + length[i]):
                mark[lists[q]] = stamp
            last = i
            j = chain[i]
            while j >= 0:
                same = length[j] == length[i] and graph.elements[j] == graph.elements[i]
                q = start[j] + 1
                while same and q < start[j] + length[j]:
                    same = mark[lists[q]] == stamp
                    q += 1
                if same:
                    graph.owner[j] = i
                    size[i] += size[j]
                    size[j] = 0
                    chain[last] = chain[j]
                else:
                    last = j
                j = chain[j]
            stamp += 1
            i = chain[i]
    return stamp


@part
def _link_again(
    graph: _Quotient,
    lists: NDArray[np.int32],
    low: int,
    high: int,
    clique: int,
    left: int,
    least: int,
) -> tuple[int, int]:
    """Put the new element's vertices back into the lists of degrees, with their new degrees.

    The element's list is lists[low:high]; vertices that were eliminated or merged leave it.
    Returns its new end, and a lower bound of all degrees.
    """
    keep = low
    for p in range(low, high):
        i = lists[p]
        if graph.size[i] < 0:
            size = -graph.size[i]
            graph.size[i] = size
            degree = min(graph.degree[i] + clique - size, left - size)
            _link(graph, i, degree)
            least = min(least, degree)
            lists[keep] = i
            keep += 1
    return keep, least


@kernel
def _fronts(
    owner: NDArray[np.int32],
    pivots: NDArray[np.int32],
    size: NDArray[np.int32],
    below: NDArray[np.int32],
) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int32]]:
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
    owner: NDArray[np.int32],
    pivots: NDArray[np.int32],
    size: NDArray[np.int32],
    below: NDArray[np.int32],
    element: NDArray[np.int32],
) -> tuple[NDArray[np.int32], NDArray[np.int64], NDArray[np.int64]]:
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
def _postorder(parent: NDArray[np.int32], into: NDArray[np.int64]) -> tuple[NDArray[np.int32], int]:
    """Number the fronts so that children come before parents; return also how many there are."""
    m = parent.shape[0]
    child = np.full(m, -1, np.int32)
    sibling = np.full(m, -1, np.int32)
    root = -1
    for k in range(m - 1, -1, -1):
        if into[k] != k:
            continue
        if parent[k] >= 0:
            p = into[parent[k]]
            sibling[k] = child[p]
            child[p] = k
        else:
            sibling[k] = root
            root = k
    number = np.full(m, -1, np.int32)
    path = np.empty(m + 1, np.int32)
    count = 0
    while root >= 0:
        depth = 0
        path[0] = root
        while depth >= 0:
            k = path[depth]
            if child[k] >= 0:
                depth += 1
                path[depth] = child[k]
                child[k] = sibling[child[k]]
            else:
                number[k] = count
                count += 1
                depth -= 1
        root = sibling[root]
    return number, count


@kernel
def _columns(
    owner: NDArray[np.int32],
    element: NDArray[np.int32],
    front: NDArray[np.int32],
    begin: NDArray[np.int32],
) -> NDArray[np.int32]:
    """Return the vertex of each column; a front's follow the order in which elements were made.

    ``front`` is the front of each element, and ``begin`` the first column of each front.
    """
    n, m = owner.shape[0], front.shape[0]
    start = np.zeros(m + 1, np.int32)
    home = np.empty(n, np.int32)  # the element that each vertex was eliminated with
    for i in range(n):
        j = i
        while element[j] < 0:
            j = owner[j]
        home[i] = element[j]
        start[home[i] + 1] += 1
    for k in range(m):
        start[k + 1] += start[k]
    members = np.empty(n, np.int32)
    fill = start[:-1].copy()
    for i in range(n):
        members[fill[home[i]]] = i
        fill[home[i]] += 1
    order = np.empty(n, np.int32)
    column = begin[:-1].copy()
    for k in range(m):
        for p in range(start[k], start[k + 1]):
            order[column[front[k]]] = members[p]
            column[front[k]] += 1
    return order


@kernel
def _children(parent: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
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
    order: NDArray[np.int32],
    position: NDArray[np.int32],
    begin: NDArray[np.int32],
    child: NDArray[np.int32],
    sibling: NDArray[np.int32],
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
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
def _room(
    begin: NDArray[np.int32],
    first_row: NDArray[np.int64],
    child: NDArray[np.int32],
    sibling: NDArray[np.int32],
) -> tuple[NDArray[np.int64], int, int]:
    """Return where each front's rows of the factor begin, the widest front, and the largest stack.

    The stack holds, of each front that waits for its parent, a triangle of numbers.
    """
    fronts = child.shape[0]
    panel = np.zeros(fronts + 1, np.int64)
    widest = 0
    waiting = 0
    stack = 0
    for k in range(fronts):
        c = child[k]
        while c >= 0:
            m = first_row[c + 1] - first_row[c]
            waiting -= m * (m + 1) // 2
            c = sibling[c]
        m = first_row[k + 1] - first_row[k]
        width = begin[k + 1] - begin[k]
        panel[k + 1] = panel[k] + width * (width + m)
        widest = max(widest, width + m)
        waiting += m * (m + 1) // 2
        stack = max(stack, waiting)
    return panel, widest, stack
