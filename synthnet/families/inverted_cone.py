"""Inverted cones: cones with the tip reflected inwards (paper §C)."""

import math

import numpy as np

from synthnet.families import cone
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(
    *, radius: float, height: float, resolution: int, split: int, subdivisions: int, flip: float
) -> Mesh:
    """Cone whose points above z = flip·height are reflected in that plane.

    ``flip·height`` is rounded to the nearest ring of vertices, so that no triangle
    crosses the plane and the reflection is an isometry of the mesh: the spectrum is
    the cone's.

    Raises
    ------
    ValueError
        If ``flip`` is above 1.
    """
    if flip > 1:
        raise ValueError(f"inverted_cone: flip must be at most 1, got {flip}")
    mesh = cone.surface(
        radius=radius, height=height, resolution=resolution, split=split, subdivisions=subdivisions
    )
    rings = split * 2**subdivisions
    plane = height * math.floor(flip * rings + 0.5) / rings
    z = mesh.vertices[:, 2]
    reflected = np.where(z > plane, 2 * plane - z, z)
    return Mesh(np.column_stack([mesh.vertices[:, :2], reflected]), mesh.faces)


FAMILY = Family(
    name="inverted_cone",
    title="Inverted cone",
    surface=surface,
    least={**cone.FAMILY.least, "flip": POSITIVE},
    limit=cone.FAMILY.limit,  # it is isometric to that cone
    atlas=cone.FAMILY.atlas,
)
