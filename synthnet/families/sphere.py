"""Spheres by latitude and longitude (paper §C: radius 1)."""

from synthnet.families import conforming_split_sphere, primitives
from synthnet.families.family import POSITIVE, Family

FAMILY = Family(
    name="sphere",
    title="Sphere",
    surface=primitives.sphere,
    least={"radius": POSITIVE, "resolution": 2},
    limit=conforming_split_sphere.limit,
    atlas=conforming_split_sphere.atlas,
)
