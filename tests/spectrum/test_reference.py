"""The reference solver against closed forms and LaPy, and the fast solver against it."""

import lapy
import numpy as np
import pytest

from synthnet import spectrum
from synthnet.families import CHARTED, PRIMITIVES
from synthnet.spectrum import reference
from synthnet.types import Mesh
from tests.spectrum.meshes import drawn, sphere


def smallest(mesh: Mesh, k: int) -> np.ndarray:
    """The first k eigenvalues after the zero."""
    return reference.eigenpairs(*reference.matrices(mesh.vertices, mesh.faces), k + 1)[0][1:]


def order_of_convergence(sizes: list[int], errors: np.ndarray) -> float:
    return float(-np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def test_sphere_converges_to_l_times_l_plus_one_with_order_two() -> None:
    exact = np.repeat([2.0, 6.0, 12.0], [3, 5, 2])
    sizes = [10, 20, 40]
    errors = np.array([np.abs(smallest(sphere(n), 10) / exact - 1) for n in sizes])
    assert errors[-1].max() < 8e-3
    orders = [order_of_convergence(sizes, error) for error in errors.T]
    np.testing.assert_allclose(orders, 2, atol=0.15)


def test_rectangle_converges_to_the_neumann_spectrum_from_above() -> None:
    # On [0, 1] x [0, 0.7] the eigenvalues are pi^2 (i^2 + (j / 0.7)^2), with i and j from 0.
    modes = np.arange(8)
    exact = np.sort((np.pi**2 * (modes[:, None] ** 2 + (modes / 0.7) ** 2)).ravel())[1:8]
    sizes, errors = [8, 16, 32], []
    for n in sizes:
        x, y = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 0.7, n + 1))
        corner = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
        below = np.stack([corner, corner + 1, corner + n + 2], axis=1)
        above = np.stack([corner, corner + n + 2, corner + n + 1], axis=1)
        vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
        errors.append(smallest(Mesh(vertices, np.concatenate([below, above])), 7) / exact - 1)
    assert (np.array(errors) > 0).all()
    orders = [order_of_convergence(sizes, error) for error in np.transpose(errors)]
    np.testing.assert_allclose(orders, 2, atol=0.15)


@pytest.mark.parametrize("family", ["torus", "tetrahedron", "split_cone", "mobius_band"])
def test_matrices_are_those_of_lapy(family: str) -> None:
    mesh = drawn(family)
    theirs = lapy.Solver(lapy.TriaMesh(mesh.vertices, mesh.faces))
    stiffness, mass = reference.matrices(mesh.vertices, mesh.faces)
    assert abs(stiffness - theirs.stiffness).max() <= 1e-12 * abs(stiffness).max()
    assert abs(mass - theirs.mass).max() <= 1e-12 * abs(mass).max()


def test_pairs_solve_the_equation_and_the_same_matrices_give_the_same_numbers() -> None:
    mesh = drawn("cylinder")
    stiffness, mass = reference.matrices(mesh.vertices, mesh.faces)
    values, vectors = reference.eigenpairs(stiffness, mass, 5)
    assert (np.diff(values) >= 0).all()
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(5), atol=1e-10)
    defects = stiffness @ vectors - mass @ vectors * values
    assert np.linalg.norm(defects) <= 1e-8 * np.linalg.norm(stiffness @ vectors)
    again, _ = reference.eigenpairs(stiffness, mass, 5)
    assert values.tobytes() == again.tobytes()


def test_the_count_is_that_of_all_eigenvalues() -> None:
    mesh = drawn("tetrahedron")
    stiffness, mass = reference.matrices(mesh.vertices, mesh.faces)
    values = reference.all_eigenvalues(stiffness, mass)
    n = len(values)
    assert n == len(mesh.vertices)
    counts = [1, 4, n // 2, n - 1]
    for count in counts:
        shift = (values[count - 1] + values[count]) / 2
        assert reference.count_below(stiffness, mass, shift) == count
    assert reference.count_below(stiffness, mass, -1.0) == 0
    assert reference.count_below(stiffness, mass, 2 * values[-1]) == n


def test_a_zero_pivot_is_no_count() -> None:
    stiffness, mass = reference.matrices(np.eye(3), np.array([[0, 1, 2]]))
    zero = stiffness[0, 0] / mass[0, 0]  # makes the diagonal of A - sigma B vanish
    with pytest.raises(RuntimeError, match=r"a pivot of A - \S+ B is zero|singular"):
        reference.count_below(stiffness, mass, zero)


@pytest.mark.parametrize("family", [*list(PRIMITIVES)[::2], *list(CHARTED)[::6]])
def test_the_fast_solver_finds_the_same(family: str) -> None:
    mesh = drawn(family)
    stiffness, mass = reference.matrices(mesh.vertices, mesh.faces)
    for ours, theirs in zip(spectrum.fem_matrices(mesh), (stiffness, mass), strict=True):
        assert abs(ours - theirs).max() <= 1e-12 * abs(theirs).max()
    label = spectrum.compute(mesh)
    values, _ = reference.eigenpairs(stiffness, mass, 11)
    np.testing.assert_allclose(label.eigenvalues, values[1:], rtol=1e-8)
    proof = label.certificate
    assert reference.count_below(stiffness, mass, proof.shift) == proof.count
