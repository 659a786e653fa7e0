"""Closed cones (paper §C: radius 1, log-normal height)."""

from synthnet.families import circular_cone, primitives
from synthnet.families.family import Family
from synthnet.mesh.open3d import subdivide
from synthnet.types import Mesh


def surface(
    *, radius: float, height: float, resolution: int, split: int, subdivisions: int
) -> Mesh:
    """Open3D's cone, base disc included, each triangle split into 4 ``subdivisions`` times."""
    cone = primitives.cone(radius=radius, height=height, resolution=resolution, split=split)
    return subdivide(cone, subdivisions)


FAMILY = Family(
    name="cone",
    title="Cone",
    surface=surface,
    least={**circular_cone.LEAST, "resolution": 3, "split": 1, "subdivisions": 0},
    limit=circular_cone.limit,
    atlas=circular_cone.atlas,
)
