"""Linear elements with the consistent mass and with the lumped one, by one certified solve.

On a mesh of equilateral triangles of side h the consistent mass B moves λ up by λ²h²/16, the lumped
mass L down by as much, so that their mean is off by a term in h⁴ only. Their ratio says how coarse
the mesh is for an eigenfunction.

The lumped values are Ritz values in the span of the consistent eigenvectors: since A is diagonal
there, they cost a product with a diagonal matrix.
"""

from collections.abc import Sequence

import numpy as np
from scipy import linalg

from synthnet import Mesh, spectrum
from synthnet.mesh.geometry import face_areas

META = {
    "name": "Mean of consistent and lumped mass",
    "kind": "classical",
    "target": "surface",
    "training_data": "none",
    "training_cost": "none",
}

spectrum.compile_solver()  # it comes from the cache, but for the first time on a machine


def spectra(mesh: Mesh) -> np.ndarray:
    """Return the first ten eigenvalues after zero with B, and with L, shape (2, 10)."""
    found = spectrum.compute(mesh)
    lumped = np.bincount(mesh.faces.ravel(), np.repeat(face_areas(mesh) / 3, 3), len(mesh.vertices))
    vectors = found.eigenvectors - lumped @ found.eigenvectors / lumped.sum()  # constants are left
    gram = vectors.T @ (lumped[:, None] * vectors)
    return np.stack([found.eigenvalues, linalg.eigvalsh(np.diag(found.eigenvalues), gram)])


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the means, shape (B, 10)."""
    return np.array([spectra(mesh).mean(axis=0) for mesh in meshes])
