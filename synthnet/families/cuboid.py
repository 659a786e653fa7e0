"""Rectangular boxes (of 2.0), their faces cut in about square patches."""

import numpy as np

from synthnet.families.atlas import Atlas, rectangle
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import flat, lines, polyhedron


def atlas(*, width: float, height: float, depth: float, **_: object) -> Atlas:
    """Box [0, width] × [0, height] × [0, depth]."""
    sizes = (width, height, depth)
    cell = float(np.cbrt(width * height * depth))
    x = [lines(size, cell) for size in sizes]
    faces = []
    for axis in range(3):
        sheet = rectangle(x[(axis + 1) % 3], x[(axis + 2) % 3])
        faces += [flat(sheet, axis=axis, turned=True), flat(sheet, sizes[axis], axis=axis)]
    return polyhedron(*faces)


LEAST = {"width": POSITIVE, "height": POSITIVE, "depth": POSITIVE}
FAMILY = charted("cuboid", "Cuboid", atlas, LEAST)
