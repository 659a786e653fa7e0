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

from synthnet.kernels import kernel

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
    first_row, rows, panel, child, sibling, widest, stack = _symbolic(
        order, position, begin, parent, indptr, indices
    )
    return Ordering(
        order, position, begin, first_row, rows, order[rows], panel, child, sibling, widest, stack
    )


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
    lists = np.empty(indptr[n] + 12 * n + 64, np.int32)
    start = np.empty(n, np.int64)  # of each vertex's or element's list
    length = np.empty(n, np.int32)
    n_elements = np.zeros(n, np.int32)  # elements come first in a vertex's list
    size = np.ones(n, np.int32)  # 0: merged away; negative: in the element being made
    degree = np.empty(n, np.int32)
    head = np.full(n, -1, np.int32)  # vertices of each degree, doubly linked
    after = np.full(n, -1, np.int32)
    before = np.full(n, -1, np.int32)
    bucket = np.full(n, -1, np.int32)  # vertices of each hash
    chain = np.full(n, -1, np.int32)
    hashes = np.empty(n, np.int32)
    mark = np.ones(n, np.int64)  # 0: element absorbed
    owner = np.full(n, -1, np.int32)
    below = np.zeros(n, np.int32)
    pivots = np.empty(n, np.int32)
    n_pivots = 0
    free = 0
    for i in range(n):
        start[i] = free
        for p in range(indptr[i], indptr[i + 1]):
            if indices[p] != i:
                lists[free] = indices[p]
                free += 1
        length[i] = free - start[i]
        degree[i] = length[i]
    for i in range(n - 1, -1, -1):
        d = degree[i]
        after[i] = head[d]
        if head[d] >= 0:
            before[head[d]] = i
        head[d] = i
    stamp = 2
    eliminated = 0
    least = 0
    largest = 0
    while eliminated < n:
        while head[least] < 0:
            least += 1
        pivot = head[least]
        head[least] = after[pivot]
        if after[pivot] >= 0:
            before[after[pivot]] = -1
        pivot_size = size[pivot]
        eliminated += pivot_size
        size[pivot] = -pivot_size

        # The new element: the neighbours, and the vertices of the elements it absorbs.
        if free + n > lists.shape[0]:
            longer = np.empty(2 * lists.shape[0] + n, np.int32)
            longer[:free] = lists[:free]
            lists = longer
        new = free
        clique = 0
        for q in range(n_elements[pivot] + 1):
            if q < n_elements[pivot]:
                element = lists[start[pivot] + q]
                low, high = start[element], start[element] + length[element]
                owner[element] = pivot
                mark[element] = 0
            else:
                low = start[pivot] + n_elements[pivot]
                high = start[pivot] + length[pivot]
            for p in range(low, high):
                i = lists[p]
                if size[i] > 0:
                    clique += size[i]
                    size[i] = -size[i]
                    lists[free] = i
                    free += 1
                    if after[i] >= 0:
                        before[after[i]] = before[i]
                    if before[i] >= 0:
                        after[before[i]] = after[i]
                    else:
                        head[degree[i]] = after[i]
        start[pivot] = new
        length[pivot] = free - new
        degree[pivot] = clique

        # mark[e] − stamp becomes the number of e's vertices outside the new element.
        for p in range(new, free):
            i = lists[p]
            for q in range(start[i], start[i] + n_elements[i]):
                element = lists[q]
                if mark[element] >= stamp:
                    mark[element] += size[i]
                elif mark[element] != 0:
                    mark[element] = degree[element] + stamp + size[i]

        # New degrees; vertices with no neighbour outside are eliminated with the pivot.
        for p in range(new, free):
            i = lists[p]
            low = start[i]
            middle = low + n_elements[i]
            high = low + length[i]
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
                        owner[element] = pivot
                        mark[element] = 0
            kept_elements = keep - low + 1
            first_vertex = keep
            for q in range(middle, high):
                j = lists[q]
                if size[j] > 0:
                    external += size[j]
                    lists[keep] = j
                    keep += 1
                    key += j
            if keep == low:
                owner[i] = pivot
                clique += size[i]
                pivot_size -= size[i]
                eliminated -= size[i]
                size[i] = 0
            else:
                n_elements[i] = kept_elements
                degree[i] = min(degree[i], external)
                lists[keep] = lists[first_vertex]
                lists[first_vertex] = lists[low]
                lists[low] = pivot
                length[i] = keep - low + 1
                hashes[i] = key % n
                chain[i] = bucket[hashes[i]]
                bucket[hashes[i]] = i
        degree[pivot] = clique
        largest = max(largest, clique)
        stamp += largest + 1

        # Merge vertices of the element that have the same list.
        for p in range(new, free):
            if size[lists[p]] >= 0:
                continue
            i = bucket[hashes[lists[p]]]
            bucket[hashes[lists[p]]] = -1
            while i >= 0 and chain[i] >= 0:
                for q in range(start[i] + 1, start[i] + length[i]):
                    mark[lists[q]] = stamp
                last = i
                j = chain[i]
                while j >= 0:
                    same = length[j] == length[i] and n_elements[j] == n_elements[i]
                    q = start[j] + 1
                    while same and q < start[j] + length[j]:
                        same = mark[lists[q]] == stamp
                        q += 1
                    j_next = chain[j]
                    if same:
                        owner[j] = i
                        size[i] += size[j]
                        size[j] = 0
                        chain[last] = j_next
                    else:
                        last = j
                    j = j_next
                stamp += 1
                i = chain[i]

        # Back into the lists of degrees.
        keep = new
        for p in range(new, free):
            i = lists[p]
            if size[i] < 0:
                size[i] = -size[i]
                d = min(degree[i] + clique - size[i], n - eliminated - size[i])
                if head[d] >= 0:
                    before[head[d]] = i
                after[i] = head[d]
                before[i] = -1
                head[d] = i
                least = min(least, d)
                degree[i] = d
                lists[keep] = i
                keep += 1
        length[pivot] = keep - new
        free = keep
        size[pivot] = pivot_size
        below[pivot] = clique
        if keep == new:
            mark[pivot] = 0
        pivots[n_pivots] = pivot
        n_pivots += 1
    return owner, pivots[:n_pivots].copy(), size, below


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
    n = owner.shape[0]
    m = pivots.shape[0]
    element = np.full(n, -1, np.int32)
    element[pivots] = np.arange(m)
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
    child = np.full(m, -1, np.int32)
    sibling = np.full(m, -1, np.int32)
    root = -1
    for k in range(m - 1, -1, -1):
        if into[k] != k:
            into[k] = into[into[k]]
        elif parent[k] >= 0:
            p = into[parent[k]]
            sibling[k] = child[p]
            child[p] = k
        else:
            sibling[k] = root
            root = k

    number = np.full(m, -1, np.int32)  # of each front, in postorder
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

    begin = np.zeros(count + 1, np.int32)
    front_parent = np.full(count, -1, np.int32)
    for k in range(m):
        if into[k] == k:
            begin[number[k] + 1] = columns[k]
            if parent[k] >= 0:
                front_parent[number[k]] = number[into[parent[k]]]
    for k in range(count):
        begin[k + 1] += begin[k]

    # Inside a front, columns follow the order in which their elements were eliminated.
    start = np.zeros(m + 1, np.int32)
    home = np.empty(n, np.int32)
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
    place = begin[:-1].copy()
    for k in range(m):
        front = number[into[k]]
        for p in range(start[k], start[k + 1]):
            order[place[front]] = members[p]
            place[front] += 1
    return order, begin, front_parent


