"""Meshes that the tests of several files take."""

import numpy as np

from synthnet import recipe
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.recipe.drawing import draw_shape
from synthnet.types import Mesh


def sphere(resolution, radius=1.0):
    return FAMILIES["sphere"].generate({"radius": radius, "resolution": resolution})


def drawn(family, index=1):
    """Return a shape of 1.0, or of 2.1 where 1.0 has no such family."""
    version = "1.0" if family in PRIMITIVES else "2.1"
    return FAMILIES[family].generate(draw_shape(recipe.load(version), family, index).parameters)


def side_by_side(first, second):
    vertices = np.concatenate([first.vertices, second.vertices + 5.0])
    return Mesh(vertices, np.concatenate([first.faces, second.faces + len(first.vertices)]))
