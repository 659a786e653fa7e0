"""Cylinders without discs, with two boundary circles."""

import numpy as np

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import turned


def atlas(*, height: float) -> Atlas:
    """Cylinder of radius 1 about the z axis, from z = 0."""
    sectors = max(6, rows(2 * np.pi, height, most=24))
    row = rows(height, 2 * np.pi / sectors)
    return turned([(1, 0), (1, height)], [row], sectors)


def limit(k: int, *, height: float, **_: object) -> Floats:
    """Spectrum of the cylinder with Neumann's condition at both ends."""
    return limits.of_open_cylinder(1.0, height, k)


FAMILY = charted(
    "open_cylinder",
    "Open cylinder",
    atlas,
    {"height": POSITIVE},
    euler_characteristic=0,
    boundaries=2,
    limit=limit,
)
