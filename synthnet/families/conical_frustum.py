"""Conical frustums: cylinders with one radius scaled (paper §C)."""

from synthnet.families import primitives, truncated_cone
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(*, radius: float, height: float, resolution: int, split: int, scaling: float) -> Mesh:
    """Open3D's cylinder with x and y scaled from 1 at the bottom to ``scaling`` at the top."""
    mesh = primitives.cylinder(radius=radius, height=height, resolution=resolution, split=split)
    vertices = mesh.vertices.copy()
    elevation = vertices[:, 2:] / height + 0.5
    vertices[:, :2] *= 1 + (scaling - 1) * elevation
    return Mesh(vertices, mesh.faces)


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
    limit=truncated_cone.limit,
    atlas=truncated_cone.atlas,
)
