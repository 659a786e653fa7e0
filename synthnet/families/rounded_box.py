"""Boxes with rounded edges and corners."""

from __future__ import annotations

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, glue_charts, rectangle, rows
from synthnet.families.charted import charted
from synthnet.families.family import SHORTEST

SIGNS = (1.0, -1.0)
AXES = np.eye(3)


def atlas(*, width: float, height: float, depth: float, fillet: float) -> Atlas:
    """Return a box with edges of radius ``fillet``, over half of its shortest side.

    Every point is so far from a smaller box, straight out. A chart's coordinates are a point of
    that box and a direction: all of a face have one direction, all of a corner one point.
    """
    half = np.array([width, height, depth]) / 2
    radius = fillet * half.min()
    inner = half - radius
    cells = [rows(2 * length, float(half.mean()), 4) for length in inner]
    lines = [np.linspace(-length, length, n + 1) for length, n in zip(inner, cells, strict=True)]
    arc = np.array([0.0, 1.0])
    parts = []
    for axis in range(3):
        right, up = (axis + 1) % 3, (axis + 2) % 3
        for sign in SIGNS:  # a face
            sheet = rectangle(lines[right], lines[up])
            patches = np.zeros((*sheet.shape[:2], 6))
            patches[..., [right, up]] = sheet
            patches[..., axis] = sign * inner[axis]
            patches[..., 3 + axis] = sign
            parts.append(patches if sign > 0 else patches[:, ::-1])
            for other in SIGNS:  # an edge along the axis
                sheet = rectangle(arc, lines[axis])
                patches = np.zeros((*sheet.shape[:2], 6))
                patches[..., [axis, right, up]] = 0.0, sign * inner[right], other * inner[up]
                patches[..., axis] = sheet[..., 1]
                patches[..., 3 + right] = sign * (1 - sheet[..., 0])
                patches[..., 3 + up] = other * sheet[..., 0]
                parts.append(patches if sign == other else patches[:, ::-1])
    for signs in np.array(np.meshgrid(SIGNS, SIGNS, SIGNS)).reshape(3, -1).T:  # a corner
        point = np.broadcast_to(signs * inner, (3, 3))
        patch = np.hstack([point, signs * AXES])[None]
        parts.append(patch if signs.prod() > 0 else patch[:, ::-1])

    def chart(_: Int64s, u: Floats) -> Floats:
        directions = u[:, 3:] / np.linalg.norm(u[:, 3:], axis=1, keepdims=True)
        return np.asarray(u[:, :3] + radius * directions)

    return Atlas(*glue_charts(parts), chart)


FAMILY = charted(
    "rounded_box",
    "Rounded box",
    atlas,
    {"width": SHORTEST, "height": SHORTEST, "depth": SHORTEST, "fillet": SHORTEST},
    most={"fillet": 0.95},
)
