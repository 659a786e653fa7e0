"""Split spheres: two halves of different resolution (paper §C)."""

from synthnet.families import conforming_split_sphere, primitives
from synthnet.families.family import POSITIVE, Family
from synthnet.types import Mesh, Parameters


def surface(*, radius: float, resolution_a: int, resolution_b: int) -> Mesh:
    """Hull of the points with x ≤ 0 of one sphere and with x ≥ 0 of another."""
    return primitives.join_hemispheres(
        primitives.sphere(radius=radius, resolution=resolution_a),
        primitives.sphere(radius=radius, resolution=resolution_b),
    )


def congruent(parameters: Parameters) -> Parameters:
    """Put the coarser half first: exchanging the halves is a reflection in x = 0."""
    a, b = sorted([parameters["resolution_a"], parameters["resolution_b"]])
    return {**parameters, "resolution_a": a, "resolution_b": b}


FAMILY = Family(
    name="split_sphere",
    title="Split sphere",
    surface=surface,
    least={"radius": POSITIVE, "resolution_a": 2, "resolution_b": 2},
    limit=conforming_split_sphere.limit,
    atlas=conforming_split_sphere.atlas,
    congruent=congruent,
)
