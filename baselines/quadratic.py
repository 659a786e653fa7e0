"""Quadratic elements on the mesh's own flat triangles."""

from collections.abc import Sequence

import numpy as np
from refined import flat

from synthnet import Mesh, spectrum
from synthnet.families.elements import assemble

META = {
    "name": "Quadratic elements",
    "kind": "classical",
    "target": "surface",
    "paper": "Reuter, Wolter, Peinecke 2006",
    "training_data": "none",
    "training_cost": "none",
}

spectrum.compile_solver()  # it comes from the cache, but for the first time on a machine


def eigenvalues(mesh: Mesh) -> np.ndarray:
    """Return the first ten eigenvalues after zero, ascending, shape (10,), in 1/length²."""
    return spectrum.of_matrices(assemble(*flat(mesh), degree=2)).eigenvalues


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues, shape (B, 10)."""
    return np.array([eigenvalues(mesh) for mesh in meshes])
