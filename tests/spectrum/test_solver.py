"""The sparse solver, room by room, against dense linear algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg, sparse

from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.spectrum import dissection, fem, ldl, substitution
from synthnet.spectrum import ordering as ordering_module
from synthnet.spectrum.degree import minimum_degree
from synthnet.spectrum.lanczos import Lanczos
from synthnet.spectrum.ordering import find_ordering
from tests.spectrum.meshes import drawn, reference_eigenvalues, sphere


def matrices_of(mesh):
    return fem.assemble(mesh.vertices, mesh.faces.astype(np.int32))


def as_scipys(matrices):
    """A and B; not by the package's own function, which is tested by these."""
    pattern = matrices.indices, matrices.indptr
    return [sparse.csr_matrix((v, *pattern)) for v in (matrices.stiffness, matrices.mass)]


def dense(matrices):
    return [matrix.toarray() for matrix in as_scipys(matrices)]


def pattern_of(graph):
    matrix = sparse.csr_matrix(graph + graph.T + np.eye(len(graph)))
    matrix.sort_indices()
    return matrix.indptr.astype(np.int32), matrix.indices.astype(np.int32)


def fill(indptr, indices, order):
    """Entries of the factor below the diagonal, by elimination on a set of neighbours."""
    position = np.argsort(order)
    later = [set() for _ in order]
    for i in range(len(order)):
        for j in indices[indptr[i] : indptr[i + 1]]:
            if position[j] > position[i]:
                later[position[i]].add(position[j])
    for column in later:
        if column:
            later[min(column)] |= column - {min(column)}
    return sum(len(column) for column in later)


# --- the matrices' pattern ---------------------------------------------------------------


def test_pattern_of_two_triangles():
    faces = np.array([[3, 0, 1], [1, 2, 3]], np.int32)
    indptr, indices = fem.pattern(faces, 4)
    assert indptr.tolist() == [0, 3, 7, 10, 14]
    assert indices.tolist() == [0, 1, 3, 0, 1, 2, 3, 1, 2, 3, 0, 1, 2, 3]


def test_a_vertex_of_many_faces_has_sorted_neighbours():
    mesh = FAMILIES["cone"].generate(
        {"radius": 1.0, "height": 1.0, "resolution": 97, "split": 1, "subdivisions": 0}
    )
    matrices = matrices_of(mesh)
    rows = np.split(matrices.indices, matrices.indptr[1:-1])
    assert max(len(row) for row in rows) == 98
    assert all((np.diff(row) > 0).all() for row in rows)


def test_products_are_those_of_the_matrix():
    matrices = matrices_of(drawn("conical_frustum"))
    stiffness, _ = dense(matrices)
    for count in (1, 2, 5):
        x = np.random.default_rng(0).normal(size=(count, len(stiffness)))
        y = fem.multiply(matrices, matrices.stiffness, x)
        np.testing.assert_allclose(y, x @ stiffness, atol=1e-12 * abs(stiffness).max())


# --- the ordering ------------------------------------------------------------------------


def check_ordering(ordering, indptr, indices):
    n, fronts = len(ordering.order), len(ordering.child)
    assert sorted(ordering.order) == list(range(n))
    assert (ordering.position[ordering.order] == np.arange(n)).all()
    assert ordering.begin[0] == 0
    assert ordering.begin[-1] == n
    assert (np.diff(ordering.begin) > 0).all()
    children = []
    for k in range(fronts):
        rows = ordering.rows[ordering.first_row[k] : ordering.first_row[k + 1]]
        assert (np.diff(rows) > 0).all()
        assert (rows >= ordering.begin[k + 1]).all()
        inside = set(range(ordering.begin[k], ordering.begin[k + 1])) | set(rows)
        for column in range(ordering.begin[k], ordering.begin[k + 1]):
            i = ordering.order[column]
            later = {c for c in ordering.position[indices[indptr[i] : indptr[i + 1]]] if c > column}
            assert later <= inside
        child = ordering.child[k]
        while child >= 0:
            children.append(child)
            assert child < k
            theirs = ordering.rows[ordering.first_row[child] : ordering.first_row[child + 1]]
            assert set(theirs) <= inside
            child = ordering.sibling[child]
    assert len(children) == len(set(children))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 40), st.floats(0.0, 0.4), st.integers(0, 2**32 - 1))
