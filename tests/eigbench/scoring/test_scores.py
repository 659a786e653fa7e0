"""Means, medians, families and bootstrap intervals on a truth small enough to work by hand."""

import math

import numpy as np
import pytest
from eigbench.board import tables
from eigbench.scoring import scores
from eigbench.scoring.metrics import METRICS

LABELS = [[1.0, 2.0], [2.0, 4.0], [4.0, 8.0], [1.0, 3.0]]
FAMILIES = ["cone", "cone", "cone", "torus"]
SHAPES = ["cone-0", "cone-0", "cone-1", "torus-0"]
# the errors |p - g| are (1, 0), (0, 2), (4, 4), (0, 0)
ANSWERS = [[2.0, 2.0], [2.0, 2.0], [8.0, 4.0], [1.0, 3.0]]


@pytest.fixture
def by_hand(made_truth):
    return made_truth(SHAPES, FAMILIES, LABELS)


@pytest.fixture
def random_case(made_truth):
    rng = np.random.default_rng(0)
    shapes = np.repeat([f"s-{i}" for i in range(40)], 3).tolist()
    families = np.repeat(["a", "b", "c", "d"], 30).tolist()
    labels = np.sort(rng.uniform(1, 30, (120, 10)), axis=1)
    predictions = labels * rng.uniform(0.7, 1.4, (2, 120, 10))
    return made_truth(shapes, families, labels), predictions


def test_overall_equals_the_numbers_worked_by_hand(by_hand):
    overall = scores.score(by_hand, np.array([ANSWERS]))["overall"]
    assert overall["l1"]["mean"] == (1 + 2 + 8 + 0) / 4
    assert overall["l1"]["median"] == 1.5
    assert overall["l2"]["mean"] == pytest.approx((1 + 2 + math.sqrt(32) + 0) / 4, rel=1e-14)
    assert overall["rpd"]["mean"] == pytest.approx((1 / 3 + 1 / 3 + 2 / 3 + 0) / 4, rel=1e-11)
    # ratios g/p - 1: (-1/2, 0), (0, 1), (-1/2, 1), (0, 0)
    invlap = (0.5 + 1 + math.sqrt(1.25) + 0) / 4
    assert overall["invlap"]["mean"] == pytest.approx(invlap, rel=1e-14)
    assert overall["psnr20"]["mean"] == 0.25
    assert all(cell["seed_std"] is None for cell in overall.values())


def test_families_equal_the_numbers_worked_by_hand(by_hand):
    families = scores.score(by_hand, np.array([ANSWERS]))["families"]
    assert list(families) == ["cone", "torus"]
    assert families["cone"]["count"] == 3
    assert families["cone"]["l1"] == {"mean": pytest.approx(11 / 3), "median": 2}
    assert families["torus"]["count"] == 1
    assert families["torus"]["l1"] == {"mean": 0, "median": 0}
    assert families["torus"]["psnr20"]["mean"] == 1


def test_per_index_equals_the_numbers_worked_by_hand(by_hand):
    first, second = scores.score(by_hand, np.array([ANSWERS]))["per_index"]
    assert first == {"mean": (1 + 0 + 1 + 0) / 4, "median": 0.5}
    assert second == {"mean": (0 + 0.5 + 0.5 + 0) / 4, "median": 0.25}


def test_several_seeds_give_the_mean_and_the_spread_of_their_means(by_hand):
    off_by_one_and_by_three = np.array(LABELS) + np.array([[[1, 0]], [[3, 0]]])
    l1 = scores.score(by_hand, off_by_one_and_by_three)["overall"]["l1"]
    assert (l1["mean"], l1["median"]) == (2, 2)
    assert l1["seed_std"] == pytest.approx(math.sqrt(2))  # of 1 and 3, n - 1


def test_one_seed_repeated_changes_nothing_but_the_spread(random_case):
    truth, predictions = random_case
    single = scores.score(truth, predictions[:1])
    twice = scores.score(truth, predictions[[0, 0]])
    assert {cell.pop("seed_std") for cell in single["overall"].values()} == {None}
    assert {cell.pop("seed_std") for cell in twice["overall"].values()} == {0.0}
    for key in METRICS:
        assert twice["overall"][key] == pytest.approx(single["overall"][key], rel=1e-14)


