"""Metrics against numbers worked by hand; one contract for every entry of METRICS."""

import math

import numpy as np
import pytest
from eigbench.scoring import metrics
from eigbench.scoring.metrics import METRICS
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

INF, NAN = math.inf, math.nan
SCALE_FREE = (
    metrics.inverse_laplacian,
    metrics.relative_percent_difference,
    metrics.polar_loss,
    metrics.psnr,
)
FUNCTIONS = [metric.function for metric in METRICS.values()]
spectra = arrays(np.float64, (3, 10), elements=st.floats(0.1, 1e3))
real_spectra = arrays(np.float64, (3, 10), elements=st.floats(-1e3, 1e3))


def test_the_main_table_has_the_papers_six():
    assert metrics.MAIN == ("invlap", "rpd", "polar", "psnr20", "l1", "l2")


def value(function, p, g):
    (number,) = function(np.array([p], dtype=np.float64), np.array([g], dtype=np.float64))
    return float(number)


# p, g, then InvLap, RPD, Polar, PSNR, PSNR>20, l1, l2, each from its formula
BY_HAND = {
    # ratios 2, 1; range 2, MSE 1/2; lengths sqrt 17, sqrt 20, product 18
    "one too small": (
        *([1, 4], [2, 4]),
        *(1, 1 / 3, 1 - 18 / math.sqrt(340) + 1 / (math.sqrt(17) + math.sqrt(20))),
        *(10 * math.log10(8), 0, 1, 1),
    ),
    # ratios 1/5, 9/5; range 8, MSE 16; lengths sqrt 50, sqrt 82, product 50
    "a constant": (
        *([5, 5], [1, 9]),
        *(math.sqrt(0.64 + 0.64), 4 / 6 + 4 / 14),
        1 - 50 / math.sqrt(50 * 82) + math.sqrt(32) / (math.sqrt(50) + math.sqrt(82)),
        *(10 * math.log10(4), 0, 8, math.sqrt(32)),
    ),
    # ratio 1/2 three times, 1/3 three times, the same direction
    "twice the label": (
        *([2, 4, 8], [1, 2, 4]),
        *(math.sqrt(3) / 2, 1, 1 / 3, 10 * math.log10(9 / 7), 0, 7, math.sqrt(21)),
    ),
    "at right angles": (
        *([3, 0], [0, 4]),
        *(INF, 2, 1 + 5 / 7, 10 * math.log10(16 / 12.5), 0, 7, 5),
    ),
    "negated": ([-2, -4], [2, 4], math.sqrt(8), 2, 3, -10, 0, 12, math.sqrt(80)),
    "exact": ([1, 2, 7], [1, 2, 7], 0, 0, 0, INF, 1, 0, 0),
    # zero has no direction
    "zero": ([0, 0], [3, 4], INF, 2, NAN, -10 * math.log10(12.5), 0, 7, 5),
}


@pytest.mark.parametrize("case", BY_HAND)
def test_metrics_equal_the_numbers_worked_by_hand(case):
    p, g, *expected = BY_HAND[case]
    for metric, number in zip(METRICS.values(), expected, strict=True):
        equal = pytest.approx(number, rel=1e-11, abs=1e-14, nan_ok=True)
        assert value(metric.function, p, g) == equal, metric.key


def test_psnr_of_exactly_20_decibels_is_not_accurate():
    g = np.arange(11.0)  # range 10
    assert value(metrics.psnr, g + 1, g) == 20  # MSE 1
    assert value(metrics.psnr_above_20, g + 1, g) == 0
    assert value(metrics.psnr_above_20, g + 0.99, g) == 1


def test_psnr_of_a_label_without_range_is_minus_infinity():
    assert value(metrics.psnr, [1, 2], [3, 3]) == -INF


def test_the_constant_in_rpd_only_matters_near_zero():
    assert value(metrics.relative_percent_difference, [0], [0]) == 0
    assert value(metrics.relative_percent_difference, [0], [metrics.EPSILON]) == 0.5
    assert value(metrics.relative_percent_difference, [0], [1e6]) == pytest.approx(1, abs=1e-15)


