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


def at_level(level: int, *, radius: float, height: float, resolution: int, split: int) -> Mesh:
    """Cylinder's mesh with the new vertices of side and rims moved out to the radius."""
    mesh = surface(radius=radius, height=height, resolution=resolution, split=split)
    return primitives.refine_lateral(mesh, level, lambda z: np.full_like(z, radius))


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
    at_level=at_level,
    least={"radius": POSITIVE, "height": POSITIVE, "resolution": 3, "split": 1},
    euler_characteristic=2,
    limit=limit,
    atlas=atlas,
    least_levels=2,
)
