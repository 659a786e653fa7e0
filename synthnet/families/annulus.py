"""Flat annuli, with two boundary circles."""

import math

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import turned


def atlas(*, inner: float) -> Atlas:
    """Plane between the circles of radius ``inner`` and 1."""
    around = math.pi * (1 + inner)
    sectors = max(6, rows(around, 1 - inner, most=24))
    row = rows(1 - inner, around / sectors)
    return turned([(1, 0), (inner, 0)], [row], sectors)


def limit(k: int, *, inner: float, **_: object) -> Floats:
    """Spectrum of the annulus with Neumann's condition."""
    return limits.of_revolution([limits.line(inner, 1)], k)


FAMILY = charted(
    "annulus",
    "Annulus",
    atlas,
    {"inner": POSITIVE},
    euler_characteristic=0,
    boundaries=2,
    most={"inner": 0.9},
    limit=limit,
)
