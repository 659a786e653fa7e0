"""Cones with the tip pushed inwards (of 2.0): isometric to the cone."""

import math

from synthnet.families import circular_cone
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.revolution import turned


def atlas(*, radius: float, height: float, flip: float) -> Atlas:
    """Cone whose part above z = flip·height is reflected in that plane."""
    plane, rim = flip * height, (1 - flip) * radius
    side = math.hypot(radius, height)
    corners = [(0, 0), (radius, 0), (rim, plane), (0, 2 * plane - height)]
    return turned(corners, [1, rows(flip * side, radius), rows((1 - flip) * side, radius)])


FAMILY = charted(
    "dented_cone",
    "Dented cone",
    atlas,
    {**circular_cone.LEAST, "flip": 0.51},
    most={"flip": 0.95},
    limit=circular_cone.limit,  # it is isometric to that cone
)
