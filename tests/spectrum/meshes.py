"""Meshes that the tests of several files take, and all their eigenvalues by dense solvers."""

import numpy as np
import scipy.linalg
import trimesh

from synthnet import recipe
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.recipe.drawing import draw_shape
from synthnet.spectrum import as_mesh, reference
from synthnet.spectrum.operators import PLAIN, as_sparse, discretise
from synthnet.types import Mesh


def sphere(resolution, radius=1.0):
    return FAMILIES["sphere"].generate({"radius": radius, "resolution": resolution})


def torus(around, across):
    sizes = {"torus_radius": 1.0, "tube_radius": 0.4}
    steps = {"radial_resolution": around, "tubular_resolution": across}
    return FAMILIES["torus"].generate(sizes | steps)


def rectangle(columns, rows, width=1.0, height=1.0):
    """Flat grid of columns × rows cells, column by column, each cut along the same diagonal."""
    x, y = np.meshgrid(
        np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1), indexing="ij"
    )
    low = (np.arange(columns)[:, None] * (rows + 1) + np.arange(rows)).ravel()
    high = low + rows + 1
    below, above = np.stack([low, high, high + 1], 1), np.stack([low, high + 1, low + 1], 1)
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    return Mesh(vertices, np.concatenate([below, above]))


def ball(subdivisions):
    """The icosphere: its eigenvalues come in copies of up to five."""
    made = trimesh.creation.icosphere(subdivisions=subdivisions)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def tetrahedron(scale=1.0):
    """A regular one."""
    corners = scale * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    return Mesh(corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))


def drawn(family, index=1):
    """Return a shape of 1.0, or of 2.1 where 1.0 has no such family."""
    version = "1.0" if family in PRIMITIVES else "2.1"
    return FAMILIES[family].generate(draw_shape(recipe.load(version), family, index).parameters)


def side_by_side(*meshes, apart=5.0):
    """Return meshes as one, each moved so far beyond the one before."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    vertices = [mesh.vertices + apart * i for i, mesh in enumerate(meshes)]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def dense(mesh, operator=PLAIN):
    """All eigenvalues, zeros among them, by LAPACK."""
    stiffness, mass = as_sparse(discretise(as_mesh(mesh), operator).matrices)
    return scipy.linalg.eigvalsh(stiffness.toarray(), mass.toarray())


def reference_eigenvalues(mesh):
    """All eigenvalues of linear elements, by the reference."""
    return reference.all_eigenvalues(*reference.matrices(mesh.vertices, mesh.faces))
