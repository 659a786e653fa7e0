"""Closed tubes, elliptic, twisted and bent, with round ends."""

import numpy as np

from synthnet.arrays import Floats
from synthnet.families.atlas import Atlas, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.revolution import Piece, revolution


def atlas(*, length: float, flatness: float, turns: float, bend: float) -> Atlas:
    """Tube of radius 1 and flatness·1 about an arc of ``length`` that bends by ``bend`` radians.

    Its ellipse makes so many turns on the way; the round ends are half ellipsoids.

    Raises
    ------
    ValueError
        If it bends by a radian or more for each unit of its length: then it cuts itself.
    """
    if bend >= length:
        raise ValueError(f"bent_tube: bend must be below length, {length}, got {bend}")
    quarter = np.pi / 2
    straight = revolution(
        [
            Piece("base", lambda s: (np.sin(quarter * s), -np.cos(quarter * s))),
            Piece("band", lambda s: (np.ones_like(s), length * s), rows(length, 1)),
            Piece("tip", lambda s: (np.sin(quarter * s), length + np.cos(quarter * s))),
        ]
    )
    curvature = bend / length

    def onto(points: Floats) -> Floats:
        x, y, z = points.T
        share = np.clip(z / length, 0, 1)
        angle = 2 * np.pi * turns * share**2 * (3 - 2 * share)  # no crease where the ends begin
        y = flatness * y
        x, y = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
        if curvature == 0:
            return np.stack([x, y, z], axis=1)
        along = np.clip(z, 0, length)
        beyond = z - along  # the ends go on straight
        turn, out = curvature * along, 1 / curvature - x
        return np.stack(
            [
                1 / curvature - out * np.cos(turn) + beyond * np.sin(turn),
                y,
                out * np.sin(turn) + beyond * np.cos(turn),
            ],
            axis=1,
        )

    return straight.put_through(onto)


FAMILY = charted(
    "bent_tube",
    "Bent tube",
    atlas,
    {"length": POSITIVE, "flatness": POSITIVE, "turns": 0.0, "bend": 0.0},
    most={"flatness": 1.0, "turns": 2.0, "bend": 4.5},
)
