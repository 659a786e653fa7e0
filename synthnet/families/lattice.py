"""Lattices: square struts along the edges of a few boxes, some left out."""

from typing import Any

import numpy as np

from synthnet.arrays import Booleans, Floats
from synthnet.families import boxes
from synthnet.families.atlas import Atlas, borders
from synthnet.families.charted import charted
from synthnet.families.family import SHORTEST

LEFT_OUT = 0.25  # of the struts, about: none without which the lattice would fall apart


def frame(
    *, columns: int, rows: int, layers: int, strut: float, form: int
) -> tuple[Booleans, list[Floats]]:
    """Return which cells of a grid are filled, and where its planes are.

    Cells with even numbers are nodes, those between two nodes struts. ``strut`` is how thick these
    are over the gaps between them, which are 0.7 to 1.3; ``form`` is the seed of that and of which
    struts there are.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    shape = tuple(2 * n + 1 for n in (columns, rows, layers))
    widths = [np.where(np.arange(n) % 2, 0.7 + 0.6 * rng.random(n), strut) for n in shape]
    odd = (np.indices(shape) % 2).sum(axis=0)
    filled = odd <= 1
    struts = np.argwhere(odd == 1)
    for cell in struts[rng.random(len(struts)) < LEFT_OUT]:
        filled[tuple(cell)] = False
        filled[tuple(cell)] = not boxes.is_connected(filled)
    return filled, [borders(across) for across in widths]


def atlas(**parameters: Any) -> Atlas:
    """Return the surface of :func:`frame`."""
    return boxes.boundary(*frame(**parameters))


def euler(**shape: Any) -> int:
    """Return the Euler characteristic of :func:`frame`."""
    return boxes.euler(frame(**shape)[0])


FAMILY = charted(
    "lattice",
    "Lattice",
    atlas,
    {"columns": 1, "rows": 1, "layers": 1, "strut": SHORTEST, "form": 0},
    euler_characteristic=euler,
    most={"columns": 3, "rows": 3, "layers": 3, "strut": 1.0},
)
