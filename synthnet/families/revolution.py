"""Atlases of surfaces of revolution, piece by piece of their profile."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, glue_charts, rectangle

Profile: TypeAlias = Callable[[Floats], tuple[Floats, Floats]]
Corner: TypeAlias = tuple[float, float]  # radius and height

SECTORS = 6


@dataclass(frozen=True, slots=True)
class Piece:
    """A smooth piece of a profile.

    Parameters
    ----------
    kind : {"base", "band", "tip"}
        ``base`` begins on the axis, ``tip`` ends there, ``band`` does not meet it.
    profile : callable
        From s in [0, 1] to distance from the axis and height. Pieces follow each other with
        the surface's outside on the right: from the lowest point outwards and up. s grows
        that way; but on a tip s is 0 on the axis.
    cells : int
        Rows of patches along the piece.
    """

    kind: Literal["base", "band", "tip"]
    profile: Profile
    cells: int = 1


def turned(corners: Sequence[Corner], cells: Sequence[int], sectors: int = SECTORS) -> Atlas:
    """Return the atlas of a surface whose profile is straight from each corner to the next.

    Corners follow each other as pieces do; ``cells`` are the rows of patches between each two.
    """
    pieces = []
    for (start, stop), count in zip(pairwise(corners), cells, strict=True):
        if stop[0] == 0:
            pieces.append(Piece("tip", _straight(stop, start), count))
        else:
            kind: Literal["base", "band"] = "base" if start[0] == 0 else "band"
            pieces.append(Piece(kind, _straight(start, stop), count))
    return revolution(pieces, sectors)


def _straight(start: Corner, stop: Corner) -> Profile:
    (r0, z0), (r1, z1) = start, stop
    return lambda s: (r0 + (r1 - r0) * s, z0 + (z1 - z0) * s)


def revolution(pieces: Sequence[Piece], sectors: int = SECTORS) -> Atlas:
    """Return the atlas of the surface about the z axis.

    Coordinates are (θ, s) on a band, (s, sθ) on a piece that meets the axis, so that the
    point there has but one pair.
    """
    theta = np.linspace(0, 2 * math.pi, sectors + 1)
    patches = [_patches(piece, theta) for piece in pieces]

    def chart(charts: Int64s, u: Floats) -> Floats:
        points = np.empty((len(u), 3))
        for number, piece in enumerate(pieces):
            here = charts == number
            first, second = u[here].T
            angle, s = first, second
            if piece.kind != "band":
                angle = np.divide(second, first, out=np.zeros_like(first), where=first > 0)
                s = first
            radius, height = piece.profile(s)
            points[here] = np.stack(
                [radius * np.cos(angle), radius * np.sin(angle), height + 0 * s], axis=1
            )
        return points

    return Atlas(*glue_charts(patches), chart)


def _patches(piece: Piece, theta: Floats) -> Floats:
    s = np.linspace(0, 1, piece.cells + 1)
    if piece.kind == "band":
        return rectangle(theta, s)
    left, right = theta[:-1], theta[1:]
    ones = np.full_like(left, s[1])
    fan = np.stack([_polar(0 * left, left), _polar(ones, right), _polar(ones, left)], axis=1)
    rest = rectangle(theta, s[1:])
    corners = np.concatenate([fan, _polar(rest[:, :, 1], rest[:, :, 0])])
    return corners[:, ::-1] if piece.kind == "tip" else corners


def _polar(s: Floats, theta: Floats) -> Floats:
    return np.stack([s, s * theta], axis=-1)