def test_ordering_of_a_random_graph_is_one_of_its_factor(n, p, seed):
    rng = np.random.default_rng(seed)
    indptr, indices = pattern_of(np.triu(rng.random((n, n)) < p, 1).astype(float))
    check_ordering(find_ordering(indptr, indices), indptr, indices)


@pytest.mark.parametrize("family", PRIMITIVES)
def test_ordering_of_every_family_is_one_of_its_factor(family):
    matrices = matrices_of(drawn(family))
    ordering = find_ordering(matrices.indptr, matrices.indices)
    check_ordering(ordering, matrices.indptr, matrices.indices)


def test_a_path_and_a_star_are_eliminated_without_fill():
    for n in (2, 9, 40):
        star = np.zeros((n, n))
        star[0, 1:] = 1
        for graph in (np.eye(n, k=1), star):
            indptr, indices = pattern_of(graph)
            assert fill(indptr, indices, find_ordering(indptr, indices).order) == n - 1


def test_fill_of_a_grid_is_that_of_a_good_ordering():
    side = 30
    line = np.eye(side, k=1)
    grid = np.kron(line, np.eye(side)) + np.kron(np.eye(side), line)
    indptr, indices = pattern_of(grid)
    natural = fill(indptr, indices, np.arange(side**2))
    dissected = fill(indptr, indices, find_ordering(indptr, indices).order)
    assert natural > 25_000
    # Nested dissection of a grid by hand needs 31/4 n log2 n in the limit (George, 1973).
    assert dissected < 31 / 4 * side**2 * np.log2(side**2) / 4 < natural


def test_vertices_with_the_same_neighbours_are_eliminated_together():
    indptr, indices = pattern_of(np.triu(np.ones((12, 12)), 1))
    _, pivots, size, below = minimum_degree(indptr, indices, np.zeros(12, np.int32))
    assert size[pivots].tolist() == [12]
    assert below[pivots].tolist() == [0]


# --- the factorisation -------------------------------------------------------------------


@pytest.mark.parametrize("family", PRIMITIVES)
@pytest.mark.parametrize("shift", [-1.0, 3.0, 30.0])
def test_factor_solves_and_counts(family, shift):
    matrices = matrices_of(drawn(family))
    ordering = find_ordering(matrices.indptr, matrices.indices)
    factor = ldl.factorise(matrices, ordering, shift)
    assert factor.finite
    a, b = as_scipys(matrices)
    x = np.random.default_rng(0).normal(size=(3, len(ordering.order)))
    y, second = x.copy(), x[1:2].copy()
    for rows in (y, second):
        substitution.solve(factor, ordering, rows)
    np.testing.assert_array_equal(second, y[1:2])
    backward = abs((a - shift * b) @ y.T - x.T).max()
    scale = abs(a - shift * b).sum(axis=1).max() * abs(y).max()
    assert backward <= 1e-12 * scale
    pivots = ldl.factorise(matrices, ordering, shift, pivots_only=True)
    np.testing.assert_array_equal(pivots.pivots, factor.pivots)
    assert pivots.negative == factor.negative
    assert (factor.negative == 0) == (shift < 0)


