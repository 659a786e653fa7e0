"""Rectangles rolled up without stretching: the spectrum of the flat one, in another place."""

import numpy as np
from numpy.typing import NDArray

from synthnet import limits
from synthnet.families.atlas import Atlas, Floats, Integers, rectangle
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import lines


def atlas(*, width: float, height: float, angle: float) -> Atlas:
    """Part of a cylinder about the y axis, ``angle`` radians of it over its width."""
    radius = width / angle

    def chart(_: Integers, u: Floats) -> Floats:
        turn = u[:, 0] / radius
        return np.stack([radius * np.sin(turn), u[:, 1], radius * np.cos(turn)], axis=1)

    cell = min(width, height)
    patches = rectangle(lines(width, cell), lines(height, cell))
    return Atlas(patches, np.zeros(len(patches), dtype=np.int64), chart)


def limit(k: int, *, width: float, height: float, **_: object) -> NDArray[np.float64]:
    """Spectrum of the flat rectangle, to which the sheet is isometric."""
    return limits.of_rectangle(width, height, k)


FAMILY = charted(
    "rolled_sheet",
    "Rolled sheet",
    atlas,
    {"width": POSITIVE, "height": POSITIVE, "angle": POSITIVE},
    euler_characteristic=1,
    boundaries=1,
    most={"angle": 6.0},
    limit=limit,
)
