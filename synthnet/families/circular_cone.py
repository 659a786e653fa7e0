"""Closed cones (of 2.0), all vertices on the smooth cone."""

import math

import numpy as np
from numpy.typing import NDArray

from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Piece, revolution, straight

SECTORS = 6


def atlas(*, radius: float, height: float, **_: object) -> Atlas:
    """Base disc on z = 0, apex at (0, 0, height)."""
    side = math.hypot(radius, height)
    lateral = rows(side, radius)
    return revolution(
        [
            Piece("base", straight((0, 0), (radius, 0))),
            Piece("tip", straight((0, height), (radius, 0)), lateral),
        ],
        SECTORS,
    )


def limit(k: int, *, radius: float, height: float, **_: object) -> NDArray[np.float64]:
    """Spectrum of the smooth cone with its base."""
    return limits.of_revolution([limits.line(0, radius), limits.line(radius, 0, height)], k)


LEAST = {"radius": POSITIVE, "height": POSITIVE}
FAMILY = charted("circular_cone", "Circular cone", atlas, LEAST, limit=limit)
