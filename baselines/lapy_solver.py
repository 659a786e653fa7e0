"""LaPy's own eigenvalues of a mesh."""

import lapy
import numpy as np

from synthnet import Mesh


def eigenvalues(mesh: Mesh, *, lump: bool = False) -> np.ndarray:
    """Return the first ten eigenvalues after zero, with LaPy's default settings."""
    solver = lapy.Solver(lapy.TriaMesh(mesh.vertices, mesh.faces), lump=lump)
    values, _ = solver.eigs(11, rng=0)
    return values[1:]
