"""Rectangular prisms (paper §C: width 1, log-normal height and depth)."""

from synthnet.families import cuboid, primitives
from synthnet.families.family import Family
from synthnet.mesh.open3d import subdivide
from synthnet.types import Mesh


def surface(*, width: float, height: float, depth: float, subdivisions: int) -> Mesh:
    """Open3D's box of 12 triangles, each split into 4 ``subdivisions`` times."""
    return subdivide(primitives.box(width=width, height=height, depth=depth), subdivisions)


FAMILY = Family(
    name="rectangular_prism",
    title="Rectangular prism",
    surface=surface,
    least={**cuboid.LEAST, "subdivisions": 0},
    atlas=cuboid.atlas,
)
