"""Superquadrics: between box, ball and octahedron."""

import math

import numpy as np

from synthnet.arrays import Floats
from synthnet.families.atlas import Atlas, rectangle
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import flat
from synthnet.families.radial import radial

SHRINK = 0.2  # a patch at a crease is so much narrower than its neighbour
CREASE = 1e-3


def atlas(*, a: float, b: float, c: float, east: float, north: float) -> Atlas:
    r"""Surface :math:`(|x/a|^{2/e} + |y/b|^{2/e})^{e/n} + |z/c|^{2/n} = 1`.

    References
    ----------
    A. H. Barr, "Superquadrics and angle-preserving transformations", IEEE CG&A 1 (1981).
    """

    def distance(directions: Floats) -> Floats:
        x, y, z = np.abs(directions).T
        inside = (x ** (2 / east) + y ** (2 / east)) ** (east / north) + z ** (2 / north)
        return np.asarray(inside ** (-north / 2))

    return radial(distance).put_through(lambda points: points * [a, b, c])


def pieces(*, a: float, b: float, c: float, east: float, north: float) -> Atlas:
    """Return the surface in patches that are smooth within.

    It has creases where a coordinate is 0, so patches of directions end there, and are the
    smaller the nearer: what a crease is to a polynomial falls with the power 4 / e − 1 of the
    width of the last one.
    """
    bent = (max(east, north), max(east, north), north)
    lines = []
    for exponent in bent:
        width = CREASE ** (1 / (4 / exponent - 1))
        count = max(1, math.ceil(math.log(width) / math.log(SHRINK)))
        positive = SHRINK ** np.arange(count, -1, -1.0)
        lines.append(np.concatenate([-positive[::-1], [0.0], positive]))
    sides = []
    for axis in range(3):
        sheet = rectangle(lines[(axis + 1) % 3], lines[(axis + 2) % 3])
        sides += [flat(sheet, sign, axis=axis) for sign in (-1.0, 1.0)]
    corners = np.concatenate(sides)
    whole = atlas(a=a, b=b, c=c, east=east, north=north)
    return Atlas(corners, np.zeros(len(corners), dtype=np.int64), whole.chart)


FAMILY = charted(
    "superquadric",
    "Superquadric",
    atlas,
    {"a": POSITIVE, "b": POSITIVE, "c": POSITIVE, "east": 0.2, "north": 0.2},
    most={"east": 2.0, "north": 2.0},
    pieces=pieces,
)
