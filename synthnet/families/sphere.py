"""Spheres by latitude and longitude (paper §C: radius 1)."""

import numpy as np
from numpy.typing import NDArray

from synthnet.families import conforming_split_sphere, limits, primitives
from synthnet.families.atlas import Atlas
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(*, radius: float, resolution: int) -> Mesh:
    """Open3D's sphere: two poles and ``resolution − 1`` circles of ``2·resolution`` points."""
    return primitives.sphere(radius=radius, resolution=resolution)


def limit(k: int, *, radius: float, **_: float) -> NDArray[np.float64]:
    """Spectrum of the smooth sphere."""
    return limits.of_sphere(radius, k)


def atlas(*, radius: float, **_: float) -> Atlas:
    """Return the smooth sphere in patches."""
    return conforming_split_sphere.atlas(radius=radius)


FAMILY = Family(
    name="sphere",
    title="Sphere",
    surface=surface,
    least={"radius": POSITIVE, "resolution": 2},
    euler_characteristic=2,
    limit=limit,
    atlas=atlas,
)
