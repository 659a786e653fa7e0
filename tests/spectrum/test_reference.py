"""The reference solver against closed forms and LaPy, and the fast solver against it."""

import lapy
import numpy as np
import pytest

from synthnet import spectrum
from synthnet.families import CHARTED, PRIMITIVES
from synthnet.spectrum import reference
from tests.spectrum.meshes import drawn


@pytest.mark.parametrize("family", [*PRIMITIVES, "mobius_band"])
def test_matrices_are_those_of_lapy(family):
    mesh = drawn(family)
    solver = lapy.Solver(lapy.TriaMesh(mesh.vertices, mesh.faces))
    for ours in (reference.matrices(mesh.vertices, mesh.faces), spectrum.fem_matrices(mesh)):
        for matrix, theirs in zip(ours, (solver.stiffness, solver.mass), strict=True):
            assert abs(matrix - theirs).max() <= 1e-12 * abs(theirs).max()


def test_pairs_solve_the_equation_and_the_same_matrices_give_the_same_numbers():
    mesh = drawn("cylinder")
    stiffness, mass = reference.matrices(mesh.vertices, mesh.faces)
    values, vectors = reference.eigenpairs(stiffness, mass, 5)
    assert (np.diff(values) >= 0).all()
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(5), atol=1e-10)
    defects = stiffness @ vectors - mass @ vectors * values
    assert np.linalg.norm(defects) <= 1e-8 * np.linalg.norm(stiffness @ vectors)
    again, _ = reference.eigenpairs(stiffness, mass, 5)
    assert values.tobytes() == again.tobytes()


def test_the_count_is_that_of_all_eigenvalues():
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


def test_a_zero_pivot_is_no_count():
    stiffness, mass = reference.matrices(np.eye(3), np.array([[0, 1, 2]]))
    zero = stiffness[0, 0] / mass[0, 0]  # makes the diagonal of A - sigma B vanish
    with pytest.raises(RuntimeError, match=r"a pivot of A - \S+ B is zero|singular"):
        reference.count_below(stiffness, mass, zero)


@pytest.mark.parametrize("family", [*list(PRIMITIVES)[::2], *list(CHARTED)[::6]])
def test_the_fast_solver_finds_the_same(family):
    mesh = drawn(family)
    stiffness, mass = reference.matrices(mesh.vertices, mesh.faces)
    for ours, theirs in zip(spectrum.fem_matrices(mesh), (stiffness, mass), strict=True):
        assert abs(ours - theirs).max() <= 1e-12 * abs(theirs).max()
    label = spectrum.compute(mesh)
    values, _ = reference.eigenpairs(stiffness, mass, 11)
    np.testing.assert_allclose(label.eigenvalues, values[1:], rtol=1e-8)
    proof = label.certificate
    assert reference.count_below(stiffness, mass, proof.shift) == proof.count