def test_pivots_of_a_random_matrix_have_the_signs_of_its_eigenvalues():
    rng = np.random.default_rng(3)
    n = 30
    indptr, indices = pattern_of(np.triu(rng.random((n, n)) < 0.2, 1).astype(float))
    symmetric = sparse.csr_matrix((np.ones(len(indices)), indices, indptr)).toarray()
    symmetric = np.triu(symmetric * rng.normal(size=(n, n)))
    symmetric += np.triu(symmetric, 1).T
    values = symmetric[np.repeat(np.arange(n), np.diff(indptr)), indices]
    mass = np.where(np.repeat(np.arange(n), np.diff(indptr)) == indices, 1.0, 0.0)
    matrices = fem.Matrices(indptr, indices, values, mass, np.ones(n))
    ordering = find_ordering(indptr, indices)
    spectrum = linalg.eigvalsh(symmetric)
    for count in range(0, 30, 3):
        low = spectrum[count - 1] if count else spectrum[0] - 2
        shift = (low + spectrum[count]) / 2
        factor = ldl.factorise(matrices, ordering, shift)
        assert factor.negative == count
        y = rng.normal(size=(2, n))
        x = y @ (symmetric - shift * np.eye(n))
        substitution.solve(factor, ordering, x)
        np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("size", "width"), [(5, 3), (60, 11), (90, 48), (121, 50), (161, 102), (150, 150)]
)
def test_a_front_is_eliminated_as_by_hand(size, width):
    half = np.random.default_rng(size).normal(size=(size, size))
    symmetric = half + half.T + 3 * np.diag(np.sign(half[0]) * size)
    front = np.triu(symmetric) + np.tril(np.full((size, size), np.nan), -1)  # not to be read
    ldl._eliminate(front, width)
    left = symmetric.copy()
    for k in range(width):
        np.testing.assert_allclose(front[k, k:], left[k, k:], rtol=1e-9, atol=1e-9)
        left -= np.outer(left[:, k], left[k]) / left[k, k]
    rest = np.triu(front)[width:, width:]
    np.testing.assert_allclose(rest, np.triu(left)[width:, width:], rtol=1e-9, atol=1e-9)


def test_uncertainty_is_that_of_the_absolute_factors():
    # A - 2B = [[-1, 1], [1, 3]]: L21 = -1, D = (-1, 4); |L||D||L'| = diag(1, 1 + 4).
    indptr, indices = np.array([0, 2, 4], np.int32), np.array([0, 1, 0, 1], np.int32)
    values, mass = np.array([1.0, 1, 1, 7]), np.array([1.0, 0, 0, 2])
    matrices = fem.Matrices(indptr, indices, values, mass, np.array([1.0, 2]))
    factor = ldl.factorise(matrices, find_ordering(indptr, indices), 2.0)
    assert sorted(factor.pivots) in ([-1, 4], pytest.approx([-4 / 3, 3]))
    largest = max(1 / 1, 5 / 2) if factor.pivots[0] == -1 else max((4 / 3 + 1 / 3) / 1, 3 / 2)
    assert factor.uncertainty == pytest.approx(4 * np.finfo(float).eps * largest)


def test_uncertainty_of_a_mesh_is_that_of_the_dense_factors():
    matrices = matrices_of(sphere(10))
    ordering = find_ordering(matrices.indptr, matrices.indices)
    a, b = dense(matrices)
    left = (a - 30.0 * b)[np.ix_(ordering.order, ordering.order)]
    n = len(left)
    lower, pivots = np.eye(n), np.zeros(n)
    for j in range(n):
        pivots[j] = left[j, j]
        lower[j:, j] = left[j:, j] / pivots[j]
        left[j:, j:] -= np.outer(lower[j:, j], left[j, j:])
    assert (pivots < 0).any()
    diagonal = np.square(lower) @ abs(pivots)  # of |L||D||L'|
    largest = (diagonal / matrices.lumped[ordering.order]).max()
    factor = ldl.factorise(matrices, ordering, 30.0)
    assert factor.uncertainty == pytest.approx(4 * np.finfo(float).eps * largest, rel=1e-6)


def test_zero_pivot_is_not_finite():
    indptr, indices = np.array([0, 2, 4], np.int32), np.array([0, 1, 0, 1], np.int32)
    matrices = fem.Matrices(
        indptr, indices, np.array([0.0, 1, 1, 0]), np.eye(2).ravel(), np.ones(2)
    )
    assert not ldl.factorise(matrices, find_ordering(indptr, indices), 0.0).finite


# --- Lanczos -----------------------------------------------------------------------------


def search(mesh, sigma, *, limit=81, **options):
    matrices = matrices_of(mesh)
    ordering = find_ordering(matrices.indptr, matrices.indices)
    factor = ldl.factorise(matrices, ordering, sigma)
    options = {"known": np.empty((0, len(matrices.lumped)))} | options
    return Lanczos(matrices, ordering, factor, sigma, limit=limit, **options)


