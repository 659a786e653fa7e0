"""evidence/two_numbers.py: variants are fitted to the shapes that are left, and to no other."""

import numpy as np
import pytest

from evidence.two_numbers import Variant


@pytest.fixture
def data():
    rng = np.random.default_rng(0)
    base, ratio, residual = rng.normal(size=(3, 40, 10))
    fitted = np.arange(40) < 30
    return base, ratio, residual, fitted


@pytest.mark.parametrize("each", [False, True])
def test_numbers_of_exact_data_are_found(each, data):
    base, ratio, residual, fitted = data
    limits = base - 0.65 * ratio - 7 * residual
    found = Variant(base, (ratio, residual), each).predicted(limits, fitted, ~fitted)
    np.testing.assert_allclose(found, limits[~fitted], atol=1e-2)


def test_what_is_tested_is_not_fitted(data):
    base, ratio, residual, fitted = data
    limits = base - 0.65 * ratio
    others = np.where(fitted[:, None], limits, limits + residual)
    variant = Variant(base, (ratio,))
    same = [variant.predicted(known, fitted, ~fitted) for known in (limits, others)]
    assert (same[0] == same[1]).all()


def test_without_terms_nothing_is_fitted(data):
    base, _, _, fitted = data
    assert (Variant(base).predicted(base + 1, fitted, ~fitted) == base[~fitted]).all()
