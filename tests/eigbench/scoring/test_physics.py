"""The physics contract: perfect for the perfect, and each rule caught by its own number."""

import numpy as np
import pytest
from eigbench.scoring import physics, truth

from synthnet.families import FAMILIES

NUMBERS = ("scale_2", "scale_half", "rotation", "reflection", "permutation", "triangulation")


@pytest.fixture(scope="module")
def questions():
    return physics.questions()


@pytest.fixture(scope="module")
def ask(questions):
    """Return a function that asks a rule for every mesh and returns the contract."""
    _, meshes = questions
    return lambda rule: physics.contract(np.array([rule(mesh) for mesh in meshes]))


def corners(mesh):
    return (mesh.vertices[mesh.faces[:, i]] for i in range(3))


def areas(mesh):
    a, b, c = corners(mesh)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def weyl(mesh):
    return 4 * np.pi * np.arange(1, 11) / areas(mesh).sum()


def centroid(mesh):
    a, b, c = corners(mesh)
    return np.average((a + b + c) / 3, axis=0, weights=areas(mesh))


def test_probes_are_one_or_two_validation_shapes_of_every_family_that_has_some():
    probes = physics.probes()
    validation = truth.load("1.0-mini", "validation")
    assert set(probes) <= set(validation.shapes.tolist())
    assert not set(probes) & set(truth.load("1.0-mini", "test").shapes.tolist())
    families = [id.rpartition("-")[0] for id in probes]
    assert set(families) == set(validation.families.tolist())
    assert set(families) <= set(FAMILIES)
    assert max(families.count(family) for family in families) == physics.PER_FAMILY == 2


def test_questions_are_the_same_for_every_call(questions):
    ids, meshes = physics.questions()
    assert ids == questions[0]
    assert len(ids) == len(meshes) == len(set(ids)) == 7 * len(physics.probes())
    for mesh, again in zip(meshes, questions[1], strict=True):
        np.testing.assert_array_equal(mesh.vertices, again.vertices)
        np.testing.assert_array_equal(mesh.faces, again.faces)


def test_every_change_of_a_mesh_changes_it(questions):
    _, meshes = questions
    base = len(physics.probes())
    assert len(meshes) == 7 * base > 0
    for start in range(base, len(meshes), base):
        for mesh, changed in zip(meshes[:base], meshes[start : start + base], strict=True):
            same_shape = mesh.vertices.shape == changed.vertices.shape
            assert not same_shape or not np.array_equal(mesh.vertices, changed.vertices)


def test_changes_keep_the_area_or_scale_it(questions):
    _, meshes = questions
    total_areas = np.array([areas(mesh).sum() for mesh in meshes]).reshape(7, -1)
    expected = [4, 0.25, 1, 1, 1, 1]
    for ratio, row in zip(expected, total_areas[1:], strict=True):
        np.testing.assert_allclose(row, ratio * total_areas[0], rtol=1e-9)


def test_permutation_keeps_the_surface(questions):
    _, meshes = questions
    mesh = meshes[0]
    changed = physics.permuted(mesh, np.random.default_rng(1))

    def triangles(mesh):
        return sorted(map(tuple, mesh.vertices[mesh.faces].reshape(-1, 9).tolist()))

    assert triangles(changed) == triangles(mesh)
    assert not np.array_equal(changed.faces, mesh.faces)


def test_area_scaled_weyl_law_obeys_the_contract(ask):
    contract = ask(weyl)
    assert tuple(contract) == (*NUMBERS, "positive", "ascending")
    assert all(contract[name] < 1e-9 for name in NUMBERS)
    assert contract["positive"] == contract["ascending"] == 1


def first_vertex(mesh):
    apart = ((mesh.vertices[0] - centroid(mesh)) ** 2).sum()
    return weyl(mesh) * (1 + apart / areas(mesh).sum())


def nothing_but_a_constant(mesh):
    return np.arange(1.0, 11.0)


# Rules, and the numbers that they spoil.
BROKEN = {
    "extent along x": (
        lambda mesh: np.arange(1, 11) / np.ptp(mesh.vertices[:, 0]) ** 2,
        {"rotation", "reflection"},  # two reflections are a rotation
    ),
    "plus a constant": (lambda mesh: weyl(mesh) + 1, {"scale_2", "scale_half"}),
    "nothing but a constant": (nothing_but_a_constant, {"scale_2", "scale_half"}),
    "first vertex": (first_vertex, {"permutation"}),
    "faces": (lambda mesh: weyl(mesh) * (1 + 1 / len(mesh.faces)), {"triangulation"}),
}


@pytest.mark.parametrize(("rule", "spoilt"), BROKEN.values(), ids=BROKEN)
def test_broken_rule_is_caught_by_its_own_numbers(rule, spoilt, ask):
    contract = ask(rule)
    assert {name for name in NUMBERS if contract[name] > 1e-6} == spoilt
    assert {name for name in NUMBERS if contract[name] < 1e-9} == set(NUMBERS) - spoilt
    assert contract["positive"] == contract["ascending"] == 1


def test_constant_deviates_by_the_factor_itself(ask):
    contract = ask(nothing_but_a_constant)
    assert contract["scale_2"] == 3  # 1 instead of 1/4
    assert contract["scale_half"] == 0.75  # 1 instead of 4


@pytest.mark.parametrize(
    ("rule", "positive", "ascending"),
    [
        (lambda mesh: -weyl(mesh), 0, 0),
        (lambda mesh: weyl(mesh)[::-1], 1, 0),
        (lambda mesh: weyl(mesh) - 1.5 * weyl(mesh)[0], 0, 1),
        (lambda mesh: np.repeat(weyl(mesh)[0], 10), 1, 1),
    ],
    ids=["negated", "descending", "first negative", "all equal"],
)
def test_sign_and_order_are_counted(rule, positive, ascending, ask):
    contract = ask(rule)
    assert (contract["positive"], contract["ascending"]) == (positive, ascending)
    assert all(contract[name] < 1e-9 for name in NUMBERS)


def test_answers_that_are_not_finite_give_none_and_no_warning(ask):
    for broken in (np.nan, np.inf):
        contract = ask(lambda mesh, broken=broken: np.full(10, broken))
        assert all(contract[name] is None for name in NUMBERS)


def test_answers_that_begin_with_the_trivial_zero_still_have_deviations(ask):
    contract = ask(lambda mesh: weyl(mesh) - weyl(mesh)[0])
    assert all(contract[name] < 1e-9 for name in NUMBERS)
    assert contract["positive"] == 0
