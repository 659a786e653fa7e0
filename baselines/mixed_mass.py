"""Linear elements with the mean of the consistent and the lumped mass, one certified solve.

On a mesh of equilateral triangles of side h the consistent mass moves λ up by λ²h²/16, the lumped
mass down by as much, and their mean by a term in h⁴ only.
"""

from collections.abc import Sequence

import numpy as np

from synthnet import Mesh, spectrum

META = {
    "name": "Mean of consistent and lumped mass",
    "kind": "classical",
    "target": "surface",
    "training_data": "none",
    "training_cost": "none",
}

spectrum.compile_solver()  # from the cache, but for the first time on a machine


def eigenvalues(mesh: Mesh) -> np.ndarray:
    """Return the first ten eigenvalues after zero, with the mass (B + L) / 2."""
    matrices = spectrum.assemble(mesh)
    rows = np.repeat(np.arange(len(matrices.lumped)), np.diff(matrices.indptr))
    mass = matrices.mass / 2
    mass[matrices.indices == rows] += matrices.lumped / 2
    return spectrum.of_matrices(matrices._replace(mass=mass)).eigenvalues


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues, shape (B, 10)."""
    return np.array([eigenvalues(mesh) for mesh in meshes])
