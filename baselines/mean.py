"""The mean spectrum of the training split, whatever the mesh."""

from collections.abc import Sequence

import numpy as np
from eigbench.scoring import truth

from synthnet import Mesh

META = {
    "name": "Mean training spectrum",
    "kind": "trivial",
    "training_data": "the training split",
    "training_cost": "none",
}


class Mean:
    """Answers the mean of the training labels."""

    def __init__(self, labels: np.ndarray) -> None:
        self.spectrum = labels.mean(axis=0)

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the same spectrum for every mesh, shape (B, 10)."""
        return np.tile(self.spectrum, (len(meshes), 1))


def load(device: str, seed: int, training: str) -> Mean:
    """Take the mean of a training split, such as ``1.0/grouped``."""
    version, _, protocol = training.partition("/")
    return Mean(truth.load(version, "train", protocol).eigenvalues)
