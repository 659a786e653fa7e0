"""Unions of boxes: blocks with steps, angles and necks, all edges sharp."""

import numpy as np

from synthnet.arrays import Booleans, Floats
from synthnet.families import boxes as of_boxes
from synthnet.families.atlas import Atlas, borders
from synthnet.families.charted import charted

GRID = 3  # cells of the grid in each direction
PASSES = 4  # so often each cell may be taken
THIN = 0.9  # widths of cells are 10^-0.9 to 1


def union(*, boxes: int, form: int) -> tuple[Booleans, list[Floats]]:
    """Return which cells of a grid are filled, (g, g, g), and where the grid's planes are.

    The union grows from the middle cell to one neighbour after the other, at random by the seed
    ``form``, and takes only those with which its surface stays a manifold.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    widths = 10 ** (-THIN * rng.random((3, GRID)))
    order = np.argsort(rng.random((PASSES, GRID**3)), axis=1, kind="stable")
    filled = np.zeros((GRID,) * 3, dtype=np.bool_)
    filled[GRID // 2, GRID // 2, GRID // 2] = True
    for number in order.ravel():
        cell = tuple(int(i) for i in np.unravel_index(number, filled.shape))
        near = np.abs(np.argwhere(filled) - cell).sum(axis=1).min() == 1
        if near and filled.sum() < boxes:
            filled[cell] = True
            filled[cell] = of_boxes.is_manifold(filled)
    return filled, [borders(across) for across in widths]


def atlas(**shape: int) -> Atlas:
    """Return the surface of :func:`union`."""
    return of_boxes.boundary(*union(**shape))


def euler(**shape: int) -> int:
    """Return the Euler characteristic of :func:`union`."""
    return of_boxes.euler(union(**shape)[0])


FAMILY = charted(
    "box_union",
    "Union of boxes",
    atlas,
    {"boxes": 1, "form": 0},
    euler_characteristic=euler,
    most={"boxes": 15},
)
