"""Nested dissection: a large graph is cut into parts, which are eliminated before the cuts.

A graph is halved where its Fiedler vector crosses a value. The vector is exact on a graph of a
few hundred aggregates of aggregates of vertices, and smoothed on every finer one. All halves of
halves are found on the first aggregates; vertices beside a cut then change sides where that makes
it smoother.

References
----------
A. George, "Nested dissection of a regular finite element mesh", SIAM J. Numer. Anal. 10 (1973).
S. T. Barnard, H. D. Simon, "Fast multilevel implementation of recursive spectral bisection for
partitioning unstructured problems", Concurrency: Practice and Experience 6 (1994). B. Merriman,
J. K. Bence, S. Osher, "Diffusion generated motion by mean curvature" (1992).
"""

from math import frexp, gcd
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from synthnet.arrays import Booleans, Floats, Int32s
from synthnet.kernels import kernel, part
from synthnet.spectrum.fem import grouped

PART = 8_000  # vertices of a part that is not cut: fewer make little difference
LEAST = 0.42  # of a graph is in its smaller half
COARSEST = 120  # aggregates whose Fiedler vector is computed by LAPACK
SWEEPS = 3  # of smoothing, there and back, on each finer graph
DIFFUSION = 4  # sweeps, there and back, that smooth a cut
DIGITS = 6  # to which a Fiedler vector is rounded, so that its order does not depend on BLAS


class Graph(NamedTuple):
    """A weighted graph without loops, symmetric.

    Attributes
    ----------
    indptr, indices : ndarray of shape (n + 1,) and (nnz,), int32
        Start of each vertex's neighbours, and these.
    weights : ndarray of shape (nnz,), float64
        Edges of the first graph that an edge stands for.
    sizes : ndarray of shape (n,), float64
        Vertices of the first graph that a vertex stands for.
    """

    indptr: Int32s
    indices: Int32s
    weights: Floats
    sizes: Floats


def dissect(indptr: Int32s, indices: Int32s) -> Int32s:
    """Return the stage at which each vertex of a symmetric pattern is eliminated.

    Each part is a stage of its own, from 0. Then come the cuts, those between the smallest parts
    first; the last stage is the cut between the first two halves.

    Parameters
    ----------
    indptr, indices : ndarray of shape (n + 1,) and (nnz,), int32
        Columns of each row, the diagonal among them.

    Returns
    -------
    ndarray of shape (n,), int32
    """
    aggregates, count = _aggregate(indptr, indices)
    n = len(aggregates)
    coarse = _contract(Graph(indptr, indices, np.ones(len(indices)), np.ones(n)), aggregates, count)
    paths = np.ones(count, np.int32)
    _halve(coarse, np.arange(count, dtype=np.int32), 1, paths)
    nodes = np.ones(n, np.int32)
    levels = _level(paths.max())
    for level in range(levels):
        of_aggregates, sides, beside = _cuts(coarse, paths, level)
        _descend(indptr, indices, nodes, aggregates, of_aggregates, sides, beside)
    return _stages(indptr, indices, nodes, levels)


def _halve(graph: Graph, vertices: Int32s, node: int, paths: Int32s) -> None:
    """Write the part of each vertex of a graph into ``paths``: 2 i and 2 i + 1 are halves of i."""
    paths[vertices] = node
    if graph.sizes.sum() <= PART or len(vertices) < 2:
        return
    order = np.argsort(_fiedler(graph), kind="stable").astype(np.int32)
    cut = _best_cut(graph, order)
    for half, members in enumerate((order[:cut], order[cut:])):
        members.sort()
        _halve(_induced(graph, members), vertices[members], 2 * node + half, paths)


def _fiedler(graph: Graph) -> Floats:
    """Return about the second eigenvector of the Laplacian of a graph."""
    n = len(graph.sizes)
    if n <= COARSEST:
        laplacian = _laplacian(graph)
        scale = 1 / np.sqrt(graph.sizes)
        laplacian *= scale[:, None] * scale
        vector = linalg.eigh(laplacian, subset_by_index=[1, 1])[1][:, 0] * scale
        rounded: Floats = np.round(vector / vector[np.abs(vector).argmax()], DIGITS)
        return rounded
    aggregates, count = _aggregate(graph.indptr, graph.indices)
    if count == 1 or 2 * count > n:  # a star, or hardly an edge: any cut will do
        return np.arange(n, dtype=np.float64)
    vector = _fiedler(_contract(graph, aggregates, count))[aggregates]
    _smooth(graph, vector)
    return vector


