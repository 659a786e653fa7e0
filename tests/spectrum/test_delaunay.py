"""Intrinsic Delaunay triangulations: flips move nothing, and give what robust_laplacian gives."""

import numpy as np
import pytest
import robust_laplacian

from evidence.operators import square
from synthnet import spectrum
from synthnet.spectrum import Operator, delaunay
from synthnet.spectrum.operators import as_sparse, discretise
from synthnet.types import Mesh
from tests.spectrum.meshes import sphere

INTRINSIC = Operator(elements="delaunay")


def wavy():
    """A closed surface with obtuse triangles: a sphere that is stretched along one axis."""
    ball = sphere(14)
    points = ball.vertices.astype(np.float64)
    points += np.random.default_rng(0).uniform(-0.02, 0.02, points.shape)  # no four on a circle
    return Mesh(points * [6.0, 1.0, 1.0], ball.faces)


def mobius():
    """A band of one side with long triangles."""
    n, m = 24, 4
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, np.linspace(-1, 1, m), indexing="ij")
    r = 4 + v * np.cos(u / 2)
    points = np.stack([r * np.cos(u), r * np.sin(u), v * np.sin(u / 2)], axis=-1).reshape(-1, 3)
    number = np.arange(n * m).reshape(n, m)
    after = np.concatenate([number[1:], number[:1, ::-1]])
    a, b, c, d = number[:, :-1], after[:, :-1], after[:, 1:], number[:, 1:]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))]
    return Mesh(points * [1.0, 1.0, 3.0], np.concatenate(faces))


@pytest.mark.parametrize("mesh", [wavy(), mobius()], ids=["closed", "one side"])
def test_flips_keep_the_surface_and_no_angles_add_up_to_more_than_pi(mesh):
    corners, lengths = delaunay.triangulate(mesh)
    plain, _ = as_sparse(discretise(mesh).matrices)
    stiffness, mass = as_sparse(discretise(mesh, INTRINSIC).matrices)
    assert mass.sum() == pytest.approx(as_sparse(discretise(mesh).matrices)[1].sum(), rel=1e-12)
    assert abs(stiffness - stiffness.T).max() < 1e-12
    assert np.abs(stiffness.sum(axis=1)).max() < 1e-9
    inner = stiffness - _boundary_part(mesh, stiffness)
    inner.setdiag(0)
    assert inner.max() < 1e-9
    plain.setdiag(0)
    assert plain.max() > 0.1  # the mesh itself is not Delaunay
    assert corners.shape == lengths.shape == mesh.faces.shape
    # Of all triangulations, Delaunay's has the least energy, whatever the function (Rippa)
    values = np.random.default_rng(0).standard_normal((len(mesh.vertices), 5))
    linear, _ = as_sparse(discretise(mesh).matrices)
    energies = [np.einsum("ij,ij->j", values, matrix @ values) for matrix in (stiffness, linear)]
    assert (energies[0] < energies[1]).all()


def _boundary_part(mesh, stiffness):
    """Entries of edges of one face, where an angle alone may be more than a right one."""
    sides = np.sort(np.concatenate([mesh.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    edges, counts = np.unique(sides, axis=0, return_counts=True)
    i, j = edges[counts == 1].T
    part = stiffness.tolil(copy=True)
    part[:] = 0
    part[i, j] = stiffness[i, j]
    part[j, i] = stiffness[j, i]
    return part.tocsc()


def test_it_is_the_operator_of_robust_laplacian_on_a_closed_surface():
    mesh = wavy()
    lumped = Operator(elements="delaunay", mass="lumped")
    stiffness, mass = as_sparse(discretise(mesh, lumped).matrices)
    theirs, weights = robust_laplacian.mesh_laplacian(mesh.vertices, mesh.faces, 0.0)
    assert abs(stiffness - theirs).max() < 1e-9 * abs(theirs).max()
    assert abs(mass - weights).max() < 1e-9 * abs(weights).max()


def test_a_delaunay_mesh_is_left_as_it_is():
    mesh = square(8)
    np.testing.assert_array_equal(delaunay.triangulate(mesh)[0], mesh.faces)


def test_flat_triangles_go_by_flips_and_edges_of_many_faces_are_refused():
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0], [1, -1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 3], [1, 0, 4]])  # the first is flat
    result = spectrum.compute(Mesh(corners, faces), 3, operator=INTRINSIC)
    whole = np.array([[0, 2, 3], [2, 1, 3], [0, 4, 2], [4, 1, 2]])
    expected = spectrum.compute(Mesh(corners, whole), 3)
    np.testing.assert_allclose(result.eigenvalues, expected.eigenvalues, rtol=1e-9)
    book = np.array([[0, 2, 3], [0, 2, 4], [2, 0, 1]])
    turned = Mesh(corners + np.array([[0, 0, 0.3]]) * (np.arange(5) == 0)[:, None], book)
    with pytest.raises(ValueError, match="1 edges have more than two faces, so that there is no"):
        spectrum.compute(turned, 2, operator=INTRINSIC)


def test_on_thin_triangles_it_is_nearer_to_the_surface():
    exact = np.pi**2 * np.array([1, 1, 2])
    mesh = crossed(12)
    plain = spectrum.compute(mesh, 3).eigenvalues
    intrinsic = spectrum.compute(mesh, 3, operator=INTRINSIC).eigenvalues
    assert np.abs(intrinsic / exact - 1).max() < np.abs(plain / exact - 1).max() / 2


def crossed(cells):
    """A square whose inner edges were flipped wherever that makes thinner triangles."""
    mesh = square(cells)
    points = mesh.vertices.copy()
    inner = (points[:, :2] > 0).all(axis=1) & (points[:, :2] < 1).all(axis=1)
    column = (points[:, 0] * cells).round().astype(int)
    points[inner, 1] += np.where(column[inner] % 2 == 1, 0.45, -0.45) / cells
    return Mesh(points, mesh.faces)
