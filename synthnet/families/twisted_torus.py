"""Tori with an elliptic tube that turns about its core."""

import math

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, rectangle, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE


def atlas(*, tube_radius: float, flatness: float, half_turns: int) -> Atlas:
    """Tube about the unit circle; its ellipse turns by half_turns·π on the way round."""

    def chart(_: Int64s, u: Floats) -> Floats:
        around, tube = u.T
        turned = half_turns * around / 2
        p, q = tube_radius * np.cos(tube), tube_radius * flatness * np.sin(tube)
        out = p * np.cos(turned) - q * np.sin(turned)
        up = p * np.sin(turned) + q * np.cos(turned)
        return np.stack([(1 + out) * np.cos(around), (1 + out) * np.sin(around), up], axis=1)

    cells = rows(2 * math.pi, 2 * math.pi * tube_radius / 4)
    patches = rectangle(
        np.linspace(0, 2 * math.pi, max(4, cells, 3 * half_turns) + 1),
        np.linspace(0, 2 * math.pi, 5),
    )
    return Atlas(patches, np.zeros(len(patches), dtype=np.int64), chart)


FAMILY = charted(
    "twisted_torus",
    "Twisted torus",
    atlas,
    {"tube_radius": POSITIVE, "flatness": POSITIVE, "half_turns": 0},
    euler_characteristic=0,
    most={"tube_radius": 0.9, "flatness": 1.0, "half_turns": 12},
)
