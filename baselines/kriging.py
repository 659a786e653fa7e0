"""Kriging on numbers that no isometry changes: the training shapes nearby, interpolated.

From the twelve numbers of `NAMES`, standardised, log(λ · area) is interpolated between the nearest
training shapes by a polyharmonic spline: kriging with the generalised covariance |x − y|³ and a
linear drift. So there is nothing to train and no length to choose. The numbers of the training
shapes are those that `surface_numbers.py` keeps.

References
----------
G. Matheron, "The intrinsic random functions and their applications", Adv. Appl. Probab. 5 (1973).
"""

from collections.abc import Sequence

import numpy as np
from ritz_features import NAMES as EVERY
from ritz_features import features
from scipy.interpolate import RBFInterpolator
from surface_numbers import kept

from synthnet import Mesh

META = {
    "name": "Kriging",
    "kind": "learned",
    "target": "surface",
    "training_data": "the training split, one instance a shape",
    "training_cost": "none, after the numbers of the shapes",
}
NAMES = (
    *(f"log_inertia_{i + 1}" for i in range(3)),
    *("log_volume", "log_fourth_moment", "log_sixth_moment", "log_farthest", "log_nearest"),
    *(f"log_ritz_{i + 1}" for i in range(4)),
)
NEIGHBOURS, SMOOTHING = 64, 1e-4  # chosen on the validation split


class Kriging:
    """Interpolates between the rows of a table.

    Parameters
    ----------
    numbers : ndarray of shape (n, 12)
        Of the training shapes.
    logs : ndarray of shape (n, 10)
        Their log(λ · area).
    """

    def __init__(self, numbers: np.ndarray, logs: np.ndarray) -> None:
        self.mean, self.scale = numbers.mean(axis=0), numbers.std(axis=0)
        self.spline = RBFInterpolator(
            (numbers - self.mean) / self.scale,
            logs,
            neighbors=NEIGHBOURS,
            smoothing=SMOOTHING,
            kernel="cubic",
        )

    def logs(self, numbers: np.ndarray) -> np.ndarray:
        """Return log(λ · area) of shapes from their numbers, (B, 10)."""
        return self.spline((numbers - self.mean) / self.scale)

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        areas, rows = zip(*map(features, meshes), strict=True)
        numbers = np.array(rows)[:, [EVERY.index(name) for name in NAMES]]
        return np.sort(np.exp(self.logs(numbers)), axis=1) / np.array(areas)[:, None]


def load(device: str, seed: int, training: str = "1.0/grouped") -> Kriging:
    """Take the shapes of a training split."""
    return Kriging(*kept(training, NAMES))
