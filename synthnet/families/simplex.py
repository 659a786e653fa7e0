"""Tetrahedra with one corner moved at will (of 2.0)."""

import numpy as np

from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import polyhedron
from synthnet.families.tetrahedron import FACES


def atlas(*, width: float, height: float, depth: float, lean: float) -> Atlas:
    """Corners (0,0,0), (w,0,0), (0,h,0) and (lean·w, lean·h, d)."""
    corners = np.array([[0, 0, 0], [width, 0, 0], [0, height, 0], [0, 0, depth]], dtype=float)
    corners[3, :2] = lean * width, lean * height
    return polyhedron(*(corners[face][None] for face in FACES))


FAMILY = charted(
    "simplex",
    "Leaning tetrahedron",
    atlas,
    {"width": POSITIVE, "height": POSITIVE, "depth": POSITIVE, "lean": 0.0},
)
