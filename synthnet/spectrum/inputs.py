"""Meshes of other libraries, and arrays: what :func:`synthnet.spectrum.compute` takes.

They are recognised by their attributes, so that none of these libraries need be installed.
"""

from __future__ import annotations

import os
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import as_array
from synthnet.errors import counted
from synthnet.mesh.repair import Repaired, Rules, repair
from synthnet.types import Mesh

OURS: Final = ("C", "W")  # of arrays: contiguous, rows first, and to be written to
EXACT = 2.0**53  # every smaller whole number has a float64 of its own
TRIANGLE = 3  # vertices, the least that a surface can have
SIZES = 1e-50, 1e50  # of a mesh: the squares of its areas are far from the ends of float64
# Attributes of vertices and faces, and whether a column is a face.
KINDS = (
    (("vertices", "faces"), False),  # synthnet, trimesh
    (("vertices", "triangles"), False),  # Open3D
    (("v", "t"), False),  # LaPy
    (("pos", "face"), True),  # PyTorch Geometric
    (("points", "regular_faces"), False),  # PyVista
)
TAKEN = (
    "a mesh of synthnet, trimesh, Open3D, LaPy, PyVista or PyTorch Geometric, or a pair of arrays "
    "(vertices, faces)"
)


def as_mesh(given: Any) -> Mesh:
    """Return a mesh as float64 vertices and integer faces.

    Parameters
    ----------
    given : Mesh or other
        A mesh of synthnet, trimesh, Open3D, LaPy, PyVista or PyTorch Geometric, or a pair
        (vertices, faces): arrays of shape (n, 3) and (m, 3), of NumPy or PyTorch, or lists.

    Returns
    -------
    Mesh
        The same vertices and faces in the same order. Arrays that are read-only are copied: Numba
        would compile every kernel once more for them, which takes half a minute.

    Raises
    ------
    ValueError
        If it is none of these, or its arrays are no vertices and faces.

    Examples
    --------
    >>> as_mesh((np.eye(3), [[0, 1, 2]])).faces
    array([[0, 1, 2]])
    """
    vertices, faces = _arrays(given)
    if vertices.dtype.kind not in "fiu":
        raise ValueError(f"vertices must be real numbers, got {vertices.dtype}")
    if faces.size == 0:
        faces = np.empty((0, 3), dtype=np.int64)
    elif faces.dtype.kind == "f":
        whole = np.array_equal(faces, np.trunc(faces)) and np.abs(faces).max() < EXACT
        faces = faces.astype(np.int64) if whole else faces
    return Mesh(np.require(vertices, np.float64, OURS), np.require(faces, requirements=OURS))


def repaired(given: Any) -> Repaired:
    """Return a mesh, repaired so that it has a spectrum; how long one depends on the operator.

    Parameters
    ----------
    given : Mesh or other
        As of :func:`as_mesh`.

    Raises
    ------
    ValueError
        If it is no mesh.
    Refused
        If it is no surface by a rule of :mod:`synthnet.mesh.repair`.
    """
    return repair(as_mesh(given), Rules(least=TRIANGLE))


def as_count(count: Any, name: str = "k") -> int:
    """Return a number of eigenvalues, or of another name, that is an integer as Python's.

    Raises
    ------
    ValueError
        If it is neither Python's nor NumPy's: a whole float too.
    """
    if isinstance(count, bool) or not isinstance(count, int | np.integer):
        raise ValueError(f"{name} must be an integer, got {count!r}")  # noqa: TRY004 - one kind of error for all bad input
    return int(count)


def as_number(number: Any, name: str) -> float:
    """Return one real number, of Python, NumPy or PyTorch, as Python's.

    Raises
    ------
    ValueError
        If it is anything else, a list of numbers too.
    """
    value = as_array(number)
    if value.ndim or value.dtype.kind not in "fiu":
        raise ValueError(
            f"{name} must be one real number, got shape {value.shape} of {value.dtype}"
        )
    return float(value)


def check(mesh: Mesh) -> None:
    """Check that a mesh has triangles, and coordinates whose areas have squares.

    Raises
    ------
    ValueError
        If it is empty or a point cloud, not finite, in one point, or of a size that overflows.
    """
    points, (least, most) = mesh.vertices, SIZES
    if not len(mesh.faces):
        count = f"a point cloud: {len(points)} vertices and" if len(points) else "an empty mesh:"
        raise ValueError(f"{count} no triangles")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        what = "NaN" if np.isnan(points[bad]).any() else "infinite"
        many = counted(len(bad), "vertex is", "vertices are")
        raise ValueError(f"{many} {what}, the first is vertex {bad[0]}")
    with np.errstate(over="ignore"):  # a width may be infinite between numbers that are not
        size, extent = float(np.abs(points).max()), float(np.ptp(points, axis=0).max())
    if size > most or 0 < extent < least:
        raise ValueError(
            f"the mesh is {extent:.3g} wide and has coordinates up to {size:.3g}: scale it to "
            f"between {least:g} and {most:g}, where areas and their squares have a float64"
        )
    if extent == 0:
        raise ValueError("all vertices are at the same position, so that no triangle has an area")


def _arrays(given: Any) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return what is given as vertices and as faces, a row each."""
    if isinstance(given, tuple | list) and len(given) == 2:
        return as_array(given[0]), as_array(given[1])
    for (vertices, faces), columns in KINDS:
        arrays = getattr(given, vertices, None), getattr(given, faces, None)
        if arrays[0] is not None and arrays[1] is not None:
            return as_array(arrays[0]), as_array(arrays[1]).T if columns else as_array(arrays[1])
    hint = ""
    if isinstance(given, str | os.PathLike):
        hint = "; read the file first: trimesh.load_mesh(path)"
    elif isinstance(given, np.ndarray):
        hint = "; with parentheses of its own: compute((vertices, faces))"
    elif hasattr(given, "to_mesh"):  # a scene of trimesh
        hint = "; its .to_mesh() is one"
    elif getattr(given, "pos", None) is not None:  # a graph of PyTorch Geometric
        hint = "; it has no face: FaceToEdge(remove_faces=False) keeps the faces"
    elif hasattr(given, "to_legacy"):  # a tensor mesh of Open3D
        hint = "; its .to_legacy() is one"
    elif hasattr(given, "cells_dict"):  # of meshio
        hint = '; of meshio: (given.points, given.cells_dict["triangle"])'
    elif hasattr(given, "points") or hasattr(given, "vertices"):
        hint = "; it has no triangles"
    kind = type(given)
    name = kind.__name__ if kind.__module__ == "builtins" else f"{kind.__module__}.{kind.__name__}"
    raise ValueError(f"this is {name}, no mesh: give {TAKEN}{hint}")
