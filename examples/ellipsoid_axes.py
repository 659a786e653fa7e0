"""Recover the axes of an ellipsoid from ten eigenvalues: gradients by `synthnet.torch`.

    python examples/ellipsoid_axes.py

A spectrum tells a shape up to motion, at least among ellipsoids. From a slightly stretched sphere,
a quasi-Newton method moves three axes until the first ten eigenvalues are those that are given.
"""

from __future__ import annotations

import time

import torch

from synthnet.families import FAMILIES
from synthnet.torch import eigenvalues

WANTED = (1.0, 1.3, 0.8)


def recover(wanted: tuple[float, float, float] = WANTED, steps: int = 30) -> list[float]:
    """Return the axes that an ellipsoid's ten eigenvalues lead to, ascending."""
    sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 20})
    points = torch.tensor(sphere.vertices, dtype=torch.float64)
    faces = torch.tensor(sphere.faces)
    target = eigenvalues(points * torch.tensor(wanted), faces, 10)
    logs = torch.tensor([0.02, 0.05, -0.04], dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([logs], max_iter=steps, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        optimiser.zero_grad()
        found = eigenvalues(points * logs.exp(), faces, 10)
        value = ((found / target).log() ** 2).sum()
        value.backward()
        axes = ", ".join(f"{axis:.4f}" for axis in logs.exp().tolist())
        print(f"axes {axes}  off by {value.item():.1e}")
        return value

    optimiser.step(loss)
    return sorted(logs.exp().tolist())


if __name__ == "__main__":
    start = time.perf_counter()
    found = recover()
    print(f"found {found}, wanted {sorted(WANTED)}, {time.perf_counter() - start:.0f} s")
