"""Rectangles rolled up without stretching: the spectrum is that of the flat rectangle."""

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families import flat_rectangle
from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE


def atlas(*, width: float, height: float, angle: float) -> Atlas:
    """Part of a cylinder about the y axis, ``angle`` radians of it over its width."""
    radius = width / angle

    def chart(_: Int64s, u: Floats) -> Floats:
        turn = u[:, 0] / radius
        return np.stack([radius * np.sin(turn), u[:, 1], radius * np.cos(turn)], axis=1)

    patches = flat_rectangle.patches(width, height)
    return Atlas(patches, np.zeros(len(patches), dtype=np.int64), chart)


FAMILY = charted(
    "rolled_sheet",
    "Rolled sheet",
    atlas,
    {"width": POSITIVE, "height": POSITIVE, "angle": POSITIVE},
    euler_characteristic=1,
    boundaries=1,
    most={"angle": 6.0},
    limit=flat_rectangle.limit,  # it is isometric to that rectangle
)
