"""The mean spectrum of the training split, whatever the mesh."""

from collections.abc import Sequence

import numpy as np
from eigbench import truth

from synthnet import Mesh

META = {
    "name": "Mean training spectrum",
    "kind": "trivial",
    "training_data": "synthNet 1.0 train, grouped",
    "training_cost": "none",
}


class Predictor:
    """Answers the mean of the training labels."""

    def __init__(self) -> None:
        self.spectrum = truth.load("1.0", "train").eigenvalues.mean(axis=0)

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the same spectrum for every mesh, shape (B, 10)."""
        return np.tile(self.spectrum, (len(meshes), 1))
