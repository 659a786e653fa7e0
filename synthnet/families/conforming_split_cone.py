"""Cones of two resolutions in one conforming mesh: what 1.0's split cones were to be."""

from synthnet.families import circular_cone
from synthnet.families.charted import charted

FAMILY = charted(
    "conforming_split_cone",
    "Conforming split cone",
    circular_cone.atlas,
    circular_cone.LEAST,
    limit=circular_cone.limit,
    halves=True,
)
