"""Resampling by hand, its intervals against theory, and Holm's correction."""

import math

import numpy as np
import pytest
from eigbench.scoring import bootstrap
from eigbench.scoring.bootstrap import holm, interval, resamples, two_sided


@pytest.fixture
def random_truth(made_truth):
    shapes = np.repeat([f"s-{i}" for i in range(40)], 3).tolist()
    families = np.repeat(["a", "b", "c", "d"], 30).tolist()
    return made_truth(shapes, families, np.ones((120, 2)))


def test_each_resample_has_as_many_shapes_of_each_family(random_truth):
    drawn = resamples(random_truth)
    assert drawn.weights.shape == (bootstrap.RESAMPLES, 40)
    _, first = np.unique(random_truth.groups, return_index=True)
    family = random_truth.families[first]
    for name in "abcd":
        assert (drawn.weights[:, family == name].sum(axis=1) == 10).all()
    assert drawn.weights.mean(axis=0) == pytest.approx(1, abs=0.08)
    assert (drawn.weights == drawn.weights.round()).all()


def test_families_with_fewer_than_five_shapes_are_resampled_together(made_truth):
    shapes = [f"s-{i}" for i in range(12)]
    truth = made_truth(shapes, ["a"] * 6 + ["b"] * 3 + ["c"] * 3, np.ones((12, 1)))
    weights = resamples(truth).weights
    families = truth.families[np.unique(truth.groups, return_index=True)[1]]
    assert (weights[:, families == "a"].sum(axis=1) == 6).all()
    assert (weights[:, families != "a"].sum(axis=1) == 6).all()
    assert set(weights[:, families == "b"].sum(axis=1).astype(int)) == set(range(7))


@pytest.mark.parametrize(
    ("of_families", "mean"), [((0.25, 0.25, 0.25, 0.25), 0.25), ((1.0, 5.0, 9.0, 2.0), 4.25)]
)
def test_interval_of_values_that_are_alike_in_each_family_is_their_mean(
    random_truth, of_families, mean
):
    values = np.repeat(of_families, 30)[None]  # their differences do not widen it
    assert interval(resamples(random_truth).means(values)) == (mean, mean)


def test_copies_of_the_shapes_do_not_narrow_the_interval(made_truth):
    rng = np.random.default_rng(1)
    shapes, values = [f"s-{i}" for i in range(30)], rng.uniform(0, 1, 30)
    once = made_truth(shapes, ["a"] * 30, np.ones((30, 2)))
    nine = made_truth(np.repeat(shapes, 9).tolist(), ["a"] * 270, np.ones((270, 2)))
    narrow = interval(resamples(once).means(values[None]))
    copied = interval(resamples(nine).means(np.repeat(values, 9)[None]))
    assert copied == pytest.approx(narrow, rel=1e-12)


def test_interval_covers_two_standard_errors_of_the_mean(made_truth):
    values = np.random.default_rng(2).normal(5, 2, 400)
    truth = made_truth([f"s-{i}" for i in range(400)], ["a"] * 400, np.ones((400, 1)))
    low, high = interval(resamples(truth).means(values[None]))
    error = values.std(ddof=1) / math.sqrt(400)
    assert (high - low) / (2 * 1.96 * error) == pytest.approx(1, abs=0.05)
    assert (low + high) / 2 == pytest.approx(values.mean(), abs=0.1 * error)


def test_shapes_with_more_instances_weigh_more(made_truth):
    truth = made_truth(["s-0"] * 3 + ["s-1"], ["a"] * 4, np.ones((4, 1)))
    means = resamples(truth).means(np.array([[1.0, 1.0, 1.0, 0.0]]))
    assert set(means) == {0.0, 0.75, 1.0}  # both s-1, one each, both s-0


@pytest.mark.parametrize("seeds", [2, 3, 5])
def test_seeds_widen_the_interval_by_the_error_of_their_mean(made_truth, seeds):
    truth = made_truth([f"s-{i}" for i in range(50)], ["a"] * 50, np.ones((50, 1)))
    offsets = np.random.default_rng(seeds).normal(0, 1, seeds)
    means = resamples(truth).means(np.repeat(offsets[:, None], 50, axis=1), "model")
    assert means.mean() == pytest.approx(offsets.mean(), abs=0.05)
    assert means.std() == pytest.approx(offsets.std(ddof=1) / math.sqrt(seeds), rel=0.05)


def test_two_models_draw_their_seeds_apart_and_each_the_same_again(made_truth):
    truth = made_truth([f"s-{i}" for i in range(5)], ["a"] * 5, np.ones((5, 1)))
    values = np.repeat([[0.0], [1.0], [2.0]], 5, axis=1)
    a, b, again = (resamples(truth).means(values, name) for name in ("a", "b", "a"))
    np.testing.assert_array_equal(a, again)
    assert abs(np.corrcoef(a, b)[0, 1]) < 0.1


def test_first_numbers_of_the_stream_are_always_these():
    expected = [0.63696169, 0.26978671, 0.04097352, 0.01652764]  # default_rng(0).random(4)
    np.testing.assert_allclose(bootstrap._uniform(0, 4), expected, atol=5e-9)


def test_p_value_is_twice_the_share_beyond_zero():
    means = np.concatenate([np.full(97, 1.0), np.full(3, -1.0)])
    assert two_sided(means) == pytest.approx(2 * 4 / 101)
    assert two_sided(-means) == two_sided(means)
    assert two_sided(np.ones(100)) == pytest.approx(2 / 101)
    far = np.append(np.ones(99), 40.0)  # 0.4 deviations from zero: the normal tail is above that
    assert two_sided(far) == pytest.approx(2 / 101)


def test_a_board_of_many_rows_can_still_rank_them():
    means = np.random.default_rng(0).normal(6.0, 1.0, bootstrap.RESAMPLES)
    assert (means > 0).all()
    assert two_sided(means) == pytest.approx(2e-9, rel=0.5)
    assert holm([two_sided(means)] * 500) == [True] * 500
    least = 2 / (bootstrap.RESAMPLES + 1)  # what the number of resamples alone could show
    assert holm([least] * 500) == [False] * 500


def test_holm_by_hand():
    assert holm([0.01, 0.04, 0.03, 0.005]) == [True, False, False, True]
    assert holm([]) == []


def test_a_hypothesis_that_is_surely_rejected_changes_no_other():
    rng = np.random.default_rng(0)
    for _ in range(200):
        p = rng.uniform(0, 0.1, 6).tolist()
        assert holm([*p, 1e-6])[:-1] == holm(p)
