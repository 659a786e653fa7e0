r"""Kriging: a Gaussian process through the training shapes nearby.

log(λ · area) is a function of the eighteen numbers of `NAMES`, which no isometry changes and which
say nothing of the triangles. Between the nearest training shapes it is interpolated as a Gaussian
process whose covariance is a smooth Matérn function and, for a trend, a wide linear one:

.. math::
    k(x, y) = (1 + s + s^2/3) e^{-s} + 100 \, (1 + x \cdot y), \qquad s = \sqrt{5} \, |x - y|,

with the shape in question at the origin, and the farthest of its neighbours at distance one. So
there is nothing to train. The numbers are those that `surface_numbers.py` and `more_numbers.py`
keep.

References
----------
C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, MIT Press 2006,
chapters 2 and 4.
"""

from collections.abc import Sequence

import numpy as np
from more_numbers import kept
from ritz_features import CORRECTED, features
from ritz_features import NAMES as EVERY
from scipy.spatial import cKDTree

from synthnet import Mesh

META = {
    "name": "Kriging on Ritz values and moments",
    "kind": "learned",
    "target": "surface",
    "paper": "Rasmussen, Williams 2006",
    "training_data": "the training split, one instance a shape",
    "training_cost": "none, after the numbers of the shapes",
}
NAMES = (
    *(f"log_ritz_{i + 1}" for i in range(CORRECTED)),
    *(f"log_inertia_{i + 1}" for i in range(3)),
    *("log_volume", "log_fourth_moment", "log_sixth_moment", "log_farthest", "log_nearest"),
)
COLUMNS = [EVERY.index(name) for name in NAMES]
# They were chosen on training and validation shapes of 2.0
NEIGHBOURS, NOISE, TREND = 64, 1e-4, 100.0
NEAREST = 1e-6  # standard deviations: neighbours that near are all the same shape


class Kriging:
    """Interpolates between the rows of a table.

    Parameters
    ----------
    numbers : ndarray of shape (n, d)
        Of the training shapes.
    logs : ndarray of shape (n, 10)
        Their log(λ · area).
    """

    def __init__(self, numbers: np.ndarray, logs: np.ndarray) -> None:
        self.mean, self.scale = numbers.mean(axis=0), numbers.std(axis=0)
        self.tree = cKDTree((numbers - self.mean) / self.scale)
        self.targets = logs

    def logs(self, numbers: np.ndarray) -> np.ndarray:
        """Return log(λ · area) of shapes from their numbers, (B, 10)."""
        points = (numbers - self.mean) / self.scale
        distances, near = self.tree.query(points, min(NEIGHBOURS, self.tree.n))
        reach = np.maximum(distances[:, -1:], NEAREST)
        x = (self.tree.data[near] - points[:, None]) / reach[:, :, None]
        products = x @ x.transpose(0, 2, 1)
        squares = np.einsum("bkk->bk", products)
        apart = np.sqrt(np.maximum(squares[:, :, None] + squares[:, None] - 2 * products, 0))
        among = matern(apart) + TREND * (1 + products) + NOISE * np.eye(near.shape[1])
        towards = matern(np.sqrt(squares)) + TREND
        weights = np.linalg.solve(among, towards[:, :, None])
        return np.einsum("bkj,bk->bj", self.targets[near], weights[:, :, 0])

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        areas, rows = zip(*map(features, meshes), strict=True)
        logs = self.logs(np.array(rows)[:, COLUMNS])
        return np.sort(np.exp(logs), axis=1) / np.array(areas)[:, None]


def matern(distance: np.ndarray) -> np.ndarray:
    """Return Matérn's covariance of smoothness 5/2 and length one."""
    s = np.sqrt(5) * distance
    return (1 + s + s * s / 3) * np.exp(-s)


def load(device: str, seed: int, training: str = "1.0/grouped") -> Kriging:
    """Take the shapes of a training split."""
    return Kriging(*kept(training, NAMES))
