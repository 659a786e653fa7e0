"""Meshes of single shapes, drawn anew from the recipe and packed for the page."""

from __future__ import annotations

import base64
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.scoring.training import on_imports
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.mesh.open3d import decimate, from_open3d, to_open3d
from synthnet.recipe.drawing import draw_shape
from synthnet.recipe.recipe import Recipe
from synthnet.types import Mesh, ShapeSpec

FACES = 20_000  # more are simplified: a phone has to load and turn them
MERGED = 26_000  # more are brought near that many first, which is faster than simplifying all
STEPS = 32_767  # of a coordinate, in int16: half the largest side of the bounding box


def spec_of(truth: Truth, shape: str) -> ShapeSpec | None:
    """Return what a shape is drawn from; ``None`` for an imported one, which has no recipe."""
    if on_imports(truth.protocol) or truth.version not in recipe.available():
        return None
    family, _, index = shape.rpartition("-")
    return draw_shape(_whole(truth.version), family, int(index))


def location(truth: Truth, shape: str) -> str:
    """Return the name of a shape's mesh on the page: the same for every subset of a version."""
    return f"meshes/{_whole(truth.version).version}/{shape}"


@cache
def _whole(version: str) -> Recipe:
    """Return the recipe of the version whose subset this one is."""
    return recipe.load(recipe.load(version).base)


def packed(mesh: Mesh) -> dict[str, Any]:
    """Return a mesh for the page: centred, scaled to [-1, 1] and rounded to :data:`STEPS`.

    Vertices and faces are little-endian in base64: int16, and uint16 or uint32 as ``wide`` says.
    ``vertex_count`` and ``face_count`` are those of the mesh itself, ``shown`` the triangles.
    """
    few = decimate(_merged(mesh), FACES)
    wide = len(few.vertices) > np.iinfo(np.uint16).max
    return {
        "vertex_count": len(mesh.vertices),
        "face_count": len(mesh.faces),
        "shown": len(few.faces),
        "vertices": _base64(_quantised(few.vertices)),
        "faces": _base64(few.faces.astype("<u4" if wide else "<u2")),
        "wide": wide,
    }


def _merged(mesh: Mesh) -> Mesh:
    """Merge nearby vertices of a mesh that has far more triangles than are shown."""
    if len(mesh.faces) <= MERGED:
        return mesh
    whole = to_open3d(mesh)
    side = (2 * whole.get_surface_area() / MERGED) ** 0.5
    return from_open3d(whole.simplify_vertex_clustering(side))


def _quantised(vertices: NDArray[np.floating[Any]]) -> NDArray[np.int16]:
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    half = float((high - low).max()) / 2
    return np.asarray(np.rint((vertices - (low + high) / 2) / half * STEPS), dtype="<i2")


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(array.tobytes()).decode("ascii")
