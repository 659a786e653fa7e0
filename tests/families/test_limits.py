"""Limit spectra against closed forms and against themselves at a higher resolution."""

import math

import numpy as np
import pytest
from scipy import special

from synthnet.families import FAMILIES, limits
from synthnet.families.limits import Arc

PARAMETERS = {
    "cylinder": {"radius": 1.0, "resolution": 20, "split": 4},
    "cone": {"radius": 1.0, "resolution": 20, "split": 4, "subdivisions": 1},
    "conical_frustum": {"radius": 1.0, "resolution": 20, "split": 4, "scaling": 0.01},
}


def torus(tube_radius):
    tube = {"torus_radius": 1.0, "tube_radius": tube_radius}
    mesh = {"radial_resolution": 30, "tubular_resolution": 20}
    return FAMILIES["torus"].limit_eigenvalues({**tube, **mesh})


def test_sphere_is_l_times_l_plus_one():
    expected = np.repeat([2.0, 6.0, 12.0, 20.0], [3, 5, 7, 9]) / 4
    np.testing.assert_array_equal(limits.of_sphere(2.0, 24), expected)


def test_sphere_is_a_surface_of_revolution():
    quarter = math.pi / 2
    values = limits.of_revolution([Arc(quarter, np.sin), Arc(quarter, np.cos)], 24)
    np.testing.assert_allclose(values, limits.of_sphere(1.0, 24), rtol=1e-10)


def test_two_discs_back_to_back_have_the_zeros_of_bessel_functions():
    # Even functions obey Neumann's condition on the rim, odd ones Dirichlet's.
    zeros = [
        np.repeat(zero, 1 if m == 0 else 2)
        for m in range(6)
        for zero in (special.jn_zeros(m, 5), special.jnp_zeros(m, 5))
    ]
    expected = np.sort(np.concatenate(zeros))[:15] ** 2 / 4
    values = limits.of_revolution([limits.line(0, 2), limits.line(2, 0)], 15)
    np.testing.assert_allclose(values, expected, rtol=1e-10)


@pytest.mark.parametrize("beta", [0.2, 0.7, 1.3])
def test_two_cones_base_to_base_have_the_zeros_of_bessel_functions_of_any_order(beta):
    # On a cone of half angle β, u is J of order m / sin β: the tip is singular.
    zeros = []
    for m in range(10):
        order = m / math.sin(beta)
        x = np.linspace(max(order * 0.5, 1e-3), order + 30, 20_000)
        for function in (special.jv, special.jvp):
            values = function(order, x)
            at = np.flatnonzero(values[:-1] * values[1:] < 0)
            slope = (values[at + 1] - values[at]) / (x[at + 1] - x[at])
            zeros.append(np.repeat(x[at] - values[at] / slope, 1 if m == 0 else 2))
    expected = np.sort(np.concatenate(zeros))[:10] ** 2
    up = limits.line(0, math.sin(beta), math.cos(beta))
    down = limits.line(math.sin(beta), 0, math.cos(beta))
    np.testing.assert_allclose(limits.of_revolution([up, down], 10), expected, rtol=2e-6)


def test_thin_torus_is_a_flat_one():
    # Circles of length 2π and 2πa; the first ten lie along the long one if a is below 1/5.
    # The curvature changes them by a share of order a².
    for tube_radius, share in ((0.1, 0.03), (0.01, 0.0003)):
        values = torus(tube_radius)
        np.testing.assert_allclose(values, np.repeat(np.arange(1, 6) ** 2, 2), rtol=share)


def of(family, **changes):
    return FAMILIES[family].limit_eigenvalues({**PARAMETERS[family], **changes})


@pytest.mark.parametrize("height", [0.01, 0.3, 3.0, 100.0])
@pytest.mark.parametrize("family", PARAMETERS)
def test_ends_converge_to_a_relative_1e_8(family, height, monkeypatch):
    values = of(family, height=height)
    monkeypatch.setattr(limits, "PIECES", 2 * limits.PIECES)
    monkeypatch.setattr(limits, "LAYERS", limits.LAYERS + 3)
    finer = of(family, height=height)
    assert (values != finer).any()
    np.testing.assert_allclose(values, finer, rtol=1e-8)


@pytest.mark.parametrize("tube_radius", [0.1, 0.5, 0.99])
def test_tori_converge_to_a_relative_1e_8(tube_radius, monkeypatch):
    values = torus(tube_radius)
    monkeypatch.setattr(limits, "PIECES", 2 * limits.PIECES)
    finer = torus(tube_radius)
    assert (values != finer).any()
    np.testing.assert_allclose(values, finer, rtol=1e-8)


def test_a_frustum_of_equal_radii_is_a_cylinder():
    cylinder, frustum = of("cylinder", height=2.0), of("conical_frustum", height=2.0, scaling=1.0)
    np.testing.assert_allclose(cylinder, frustum, rtol=1e-12)


def test_a_surface_twice_the_size_has_a_quarter_of_the_eigenvalues():
    single, double = of("cylinder", height=0.7), of("cylinder", radius=2.0, height=1.4)
    np.testing.assert_allclose(single, 4 * double, rtol=1e-11)
