"""Split cones: two halves of different resolution (paper §C)."""

from synthnet.families import circular_cone, primitives
from synthnet.families.family import POSITIVE, Family
from synthnet.mesh.open3d import subdivide
from synthnet.types import Mesh


def surface(
    *,
    radius: float,
    height: float,
    resolution_a: int,
    resolution_b: int,
    split_a: int,
    split_b: int,
    subdivisions: int,
) -> Mesh:
    """Hull of the points with x ≤ 0 of one cone and with x ≥ 0 of another, then split.

    The hull drops every ring between apex and base, for those points lie on straight
    generators: that is the paper's recipe, and it makes these meshes coarse.
    """
    hull = primitives.join_halves(
        primitives.cone(radius=radius, height=height, resolution=resolution_a, split=split_a),
        primitives.cone(radius=radius, height=height, resolution=resolution_b, split=split_b),
    )
    return subdivide(hull, subdivisions)


FAMILY = Family(
    name="split_cone",
    title="Split cone",
    surface=surface,
    least={
        "radius": POSITIVE,
        "height": POSITIVE,
        "resolution_a": 3,
        "resolution_b": 3,
        "split_a": 1,
        "split_b": 1,
        "subdivisions": 0,
    },
    limit=circular_cone.limit,
    atlas=circular_cone.atlas,
)
