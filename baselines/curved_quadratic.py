"""Quadratic elements on triangles bent to the surface: see :mod:`synthnet.spectrum.curved`."""

from collections.abc import Sequence

import numpy as np

from synthnet import Mesh, spectrum

META = {
    "name": "Quadratic elements on bent triangles",
    "kind": "classical",
    "target": "surface",
    "paper": "Demlow 2009; Vlachos et al. 2001",
    "training_data": "none",
    "training_cost": "none",
}
CURVED = spectrum.Operator(elements="curved")

spectrum.compile_solver()  # it comes from the cache, but for the first time on a machine


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues, ascending, shape (B, 10)."""
    return np.array([spectrum.compute(mesh, operator=CURVED).eigenvalues for mesh in meshes])
