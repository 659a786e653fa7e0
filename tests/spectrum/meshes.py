"""Meshes that the tests of several files take."""

from __future__ import annotations

import numpy as np

from synthnet import recipe
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.recipe.drawing import draw_shape
from synthnet.types import Mesh


def sphere(resolution: int, radius: float = 1.0) -> Mesh:
    return FAMILIES["sphere"].generate({"radius": radius, "resolution": resolution})


def drawn(family: str, index: int = 1) -> Mesh:
    """Return a shape of 1.0, or of 2.1 where 1.0 has no such family."""
    version = "1.0" if family in PRIMITIVES else "2.1"
    return FAMILIES[family].generate(draw_shape(recipe.load(version), family, index).parameters)


def side_by_side(first: Mesh, second: Mesh) -> Mesh:
    vertices = np.concatenate([first.vertices, second.vertices + 5.0])
    return Mesh(vertices, np.concatenate([first.faces, second.faces + len(first.vertices)]))
