"""Caps of the unit sphere, the hemisphere among them, with boundary."""

import math

import numpy as np

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.limits import Arc
from synthnet.families.revolution import Piece, revolution


def atlas(*, angle: float) -> Atlas:
    """Points of the unit sphere within ``angle`` radians of the lowest one."""
    row = rows(angle, math.pi / 4)
    return revolution([Piece("base", lambda s: (np.sin(angle * s), -np.cos(angle * s)), row)])


def limit(k: int, *, angle: float, **_: object) -> Floats:
    """Spectrum of the cap with Neumann's condition."""
    return limits.of_revolution([Arc(angle, np.sin)], k)


FAMILY = charted(
    "spherical_cap",
    "Spherical cap",
    atlas,
    {"angle": 0.1},
    euler_characteristic=1,
    boundaries=1,
    most={"angle": 3.0},
    limit=limit,
)
