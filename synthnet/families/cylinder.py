"""Closed cylinders (paper §C: radius 1, log-normal height)."""

from synthnet.families import primitives
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(*, radius: float, height: float, resolution: int, split: int) -> Mesh:
    """Open3D's cylinder, both caps included; each cap is one fan of triangles."""
    return primitives.cylinder(radius=radius, height=height, resolution=resolution, split=split)


FAMILY = Family(
    name="cylinder",
    title="Cylinder",
    surface=surface,
    least={"radius": POSITIVE, "height": POSITIVE, "resolution": 3, "split": 1},
    euler_characteristic=2,
)
