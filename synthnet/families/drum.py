"""The two drums that sound alike, flat, with boundary.

Seven copies of a triangle, each the mirror image of its neighbour in their common side, put
together in two ways: the two polygons are not congruent and have the same spectrum, with
Neumann's condition too. So have their linear finite elements, if every triangle is cut alike.

References
----------
C. Gordon, D. Webb, S. Wolpert, "One cannot hear the shape of a drum", Bull. AMS 27 (1992).
P. Buser, J. Conway, P. Doyle, K.-D. Semmler, "Some planar isospectral domains", IMRN (1994).
"""

import numpy as np

from synthnet.arrays import Floats
from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import flat, polyhedron

# Corners have the names they have where the triangle is half a unit square. Each triangle but
# the first shares its last two corners with one before it; all turn counter-clockwise.
TRIANGLES = (
    ("11 01 10", "00 10 01", "12 01 11", "21 12 11", "22 12 21", "23 12 22", "32 22 21"),
    ("11 01 10", "12 01 11", "02 01 12", "21 12 11", "22 12 21", "32 22 21", "23 22 32"),
)
INWARD = ("11", "22")  # where the outline turns inwards
OUTLINES = ("00 10 11 21 32 22 23 12 01", "10 11 21 32 23 22 12 02 01")


def positions(form: int, size: float, lean: float) -> dict[str, Floats]:
    """Return the positions of the corners, by name.

    The first triangle has sides of length ``size`` from the corner 11 to 01 and 10, which make
    an angle of π/2 + lean.
    """
    tilt = np.array([np.sin(lean), -np.cos(lean)])
    corner = np.array([1.0, 1.0])
    at = {"11": corner, "01": corner - np.array([1.0, 0.0]), "10": corner + tilt}
    names = [triangle.split() for triangle in TRIANGLES[form]]
    for number, (new, a, b) in enumerate(names[1:], start=1):
        (old,) = (
            third
            for before in names[:number]
            if {a, b} < set(before)
            for third in set(before) - {a, b}
        )
        side = at[b] - at[a]
        away = at[old] - at[a]
        along = side * (away @ side) / (side @ side)
        at[new] = at[a] + 2 * along - away
    return {name: size * position for name, position in at.items()}


def patches(form: int, size: float, lean: float) -> Floats:
    """Return the seven triangles, shape (7, 3, 2), counter-clockwise."""
    at = positions(form, size, lean)
    corners = np.array([[at[name] for name in triangle.split()] for triangle in TRIANGLES[form]])
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turned = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0] < 0
    return np.where(turned[:, None, None], corners[:, ::-1], corners)


def atlas(*, form: int, size: float, lean: float) -> Atlas:
    """Drum ``form``, 0 or 1, of triangles with two sides of length ``size``."""
    at = positions(form, size, lean)
    inward = np.array([[*at[name], 0.0] for name in INWARD])
    return polyhedron(flat(patches(form, size, lean)), singular=inward)


LEAST = {"form": 0, "size": POSITIVE, "lean": 0.0}
MOST = {"form": 1, "lean": 0.3}
FAMILY = charted("drum", "Drum", atlas, LEAST, euler_characteristic=1, boundaries=1, most=MOST)
