"""LaPy itself: what exactness costs."""

from collections.abc import Sequence

import lapy_solver
import numpy as np

from synthnet import Mesh

META = {
    "name": "LaPy",
    "kind": "classical",
    "paper": "Reuter, Wolter, Peinecke 2006",
    "training_data": "none",
    "training_cost": "none",
}


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues that the labels are, shape (B, 10)."""
    return np.array([lapy_solver.eigenvalues(mesh) for mesh in meshes])
