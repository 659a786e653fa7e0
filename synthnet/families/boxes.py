"""Surfaces of solids that are made of boxes: cells of a grid, some of them filled."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.families.atlas import Atlas
from synthnet.families.polyhedra import polyhedron

AROUND = ((1, 2), (2, 0), (0, 1))  # of each axis the two others, which turn about it
# A square from (0, 0) to (2, 2) in eight triangles, each with one corner of the square.
SQUARE = np.array(
    [
        [(0, 0), (1, 0), (1, 1)],
        [(0, 0), (1, 1), (0, 1)],
        [(2, 0), (2, 1), (1, 1)],
        [(2, 0), (1, 1), (1, 0)],
        [(2, 2), (1, 2), (1, 1)],
        [(2, 2), (1, 1), (2, 1)],
        [(0, 2), (0, 1), (1, 1)],
        [(0, 2), (1, 1), (1, 2)],
    ]
)
FLAT = 8  # triangles of SQUARE around a point of a plane that is a corner of squares


def boundary(filled: Booleans, planes: Sequence[Floats]) -> Atlas:
    """Return the surface of filled cells, each of its squares in eight patches.

    Parameters
    ----------
    filled : ndarray of shape (a, b, c), bool
        Cells, with which :func:`is_manifold`.
    planes : three ndarrays of shape (a + 1,), (b + 1,) and (c + 1,)
        Ascending coordinates of the planes between cells.
    """
    padded = np.pad(filled, 1)
    squares = []  # corners as numbers of half cells, (8, 3, 3) a square
    for axis, (right, up) in enumerate(AROUND):
        for side in (0, 1):
            beyond = np.roll(padded, 1 - 2 * side, axis=axis)[1:-1, 1:-1, 1:-1]
            for cell in np.argwhere(filled & ~beyond):
                corners = np.empty((*SQUARE.shape[:2], 3), dtype=np.int64)
                corners[:] = 2 * cell
                corners[..., axis] += 2 * side
                corners[..., [right, up]] += SQUARE
                squares.append(corners if side else corners[:, ::-1])
    patches = np.concatenate(squares)
    numbers, counts = np.unique(patches[(patches % 2 == 0).all(axis=2)], axis=0, return_counts=True)
    points, reentrant = (
        np.stack([_at(line, of[..., axis]) for axis, line in enumerate(planes)], axis=-1)
        for of in (patches, numbers[counts > FLAT])
    )
    return polyhedron(*points.reshape(-1, *SQUARE.shape[:2], 3), singular=reentrant)


def _at(planes: Floats, halves: Int64s) -> Floats:
    """Return the coordinates of half cells."""
    return np.asarray((planes[halves // 2] + planes[(halves + 1) // 2]) / 2)


def is_manifold(filled: Booleans) -> bool:
    """Return whether the boundary of filled cells is a surface, pinched nowhere.

    It is if, of the eight cells around each corner of the grid, the filled ones are connected by
    their faces, and so are the empty ones.
    """
    padded = np.pad(filled, 1)
    corners = np.ndindex(*(n - 1 for n in padded.shape))
    around = [padded[tuple(slice(i, i + 2) for i in corner)] for corner in corners]
    return all(is_connected(part) for cells in around for part in (cells, ~cells))


def is_connected(filled: Booleans) -> bool:
    """Return whether filled cells are connected by their faces, or there are none."""
    return int(ndimage.label(filled)[1]) <= 1


def euler(filled: Booleans) -> int:
    """Return the surface's Euler characteristic: twice corners − edges + squares − cells."""
    total = 0
    for flat in np.ndindex(2, 2, 2):  # along which axes an element has no extent
        present = np.pad(filled, 1)
        for axis in np.flatnonzero(flat):
            low, high = (np.delete(present, end, axis=axis) for end in (-1, 0))
            present = low | high
        total += (-1) ** (3 - sum(flat)) * int(present.sum())
    return 2 * total
