"""Meshes of several components: the union of their spectra, each zero left out."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synthnet import spectrum
from synthnet.spectrum import reference
from synthnet.types import Mesh
from tests.spectrum.meshes import reference_eigenvalues, side_by_side, sphere, tetrahedron


def together(meshes):
    """Put meshes side by side, their vertices in a random order."""
    whole = side_by_side(*meshes)
    order = np.random.default_rng(0).permutation(len(whole.vertices))
    return Mesh(whole.vertices[order], np.argsort(order)[whole.faces])


def union(meshes, k):
    """The first k eigenvalues after all zeros, by the dense solver."""
    return np.sort(np.concatenate([reference_eigenvalues(mesh)[1:] for mesh in meshes]))[:k]


def test_two_components_have_the_union_of_their_spectra():
    meshes = [sphere(20), sphere(16, radius=1.5)]
    mesh = together(meshes)
    result = spectrum.compute(mesh, k=12)
    assert result.components == 2
    np.testing.assert_allclose(result.eigenvalues, union(meshes, 12), rtol=1e-8)
    stiffness, mass = spectrum.fem_matrices(mesh)
    vectors = result.eigenvectors
    np.testing.assert_allclose(vectors.T @ (mass @ vectors), np.eye(12), atol=1e-9)
    defects = stiffness @ vectors - (mass @ vectors) * result.eigenvalues
    assert np.abs(defects).max() < 1e-8


def test_the_count_is_that_of_all_components():
    meshes = [sphere(20), sphere(16, radius=1.5), tetrahedron(0.1)]
    proof = spectrum.compute(together(meshes), k=7).certificate
    stiffness, mass = spectrum.fem_matrices(together(meshes))
    assert proof.count == reference.count_below(stiffness, mass, proof.shift)


@pytest.mark.parametrize("k", range(1, 13))
@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-5, 0.1])
def test_the_count_is_right_where_components_have_nearly_the_same_spectrum(k, apart):
    """A component is solved up to its own k-th pair: above that, others must not tell of it."""
    mesh = together([sphere(8, radius=1 + i * apart) for i in range(3)])
    proof = spectrum.compute(mesh, k=k).certificate
    stiffness, mass = spectrum.fem_matrices(mesh)
    assert proof.count == reference.count_below(stiffness, mass, proof.shift)


@pytest.mark.parametrize("copies", [2, 11, 60])
def test_equal_components(copies):
    mesh = sphere(8)
    result = spectrum.compute(together([mesh] * copies))
    assert result.components == copies
    np.testing.assert_allclose(result.eigenvalues, union([mesh] * copies, 10), rtol=1e-8)


@pytest.mark.parametrize("scale", [1e-2, 1e-5, 1e-8])
def test_debris_changes_nothing(scale):
    mesh = sphere(20)
    result = spectrum.compute(together([mesh, *[tetrahedron(scale)] * 5]))
    assert result.components == 6
    np.testing.assert_allclose(result.eigenvalues, union([mesh], 10), rtol=1e-8)


def test_k_is_at_most_the_vertices_less_the_components():
    mesh = together([tetrahedron(), tetrahedron(0.5)])
    assert len(spectrum.compute(mesh, k=6).eigenvalues) == 6
    with pytest.raises(ValueError, match="between 1 and 6 for 8 vertices in 2 components, got 7"):
        spectrum.compute(mesh, k=7)


@settings(max_examples=25, deadline=None)
@given(
    sizes=st.lists(st.tuples(st.integers(4, 12), st.floats(0.05, 20.0)), min_size=2, max_size=6),
    k=st.integers(1, 20),
)
def test_any_components(sizes, k):
    meshes = [sphere(*size) for size in sizes]
    result = spectrum.compute(together(meshes), k=k)
    np.testing.assert_allclose(result.eigenvalues, union(meshes, k), rtol=1e-8)
    assert result.components == len(meshes)
