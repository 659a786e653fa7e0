"""Flat rectangles, with boundary."""

from synthnet.arrays import Floats
from synthnet.families import limits
from synthnet.families.atlas import Atlas, rectangle
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import flat, lines, polyhedron


def atlas(*, width: float, height: float) -> Atlas:
    """Rectangle [0, width] × [0, height] in the plane z = 0."""
    return polyhedron(flat(patches(width, height)))


def patches(width: float, height: float) -> Floats:
    """Return about square patches of the rectangle, shape (p, 3, 2)."""
    cell = min(width, height)
    return rectangle(lines(width, cell), lines(height, cell))


def limit(k: int, *, width: float, height: float, **_: object) -> Floats:
    """Spectrum of the rectangle with Neumann's condition."""
    return limits.of_rectangle(width, height, k)


FAMILY = charted(
    "flat_rectangle",
    "Flat rectangle",
    atlas,
    {"width": POSITIVE, "height": POSITIVE},
    euler_characteristic=1,
    boundaries=1,
    limit=limit,
)
