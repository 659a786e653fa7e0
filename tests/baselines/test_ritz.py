"""The baseline baselines/ritz.py: Rayleigh-Ritz on polynomials."""

import numpy as np
import pytest

from evidence import baseline
from synthnet import Mesh, spectrum
from synthnet.families import FAMILIES


@pytest.fixture(scope="module")
def ritz():
    return baseline("ritz")


def square(n):
    """The unit square in a plane askew, (n + 1)² vertices."""
    x, y = (axis.ravel() for axis in np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2, indexing="ij"))
    i = np.arange((n + 1) * n).reshape(n, n + 1)[:, :n].ravel()
    faces = np.vstack(
        [np.stack([i, i + n + 1, i + n + 2], axis=1), np.stack([i, i + n + 2, i + 1], axis=1)]
    )
    return Mesh(np.stack([x, y, 0.3 * x - 0.2 * y], axis=1), faces)


@pytest.mark.parametrize("degree", [1, 3, 5])
def test_ritz_values_are_upper_bounds_ten_of_them_also_in_a_plane(ritz, degree):
    mesh = square(20)  # of degree 3 a plane has 9 functions besides the constant
    values = ritz.ritz_values(mesh, degree)
    exact = spectrum.compute(mesh).eigenvalues
    assert values.shape == (10,)
    assert (values >= exact * (1 - 1e-9)).all()
    assert values[:2] == pytest.approx(exact[:2], rel=0.02)


def test_degree_is_not_raised_where_the_functions_suffice(ritz):
    sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 12})
    np.testing.assert_array_equal(ritz.ritz_values(sphere, 3), ritz.predict([sphere], degree=3)[0])
    assert ritz.ritz_values(sphere, 3)[-1] > ritz.ritz_values(sphere, 5)[-1]


def test_a_mesh_of_fewer_vertices_than_eigenvalues_ends(ritz):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=float)
    tetrahedron = Mesh(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    exact = spectrum.compute(tetrahedron, k=3).eigenvalues
    np.testing.assert_allclose(ritz.ritz_values(tetrahedron, 1), exact)