@kernel
def _laplacian(graph: Graph) -> Floats:
    n = graph.sizes.shape[0]
    dense = np.zeros((n, n))
    for i in range(n):
        for p in range(graph.indptr[i], graph.indptr[i + 1]):
            dense[i, i] += graph.weights[p]
            dense[i, graph.indices[p]] -= graph.weights[p]
    return dense


@kernel
def _smooth(graph: Graph, values: Floats) -> None:
    """Set the value of each vertex to the mean of its neighbours, there and back."""
    n = values.shape[0]
    for sweep in range(2 * SWEEPS):
        for at in range(n):
            i = at if sweep % 2 == 0 else n - 1 - at
            total = 0.0
            weight = 0.0
            for p in range(graph.indptr[i], graph.indptr[i + 1]):
                total += graph.weights[p] * values[graph.indices[p]]
                weight += graph.weights[p]
            if weight > 0.0:
                values[i] = total / weight


@kernel
def _best_cut(graph: Graph, order: Int32s) -> int:
    """Return how many vertices of an order to cut off, for the least weight of edges by balance."""
    n = order.shape[0]
    rank = np.empty(n, np.int32)
    for r in range(n):
        rank[order[r]] = r
    total = graph.sizes.sum()
    before = 0.0
    cut = 0.0
    best = np.inf
    found: int = n // 2
    for r in range(n - 1):
        i = order[r]
        before += graph.sizes[i] / total
        for p in range(graph.indptr[i], graph.indptr[i + 1]):
            if rank[graph.indices[p]] > r:
                cut += graph.weights[p]
            else:
                cut -= graph.weights[p]
        if LEAST <= before <= 1 - LEAST and cut < best * before * (1 - before):
            best = cut / (before * (1 - before))
            found = r + 1
    return found


@kernel
def _aggregate(indptr: Int32s, indices: Int32s) -> tuple[Int32s, int]:
    """Cut a graph into vertices with their neighbours; return the aggregate of each, and how many.

    Vertices are visited in steps of about 0.62 n: along a grid, row by row, aggregates would be
    long, and cuts through them would run the wrong way.
    """
    n = indptr.shape[0] - 1
    home = np.full(n, -1, np.int32)
    count = 0
    step = _coprime(n)
    i = 0
    for _ in range(n):
        i = (i + step) % n
        alone = home[i] < 0
        for p in range(indptr[i], indptr[i + 1]):
            alone = alone and home[indices[p]] < 0
        if alone:
            home[i] = count
            for p in range(indptr[i], indptr[i + 1]):
                home[indices[p]] = count
            count += 1
    centred = count
    for i in range(n):
        if home[i] < 0:
            for p in range(indptr[i], indptr[i + 1]):
                if 0 <= home[indices[p]] < centred:
                    home[i] = -2 - home[indices[p]]  # marked, so that aggregates grow no further
                    break
    number = np.full(count, -1, np.int32)  # in the order of first vertices: neighbours lie close
    count = 0
    for i in range(n):
        k = home[i] if home[i] >= 0 else -2 - home[i]
        if number[k] < 0:
            number[k] = count
            count += 1
        home[i] = number[k]
    return home, count


@part
def _coprime(n: int) -> int:
    """Return a step of about 0.62 n that visits every one of n places."""
    step = int(0.6180339887 * n) | 1
    while gcd(n, step) > 1:
        step += 2
    return step


@kernel
def _contract(graph: Graph, home: Int32s, count: int) -> Graph:
    """Return the graph of aggregates, given the aggregate of each vertex."""
    start, members = grouped(home, count)
    indptr = np.zeros(count + 1, np.int32)
    indices = np.empty(graph.indices.shape[0], np.int32)
    weights = np.empty(graph.indices.shape[0])
    sizes = np.zeros(count)
    at = np.full(count, -1, np.int32)
    end = 0
    for k in range(count):
        for q in range(start[k], start[k + 1]):
            i = members[q]
            sizes[k] += graph.sizes[i]
            for p in range(graph.indptr[i], graph.indptr[i + 1]):
                j = home[graph.indices[p]]
                if j == k:
                    continue
                if at[j] < indptr[k]:
                    at[j] = end
                    indices[end] = j
                    weights[end] = 0.0
                    end += 1
                weights[at[j]] += graph.weights[p]
        indptr[k + 1] = end
    return Graph(indptr, indices[:end].copy(), weights[:end].copy(), sizes)


