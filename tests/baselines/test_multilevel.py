"""baselines/multilevel.py: Galerkin levels, upper bounds, and what may not change an answer."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from evidence import baseline, numbers
from evidence import multilevel as variants
from evidence.solids import Solid, made
from synthnet import recipe, spectrum
from synthnet.families import FAMILIES
from synthnet.families.radial import radial
from synthnet.recipe.drawing import draw_shape
from synthnet.types import Mesh
from tests.spectrum.meshes import side_by_side


@pytest.fixture(scope="module")
def multilevel():
    return baseline("multilevel")


@pytest.fixture(scope="module")
def kernels():
    return baseline("multilevel_kernels")


def drawn(family, vertices=1500):
    parameters = draw_shape(recipe.load("2.0"), family, 0).parameters
    how = {"triangulation": "uniform", "vertices": vertices, "seed": 7}
    return FAMILIES[family].generate({**parameters, **how})


def blob():
    """A surface without symmetry, so that no comparison of floats is a tie."""
    atlas = radial(
        lambda d: 1 + 0.3 * np.sin(3 * d[:, 0] + 1) * np.cos(2 * d[:, 1]) + 0.1 * d[:, 2]
    )
    return atlas.mesh(atlas.uniform(12))


def slivers():
    """A plate cut into needles and caps: angles from less than 0.01 to nearly 180 degrees."""
    x = np.cumsum(np.random.default_rng(3).uniform(0.05, 1, size=400) ** 2)
    x = x / x[-1]
    n = len(x)
    rows = [np.stack([x, np.full(n, y), 0.05 * np.sin(9 * x + y)], axis=1) for y in (0, 0.02, 1)]
    a = np.arange(n - 1)
    low = [np.stack([a + r * n, a + 1 + r * n, a + 1 + (r + 1) * n], axis=1) for r in (0, 1)]
    high = [np.stack([a + r * n, a + 1 + (r + 1) * n, a + (r + 1) * n], axis=1) for r in (0, 1)]
    return Mesh(np.concatenate(rows), np.concatenate(low + high))


HARD = {
    "sphere-like": blob,
    "pretzel": lambda: drawn("pretzel"),
    "boundary": lambda: drawn("drum"),
    "not orientable": lambda: drawn("mobius_band"),
    "slivers": slivers,
}


@pytest.fixture(scope="module", params=HARD)
def mesh(request):
    return HARD[request.param]()


def matrix(indptr, indices, values, n):
    return sparse.csr_matrix((values, indices, indptr), shape=(len(indptr) - 1, n)).toarray()


# --- levels ----------------------------------------------------------------------------


def test_matrices_are_those_of_the_label(mesh, multilevel):
    dense, expected = multilevel.finest(mesh).dense(), spectrum.fem_matrices(mesh)
    for ours, known in zip(dense, expected, strict=True):
        np.testing.assert_allclose(ours, known.toarray(), atol=1e-12 * abs(known).max())


def test_aggregates_partition_the_vertices_and_hang_together(mesh, multilevel, kernels):
    level = multilevel.finest(mesh)
    of, count = kernels.aggregates(*level.pattern, level.stiffness, 0.24)
    assert (np.unique(of) == np.arange(count)).all()
    assert count < len(level) / 1.5
    edges = sparse.csr_matrix((np.ones_like(level.mass), *level.pattern[::-1])).tocoo()
    inside = of[edges.row] == of[edges.col]
    graph = sparse.coo_matrix((np.ones(inside.sum()), (edges.row[inside], edges.col[inside])))
    assert sparse.csgraph.connected_components(graph)[0] == count


def test_coarse_matrices_are_galerkin(mesh, multilevel):
    fine, coarse = multilevel.coarsened(multilevel.finest(mesh), multilevel.SETTING)
    p = matrix(*fine.prolongation, len(coarse))
    assert (p >= 0).all()
    np.testing.assert_allclose(p.sum(axis=1), 1, rtol=1e-14)
    for small, large in zip(coarse.dense(), fine.dense(), strict=True):
        np.testing.assert_allclose(small, p.T @ large @ p, atol=1e-12 * abs(large).max())


def test_every_level_is_symmetric_semidefinite_with_the_constants_in_its_kernel(mesh, multilevel):
    levels = multilevel.hierarchy(mesh)
    assert len(levels) >= 2
    area = levels[0].mass.sum()
    for level in levels[1:]:
        a, b = level.dense()
        assert (level.pattern[1][level.pattern[0][:-1]] == np.arange(len(level))).all()
        np.testing.assert_allclose(a, a.T, atol=1e-12 * a.max())
        np.testing.assert_allclose(b, b.T, atol=1e-12 * b.max())
        np.testing.assert_allclose(a.sum(axis=1), 0, atol=1e-10 * a.max())
        assert b.sum() == pytest.approx(area)
        assert np.linalg.eigvalsh(a)[0] > -1e-12 * a.max()
        assert np.linalg.eigvalsh(b)[0] > 0


def test_prolongation_of_a_path_by_hand(kernels):
    # Four vertices in a row, couplings 1, 3, 1; aggregates {0, 1}, {2, 3}; half of each is shared.
    indptr = np.array([0, 2, 5, 8, 10], np.int32)
    indices = np.array([0, 1, 1, 0, 2, 2, 1, 3, 3, 2], np.int32)
    stiffness = np.array([1.0, -1, 4, -1, -3, 4, -3, -1, 1, -1])
    of = np.array([0, 0, 1, 1], np.int32)
    for least, shared in ((0.0, 3 / 8), (0.8, 0.0)):  # of the inner two, 3/4 is across
        parts = kernels.prolongation(indptr, indices, stiffness, of, 0.5, least)
        expected = [[1, 0], [1 - shared, shared], [shared, 1 - shared], [0, 1]]
        np.testing.assert_allclose(matrix(*parts, 2), expected)


def test_a_dropped_share_does_not_spoil_the_next_row(mesh, multilevel, kernels):
    level = multilevel.finest(mesh)
    of, count = kernels.aggregates(*level.pattern, level.stiffness, 0.24)
    whole, cut = (
        matrix(*kernels.prolongation(*level.pattern, level.stiffness, of, 0.6, least), count)
        for least in (0.0, 0.3)
    )
    other = np.arange(count) != of[:, None]
    kept = np.where(other & (whole >= 0.3 * 0.6), whole, 0)
    own = 0.6 - (whole * other).sum(axis=1)  # what went to the vertex's own aggregate
    kept *= (0.6 / np.maximum(kept.sum(axis=1) + own, 1e-300))[:, None]
    np.testing.assert_allclose(cut * other, kept, atol=1e-12)


def test_a_cycle_reduces_the_error_in_energy(mesh, multilevel):
    levels = multilevel.hierarchy(mesh)[:2]
    a = levels[0].dense()[0]
    coarse = np.linalg.pinv(levels[1].dense()[0], hermitian=True)
    solution = np.random.default_rng(0).normal(size=(len(a), 3))
    x = np.zeros_like(solution)
    multilevel.cycle(levels, a @ solution, x, lambda right: coarse @ right, (2, 2))
    left = np.einsum("ij,ij->j", solution - x, a @ (solution - x))
    assert (left < 0.1 * np.einsum("ij,ij->j", solution, a @ solution)).all()


# --- answers ---------------------------------------------------------------------------


def test_answers_bound_the_eigenvalues_from_above_and_are_close(mesh, multilevel):
    exact = spectrum.compute(mesh).eigenvalues
    values = multilevel.ritz_values(mesh)
    assert (values >= exact * (1 - 1e-9)).all()
    assert (np.diff(values) >= 0).all()
    np.testing.assert_allclose(values, exact, rtol=0.15)
    assert np.abs(values / exact - 1).mean() < 0.03


def test_with_cycles_enough_the_answers_are_exact(mesh, multilevel):
    setting = replace(multilevel.SETTING, enough=0.0, cycles=40)
    exact = spectrum.compute(mesh).eigenvalues
    np.testing.assert_allclose(multilevel.ritz_values(mesh, setting), exact, rtol=1e-4)


def test_more_cycles_never_raise_a_value(multilevel):
    mesh = slivers()
    values = [
        multilevel.ritz_values(mesh, replace(multilevel.SETTING, enough=0.0, cycles=cycles))
        for cycles in (1, 2, 4)
    ]
    assert (values[0] > values[1]).any()
    assert (values[1] <= values[0] * (1 + 1e-12)).all()
    assert (values[2] <= values[1] * (1 + 1e-12)).all()


def test_scale_and_motion(multilevel):
    mesh = blob()
    values = multilevel.ritz_values(mesh)
    turn, _ = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))
    twice = multilevel.ritz_values(Mesh(2 * mesh.vertices, mesh.faces))
    assert (4 * twice == values).all()  # to the last bit: powers of two round nothing
    moved = Mesh(1e-5 * mesh.vertices @ turn.T, mesh.faces)
    np.testing.assert_allclose(1e-10 * multilevel.ritz_values(moved), values, rtol=1e-9)


def test_another_numbering_changes_less_than_the_error_allowed(multilevel):
    mesh = blob()
    order = np.random.default_rng(2).permutation(len(mesh.vertices))
    renumbered = Mesh(mesh.vertices[order], np.argsort(order)[mesh.faces])
    values, again = multilevel.ritz_values(mesh), multilevel.ritz_values(renumbered)
    assert (values != again).any()  # aggregates depend on it, and the page says so
    np.testing.assert_allclose(again, values, rtol=0.03)


def test_neither_batch_nor_order_nor_another_call_changes_a_bit(multilevel):
    pair = [blob(), slivers()]
    both = multilevel.predict(pair)
    assert (multilevel.predict(pair[::-1])[::-1] == both).all()
    assert (np.concatenate([multilevel.predict([mesh]) for mesh in pair]) == both).all()


@pytest.mark.parametrize("resolution", [1, 2, 3])
def test_a_small_mesh_is_solved_exactly(resolution, multilevel):
    atlas = radial(lambda directions: 1 + 0.1 * directions[:, 0])
    mesh = atlas.mesh(atlas.uniform(resolution))  # 12, 42 and 92 vertices
    exact = spectrum.compute(mesh).eigenvalues
    np.testing.assert_allclose(multilevel.ritz_values(mesh), exact, rtol=1e-9)


def test_components_make_more_zeros_and_leave_the_rest(multilevel):
    single = blob()
    both = side_by_side(single, Mesh(2 * single.vertices, single.faces))
    values = multilevel.ritz_values(both)
    alone = spectrum.compute(single).eigenvalues
    expected = np.sort(np.concatenate([alone, alone / 4]))[:9]
    assert 0 < values[0] < 1e-8 * expected[0]
    np.testing.assert_allclose(values[1:], expected, rtol=0.03)
    assert (values[1:] >= expected * (1 - 1e-9)).all()


RING = [[i, i + 1, (i + 2) % 12] for i in range(2, 12, 2)]


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.eye(3), [[0, 1, 2]], "k must be between 1 and 2 for 3 vertices, got 10"),
        (np.outer(np.arange(12), np.eye(3)[0]), [[0, 1, 2], *RING], "6 of 6 faces have no area"),
        (np.eye(11)[:, :3], [[0, 1, 2]], "8 vertices belong to no triangle"),
    ],
)
def test_what_has_no_answer(vertices, faces, message, multilevel):
    with pytest.raises(ValueError, match=message):
        multilevel.predict([Mesh(vertices, np.array(faces))])


# --- trust -----------------------------------------------------------------------------


def test_up_to_five_thousand_vertices_the_answer_is_certified(mesh, multilevel):
    values, certified = multilevel.eigenvalues(mesh)
    assert certified
    assert (values == spectrum.compute(mesh).eigenvalues).all()


@pytest.mark.parametrize("family", ["pretzel", "drum", "mobius_band"])
def test_meshes_of_good_triangles_are_trusted_and_near(family, multilevel):
    mesh = drawn(family, 6000)
    values, certified = multilevel.eigenvalues(mesh)
    assert not certified
    exact = spectrum.compute(mesh).eigenvalues
    assert (values >= exact * (1 - 1e-9)).all()
    np.testing.assert_allclose(values, exact, rtol=0.05)


def test_a_coarsest_level_that_is_left_a_little_large_is_solved(multilevel):
    shape = draw_shape(recipe.load("2.0"), "circular_cone", 50)  # the next would have 26 vertices
    how = {"triangulation": "uniform", "vertices": 23_985, "seed": 434510375}
    mesh = FAMILIES["circular_cone"].generate({**shape.parameters, **how})
    assert 2 * multilevel.SETTING.coarsest < len(multilevel.hierarchy(mesh)[-1])
    exact = spectrum.compute(mesh).eigenvalues
    np.testing.assert_allclose(multilevel.trusted(mesh), exact, rtol=0.03)


def test_eigenvalues_close_behind_the_tenth_leave_it_near(multilevel):
    shape = draw_shape(recipe.load("2.0"), "superquadric", 149)  # λ₁₁ to λ₁₅ are below 1.3 λ₁₀
    how = {"triangulation": "uniform", "vertices": 5500, "seed": 7}
    mesh = FAMILIES["superquadric"].generate({**shape.parameters, **how})
    exact = spectrum.compute(mesh).eigenvalues
    np.testing.assert_allclose(multilevel.trusted(mesh), exact, rtol=0.03)  # 0.08 by 12 vectors


def test_a_mesh_on_which_the_iteration_fails_is_not_trusted(multilevel):
    plate = made(seed=0, number=15)  # thin, with holes, and cut in one half: of those tuned on
    assert isinstance(plate, Solid)
    mesh = plate.mesh
    exact = spectrum.compute(mesh).eigenvalues
    assert (multilevel.ritz_values(mesh) / exact - 1).max() > 0.05
    assert multilevel.trusted(mesh) is None
    values, certified = multilevel.eigenvalues(mesh)
    assert certified
    assert (values == exact).all()


def test_one_flat_triangle_is_enough_for_the_certified_solver(multilevel):
    mesh = drawn("mobius_band", 6000)
    assert multilevel.trusted(mesh) is not None
    apex, left, right = mesh.faces[0]
    vertices = mesh.vertices.astype(np.float64)
    base = (vertices[left] + vertices[right]) / 2
    vertices[apex] = base + 1e-4 * (vertices[apex] - base)  # angles of about 0.01 degrees
    assert multilevel.trusted(Mesh(vertices, mesh.faces)) is None


def test_components_are_not_trusted(multilevel):
    single = drawn("pretzel", 3000)
    both = side_by_side(single, single)
    assert multilevel.trusted(both) is None
    alone = spectrum.compute(single).eigenvalues
    np.testing.assert_allclose(multilevel.eigenvalues(both)[0], np.repeat(alone[:5], 2), rtol=1e-6)


# --- page ------------------------------------------------------------------------------


def test_every_method_was_measured():
    measured = numbers.read("multilevel")
    assert [row["method"] for row in measured["methods"]] == list(variants.methods())
    assert variants.VARIANTS[variants.OURS] == {}
