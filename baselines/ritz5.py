"""Rayleigh-Ritz on the 56 polynomials of x, y, z up to degree 5."""

from collections.abc import Sequence

import numpy as np
import ritz

from synthnet import Mesh

META = {
    "name": "Rayleigh-Ritz, degree 5",
    "kind": "classical",
    "training_data": "none",
    "training_cost": "none",
}


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the Ritz values, shape (B, 10)."""
    return ritz.predict(meshes, degree=5)
