"""Quadric decimation, then LaPy on what is left."""

from collections.abc import Sequence

import lapy_solver
import numpy as np

from synthnet import Mesh
from synthnet.mesh.open3d import from_open3d, to_open3d


def decimated(mesh: Mesh, vertices: int) -> Mesh:
    """Return a mesh of about ``vertices`` vertices; a smaller one as it is."""
    if len(mesh.vertices) <= vertices:
        return mesh
    # Euler: F = 2V − 2χ, and χ is small
    simple = to_open3d(mesh).simplify_quadric_decimation(target_number_of_triangles=2 * vertices)
    simple.remove_degenerate_triangles()
    simple.remove_unreferenced_vertices()
    return from_open3d(simple)


def predict(meshes: Sequence[Mesh], vertices: int) -> np.ndarray:
    """Return the eigenvalues of the decimated meshes, shape (B, 10)."""
    return np.array([lapy_solver.eigenvalues(decimated(mesh, vertices)) for mesh in meshes])
