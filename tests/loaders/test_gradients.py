"""Eigenvalues as a function of the vertices: their derivative against finite differences."""

import runpy
from pathlib import Path

import numpy as np
import pytest
import trimesh

from synthnet.spectrum import Operator, compute
from synthnet.spectrum.derivative import clusters, vertex_gradient
from tests.spectrum.meshes import sphere

torch = pytest.importorskip("torch")
from synthnet.torch import eigenvalues  # noqa: E402 - it needs torch


def bumpy(n=8):
    """A sphere whose symmetry random moves have taken away, and its faces."""
    mesh = sphere(n)
    rng = np.random.default_rng(3)
    moved = mesh.vertices * (1 + 0.1 * rng.standard_normal((len(mesh.vertices), 1)))
    return torch.tensor(moved, dtype=torch.float64, requires_grad=True), torch.tensor(mesh.faces)


def test_values_are_those_of_compute():
    vertices, faces = bumpy()
    values = eigenvalues(vertices, faces, 6)
    assert values.dtype == torch.float64
    expected = compute((vertices, faces), 6).eigenvalues
    np.testing.assert_allclose(values.detach().numpy(), expected, rtol=1e-9)


def test_gradient_is_that_of_finite_differences():
    vertices, faces = bumpy(4)
    assert torch.autograd.gradcheck(
        lambda v: eigenvalues(v, faces, 4), (vertices,), eps=1e-6, atol=1e-6, rtol=1e-4
    )


def test_gradient_knows_that_eigenvalues_scale_and_do_not_move_or_turn():
    vertices, faces = bumpy()
    values = eigenvalues(vertices, faces, 5)
    for i in range(5):
        (gradient,) = torch.autograd.grad(values[i], vertices, retain_graph=True)
        assert (vertices * gradient).sum().item() == pytest.approx(-2 * values[i].item(), rel=1e-6)
        np.testing.assert_allclose(gradient.sum(0).numpy(), 0, atol=1e-9)
        turned = torch.linalg.cross(vertices, gradient, dim=1).sum(0)
        np.testing.assert_allclose(turned.detach().numpy(), 0, atol=1e-9)


def test_each_eigenvalue_of_a_cluster_has_the_gradient_of_its_mean():
    solid = trimesh.creation.icosahedron()
    vertices, faces = torch.tensor(solid.vertices, requires_grad=True), torch.tensor(solid.faces)
    values = eigenvalues(vertices, faces, 2)  # the first three agree
    gradient, other = (
        torch.autograd.grad(values[i], vertices, retain_graph=True)[0] for i in range(2)
    )
    np.testing.assert_allclose(gradient.numpy(), other.numpy(), atol=1e-12)
    step = torch.tensor(1e-6 * np.random.default_rng(0).normal(size=(12, 3)))
    at = vertices.detach()
    change = (eigenvalues(at + step, faces, 3) - eigenvalues(at, faces, 3)).mean()
    assert change.item() == pytest.approx((gradient * step).sum().item(), rel=1e-3)


def test_a_batch_is_its_meshes_and_single_precision_stays():
    (a, faces), (b, more) = bumpy(6), bumpy(8)
    single = a.detach().to(torch.float32).requires_grad_()
    batch = eigenvalues([single, b], [faces, more.numpy()], 3)
    assert batch.shape == (2, 3)
    batch.sum().backward()
    assert single.grad is not None
    assert single.grad.dtype == torch.float32
    expected = torch.autograd.grad(eigenvalues(a, faces, 3).sum(), a)[0]
    np.testing.assert_allclose(single.grad.numpy(), expected.numpy(), rtol=1e-3, atol=1e-5)


def test_clusters_are_neighbours_with_small_gaps():
    assert clusters(np.array([1.0, 1.0 + 1e-6, 2.0]), 1e-5).tolist() == [0, 0, 1]
    assert clusters(np.array([1.0, 1.0 + 1e-4, 2.0]), 1e-5).tolist() == [0, 1, 2]


@pytest.mark.parametrize("mass", ["consistent", "lumped", "mean"])
def test_only_eigenvectors_of_consistent_mass_have_this_gradient(mass):
    mesh = sphere(8)
    found = compute(mesh, 3, operator=Operator(mass=mass))
    if mass == "consistent":
        gradient = vertex_gradient(mesh, found, np.ones(3))
        assert (mesh.vertices * gradient).sum() == pytest.approx(-2 * found.eigenvalues.sum())
        return
    with pytest.raises(ValueError, match=r"eigenvector 1 has a square of 0\.\d+ in the consistent"):
        vertex_gradient(mesh, found, np.ones(3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"k": 0}, "k must be at least 1"),
        ({"k": 2.5}, "k must be an integer"),
        ({"tolerance": 1.0}, "tolerance must be at least 0 and below 1"),
        ({"vertices": np.eye(3)}, "vertices and faces must be a tensor each"),
        ({"vertices": []}, "vertices and faces must be a tensor each"),
        ({"vertices": [], "faces": []}, "a batch has as many vertices as faces"),
        ({"vertices": torch.zeros(4, 3, dtype=torch.int64)}, "tensor of float32 or float64"),
        ({"vertices": torch.full((4, 3), torch.nan)}, "4 vertices are NaN"),
        ({"faces": torch.zeros(3, 9, dtype=torch.int64)}, "transpose PyG's data.face"),
    ],
)
def test_bad_input_is_one_line(change, message):
    vertices = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = torch.tensor([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    with pytest.raises(ValueError, match=message):
        eigenvalues(**{"vertices": vertices, "faces": faces, "k": 2, **change})


def test_the_example_recovers_the_axes_of_an_ellipsoid(capsys):
    example = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "ellipsoid_axes.py"))
    assert example["recover"]() == pytest.approx([0.8, 1.0, 1.3], abs=1e-3)
    assert "off by" in capsys.readouterr().out
