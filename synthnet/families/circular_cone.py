"""Closed cones (of 2.0), all vertices on the smooth cone."""

import math

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Corner, turned


def atlas(*, radius: float, height: float, **_: object) -> Atlas:
    """Base disc on z = 0, apex at (0, 0, height)."""
    side = math.hypot(radius, height)
    return turned(_profile(radius, height), [1, rows(side, radius)])


def limit(k: int, *, radius: float, height: float, **_: object) -> Floats:
    """Spectrum of the smooth cone with its base."""
    return limits.of_corners(_profile(radius, height), k)


def _profile(radius: float, height: float) -> list[Corner]:
    return [(0, 0), (radius, 0), (0, height)]


LEAST = {"radius": POSITIVE, "height": POSITIVE}
FAMILY = charted("circular_cone", "Circular cone", atlas, LEAST, limit=limit)
