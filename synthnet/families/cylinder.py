"""Closed cylinders (paper §C: radius 1, log-normal height)."""

from synthnet.families import capped_cylinder, primitives
from synthnet.families.family import Family

FAMILY = Family(
    name="cylinder",
    title="Cylinder",
    surface=primitives.cylinder,
    least={**capped_cylinder.LEAST, "resolution": 3, "split": 1},
    limit=capped_cylinder.limit,
    atlas=capped_cylinder.atlas,
)
