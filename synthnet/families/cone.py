"""Closed cones (paper §C: radius 1, log-normal height)."""

import numpy as np
from numpy.typing import NDArray

from synthnet.families import circular_cone, limits, primitives
from synthnet.families.atlas import Atlas
from synthnet.families.family import POSITIVE, Family
from synthnet.mesh.open3d import subdivide
from synthnet.types import Mesh


def surface(
    *, radius: float, height: float, resolution: int, split: int, subdivisions: int
) -> Mesh:
    """Open3D's cone, base disc included, each triangle split into 4 ``subdivisions`` times."""
    cone = primitives.cone(radius=radius, height=height, resolution=resolution, split=split)
    return subdivide(cone, subdivisions)


def limit(k: int, *, radius: float, height: float, **_: float) -> NDArray[np.float64]:
    """Spectrum of the smooth cone with its base."""
    return limits.of_revolution([limits.line(0, radius), limits.line(radius, 0, height)], k)


def atlas(*, radius: float, height: float, **_: float) -> Atlas:
    """Return the smooth cone in patches."""
    return circular_cone.atlas(radius=radius, height=height)


FAMILY = Family(
    name="cone",
    title="Cone",
    surface=surface,
    least={
        "radius": POSITIVE,
        "height": POSITIVE,
        "resolution": 3,
        "split": 1,
        "subdivisions": 0,
    },
    euler_characteristic=2,
    limit=limit,
    atlas=atlas,
)
