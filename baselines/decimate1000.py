"""Quadric decimation to 1000 vertices, then LaPy."""

from collections.abc import Sequence

import decimate
import numpy as np

from synthnet import Mesh

META = {
    "name": "Decimation to 1000, LaPy",
    "kind": "classical",
    "training_data": "none",
    "training_cost": "none",
}


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues of the decimated meshes, shape (B, 10)."""
    return decimate.predict(meshes, vertices=1000)
