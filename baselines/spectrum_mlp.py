"""The mesh's own spectrum, corrected by a small network towards that of the surface.

The network of `ritz_mlp.py` learns log(limit / eigenvalue of the mesh) from the 28 numbers of
`ritz_features.py` and from the spectra of the mesh with both masses. It is trained when it is
loaded, on the numbers that `surface_numbers.py` and `more_numbers.py` keep.
"""

from collections.abc import Sequence

import numpy as np
import ritz_features
import ritz_mlp
from more_numbers import kept
from two_masses import spectra

from synthnet import Mesh

META = {
    "name": "The mesh's spectrum, corrected by an MLP",
    "kind": "learned",
    "target": "surface",
    "training_data": "shapes of the training split, one instance a shape",
    "training_cost": "half a minute on one core at loading, after the numbers of the shapes",
}
COUNT = ritz_features.CORRECTED
SPECTRA = tuple(f"log_{mass}_{i + 1}" for mass in ("consistent", "lumped") for i in range(COUNT))
NAMES = (*SPECTRA, *ritz_features.NAMES)
EPOCHS = 200


def features(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Return the area in length², and the numbers of :data:`NAMES`, those of the mesh at area 1."""
    area, numbers = ritz_features.features(mesh)
    return area, np.concatenate([np.log(spectra(mesh) * area).ravel(), numbers])


class Corrected(ritz_mlp.Corrected):
    """The network of one seed."""

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        areas, rows = zip(*map(features, meshes), strict=True)
        numbers = np.array(rows)
        logs = numbers[:, :COUNT] + self.correct(numbers)
        return np.sort(np.exp(logs), axis=1) / np.array(areas)[:, None]


def load(device: str, seed: int, training: str = "1.0/grouped") -> Corrected:
    """Train the network on the shapes of a training split."""
    numbers, logs = kept(training, NAMES)
    return Corrected(ritz_mlp.train(numbers, logs - numbers[:, :COUNT], seed, epochs=EPOCHS))
