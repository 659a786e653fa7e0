"""Prisms over random star-shaped polygons: sharp edges, corners in and out."""

import math

import numpy as np

from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import prism


def atlas(*, corners: int, depth: float, height: float, form: int) -> Atlas:
    """Prism over a polygon with corners at equal angles, 1 − depth to 1 from the origin.

    ``form`` is the seed of their distances. Its triangles meet at the origin; each side is
    cut in two, so that a triangle has but one corner of the polygon.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    angles = 2 * math.pi * np.arange(corners) / corners
    distances = 1 - depth * rng.random(corners)
    polygon = distances[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    middles = (polygon + np.roll(polygon, -1, axis=0)) / 2
    outline = np.stack([polygon, middles], axis=1).reshape(-1, 2)
    ahead = np.roll(outline, -1, axis=0)
    patches = np.stack([np.zeros_like(outline), outline, ahead], axis=1)
    walls = np.repeat(np.arange(corners), 2)
    return prism(patches, outline, height, 1.0, walls.tolist(), polygon)


FAMILY = charted(
    "extruded_star",
    "Extruded star",
    atlas,
    {"corners": 3, "depth": 0.0, "height": POSITIVE, "form": 0},
    most={"corners": 12, "depth": 0.8},
)
