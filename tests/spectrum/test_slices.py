"""Long spectra in slices, against dense solvers and against one search."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evidence.operators import square
from synthnet import spectrum
from synthnet.errors import CertificateError, SpectrumError
from synthnet.spectrum import Operator, slices, solve
from synthnet.spectrum.certificate import Candidate
from synthnet.spectrum.operators import as_sparse, discretise
from synthnet.types import Mesh
from tests.spectrum.meshes import ball, dense, side_by_side


def bumpy(cells, seed):
    mesh = square(cells)
    moved = np.random.default_rng(seed).uniform(-0.3 / cells, 0.3 / cells, mesh.vertices.shape)
    return Mesh(mesh.vertices + moved, mesh.faces)


@pytest.fixture
def sliced(monkeypatch):
    """Slices on small meshes; the number of pairs of each that was searched for."""
    asked = []
    search = slices.search

    def counted(matrices, ordering, k, *others):
        asked.append(k)
        return search(matrices, ordering, k, *others)

    monkeypatch.setattr(slices, "search", counted)
    monkeypatch.setattr(solve, "DENSE_AT_MOST", 0)
    return asked


@pytest.mark.parametrize(
    ("mesh", "operator", "zeros"),
    [
        (ball(3), Operator(), 1),
        (ball(3), Operator(mass="lumped"), 1),
        (square(30), Operator(), 1),
        (square(30), Operator("dirichlet"), 0),
        (square(15), Operator("dirichlet", elements="quadratic"), 0),
    ],
)
def test_none_is_missed_over_several_slices(mesh, operator, zeros, sliced):
    result = spectrum.compute(mesh, 200, operator=operator)
    assert len(sliced) >= 3
    values = dense(mesh, operator)
    np.testing.assert_allclose(result.eigenvalues, values[zeros : zeros + 200], rtol=1e-9)
    proof = result.certificate
    assert proof.count == np.count_nonzero(values < proof.shift)
    assert proof.residual <= 1e-7
    if operator.elements == "linear":
        off = np.abs(result.eigenvalues - values[zeros : zeros + 200])
        assert (off <= proof.error_bound + 1e-11 * values[200]).all()
        assert (proof.error_bound / result.eigenvalues).max() < 1e-5
        discrete = discretise(mesh, operator)
        free = slice(None) if discrete.free is None else discrete.free
        vectors, mass = result.eigenvectors[free], as_sparse(discrete.matrices)[1]
        np.testing.assert_allclose(vectors.T @ (mass @ vectors), np.eye(200), atol=1e-6)


@pytest.mark.slow
@given(st.integers(0, 2**32), st.integers(6, 20), st.integers(1, 12))
@settings(max_examples=30, deadline=None)
def test_any_slices_give_the_spectrum(seed, pairs, beside):
    mesh = bumpy(16, seed)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solve, "DENSE_AT_MOST", 0)
        patch.setattr(solve, "LONG", pairs)
        patch.setattr(slices, "SLICE", pairs)
        patch.setattr(slices, "BESIDE", beside)
        result = spectrum.compute(mesh, 80)
    np.testing.assert_allclose(result.eigenvalues, dense(mesh)[1:81], rtol=1e-9)


def test_components_may_have_long_spectra(sliced):
    mesh = side_by_side(ball(3), square(20))
    result = spectrum.compute(mesh, 150)
    assert sliced
    np.testing.assert_allclose(result.eigenvalues, dense(mesh)[2:152], rtol=1e-9)


def test_a_slice_that_lacks_a_pair_is_no_answer(monkeypatch, sliced):
    search = slices.search

    def lossy(matrices, ordering, k, setting, window):
        part, counted = search(matrices, ordering, k, setting, window)
        if window is not None:
            part = replace(part, values=part.values[1:], vectors=part.vectors[1:])
        return part, counted

    monkeypatch.setattr(slices, "search", lossy)
    matrices = spectrum.discretise(square(30)).matrices
    ordering = solve.find_ordering(matrices.indptr, matrices.indices)
    with pytest.raises(CertificateError, match=r"\d+ eigenvalues are below .*, but \d+ were found"):
        slices.search_in_slices(matrices, ordering, 120, solve.NORMAL)


def test_a_pair_that_may_be_of_the_slice_before_is_no_answer(monkeypatch, sliced):
    search = slices.search

    def rough(matrices, ordering, k, setting, window):
        part, counted = search(matrices, ordering, k, setting, window)
        if window is None:
            return part, counted
        low = window.low * (1 + 1e-9)
        values = np.concatenate([[low], part.values[1:]])
        return Candidate(values, part.vectors, part.residual, part.gap), counted

    monkeypatch.setattr(slices, "search", rough)
    matrices = spectrum.discretise(bumpy(30, 1)).matrices
    ordering = solve.find_ordering(matrices.indptr, matrices.indices)
    with pytest.raises(CertificateError, match=r"an eigenvalue of residual .* may be below"):
        slices.search_in_slices(matrices, ordering, 120, solve.NORMAL)


def test_where_slices_fail_one_search_is_the_answer(monkeypatch):
    def failing(*_):
        raise SpectrumError("no slice")

    mesh = square(20)
    monkeypatch.setattr(solve, "DENSE_AT_MOST", 0)
    monkeypatch.setattr(solve, "search_in_slices", failing)
    result = spectrum.compute(mesh, 130)
    np.testing.assert_allclose(result.eigenvalues, dense(mesh)[1:131], rtol=1e-9)


@pytest.mark.slow
def test_a_thousand_eigenvalues_of_a_sphere_are_clusters_around_the_smooth_ones():
    result = spectrum.compute(ball(5), 1000)
    smooth = np.repeat([n * (n + 1.0) for n in range(1, 32)], [2 * n + 1 for n in range(1, 32)])
    off = result.eigenvalues / smooth[:1000] - 1
    assert result.certificate.count > 1000
    assert (off > 0).all()
    assert off.max() < 0.1


@pytest.mark.parametrize("mesh", [ball(3), square(25)], ids=["sphere", "square"])
def test_one_search_finds_a_spectrum_that_just_needs_no_slices(mesh, monkeypatch):
    monkeypatch.setattr(solve, "DENSE_AT_MOST", 0)
    monkeypatch.setattr(solve, "search_in_slices", None)  # is not called
    result = spectrum.compute(mesh, solve.LONG)
    np.testing.assert_allclose(result.eigenvalues, dense(mesh)[1 : solve.LONG + 1], rtol=1e-9)
