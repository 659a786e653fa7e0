"""Spheres by latitude and longitude (paper §C: radius 1)."""

from synthnet.families import primitives
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(*, radius: float, resolution: int) -> Mesh:
    """Open3D's sphere: two poles and ``resolution − 1`` circles of ``2·resolution`` points."""
    return primitives.sphere(radius=radius, resolution=resolution)


FAMILY = Family(
    name="sphere",
    title="Sphere",
    surface=surface,
    least={"radius": POSITIVE, "resolution": 2},
    euler_characteristic=2,
)
