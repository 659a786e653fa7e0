"""Shafts: coaxial cylinders and cones with shoulders between them, some with a bore."""

import math
from itertools import pairwise

import numpy as np

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, borders, rows
from synthnet.families.charted import charted
from synthnet.families.revolution import Corner, turned

SLENDER = 0.8  # lengths and radii of steps are 10^-0.8 to 1
TAPERED = 0.3  # of the steps, about, have another radius at their end
BORE = (0.2, 0.8)  # radius of a bore over that of the thinnest step


def profile(*, steps: int, bore: int, form: int) -> list[Corner]:
    """Return the corners of the profile, (radius, height), from the lowest inside, and round.

    ``form`` is the seed of the steps' lengths and radii. Without a bore the profile begins and
    ends on the axis; with one it is closed: its last corner is the first again.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    radii, ends, lengths = 10 ** (-SLENDER * rng.random((3, steps)))
    ends = np.where(rng.random(steps) < TAPERED, ends, radii)
    share = BORE[0] + (BORE[1] - BORE[0]) * float(rng.random())
    inside = share * float(min(radii.min(), ends.min())) if bore else 0.0
    heights = borders(lengths)
    corners = [(inside, 0.0)]
    for low, high, bottom, top in zip(radii, ends, heights[:-1], heights[1:], strict=True):
        corners += [(float(low), float(bottom)), (float(high), float(top))]
    corners.append((inside, float(heights[-1])))
    return corners + corners[:1] * bore


def atlas(**parameters: int) -> Atlas:
    """Return the surface of :func:`profile` about the z axis."""
    corners = profile(**parameters)
    around = float(np.mean([radius for radius, _ in corners]))
    cells = [
        1 if 0 in (start[0], stop[0]) else rows(math.dist(start, stop), around)
        for start, stop in pairwise(corners)
    ]
    return turned(corners, cells)


def limit(k: int, *, steps: int, bore: int, form: int, **_: object) -> Floats:
    """Return the spectrum of the smooth shaft."""
    return limits.of_corners(profile(steps=steps, bore=bore, form=form), k, closed=bool(bore))


def euler(*, bore: int, **_: object) -> int:
    """Return 2, or 0 with a bore."""
    return 0 if bore else 2


FAMILY = charted(
    "shaft",
    "Shaft",
    atlas,
    {"steps": 1, "bore": 0, "form": 0},
    euler_characteristic=euler,
    most={"steps": 6, "bore": 1},
    limit=limit,
)
