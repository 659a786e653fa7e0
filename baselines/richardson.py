"""Linear elements on the mesh and on its triangles' quarters, extrapolated: Richardson's way.

The error of linear elements falls like h²: λ ≈ λ(h/2) + (λ(h/2) − λ(h)) / 3, eigenvalues paired by
their index. Where quartering halves an eigenvalue or more, the mesh is too coarse for that law,
which would soon make it negative: there the value of the quartered mesh stands.
"""

from collections.abc import Sequence

import numpy as np
from refined import quartered

from synthnet import Mesh, spectrum
from synthnet.families.limits import extrapolate

META = {
    "name": "Linear elements, extrapolated",
    "kind": "classical",
    "target": "surface",
    "training_data": "none",
    "training_cost": "none",
}

spectrum.compile_solver()  # it comes from the cache, but for the first time on a machine


def eigenvalues(mesh: Mesh) -> np.ndarray:
    """Return the first ten eigenvalues after zero, ascending, shape (10,), in 1/length²."""
    coarse, fine = (spectrum.compute(each).eigenvalues for each in (mesh, quartered(mesh)))
    return np.sort(np.where(coarse < 2 * fine, extrapolate(coarse, fine), fine))


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues, shape (B, 10)."""
    return np.array([eigenvalues(mesh) for mesh in meshes])