@pytest.mark.parametrize("lean", [False, True])
@pytest.mark.parametrize("strict", [False, True])
@pytest.mark.parametrize("large", [False, True])
def test_a_basis_that_grows_step_by_step_is_the_same(large, strict, lean, monkeypatch):
    if large:  # is solved by portions
        monkeypatch.setattr(ordering_module, "LARGE", 1)
        monkeypatch.setattr(dissection, "PART", 100)
    one, many = (search(drawn("torus"), 5.0, strict=strict, lean=lean) for _ in range(2))
    assert one.ordering.whole is not large
    assert one.extend(20)
    for _ in range(20):
        assert many.extend(1)
    assert (many.size, many.skipped) == (one.size, one.skipped)
    kept = slice(one.size)
    np.testing.assert_array_equal(many.basis[kept], one.basis[kept])
    np.testing.assert_array_equal(many.weighted[kept], one.weighted[kept])
    np.testing.assert_array_equal(many.projected[kept, kept], one.projected[kept, kept])


@pytest.mark.parametrize("lean", [False, True])
@pytest.mark.parametrize("strict", [False, True])
def test_basis_is_orthonormal_and_the_projection_that_of_the_operator(strict, lean):
    mesh = drawn("torus")
    lanczos = search(mesh, 5.0, strict=strict, lean=lean)
    assert lanczos.extend(20)
    m = lanczos.size - 2
    a, b = dense(lanczos.matrices)
    v = lanczos.basis[: lanczos.size]
    kept = v[-2:] if lean else v
    np.testing.assert_allclose(lanczos.weighted[: len(kept)], kept @ b, atol=1e-12)
    # Semi-orthogonality: half the digits, unless all vectors are kept orthogonal.
    np.testing.assert_allclose(v @ b @ v.T, np.eye(lanczos.size), atol=1e-13 if strict else 1e-8)
    operator = np.linalg.solve(a - 5 * b, b)
    np.testing.assert_allclose(
        v[1:m] @ b @ operator @ v[1:m].T, lanczos.projected[1:m, 1:m], atol=1e-9
    )


def test_error_bounds_hold_and_fall():
    mesh = drawn("cylinder")
    a, b = dense(matrices_of(mesh))
    exact = reference_eigenvalues(mesh)
    lanczos = search(mesh, 5.0)
    before = np.inf
    for _ in range(4):
        lanczos.extend(8)
        pairs = lanczos.ritz()
        near = np.argsort(abs(pairs.values - 5.0))[:4]
        apart = abs(pairs.values[near, None] - exact).min(axis=1)
        assert (apart <= 1.1 * pairs.errors[near] + 1e-11).all()
        assert pairs.errors[near].max() <= max(before, 1e-15)
        before = pairs.errors[near].max()
    vectors, weighted = lanczos.vectors(pairs, 3)
    np.testing.assert_allclose(weighted, vectors @ b, atol=1e-9)
    for value, vector in zip(pairs.values[:3], vectors, strict=True):
        defect = np.linalg.norm(a @ vector - value * b @ vector)
        assert defect <= 1e-6 * np.linalg.norm(b @ vector)


def test_search_ends_where_there_is_no_room():
    lanczos = search(drawn("tetrahedron"), 5.0, limit=11)
    assert lanczos.extend(3)
    assert not lanczos.extend(3)
    assert lanczos.size == 11
    assert not lanczos.extend(1)
    assert lanczos.size == 11


@pytest.mark.parametrize("lean", [False, True])
def test_a_shift_close_to_an_eigenvalue_makes_the_search_strict(lean):
    mesh = drawn("torus")
    exact = reference_eigenvalues(mesh)
    lanczos = search(mesh, exact[6] * (1 - 1e-5), lean=lean)
    lanczos.extend(30)
    assert lanczos.skipped == 0
    values = lanczos.ritz().values
    np.testing.assert_allclose(values[:6], exact[1:7], rtol=1e-6)
