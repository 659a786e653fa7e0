"""Closed cylinders (of 2.0), all vertices on the smooth cylinder."""

import numpy as np
from numpy.typing import NDArray

from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Piece, revolution, straight

SECTORS = 6


def atlas(*, radius: float, height: float, **_: object) -> Atlas:
    """Cylinder about the z axis from z = 0, with both discs."""
    return revolution(
        [
            Piece("base", straight((0, 0), (radius, 0))),
            Piece("band", straight((radius, 0), (radius, height)), rows(height, radius)),
            Piece("tip", straight((0, height), (radius, height))),
        ],
        SECTORS,
    )


def limit(k: int, *, radius: float, height: float, **_: object) -> NDArray[np.float64]:
    """Spectrum of the smooth cylinder with its discs."""
    disc = limits.line(0, radius), limits.line(radius, 0)
    return limits.of_revolution([disc[0], limits.line(radius, radius, height), disc[1]], k)


LEAST = {"radius": POSITIVE, "height": POSITIVE}
FAMILY = charted("capped_cylinder", "Capped cylinder", atlas, LEAST, limit=limit)
