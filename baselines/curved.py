"""Linear elements on triangles bent to the surface, corrected for what quadratic ones would find.

Normals at the vertices give the surface back that the flat triangles cut the corners of; the
eigenvalues of linear elements on it are corrected by the energy of edges' functions, which a few
steps of conjugate gradients find. Edges that are too long for that are cut. Nothing is trained. See
:mod:`synthnet.spectrum.surface`.
"""

from collections.abc import Sequence

import numpy as np

from synthnet import Mesh, spectrum

META = {
    "name": "Linear elements on bent triangles, corrected",
    "kind": "classical",
    "target": "surface",
    "paper": "Vlachos et al. 2001; Bank, Smith 1993",
    "training_data": "none",
    "training_cost": "none",
}

spectrum.compile_solver()  # it comes from the cache, but for the first time on a machine


def predict(meshes: Sequence[Mesh]) -> np.ndarray:
    """Return the eigenvalues, ascending, shape (B, 10)."""
    return np.array([spectrum.surface_eigenvalues(mesh) for mesh in meshes])
