"""Right-angled tetrahedra (paper §C: width 1, log-normal height and depth)."""

import numpy as np

from synthnet.families.atlas import Atlas
from synthnet.families.family import POSITIVE, Family
from synthnet.families.polyhedra import polyhedron
from synthnet.mesh.open3d import subdivide
from synthnet.types import Mesh

FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])  # outward, all triples


def surface(*, width: float, height: float, depth: float, subdivisions: int) -> Mesh:
    """Vertices (0,0,0), (w,0,0), (0,h,0), (0,0,d); faces split into 4 ``subdivisions`` times."""
    vertices = np.vstack([np.zeros(3), np.diag([width, height, depth])])
    return subdivide(Mesh(vertices, FACES.copy()), subdivisions)


def atlas(*, width: float, height: float, depth: float, **_: float) -> Atlas:
    """Return the four faces as patches."""
    corners = np.vstack([np.zeros(3), np.diag([width, height, depth])])
    return polyhedron(*(corners[face][None] for face in FACES))


FAMILY = Family(
    name="tetrahedron",
    title="Tetrahedron",
    surface=surface,
    least={"width": POSITIVE, "height": POSITIVE, "depth": POSITIVE, "subdivisions": 0},
    atlas=atlas,
)
