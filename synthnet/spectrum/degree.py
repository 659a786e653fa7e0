"""Approximate minimum degree: the order in which eliminating vertices makes little fill.

References
----------
P. R. Amestoy, T. A. Davis, I. S. Duff, "An approximate minimum degree ordering algorithm",
SIAM J. Matrix Anal. Appl. 17 (1996).
"""

from typing import NamedTuple

import numpy as np

from synthnet.arrays import Int32s, Int64s
from synthnet.kernels import kernel, part


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
        A bound of the vertices around a vertex, or the number of an element's. Until its stage
        begins, a vertex has n, n + 1, ...: the place of that stage in ``head``.
    mark : ndarray, int64
        0: the element was absorbed by another; otherwise see :func:`_count_outside`.
    owner : ndarray, int32
        What a vertex was merged into, or what element absorbed the element; −1 at the roots.
    head, after, before : ndarray, int32
        The vertices of each degree, and of each later stage, as a doubly linked list; −1 at its
        ends. ``head`` has shape (n + later stages,).
    bucket, chain, hashes : ndarray, int32
        The vertices of each hash as a linked list, and each vertex's hash.
    """

    start: Int64s
    length: Int32s
    elements: Int32s
    size: Int32s
    degree: Int32s
    mark: Int64s
    owner: Int32s
    head: Int32s
    after: Int32s
    before: Int32s
    bucket: Int32s
    chain: Int32s
    hashes: Int32s


@kernel
def minimum_degree(
    indptr: Int32s, indices: Int32s, stage: Int32s
) -> tuple[Int32s, Int32s, Int32s, Int32s]:
    """Eliminate vertices in the order of approximate external degree.

    The graph of what is left is kept as vertices and elements (cliques of eliminated
    vertices). Vertices with the same neighbours are merged and eliminated together.

    Parameters
    ----------
    indptr, indices : ndarray of shape (n + 1,) and (nnz,), int32
        The neighbours of each vertex; itself may be among them.
    stage : ndarray of shape (n,), int32
        From zero; a vertex is eliminated after all those of lower stages.

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
    graph, lists, free = _quotient(indptr, indices, stage)
    size, head = graph.size, graph.head
    below = np.zeros(n, np.int32)
    pivots = np.empty(n, np.int32)
    n_pivots = eliminated = least = largest = 0
    stamp = 2
    while eliminated < n:
        while head[least] < 0:
            least += 1
        if least >= n:
            least = _begin_stage(graph, lists, least, n - eliminated)
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
def _quotient(indptr: Int32s, indices: Int32s, stage: Int32s) -> tuple[_Quotient, Int32s, int]:
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
        np.full(n + stage.max(), -1, np.int32),
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
        _link(graph, i, graph.length[i] if stage[i] == 0 else n - 1 + stage[i])
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
def _begin_stage(graph: _Quotient, lists: Int32s, bucket: int, left: int) -> int:
    """Give the vertices of a stage a bound of their degree; return the least of these."""
    least = left
    i = graph.head[bucket]
    graph.head[bucket] = -1
    while i >= 0:
        after = graph.after[i]
        degree = 0
        for q in range(graph.start[i], graph.start[i] + graph.length[i]):
            j = lists[q]
            degree += graph.degree[j] if q - graph.start[i] < graph.elements[i] else graph.size[j]
        degree = min(degree, left - graph.size[i])
        _link(graph, i, degree)
        least = min(least, degree)
        i = after
    return least


@part
def _make_element(graph: _Quotient, lists: Int32s, pivot: int, free: int) -> tuple[int, int]:
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
def _count_outside(graph: _Quotient, members: Int32s, lists: Int32s, stamp: int) -> None:
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
    graph: _Quotient, members: Int32s, lists: Int32s, pivot: int, stamp: int
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
        if keep == low and graph.degree[i] < n:
            graph.owner[i] = pivot
            alone -= size[i]
            size[i] = 0
        else:
            elements[i] = first_vertex - low + 1
            if graph.degree[i] < n:
                graph.degree[i] = min(graph.degree[i], external)
            if keep > low:
                lists[keep] = lists[first_vertex]
                lists[first_vertex] = lists[low]
            lists[low] = pivot
            graph.length[i] = keep - low + 1
            graph.hashes[i] = key % n
            graph.chain[i] = graph.bucket[graph.hashes[i]]
            graph.bucket[graph.hashes[i]] = i
    return alone


@part
def _merge_twins(graph: _Quotient, members: Int32s, lists: Int32s, stamp: int) -> int:
    """Merge vertices of the new element that have the same list; return the next free stamp."""
    start, length, size, chain = graph.start, graph.length, graph.size, graph.chain
    mark, n = graph.mark, start.shape[0]
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
                same = same and max(graph.degree[j], n - 1) == max(graph.degree[i], n - 1)
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
    graph: _Quotient, lists: Int32s, low: int, high: int, clique: int, left: int, least: int
) -> tuple[int, int]:
    """Put the new element's vertices back into the lists of degrees, with their new degrees.

    The element's list is lists[low:high]; vertices that were eliminated or merged leave it.
    Returns its new end, and a lower bound of all degrees.
    """
    keep, n = low, graph.start.shape[0]
    for p in range(low, high):
        i = lists[p]
        if graph.size[i] < 0:
            size = -graph.size[i]
            graph.size[i] = size
            degree = graph.degree[i]
            if degree < n:
                degree = min(degree + clique - size, left - size)
            _link(graph, i, degree)
            least = min(least, degree)
            lists[keep] = i
            keep += 1
    return keep, least
