"""Conical frustums: cylinders with one radius scaled (paper §C)."""

import numpy as np
from numpy.typing import NDArray

from synthnet.families import limits, primitives, truncated_cone
from synthnet.families.atlas import Atlas
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(*, radius: float, height: float, resolution: int, split: int, scaling: float) -> Mesh:
    """Open3D's cylinder with x and y scaled from 1 at the bottom to ``scaling`` at the top."""
    mesh = primitives.cylinder(radius=radius, height=height, resolution=resolution, split=split)
    vertices = mesh.vertices.copy()
    elevation = vertices[:, 2:] / height + 0.5
    vertices[:, :2] *= 1 + (scaling - 1) * elevation
    return Mesh(vertices, mesh.faces)


def limit(
    k: int, *, radius: float, height: float, scaling: float, **_: float
) -> NDArray[np.float64]:
    """Spectrum of the smooth frustum with its two discs."""
    top = radius * scaling
    return limits.of_revolution(
        [limits.line(0, radius), limits.line(radius, top, height), limits.line(top, 0)], k
    )


def atlas(*, radius: float, height: float, scaling: float, **_: float) -> Atlas:
    """Return the smooth frustum in patches."""
    return truncated_cone.atlas(radius=radius, height=height, scaling=scaling)


FAMILY = Family(
    name="conical_frustum",
    title="Conical frustum",
    surface=surface,
    least={
        "radius": POSITIVE,
        "height": POSITIVE,
        "resolution": 3,
        "split": 1,
        "scaling": POSITIVE,
    },
    euler_characteristic=2,
    limit=limit,
    atlas=atlas,
)
