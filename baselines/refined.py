"""A mesh with its edges' midpoints, for elements that need them."""

import numpy as np

from synthnet import Mesh
from synthnet.families.atlas import Atlas, Charted


def flat(mesh: Mesh) -> tuple[Atlas, Charted]:
    """Return a mesh as the surface of its own flat triangles, and that surface's triangulation."""
    vertices = mesh.vertices.astype(np.float64)
    faces = mesh.faces.astype(np.int64)
    charts = np.zeros(len(faces), dtype=np.int64)
    atlas = Atlas(vertices[faces], charts, lambda charts, points: points)
    return atlas, Charted(faces, atlas.corners, charts)


def quartered(mesh: Mesh) -> Mesh:
    """Return the mesh whose triangles are quarters of the given ones, in the same planes."""
    vertices = mesh.vertices.astype(np.float64)
    _, triangulation = flat(mesh)
    edges, of_side = triangulation.edges()
    a, b, c = mesh.faces.T
    ab, bc, ca = (of_side + len(vertices)).T
    corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
    faces = np.concatenate([np.stack(corner, axis=1) for corner in corners])
    return Mesh(np.concatenate([vertices, vertices[edges].mean(axis=1)]), faces)
