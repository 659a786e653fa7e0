"""Superquadrics: between box, ball and octahedron."""

import numpy as np

from synthnet.families.atlas import Atlas, Floats
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.radial import radial


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

    return radial(distance, lambda points: points * [a, b, c])


FAMILY = charted(
    "superquadric",
    "Superquadric",
    atlas,
    {"a": POSITIVE, "b": POSITIVE, "c": POSITIVE, "east": 0.2, "north": 0.2},
    most={"east": 2.0, "north": 2.0},
)
