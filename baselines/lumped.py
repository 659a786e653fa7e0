"""LaPy with a lumped, that is diagonal, mass matrix."""

from collections.abc import Sequence

import lapy_solver
import numpy as np

from synthnet import Mesh

META = {
    "name": "Lumped mass",
    "kind": "classical",
    "training_data": "none",
    "training_cost": "none",
}


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues with the lumped mass matrix, shape (B, 10)."""
    return np.array([lapy_solver.eigenvalues(mesh, lump=True) for mesh in meshes])
