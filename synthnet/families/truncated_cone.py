"""Truncated cones with both discs (of 2.0)."""

import math

import numpy as np
from numpy.typing import NDArray

from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Piece, revolution, straight

SECTORS = 6


def atlas(*, radius: float, height: float, scaling: float, **_: object) -> Atlas:
    """Frustum about the z axis from z = 0; the upper disc has radius·scaling."""
    top = radius * scaling
    side = math.hypot(height, top - radius)
    return revolution(
        [
            Piece("base", straight((0, 0), (radius, 0))),
            Piece("band", straight((radius, 0), (top, height)), rows(side, (radius + top) / 2)),
            Piece("tip", straight((0, height), (top, height))),
        ],
        SECTORS,
    )


def limit(
    k: int, *, radius: float, height: float, scaling: float, **_: object
) -> NDArray[np.float64]:
    """Spectrum of the smooth frustum with its discs."""
    top = radius * scaling
    profile = [limits.line(0, radius), limits.line(radius, top, height), limits.line(top, 0)]
    return limits.of_revolution(profile, k)


FAMILY = charted(
    "truncated_cone",
    "Truncated cone",
    atlas,
    {"radius": POSITIVE, "height": POSITIVE, "scaling": POSITIVE},
    limit=limit,
)
