"""Plates with a grid of round holes, the bars between them thick or thin."""

from typing import Any

import numpy as np

from synthnet.families.atlas import Atlas, borders
from synthnet.families.charted import charted
from synthnet.families.family import SHORTEST
from synthnet.families.plates import Plate

DRILLED = 0.75  # of the cells, about
SMALLEST = 0.5  # hole of a plate, over its largest


def plate(*, columns: int, rows: int, hole: float, thickness: float, form: int) -> Plate:
    """Return a plate of cells of about unit size; the middle one of the grid has a hole.

    ``hole`` is the radius of the largest holes over the largest there is room for; ``form`` is the
    seed of the cells' sizes, of which have holes, and of how large these are.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    x, y = (borders(1 + 0.5 * (rng.random(n) - 0.5)) for n in (columns, rows))
    drilled = rng.random((columns, rows)) < DRILLED
    drilled[columns // 2, rows // 2] = True
    room = np.minimum(np.diff(x)[:, None], np.diff(y)) / 2
    sizes = SMALLEST + (1 - SMALLEST) * rng.random((columns, rows))
    return Plate(x, y, np.where(drilled, hole * room * sizes, 0.0), thickness)


def atlas(**parameters: Any) -> Atlas:
    """Return the surface of :func:`plate`."""
    return plate(**parameters).atlas()


def euler(**shape: Any) -> int:
    """Return 2 − 2g for g holes."""
    return plate(**shape).euler_characteristic


FAMILY = charted(
    "perforated_plate",
    "Perforated plate",
    atlas,
    {"columns": 1, "rows": 1, "hole": SHORTEST, "thickness": SHORTEST, "form": 0},
    euler_characteristic=euler,
    most={"columns": 6, "rows": 6, "hole": 0.95},
)