@kernel
def _symbolic(
    order: NDArray[np.int32],
    position: NDArray[np.int32],
    begin: NDArray[np.int32],
    parent: NDArray[np.int32],
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
) -> tuple[
    NDArray[np.int64],
    NDArray[np.int32],
    NDArray[np.int64],
    NDArray[np.int32],
    NDArray[np.int32],
    int,
    int,
]:
    """Find the rows below each front, and how much room the factorisation takes."""
    n = order.shape[0]
    fronts = parent.shape[0]
    first_row = np.zeros(fronts + 1, np.int64)
    panel = np.zeros(fronts + 1, np.int64)
    rows = np.empty(16 * n + 1024, np.int32)
    child = np.full(fronts, -1, np.int32)
    sibling = np.full(fronts, -1, np.int32)
    seen = np.full(n, -1, np.int32)
    widest = 0
    waiting = 0
    stack = 0
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
            m = first_row[c + 1] - first_row[c]
            waiting -= m * (m + 1) // 2
            c = sibling[c]
        rows[first_row[k] : count].sort()
        first_row[k + 1] = count
        m = count - first_row[k]
        width = end - begin[k]
        panel[k + 1] = panel[k] + width * (width + m)
        widest = max(widest, width + m)
        waiting += m * (m + 1) // 2
        stack = max(stack, waiting)
        if parent[k] >= 0:
            sibling[k] = child[parent[k]]
            child[parent[k]] = k
    return first_row, rows[: first_row[fronts]].copy(), panel, child, sibling, widest, stack
