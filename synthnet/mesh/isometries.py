"""Isometric copies of a shape: rotations, reflections and their products."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Floats
from synthnet.types import Mesh


def random_rotation(rng: np.random.Generator) -> Floats:
    """Draw a rotation uniformly from SO(3), shape (3, 3), float64, by trimesh.

    Examples
    --------
    >>> rotation = random_rotation(np.random.default_rng(0))
    >>> bool(np.allclose(rotation @ rotation.T, np.eye(3)))
    True
    >>> round(float(np.linalg.det(rotation)), 9)
    1.0
    """
    from trimesh import transformations  # as late as here, since that takes half a second

    matrix: Floats = transformations.random_rotation_matrix(rand=rng.random(3))
    return matrix[:3, :3]


def random_reflection(rng: np.random.Generator) -> Floats:
    """Draw a reflection in a plane through the origin, its normal uniform on the sphere.

    Examples
    --------
    >>> reflection = random_reflection(np.random.default_rng(0))
    >>> bool(np.allclose(reflection @ reflection, np.eye(3)))
    True
    """
    from trimesh import transformations

    normal = random_rotation(rng)[:, 2]
    matrix: Floats = transformations.reflection_matrix(np.zeros(3), normal)
    return matrix[:3, :3]


def draw_isometries(rotations: int, reflections: int, rng: np.random.Generator) -> Floats:
    """Draw a shape's instances.

    Parameters
    ----------
    rotations, reflections : int
        How many rotations R and reflections S.
    rng : numpy.random.Generator
        The shape's own generator.

    Returns
    -------
    ndarray of shape (c, 3, 3), float64
        The identity, the rotations, the reflections, then every product R S, with R in
        the outer loop. A vertex x goes to ``matrix @ x``.

    References
    ----------
    Paper, section 4.1: two rotations, two reflections and four of both.

    Examples
    --------
    >>> isometries = draw_isometries(2, 2, np.random.default_rng(0))
    >>> np.linalg.det(isometries).round().astype(int).tolist()
    [1, 1, 1, -1, -1, -1, -1, -1, -1]
    """
    turns = [random_rotation(rng) for _ in range(rotations)]
    mirrors = [random_reflection(rng) for _ in range(reflections)]
    products = [turn @ mirror for turn in turns for mirror in mirrors]
    return np.stack([np.eye(3), *turns, *mirrors, *products])


def apply(mesh: Mesh, isometry: NDArray[np.floating[Any]]) -> Mesh:
    """Move a mesh by an orthogonal matrix; a reflection also turns the faces round.

    Parameters
    ----------
    mesh : Mesh
        Any mesh; dtypes are kept.
    isometry : ndarray of shape (3, 3)
        Orthogonal matrix.

    Returns
    -------
    Mesh
        Oriented outwards if ``mesh`` is.

    Examples
    --------
    >>> mirrored = apply(Mesh(np.eye(3), np.array([[0, 1, 2]])), np.diag([1.0, 1.0, -1.0]))
    >>> mirrored.vertices[2].tolist(), mirrored.faces.tolist()
    ([0.0, 0.0, -1.0], [[0, 2, 1]])
    """
    moved = mesh.vertices @ isometry.T.astype(mesh.vertices.dtype)
    reflects = np.linalg.det(isometry) < 0
    return Mesh(moved, mesh.faces[:, [0, 2, 1]] if reflects else mesh.faces)
