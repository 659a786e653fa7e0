"""Weyl's law: the i-th eigenvalue of a closed surface grows like 4πi / area."""

from collections.abc import Sequence

import numpy as np

from synthnet import Mesh
from synthnet.mesh.geometry import area

META = {"name": "Weyl's law", "kind": "trivial", "training_data": "none", "training_cost": "none"}


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return 4πi / area for i = 1 to 10, shape (B, 10)."""
    return np.array([4 * np.pi * np.arange(1, 11) / area(mesh) for mesh in meshes])
