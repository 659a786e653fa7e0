"""Closed cylinders (of 2.0), all vertices on the smooth cylinder."""

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Corner, turned


def atlas(*, radius: float, height: float, **_: object) -> Atlas:
    """Cylinder about the z axis from z = 0, with both discs."""
    return turned(_profile(radius, height), [1, rows(height, radius), 1])


def limit(k: int, *, radius: float, height: float, **_: object) -> Floats:
    """Spectrum of the smooth cylinder with its discs."""
    return limits.of_corners(_profile(radius, height), k)


def _profile(radius: float, height: float) -> list[Corner]:
    return [(0, 0), (radius, 0), (radius, height), (0, height)]


LEAST = {"radius": POSITIVE, "height": POSITIVE}
FAMILY = charted("capped_cylinder", "Capped cylinder", atlas, LEAST, limit=limit)
