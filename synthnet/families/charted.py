"""Families of surfaces given by an atlas, each in several triangulations."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from synthnet.arrays import Floats
from synthnet.families import remesh
from synthnet.families.atlas import Atlas, Charted
from synthnet.families.family import Choice, Euler, Family
from synthnet.types import Mesh, Parameters

TRIANGULATIONS = ("uniform", "adaptive", "irregular")
TRIANGULATION: Mapping[str, float | Choice] = {
    "triangulation": Choice(TRIANGULATIONS),
    "vertices": 50,
    "seed": 0,
}
NEAREST = (1 / 4, 1 / 16)  # shares of the vertices that an adaptive mesh has around its focus
# By what that multiplies its vertices
GROWTH = 1 + 3 * sum(4**i * share for i, share in enumerate(NEAREST))


def triangulate(
    atlas: Atlas, *, triangulation: str, vertices: int, seed: int, halves: bool = False
) -> Charted:
    """Return a mesh of a surface with about so many vertices.

    Parameters
    ----------
    atlas : Atlas
        The surface.
    triangulation : str
        ``uniform``: every patch cut into equal triangles. ``adaptive``: four times finer, and
        four times again, towards a random point. ``irregular``: vertices moved at random on
        the surface, then edges flipped until they are Delaunay.
    vertices : int
        How many vertices to aim at; the mesh has the nearest number that its patches allow.
    seed : int
        Seed of the random point or moves.
    halves : bool
        Whether the half with x > 0 is four times finer, or sixteen times, for an odd seed.
    """
    rng = np.random.Generator(np.random.PCG64(seed))
    times = 1 + seed % 2 if halves else 0
    growth = (1 + 4**times) / 2 * (GROWTH if triangulation == "adaptive" else 1)
    mesh = atlas.uniform(atlas.steps(vertices / growth))
    mesh = remesh.finer_half(atlas, mesh, times)
    if triangulation == "adaptive":
        points = atlas.points(mesh)
        low, high = points.min(axis=0), points.max(axis=0)
        focus = low + (high - low) * rng.random(3)
        mesh = remesh.towards(atlas, mesh, focus, NEAREST)
    if triangulation == "irregular":
        mesh = remesh.irregular(atlas, mesh, rng)
    return mesh


def one_shape(parameters: Parameters) -> Parameters:
    """Drop the parameters of the triangulation: two triangulations of a surface are one shape."""
    return {name: value for name, value in parameters.items() if name not in TRIANGULATION}


def charted(
    name: str,
    title: str,
    atlas: Callable[..., Atlas],
    least: Mapping[str, float | Choice],
    *,
    euler_characteristic: Euler = 2,
    boundaries: int = 0,
    orientable: bool = True,
    most: Mapping[str, float] | None = None,
    limit: Callable[..., Floats] | None = None,
    halves: bool = False,
    pieces: Callable[..., Atlas] | None = None,
) -> Family:
    """Return the family of an atlas, with the parameters of its triangulations.

    Parameters
    ----------
    name, title, euler_characteristic, boundaries, orientable, most, limit
        As of :class:`~synthnet.families.family.Family`.
    halves : bool
        As of :func:`triangulate`.
    atlas : callable
        From the surface's parameters, by keyword, to its atlas.
    least : mapping
        The surface's parameters; :data:`TRIANGULATION` comes on top.
    pieces : callable, optional
        From the surface's parameters to another atlas of it, smooth on each patch, where
        ``atlas`` is not.
    """

    def surface(*, triangulation: str, vertices: int, seed: int, **shape: float) -> Mesh:
        smooth = atlas(**shape)
        in_charts = triangulate(
            smooth, triangulation=triangulation, vertices=vertices, seed=seed, halves=halves
        )
        return smooth.mesh(in_charts)

    return Family(
        name=name,
        title=title,
        surface=surface,
        least={**least, **TRIANGULATION},
        most=most or {},
        euler_characteristic=euler_characteristic,
        boundaries=boundaries,
        orientable=orientable,
        limit=limit,
        atlas=lambda **parameters: (pieces or atlas)(**one_shape(parameters)),
        congruent=one_shape,
        shared=one_shape,
    )
