"""The physics contract: what every spectrum obeys, measured on a predictor.

Scaling λ(sX) = λ(X)/s²; invariance under rotation, reflection and the numbering of the
vertices; the same spectrum for two triangulations of one surface; positive and ascending
values. Deviations are relative, the largest of the ten eigenvalues of a shape.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from synthnet.families import FAMILIES
from synthnet.mesh import isometries
from synthnet.mesh.open3d import subdivide
from synthnet.recipe.plan import planned
from synthnet.types import Mesh

PER_FAMILY = 2
SEED = 0


def probes() -> dict[str, Mesh]:
    """Return the two smallest validation shapes of each family of 1.0-mini, by id.

    They are generated here: no built dataset is needed, and no test shape is shown.
    """
    by_family: dict[str, dict[str, Mesh]] = {}
    for plan in planned("1.0-mini"):
        for shape in plan.shapes:
            if shape.split == "validation":
                mesh = FAMILIES[plan.family].generate(shape.spec.parameters)
                by_family.setdefault(plan.family, {})[shape.spec.id] = mesh
    chosen: dict[str, Mesh] = {}
    for meshes in by_family.values():
        smallest = sorted(meshes, key=lambda id: (len(meshes[id].vertices), id))
        chosen.update((id, meshes[id]) for id in smallest[:PER_FAMILY])
    return chosen


def scaled(factor: float) -> Callable[[Mesh, np.random.Generator], Mesh]:
    """Return a change that scales a mesh."""
    return lambda mesh, rng: Mesh(mesh.vertices * factor, mesh.faces)


def permuted(mesh: Mesh, rng: np.random.Generator) -> Mesh:
    """Number the vertices and the faces in another order."""
    order = rng.permutation(len(mesh.vertices))
    number = np.argsort(order)
    return Mesh(mesh.vertices[order], number[mesh.faces][rng.permutation(len(mesh.faces))])


# How a mesh is changed, and by what that multiplies the eigenvalues.
CHANGES: dict[str, tuple[Callable[[Mesh, np.random.Generator], Mesh], float]] = {
    "scale_2": (scaled(2.0), 0.25),
    "scale_half": (scaled(0.5), 4.0),
    "rotation": (lambda mesh, rng: isometries.apply(mesh, isometries.random_rotation(rng)), 1.0),
    "reflection": (
        lambda mesh, rng: isometries.apply(mesh, isometries.random_reflection(rng)),
        1.0,
    ),
    "permutation": (permuted, 1.0),
    "triangulation": (lambda mesh, rng: subdivide(mesh, 1), 1.0),
}


SHARES = ("positive", "ascending")
TITLES = {
    "scale_2": "λ(2X) against λ(X)/4",
    "scale_half": "λ(X/2) against 4 λ(X)",
    "rotation": "rotated",
    "reflection": "reflected",
    "permutation": "renumbered",
    "triangulation": "each triangle split into four",
    "positive": "share positive",
    "ascending": "share ascending",
}


@cache
def questions() -> tuple[tuple[str, ...], tuple[Mesh, ...]]:
    """Return ids and meshes: the probes, then the probes under each change."""
    rng = np.random.default_rng(SEED)
    base = probes()
    ids, meshes = list(base), list(base.values())
    for name, (change, _) in CHANGES.items():
        for id, mesh in base.items():
            ids.append(f"{id}/{name}")
            meshes.append(change(mesh, rng))
    return tuple(ids), tuple(meshes)


def contract(answers: NDArray[np.float64]) -> dict[str, float | None]:
    """Return the numbers of the contract from the answers to :func:`questions`.

    Parameters
    ----------
    answers : ndarray of shape (B, k), float64
        Predicted eigenvalues of its B meshes in their order, in 1/length².

    Returns
    -------
    dict of str to float or None
        For each change the median over shapes of the largest relative deviation, then the
        shares of shapes with positive and with ascending values; ``None`` where not finite.
    """
    groups = answers.reshape(1 + len(CHANGES), -1, answers.shape[1])
    base = groups[0]
    numbers: dict[str, float | None] = {}
    for (name, (_, factor)), changed in zip(CHANGES.items(), groups[1:], strict=True):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            apart = np.abs(changed - factor * base)
            deviation = np.where(apart == 0, 0.0, apart / np.abs(factor * base)).max(axis=1)
        median = float(np.median(deviation))
        numbers[name] = median if np.isfinite(median) else None
    numbers["positive"] = float((base > 0).all(axis=1).mean())
    numbers["ascending"] = float((base[:, 1:] >= base[:, :-1]).all(axis=1).mean())
    return numbers
