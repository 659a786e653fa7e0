"""Large graphs: their parts and cuts, the order in stages, and the threads that solve."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from synthnet import processes, spectrum
from synthnet.spectrum import dissection, ldl, ordering, substitution
from synthnet.spectrum.degree import minimum_degree
from synthnet.spectrum.operators import as_sparse
from tests.spectrum.meshes import torus
from tests.spectrum.test_solver import check_ordering, matrices_of, pattern_of


@pytest.fixture
def large(monkeypatch):
    """Return matrices of a torus that counts as large."""
    monkeypatch.setattr(ordering, "LARGE", 1)
    monkeypatch.setattr(dissection, "PART", 300)
    return matrices_of(torus(90, 60))


def graph_of(matrices):
    return sparse.csr_matrix((np.ones(len(matrices.indices)), matrices.indices, matrices.indptr))


def operations(found):
    below = np.diff(found.first_row).astype(float)
    return float(np.sum((below + np.diff(found.begin)) ** 3 - below**3))


@pytest.mark.slow
def test_no_edge_joins_two_parts(large):
    stages = dissection.dissect(large.indptr, large.indices)
    rows = np.repeat(np.arange(len(stages)), np.diff(large.indptr))
    levels = 5  # 5400 vertices, halved until there are no more than 300
    parts = stages.max() + 1 - levels
    assert 2 ** (levels - 1) < parts <= 2**levels + levels
    inside = (stages[rows] < parts) & (stages[large.indices] < parts)
    assert inside.any()
    np.testing.assert_array_equal(stages[rows][inside], stages[large.indices][inside])
    sizes = np.bincount(stages)
    assert sizes[:parts].max() <= 300 * 1.2
    assert sizes[parts:].sum() < len(stages) / 4


def test_the_last_cut_leaves_two_halves_and_is_short(large):
    stages = dissection.dissect(large.indptr, large.indices)
    left = stages < stages.max()
    count, numbers = connected_components(graph_of(large)[left][:, left])
    assert count == 2
    assert np.bincount(numbers).min() > 0.4 * len(stages)
    assert (~left).sum() <= 1.2 * 2 * 60  # two circles across, of 60 vertices each


def test_stages_depend_on_the_pattern_alone(large):
    first = dissection.dissect(large.indptr, large.indices)
    np.testing.assert_array_equal(first, dissection.dissect(large.indptr, large.indices))


def test_dissection_saves_operations_on_a_large_torus():
    matrices = matrices_of(torus(367, 245))
    n = len(matrices.lumped)
    plain = ordering.find_ordering(matrices.indptr, matrices.indices)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ordering, "LARGE", n)
        dissected = ordering.find_ordering(matrices.indptr, matrices.indices)
    assert operations(dissected) < operations(plain)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 60), st.floats(0.0, 0.3), st.integers(0, 2**32 - 1))
@example(51, 0.09375, 581)  # a part in which one vertex is the neighbour of all others
def test_the_order_of_a_dissected_random_graph_is_one_of_its_factor(n, p, seed):
    rng = np.random.default_rng(seed)
    indptr, indices = pattern_of(np.triu(rng.random((n, n)) < p, 1).astype(float))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ordering, "LARGE", 1)
        patch.setattr(dissection, "PART", 5)
        patch.setattr(dissection, "COARSEST", 8)
        found = ordering.find_ordering(indptr, indices)
    check_ordering(found, indptr, indices)
    fronts = np.concatenate([np.arange(first, end) for first, end in found.portions])
    np.testing.assert_array_equal(np.sort(fronts), np.arange(len(found.child)))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 40), st.floats(0.0, 0.4), st.integers(0, 2**32 - 1))
def test_no_vertex_is_eliminated_before_its_stage(n, p, seed):
    rng = np.random.default_rng(seed)
    indptr, indices = pattern_of(np.triu(rng.random((n, n)) < p, 1).astype(float))
    stages = rng.integers(0, 4, n).astype(np.int32)
    stages -= stages.min()
    owner, pivots, size, _ = minimum_degree(indptr, indices, stages)
    assert (np.diff(stages[pivots]) >= 0).all()
    assert size[pivots].sum() == n
    made = set(pivots.tolist())
    for i in range(n):
        home = i
        while home not in made:
            home = owner[home]
        assert stages[i] <= stages[home]


@pytest.mark.parametrize("shift", [-1.0, 30.0])
def test_any_number_of_threads_gives_the_same_factor(large, monkeypatch, shift):
    found = ordering.find_ordering(large.indptr, large.indices)
    assert found.subtrees >= 4
    assert len(found.portions) > found.subtrees
    rows = np.random.default_rng(0).normal(size=(2, len(large.lumped)))
    solved = rows.copy()
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    alone = ldl.factorise(large, found, shift)
    substitution.solve(alone, found, solved)
    for count in ("2", "5"):
        monkeypatch.setenv("OMP_NUM_THREADS", count)
        together, again = ldl.factorise(large, found, shift), rows.copy()
        substitution.solve(together, found, again)
        np.testing.assert_array_equal(together.pivots, alone.pivots)
        np.testing.assert_array_equal(again, solved)
        assert together.uncertainty == alone.uncertainty
    a, b = as_sparse(large)
    np.testing.assert_allclose((a - shift * b) @ solved.T, rows.T, atol=1e-9)


@pytest.mark.parametrize("count", [1, 3])
def test_solutions_by_portions_are_those_at_once(large, count):
    found = ordering.find_ordering(large.indptr, large.indices)
    factor = ldl.factorise(large, found, 30.0)
    rows = np.random.default_rng(1).normal(size=(count, len(large.lumped)))
    by_portions = rows.copy()
    substitution.solve(factor, found, by_portions)
    for begin in range(0, count, 2):
        pair = np.stack([rows[begin], rows[min(begin + 1, count - 1)]])
        substitution.solve_two(found, factor.pivots, factor.panels, pair)
        np.testing.assert_allclose(by_portions[begin], pair[0], rtol=1e-9, atol=1e-9)


def test_any_number_of_threads_gives_the_same_spectrum(monkeypatch):
    mesh = torus(90, 60)
    at_once = spectrum.compute(mesh, k=20)
    monkeypatch.setattr(ordering, "LARGE", 1)
    monkeypatch.setattr(dissection, "PART", 300)
    found = []
    for count in ("1", "2", "5"):
        monkeypatch.setenv("OMP_NUM_THREADS", count)
        found.append(spectrum.compute(mesh, k=20))
    np.testing.assert_allclose(found[0].eigenvalues, at_once.eigenvalues, rtol=1e-11)
    for other in found[1:]:
        np.testing.assert_array_equal(other.eigenvalues, found[0].eigenvalues)
        np.testing.assert_array_equal(other.eigenvectors, found[0].eigenvectors)


def test_portions_give_the_factor_of_the_whole(large):
    cut = ordering.find_ordering(large.indptr, large.indices)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ordering, "PORTION", 1.0)
        whole = ordering.find_ordering(large.indptr, large.indices)
    assert whole.portions.tolist() == [[0, len(whole.child)]]
    in_portions, at_once = (ldl.factorise(large, found, 30.0) for found in (cut, whole))
    assert in_portions.negative == at_once.negative > 0
    np.testing.assert_allclose(in_portions.pivots, at_once.pivots, rtol=1e-9)
    assert in_portions.uncertainty == pytest.approx(at_once.uncertainty)


def test_threads_are_those_that_openmp_is_told(monkeypatch):
    for value, count in (("3", 3), ("2,4", 2), ("0", 1), ("many", processes.cores())):
        monkeypatch.setenv("OMP_NUM_THREADS", value)
        assert processes.threads() == count
    monkeypatch.delenv("OMP_NUM_THREADS")
    assert processes.threads() == processes.cores()
