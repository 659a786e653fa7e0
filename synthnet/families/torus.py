"""Tori of revolution (paper §C: torus radius 1, log-normal tube radius)."""

from synthnet.families import primitives
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh


def surface(
    *, torus_radius: float, tube_radius: float, radial_resolution: int, tubular_resolution: int
) -> Mesh:
    """Open3D's torus; embedded only while the tube radius is below the torus radius."""
    return primitives.torus(
        torus_radius=torus_radius,
        tube_radius=tube_radius,
        radial_resolution=radial_resolution,
        tubular_resolution=tubular_resolution,
    )


FAMILY = Family(
    name="torus",
    title="Torus",
    surface=surface,
    least={
        "torus_radius": POSITIVE,
        "tube_radius": POSITIVE,
        "radial_resolution": 3,
        "tubular_resolution": 3,
    },
    euler_characteristic=0,
)