def test_weighted_mean_over_families_is_the_overall_mean(random_case, by_hand):
    for truth, predictions in (random_case, (by_hand, np.array([ANSWERS]))):
        result = scores.score(truth, predictions)
        for key in METRICS:
            if result["overall"][key]["mean"] is None:  # PSNR of an exact prediction is infinite
                assert any(f[key]["mean"] is None for f in result["families"].values())
                continue
            cells = [(f["count"], f[key]["mean"]) for f in result["families"].values()]
            weighted = sum(n * mean for n, mean in cells) / len(truth.ids)
            assert weighted == pytest.approx(result["overall"][key]["mean"], rel=1e-12)
        assert sum(f["count"] for f in result["families"].values()) == len(truth.ids)


def test_interval_holds_the_mean(random_case):
    scored = scores.score(*random_case)
    assert scored == scores.score(*random_case)  # the same for every call
    assert list(scored["overall"]) == list(METRICS)
    for cell in scored["overall"].values():
        assert cell["low"] <= cell["mean"] <= cell["high"]


def test_families_weigh_alike_in_the_mean_over_families(by_hand):
    scored = scores.score(by_hand, np.array([ANSWERS]))
    assert scored["overall"]["l1"]["by_family"] == pytest.approx((11 / 3 + 0) / 2)
    assert scored["overall"]["psnr20"]["by_family"] == 0.5
    assert [family["shapes"] for family in scored["families"].values()] == [2, 1]
    printed = tables.overall(scored)
    (l1,) = (row for row in printed.rows if row[0] == METRICS["l1"].heading)
    assert l1[printed.headers.index("macro average")] == "1.833"


def test_where_all_succeed_the_bound_is_that_of_the_rule_of_three(random_case):
    truth, _ = random_case
    all_right = scores.score(truth, 1.001 * truth.eigenvalues[None])["overall"]["psnr20"]
    assert (all_right["low"], all_right["high"]) == (pytest.approx(1 - 3 / 40), 1)
    none_right = scores.score(truth, 9 * truth.eigenvalues[None])["overall"]["psnr20"]
    assert (none_right["low"], none_right["high"]) == (0, pytest.approx(3 / 40))


@pytest.mark.parametrize("right", [True, False])
def test_no_share_is_surer_than_where_all_succeed_or_none(random_case, right):
    truth, _ = random_case
    few = np.arange(len(truth.ids)) == 0  # one instance of a shape: resamples hardly see it
    answers = truth.eigenvalues * np.where(few == right, 9, 1.001)[:, None]
    share = scores.score(truth, answers[None])["overall"]["psnr20"]
    if right:
        assert 1 - 3 / 40 < share["mean"] < 1
        assert (share["low"], share["high"]) == (pytest.approx(1 - 3 / 40), 1)
    else:
        assert 0 < share["mean"] < 3 / 40
        assert (share["low"], share["high"]) == (0, pytest.approx(3 / 40))


def test_the_share_of_several_seeds_has_an_interval_within_0_and_1(random_case):
    truth, _ = random_case
    seeds = truth.eigenvalues * np.array([1.001, 1.001, 9.0])[:, None, None]
    share = scores.score(truth, seeds)["overall"]["psnr20"]
    assert share["mean"] == pytest.approx(2 / 3)
    assert (share["low"], share["high"]) == (0, 1)


def test_seeds_that_disagree_widen_the_interval(random_case):
    truth, _ = random_case
    alike = truth.eigenvalues * np.array([1.1, 1.1, 1.1])[:, None, None]
    apart = truth.eigenvalues * np.array([1.0, 1.1, 1.2])[:, None, None]
    a, b = (scores.score(truth, p)["overall"]["rpd"] for p in (alike, apart))
    assert a["high"] - a["low"] < 1e-9
    assert b["high"] - b["low"] > 0.3
    assert b["low"] < b["mean"] < b["high"]


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
def test_one_value_that_is_not_finite_is_never_dropped(random_case, broken):
    truth, predictions = random_case
    predictions[1, 5, 2] = broken
    result = scores.score(truth, predictions)
    for key in ("invlap", "rpd", "polar", "l1", "l2"):
        cell = result["overall"][key]
        assert [cell[name] for name in ("mean", "low", "high", "seed_std")] == [None] * 4
        assert result["families"]["a"][key]["mean"] is None
        assert result["families"]["b"][key]["mean"] is not None
    assert result["families"]["a"]["count"] == 30
    assert result["per_index"][2]["mean"] is None
    assert result["per_index"][3]["mean"] is not None


def test_prediction_of_zeros_is_scored_without_a_warning(random_case):
    truth, predictions = random_case
    overall = scores.score(truth, np.zeros_like(predictions))["overall"]
    assert overall["invlap"]["mean"] is None
    assert overall["polar"]["mean"] is None
    assert overall["rpd"]["mean"] == pytest.approx(10)
    assert overall["psnr20"]["mean"] == 0
