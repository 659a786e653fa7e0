"""Rectangular boxes (of 2.0), their faces cut in about square patches."""

import numpy as np

from synthnet.families.atlas import Atlas, Floats, rectangle
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import lines, polyhedron


def atlas(*, width: float, height: float, depth: float, **_: object) -> Atlas:
    """Box [0, width] × [0, height] × [0, depth]."""
    sizes = (width, height, depth)
    cell = float(np.cbrt(width * height * depth))
    x = [lines(size, cell) for size in sizes]
    faces = []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for position, outward in ((0.0, False), (sizes[axis], True)):
            faces.append(_face(rectangle(x[first], x[second]), axis, position, outward))
    return polyhedron(*faces)


def _face(patches: Floats, axis: int, position: float, outward: bool) -> Floats:
    points = np.empty((len(patches), 3, 3))
    points[:, :, axis] = position
    points[:, :, (axis + 1) % 3], points[:, :, (axis + 2) % 3] = np.moveaxis(patches, 2, 0)
    return points if outward else points[:, ::-1]


LEAST = {"width": POSITIVE, "height": POSITIVE, "depth": POSITIVE}
FAMILY = charted("cuboid", "Cuboid", atlas, LEAST)
