"""Spheres of two resolutions in one conforming mesh, every vertex on the sphere."""

import numpy as np

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.radial import radial


def atlas(*, radius: float, **_: object) -> Atlas:
    """Sphere about the origin."""
    return radial(lambda directions: np.full(len(directions), radius))


def limit(k: int, *, radius: float, **_: object) -> Floats:
    """Spectrum of the smooth sphere."""
    return limits.of_sphere(radius, k)


FAMILY = charted(
    "conforming_split_sphere",
    "Conforming split sphere",
    atlas,
    {"radius": POSITIVE},
    limit=limit,
    halves=True,
)