@given(g=st.floats(1e-3, 1e6), ratio=st.floats(1e-3, 1e3) | st.floats(-1e3, -1e-3))
def test_lemma_a_1_ties_the_relative_error_to_the_inverse_laplacian(g, ratio):
    # With e = g/p - 1, (g - p)/g = e/(1 + e). The lemma prints (p - g)/g, its proof g - p.
    p = g / ratio
    e = g / p - 1
    assert (g - p) / g == pytest.approx(e / (1 + e), rel=1e-9, abs=1e-12)
    invlap = value(metrics.inverse_laplacian, [p], [g])
    assert invlap == pytest.approx(abs(e), rel=1e-12, abs=1e-15)
    assert abs(p - g) / g == pytest.approx(invlap / abs(1 + e), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("small", [1e-2, 1e-4, 1e-6])
def test_inverse_laplacian_nears_the_relative_error_as_a_prediction_nears_the_label(small):
    g = np.arange(1.0, 11.0)
    relative = math.sqrt(10) * small
    invlap = value(metrics.inverse_laplacian, g * (1 + small), g)
    assert invlap / relative == pytest.approx(1 / (1 + small), rel=1e-7)


def test_inverse_laplacian_punishes_small_predictions_more_than_large_ones():
    assert value(metrics.inverse_laplacian, [1], [10]) == 9
    assert value(metrics.inverse_laplacian, [100], [10]) == pytest.approx(0.9)


@given(p=real_spectra, g=spectra)
def test_rpd_lies_between_zero_and_k_for_any_sign(p, g):
    values = metrics.relative_percent_difference(p, g)
    assert ((values >= 0) & (values <= 10)).all()


@given(p=real_spectra, g=spectra)
def test_polar_loss_lies_between_zero_and_three(p, g):
    p[:, 0] += np.where(np.abs(p).max(axis=1) < 1e-3, 1.0, 0.0)  # zero has no direction
    values = metrics.polar_loss(p, g)
    assert ((values >= -1e-12) & (values <= 3 + 1e-12)).all()


@given(p=spectra, g=spectra)
def test_symmetric_metrics_do_not_tell_prediction_from_label(p, g):
    for function in (
        metrics.relative_percent_difference,
        metrics.polar_loss,
        metrics.l1_norm,
        metrics.l2_norm,
    ):
        np.testing.assert_allclose(function(p, g), function(g, p), rtol=1e-12, atol=1e-12)


@given(p=spectra, g=spectra)
def test_norms_obey_l2_at_most_l1_at_most_root_k_times_l2(p, g):
    l1, l2 = metrics.l1_norm(p, g), metrics.l2_norm(p, g)
    assert (l2 <= l1 * (1 + 1e-12)).all()
    assert (l1 <= math.sqrt(10) * l2 * (1 + 1e-12)).all()


@pytest.mark.parametrize("c", [1e-4, 0.3, 7.0, 1e5])
@pytest.mark.parametrize("function", SCALE_FREE, ids=lambda f: f.__name__)
def test_metric_does_not_change_with_the_unit_of_length(function, c):
    rng = np.random.default_rng(0)
    g = np.sort(rng.uniform(1, 50, (20, 10)), axis=1)
    p = g * rng.uniform(0.5, 2, g.shape)
    np.testing.assert_allclose(function(c * p, c * g), function(p, g), rtol=1e-9)


@pytest.mark.parametrize("function", [metrics.l1_norm, metrics.l2_norm], ids=lambda f: f.__name__)
def test_norms_scale_with_the_unit_of_length(function):
    rng = np.random.default_rng(1)
    p, g = rng.uniform(1, 50, (2, 20, 10))
    np.testing.assert_allclose(function(7 * p, 7 * g), 7 * function(p, g), rtol=1e-12)


# --- the contract of every registered metric -------------------------------------------


def has_one_float64_a_mesh(metric, p, g):
    values = metric.function(p, g)
    assert values.shape == (len(p),)
    assert values.dtype == np.float64


def treats_each_mesh_alone(metric, p, g):
    order = np.random.default_rng(2).permutation(len(p))
    np.testing.assert_array_equal(metric.function(p[order], g[order]), metric.function(p, g)[order])
    np.testing.assert_array_equal(metric.function(p[:1], g[:1]), metric.function(p, g)[:1])


def leaves_its_input_alone(metric, p, g):
    before = p.copy(), g.copy()
    p.flags.writeable = g.flags.writeable = False
    metric.function(p, g)
    p.flags.writeable = g.flags.writeable = True
    np.testing.assert_array_equal(p, before[0])
    np.testing.assert_array_equal(g, before[1])


def has_its_best_value_at_the_label(metric, p, g):
    best = metric.function(g, g)
    highest = {"psnr": np.inf, "psnr20": 1}
    np.testing.assert_allclose(best, highest.get(metric.key, 0), atol=1e-12)


def improves_in_the_direction_it_declares(metric, p, g):
    means = [metric.function(g * (1 + e), g).mean() for e in (1e-3, 0.03, 0.3, 3.0)]
    if not metric.higher_is_better:
        assert means == sorted(means)
        assert means[0] < means[-1]
    else:
        assert means == sorted(means, reverse=True)
        assert means[0] > means[-1]


def does_not_depend_on_the_order_of_the_indices(metric, p, g):
    order = np.random.default_rng(3).permutation(p.shape[1])
    values = metric.function(p[:, order], g[:, order])
    np.testing.assert_allclose(values, metric.function(p, g), rtol=1e-12)


def takes_an_empty_batch(metric, p, g):
    assert metric.function(p[:0], g[:0]).shape == (0,)


def takes_tensors(metric, p, g):
    torch = pytest.importorskip("torch")
    values = metric.function(torch.tensor(p, requires_grad=True), torch.tensor(g))
    np.testing.assert_array_equal(values, metric.function(p, g))


def takes_lists_and_single_precision(metric, p, g):
    values = metric.function(p.tolist(), g.tolist())
    np.testing.assert_array_equal(values, metric.function(p, g))
    p, g = p.astype(np.float32), g.astype(np.float32)
    expected = metric.function(p.astype(np.float64), g.astype(np.float64))
    np.testing.assert_array_equal(metric.function(p, g), expected)


def takes_real_numbers_only(metric, p, g):
    for given_kind in (p + 5j, p.astype(str), p > 1):
        with pytest.raises(ValueError, match="must be real numbers, got "):
            metric.function(given_kind, g)


def broadcasts_nothing(metric, p, g):
    for predicted, label in ((p, g[:1]), (p, g[0]), (p[0], g[0]), (p[:, :1], g), (p[:, :5], g)):
        with pytest.raises(ValueError, match=r"must both have shape \(B, k\), got \("):
            metric.function(predicted, label)


def says_what_it_is(metric, p, g):
    assert METRICS[metric.key] is metric
    assert metric.title
    assert metric.decimals > 0
    assert metric.function.__doc__


CONTRACT = (
    has_one_float64_a_mesh,
    treats_each_mesh_alone,
    leaves_its_input_alone,
    has_its_best_value_at_the_label,
    improves_in_the_direction_it_declares,
    does_not_depend_on_the_order_of_the_indices,
    takes_an_empty_batch,
    takes_tensors,
    takes_lists_and_single_precision,
    takes_real_numbers_only,
    broadcasts_nothing,
    says_what_it_is,
)


@pytest.mark.parametrize("key", METRICS)
@pytest.mark.parametrize("rule", CONTRACT, ids=lambda rule: rule.__name__)
def test_registered_metric(rule, key):
    rng = np.random.default_rng(4)
    g = np.sort(rng.uniform(1, 50, (20, 10)), axis=1)
    rule(METRICS[key], g * rng.uniform(0.8, 1.25, g.shape), g)


@pytest.mark.parametrize("broken", [NAN, INF, -INF])
@pytest.mark.parametrize("position", [0, 9])
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_prediction_that_is_not_finite_is_never_finite_and_never_raises(function, position, broken):
    g = np.tile(np.arange(1.0, 11.0), (2, 1))
    p = g * 1.1
    p[0, position] = broken
    values = function(p, g)
    assert np.isfinite(values[1])  # its neighbour keeps its value
    if function is metrics.psnr_above_20:
        assert values[0] == 0  # a share: it counts as not accurate
    else:
        assert not np.isfinite(values[0])


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda f: f.__name__)
def test_predictions_of_any_size_raise_nothing(function):
    g = np.tile(np.arange(1.0, 11.0), (6, 1))
    p = np.tile([[1e308], [-1e308], [1e-308], [5e-324], [0.0], [-0.0]], (1, 10))
    assert function(p, g).shape == (6,)


def test_directions_of_the_registry():
    higher = [key for key, metric in METRICS.items() if metric.higher_is_better]
    assert higher == ["psnr", "psnr20"]
    assert list(METRICS) == ["invlap", "rpd", "polar", "psnr", "psnr20", "l1", "l2"]
    assert {key for key, m in METRICS.items() if m.unit == "1/length²"} == {"l1", "l2"}
