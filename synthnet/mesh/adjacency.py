"""Which faces share an edge, and what is connected by that."""

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from synthnet.arrays import Int64s


def edge_keys(faces: NDArray[np.integer]) -> Int64s:
    """Return a number of the edge from corner i to corner i + 1 of each face, (3 m,).

    Examples
    --------
    >>> edge_keys(np.array([[0, 1, 2], [1, 0, 3]])).tolist()
    [1, 6, 2, 1, 3, 7]
    """
    tails, heads = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    keys: Int64s = low * (int(faces.max(initial=0)) + 1) + high
    return keys


def joined_half_edges(keys: Int64s) -> tuple[Int64s, Int64s]:
    """Return pairs of half-edges 3 f + i that share an edge, (e,) twice.

    Of an edge of more than two faces these are each with the next, so that all are connected.
    """
    order = np.argsort(keys, kind="stable")
    twice = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    return order[twice], order[twice + 1]


def neighbours(
    faces: NDArray[np.integer],
) -> tuple[Int64s, Int64s, Int64s]:
    """Return the two faces of each inner edge, (e,) twice, and where it begins in each, (e, 2).

    An edge that begins at corner i of a face goes on to corner i + 1.
    """
    first, second = joined_half_edges(edge_keys(faces))
    return first // 3, second // 3, np.stack([first % 3, second % 3], axis=1)


def connected(count: int, tails: NDArray[np.integer], heads: NDArray[np.integer]) -> Int64s:
    """Return the number of the component of each of ``count`` nodes, (count,).

    Examples
    --------
    >>> connected(4, np.array([0, 2]), np.array([3, 2])).tolist()
    [0, 1, 2, 0]
    """
    graph = sparse.coo_matrix((np.ones(len(tails), bool), (tails, heads)), shape=(count, count))
    labels: Int64s = connected_components(graph, directed=False)[1].astype(np.int64)
    return labels


def face_components(faces: NDArray[np.integer]) -> Int64s:
    """Return the component of each face, (m,): faces that share an edge are in one."""
    left, right, _ = neighbours(faces)
    return connected(len(faces), left, right)
