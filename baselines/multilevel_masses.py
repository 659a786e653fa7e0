r"""Multilevel Ritz values, corrected by two fitted numbers towards the surface.

Two cycles of `multilevel.py` leave two errors in an eigenvalue, and both can be computed beside
it. What the triangles are too coarse for shows in the ratio of the Ritz value θ with the consistent
mass to that with the lumped one, ℓ; what the iteration has not found yet shows in the residual
r = A u − θ B u:

.. math::
    \log \lambda = \log \theta - a \log(\theta / \ell) - b \, r^T D^{-1} r / \theta

with D the diagonal of A and u normalised. On a mesh of equilateral triangles a is a half (see
`two_masses.py`), and b would be one if D were A − θ B. Both errors are local, so the numbers hold
for surfaces unlike those of the training. They are fitted when the file is loaded, to the shapes
that `surface_numbers.py` and `more_numbers.py` keep.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import multilevel
import multilevel_kernels as kernels
import numpy as np
from more_numbers import kept
from scipy import linalg, optimize

from synthnet import Mesh
from synthnet.mesh.geometry import area

META = {
    "name": "Multilevel Ritz values with two masses, two fitted numbers",
    "kind": "learned",
    "target": "surface",
    "paper": "Nasikun, Hildebrandt 2022; Vaněk, Mandel, Brezina 1996",
    "training_data": "shapes of the training split, one instance a shape",
    "training_cost": "a second on one core at loading, after the numbers of the shapes",
}
SETTING = replace(multilevel.SETTING, enough=0.05, cycles=2)
COUNT = multilevel.COUNT
NAMES = tuple(
    f"{what}_{i + 1}" for what in ("log_multilevel", "mass_ratio", "residual") for i in range(COUNT)
)


def features(mesh: Mesh) -> np.ndarray:
    """Return log(θ · area), log(θ / ℓ) and the residuals' shares, in the order of :data:`NAMES`."""
    levels = multilevel.hierarchy(mesh, SETTING)
    *_, (values, basis, turn) = multilevel.ascent(levels, SETTING)
    values, level = values[:COUNT], levels[0]
    vectors = multilevel.combined(basis, turn[:, :COUNT])
    stiff, weighted = np.empty_like(vectors), np.empty_like(vectors)
    kernels.multiply_both(*level.pattern, level.stiffness, level.mass, vectors, stiff, weighted)
    first = level.pattern[0][:-1]
    residual = ((stiff - weighted * values) ** 2 / level.stiffness[first, None]).sum(axis=0)
    lumped = np.add.reduceat(level.mass, first)
    vectors -= lumped @ vectors / lumped.sum()  # constants are left
    gram = vectors.T @ (lumped[:, None] * vectors)
    ratio = np.log(values / linalg.eigvalsh(np.diag(values), gram))
    return np.concatenate([np.log(values * lumped.sum()), ratio, residual / values])


class TwoNumbers:
    """The correction.

    Parameters
    ----------
    a, b : float
        Shares of the ratio of masses and of the residual.
    """

    def __init__(self, a: float, b: float) -> None:
        self.a, self.b = a, b

    def parameters(self) -> list[np.ndarray]:
        """Return a and b, which the harness counts."""
        return [np.array([self.a, self.b])]

    def logs(self, numbers: np.ndarray) -> np.ndarray:
        """Return log(λ · area) from rows of numbers, (B, 10)."""
        logs, ratio, residual = np.split(numbers, 3, axis=1)
        return logs - self.a * ratio - self.b * residual

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        areas = np.array([area(mesh) for mesh in meshes])[:, None]
        logs = self.logs(np.array([features(mesh) for mesh in meshes]))
        return np.sort(np.exp(logs), axis=1) / areas


def fit(numbers: np.ndarray, logs: np.ndarray) -> TwoNumbers:
    """Return the two numbers of the least mean error of log(λ · area)."""

    def error(pair: np.ndarray) -> float:
        return float(np.abs(TwoNumbers(*pair).logs(numbers) - logs).mean())

    return TwoNumbers(*optimize.minimize(error, (0.5, 1.0), method="Nelder-Mead").x)


def load(device: str, seed: int, training: str = "1.0/grouped") -> TwoNumbers:
    """Fit to the shapes of a training split."""
    return fit(*kept(training, NAMES))
