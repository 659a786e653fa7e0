"""Möbius bands, of one side and one boundary curve."""

import math

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, rectangle, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE


def atlas(*, width: float, half_turns: int) -> Atlas:
    """Band about the unit circle that makes an odd number of half turns on the way round.

    Raises
    ------
    ValueError
        If the number is even: that band has two sides.
    """
    if half_turns % 2 == 0:
        raise ValueError(f"mobius_band: half_turns must be odd, got {half_turns}")

    def chart(_: Int64s, u: Floats) -> Floats:
        around, across = u.T
        turned = half_turns * around / 2
        out = 1 + across * np.cos(turned)
        return np.stack(
            [out * np.cos(around), out * np.sin(around), across * np.sin(turned)], axis=1
        )

    cells = max(6, rows(2 * math.pi, width, most=24))
    patches = rectangle(
        np.linspace(0, 2 * math.pi, cells + 1), np.linspace(-width / 2, width / 2, 3)
    )
    return Atlas(patches, np.zeros(len(patches), dtype=np.int64), chart)


FAMILY = charted(
    "mobius_band",
    "Möbius band",
    atlas,
    {"width": POSITIVE, "half_turns": 1},
    euler_characteristic=0,
    boundaries=1,
    orientable=False,
    most={"width": 1.2, "half_turns": 5},
)
