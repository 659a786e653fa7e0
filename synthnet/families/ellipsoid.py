"""Ellipsoids (of 2.0), from nearly spheres to discs and needles."""

import numpy as np

from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.radial import radial


def atlas(*, a: float, b: float, c: float) -> Atlas:
    """Half axes a, b and c along x, y and z."""
    sphere = radial(lambda directions: np.ones(len(directions)))
    return sphere.put_through(lambda points: points * [a, b, c])


FAMILY = charted("ellipsoid", "Ellipsoid", atlas, {"a": POSITIVE, "b": POSITIVE, "c": POSITIVE})
