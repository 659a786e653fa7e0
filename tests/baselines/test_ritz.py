"""The baseline baselines/ritz.py: Rayleigh-Ritz on polynomials."""

import numpy as np
import pytest

from evidence import baseline
from evidence.operators import square
from synthnet import Mesh, spectrum
from tests.spectrum.meshes import sphere


@pytest.fixture(scope="module")
def ritz():
    return baseline("ritz")


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_ritz_values_are_upper_bounds_ten_of_them_also_in_a_plane(ritz, degree):
    flat = square(20)  # of degree 3 a plane has 9 functions besides the constant
    mesh = Mesh(flat.vertices @ [[1, 0, 0.3], [0, 1, -0.2], [0, 0, 0]], flat.faces)  # askew
    values = ritz.ritz_values(mesh, degree)
    exact = spectrum.compute(mesh).eigenvalues
    assert values.shape == (10,)
    assert (values >= exact * (1 - 1e-9)).all()
    assert values[:2] == pytest.approx(exact[:2], rel=0.02)


def test_degree_is_not_raised_where_the_functions_suffice(ritz):
    mesh = sphere(12)
    np.testing.assert_array_equal(ritz.ritz_values(mesh, 3), ritz.predict([mesh], degree=3)[0])
    assert ritz.ritz_values(mesh, 3)[-1] > ritz.ritz_values(mesh, 5)[-1]


def test_a_mesh_of_fewer_vertices_than_eigenvalues_ends(ritz):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    tetrahedron = Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    exact = spectrum.compute(tetrahedron, k=3).eigenvalues
    np.testing.assert_allclose(ritz.ritz_values(tetrahedron, 1), exact)
