"""Atlases of surfaces that are seen whole from the origin, over an icosahedron."""

from collections.abc import Callable
from itertools import combinations

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas

GOLDEN = (1 + np.sqrt(5)) / 2
CORNERS = np.array(
    [[s, t * GOLDEN, 0] for s in (-1, 1) for t in (-1, 1)]
    + [[0, s, t * GOLDEN] for s in (-1, 1) for t in (-1, 1)]
    + [[t * GOLDEN, 0, s] for s in (-1, 1) for t in (-1, 1)]
)
EDGE = 2.0


def icosahedron() -> Floats:
    """Return the twenty faces, shape (20, 3, 3), counter-clockwise seen from outside."""
    near = np.isclose(np.linalg.norm(CORNERS[:, None] - CORNERS, axis=2), EDGE)
    triangles = []
    for a, b, c in combinations(range(12), 3):
        if near[a, b] and near[b, c] and near[a, c]:
            turn = np.linalg.det(CORNERS[[a, b, c]])
            triangles.append((a, b, c) if turn > 0 else (a, c, b))
    return np.asarray(CORNERS[np.array(triangles)])


def unit_vectors(z: Floats, angle: Floats) -> Floats:
    """Return unit vectors (n, 3), spread evenly if z and angle are in [−1, 1]."""
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(np.pi * angle), flat * np.sin(np.pi * angle), z], axis=1)


def radial(distance: Callable[[Floats], Floats]) -> Atlas:
    """Return the atlas of a surface by its distance from the origin in each direction.

    Parameters
    ----------
    distance : callable
        From unit vectors of shape (n, 3) to positive numbers (n,).
    """

    def chart(_: Int64s, u: Floats) -> Floats:
        directions = u / np.linalg.norm(u, axis=1, keepdims=True)
        return np.asarray(directions * distance(directions)[:, None])

    return Atlas(icosahedron(), np.zeros(20, dtype=np.int64), chart)
