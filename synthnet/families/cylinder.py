"""Closed cylinders (paper §C: radius 1, log-normal height)."""

import numpy as np
from numpy.typing import NDArray

from synthnet.families import capped_cylinder, limits, primitives
from synthnet.families.atlas import Atlas
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(*, radius: float, height: float, resolution: int, split: int) -> Mesh:
    """Open3D's cylinder, both caps included; each cap is one fan of triangles."""
    return primitives.cylinder(radius=radius, height=height, resolution=resolution, split=split)


def limit(k: int, *, radius: float, height: float, **_: float) -> NDArray[np.float64]:
    """Spectrum of the smooth cylinder with its two discs."""
    profile = [limits.line(0, radius), limits.line(radius, radius, height), limits.line(radius, 0)]
    return limits.of_revolution(profile, k)


def atlas(*, radius: float, height: float, **_: float) -> Atlas:
    """Return the smooth cylinder in patches."""
    return capped_cylinder.atlas(radius=radius, height=height)


FAMILY = Family(
    name="cylinder",
    title="Cylinder",
    surface=surface,
    least={"radius": POSITIVE, "height": POSITIVE, "resolution": 3, "split": 1},
    euler_characteristic=2,
    limit=limit,
    atlas=atlas,
)
