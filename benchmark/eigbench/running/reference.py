"""LaPy as a predictor: what every other is timed beside, on the same meshes and machine.

Milliseconds of two machines cannot be compared, and a machine's name does not tell how fast it
is today; the ratio to a peer in the same run can.
"""

from collections.abc import Sequence
from importlib import metadata

import lapy
import numpy as np
from numpy.typing import NDArray

from synthnet.types import Mesh

META = {"name": f"LaPy {metadata.version('lapy')}", "kind": "classical"}


def predict(meshes: Sequence[Mesh]) -> NDArray[np.float64]:
    """Return the first ten eigenvalues after zero, (B, 10), by LaPy with its default settings."""
    spectra = [
        lapy.Solver(lapy.TriaMesh(mesh.vertices, mesh.faces)).eigs(11, rng=0)[0] for mesh in meshes
    ]
    return np.array(spectra)[:, 1:]