@kernel
def _induced(graph: Graph, members: Int32s) -> Graph:
    """Return the graph of some vertices, in ascending order."""
    m = members.shape[0]
    local = np.full(graph.sizes.shape[0], -1, np.int32)
    for i in range(m):
        local[members[i]] = i
    indptr = np.zeros(m + 1, np.int32)
    indices = np.empty(graph.indices.shape[0], np.int32)
    weights = np.empty(graph.indices.shape[0])
    end = 0
    for i in range(m):
        for p in range(graph.indptr[members[i]], graph.indptr[members[i] + 1]):
            j = local[graph.indices[p]]
            if j >= 0:
                indices[end] = j
                weights[end] = graph.weights[p]
                end += 1
        indptr[i + 1] = end
    return Graph(indptr, indices[:end].copy(), weights[:end].copy(), graph.sizes[members])


@kernel
def _level(node: int) -> int:
    """Return how often the whole graph was halved to get a part: 0 for 1, 1 for 2 and 3, ..."""
    return frexp(node)[1] - 1


@kernel
def _cuts(graph: Graph, paths: Int32s, level: int) -> tuple[Int32s, NDArray[np.float32], Booleans]:
    """Return, of each aggregate, its part at a level, its side of that part, and if a cut is near.

    A side is 1 or −1, or 0 in a part that is not cut. Near are aggregates with a neighbour on the
    other side, and their neighbours.
    """
    n = paths.shape[0]
    nodes = np.empty(n, np.int32)
    sides = np.zeros(n, np.float32)
    for i in range(n):
        below = _level(paths[i]) - level
        nodes[i] = paths[i] >> max(below, 0)
        if below > 0:
            sides[i] = 2 * ((paths[i] >> (below - 1)) & 1) - 1
    beside = np.zeros(n, np.bool_)
    for i in range(n):
        for p in range(graph.indptr[i], graph.indptr[i + 1]):
            j = graph.indices[p]
            beside[i] |= nodes[j] == nodes[i] and sides[j] != sides[i]
    near = beside.copy()
    for i in range(n):
        if beside[i]:
            near[graph.indices[graph.indptr[i] : graph.indptr[i + 1]]] = True
    return nodes, sides, near


@kernel
def _descend(
    indptr: Int32s,
    indices: Int32s,
    nodes: Int32s,
    home: Int32s,
    of_aggregates: Int32s,
    sides_of_aggregates: NDArray[np.float32],
    near: Booleans,
) -> None:
    """Move vertices from parts into their halves, those near a cut so that it gets smoother.

    The sides of aggregates diffuse; a vertex belongs to the side whose sign it has then. One that
    is no longer in the part of its aggregate has no side at first.
    """
    n = nodes.shape[0]
    sides = np.zeros(n, np.float32)
    band = np.empty(n, np.int32)
    count = 0
    for i in range(n):
        there = of_aggregates[home[i]] == nodes[i]
        if there:
            sides[i] = sides_of_aggregates[home[i]]
        if near[home[i]] or not there:
            band[count] = i
            count += 1
    for sweep in range(2 * DIFFUSION):
        for at in range(count):
            i = band[at if sweep % 2 == 0 else count - 1 - at]
            total = np.float32(0)
            neighbours = 0
            for p in range(indptr[i], indptr[i + 1]):
                if nodes[indices[p]] == nodes[i]:
                    total += sides[indices[p]]
                    neighbours += 1
            sides[i] = total / neighbours
    for i in range(n):
        if sides[i] != 0:
            nodes[i] = 2 * nodes[i] + (sides[i] > 0)


@kernel
def _stages(indptr: Int32s, indices: Int32s, nodes: Int32s, levels: int) -> Int32s:
    """Return each vertex's stage, as :func:`dissect`, from the part or half it belongs to.

    Of the two vertices of an edge between the halves of a part, the one in the first is on the
    cut. So is a vertex that belongs to neither.
    """
    n = nodes.shape[0]
    number = np.full(nodes.max() + 1, -1, np.int32)
    parts = 0
    for node in nodes:
        if number[node] < 0:
            number[node] = parts
            parts += 1
    stages = np.empty(n, np.int32)
    for i in range(n):
        stages[i] = number[nodes[i]]
        for p in range(indptr[i], indptr[i + 1]):
            own, other = nodes[i], nodes[indices[p]]
            if own == other:
                continue
            while own != other and own >> 1 != other >> 1:
                if own > other:
                    own >>= 1
                else:
                    other >>= 1
            if own < other:
                stages[i] = max(stages[i], parts + levels - _level(own))
            elif own == other == nodes[i]:
                stages[i] = max(stages[i], parts + levels - 1 - _level(own))
    return stages
