"""Flat elliptic discs, with boundary."""

from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import turned


def atlas(*, flatness: float) -> Atlas:
    """Ellipse of half axes 1 and ``flatness`` in the plane z = 0."""
    disc = turned([(1, 0), (0, 0)], [1])
    return disc.put_through(lambda points: points * [1, flatness, 1])


FAMILY = charted(
    "elliptic_disc",
    "Elliptic disc",
    atlas,
    {"flatness": POSITIVE},
    euler_characteristic=1,
    boundaries=1,
    most={"flatness": 1.0},
)
