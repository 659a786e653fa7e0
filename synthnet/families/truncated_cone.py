"""Truncated cones with both discs (of 2.0)."""

import math

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Corner, turned


def atlas(*, radius: float, height: float, scaling: float, **_: object) -> Atlas:
    """Frustum about the z axis from z = 0; the upper disc has radius·scaling."""
    top = radius * scaling
    side = math.hypot(height, top - radius)
    return turned(_profile(radius, top, height), [1, rows(side, (radius + top) / 2), 1])


def limit(k: int, *, radius: float, height: float, scaling: float, **_: object) -> Floats:
    """Spectrum of the smooth frustum with its discs."""
    return limits.of_corners(_profile(radius, radius * scaling, height), k)


def _profile(radius: float, top: float, height: float) -> list[Corner]:
    return [(0, 0), (radius, 0), (top, height), (0, height)]


FAMILY = charted(
    "truncated_cone",
    "Truncated cone",
    atlas,
    {"radius": POSITIVE, "height": POSITIVE, "scaling": POSITIVE},
    limit=limit,
)
