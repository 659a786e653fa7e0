"""LaPy at its fastest: with the Cholesky factorisation of CHOLMOD, of the extra ``cholmod``."""

from collections.abc import Sequence

import cholespy  # noqa: F401 - LaPy imports it as late as in the first solve
import lapy
import numpy as np

from synthnet import Mesh

META = {
    "name": "LaPy with CHOLMOD",
    "kind": "classical",
    "paper": "Reuter, Wolter, Peinecke 2006",
    "training_data": "none",
    "training_cost": "none",
}


def eigenvalues(mesh: Mesh) -> np.ndarray:
    """Return the first ten eigenvalues after zero."""
    solver = lapy.Solver(lapy.TriaMesh(mesh.vertices, mesh.faces), use_cholmod=True)
    values, _ = solver.eigs(11, rng=0)
    return values[1:]


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues that the labels are, shape (B, 10)."""
    return np.array([eigenvalues(mesh) for mesh in meshes])
