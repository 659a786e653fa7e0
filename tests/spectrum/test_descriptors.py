"""Descriptors against their formulas, LaPy, and what is known of the smooth surface."""

import numpy as np
import pytest

from evidence.operators import square
from synthnet.mesh import geometry
from synthnet.spectrum import Operator, compute
from synthnet.spectrum.descriptors import (
    heat_kernel_signature,
    heat_trace,
    shape_dna,
    wave_kernel_signature,
)
from synthnet.types import Mesh
from tests.spectrum.meshes import side_by_side, sphere

SPHERE = sphere(20, radius=1.5)
FOUND = compute(SPHERE, 40)
BOTH = side_by_side(square(10), sphere(9))
AREA, VOLUME = geometry.area(SPHERE), geometry.volume(SPHERE)


@pytest.mark.parametrize(("normalisation", "method"), [("area", "surface"), ("volume", "volume")])
def test_shape_dna_is_lapys(normalisation, method):
    lapy, shapedna = pytest.importorskip("lapy"), pytest.importorskip("lapy.shapedna")
    mesh = lapy.TriaMesh(SPHERE.vertices.astype(np.float64), SPHERE.faces)
    mesh.orient_()
    descriptor = shape_dna(FOUND, normalisation, area=AREA, volume=VOLUME)
    if method == "surface":
        expected = shapedna.normalize_ev(mesh, FOUND.eigenvalues, method=method)
        assert descriptor == pytest.approx(expected, rel=1e-6)
    else:
        assert descriptor == pytest.approx(FOUND.eigenvalues * mesh.volume() ** (2 / 3), rel=1e-6)
    weighted = shape_dna(FOUND, normalisation, area=AREA, volume=VOLUME, reweighted=True)
    assert weighted == pytest.approx(shapedna.reweight_ev(descriptor), rel=1e-12)


def test_normalised_shape_dna_does_not_know_the_size():
    large = compute((3 * SPHERE.vertices, SPHERE.faces), 10)
    for normalisation in ("area", "volume", "first"):
        descriptor = shape_dna(large, normalisation, area=9 * AREA, volume=27 * VOLUME)
        expected = shape_dna(FOUND, normalisation, area=AREA, volume=VOLUME)[:10]
        assert descriptor == pytest.approx(expected, rel=1e-6)
    assert shape_dna(large) == pytest.approx(FOUND.eigenvalues[:10] / 9, rel=1e-6)


def test_a_tensor_that_has_a_gradient_is_taken_by_its_values():
    torch = pytest.importorskip("torch")
    values = torch.tensor(FOUND.eigenvalues, requires_grad=True)
    np.testing.assert_array_equal(shape_dna(values), FOUND.eigenvalues)
    assert heat_trace(values, 1.0) == heat_trace(FOUND.eigenvalues, 1.0)


def test_heat_trace_begins_as_area_over_four_pi_t():
    degrees = np.arange(200)
    series = np.repeat(degrees * (degrees + 1.0), 2 * degrees + 1)[1:]  # the unit sphere's
    for t in (0.001, 0.01):
        assert heat_trace(series, t) == pytest.approx(1 / t + 1 / 3, rel=t)
    two = heat_trace(series, [0.01], components=2)
    assert two == pytest.approx(1 + heat_trace(series, [0.01]))


def test_signatures_are_the_plain_formulas():
    values, vectors = FOUND.eigenvalues, FOUND.eigenvectors
    times = np.array([0.1, 1.0])
    heat = heat_kernel_signature(FOUND, times, area=AREA)
    waves = wave_kernel_signature(FOUND, [0.5, 1.5], sigma=0.3)
    for x in (0, 17, 100):
        for j, t in enumerate(times):
            plain = 1 / AREA + sum(
                np.exp(-value * t) * phi**2 for value, phi in zip(values, vectors[x], strict=True)
            )
            assert heat[x, j] == pytest.approx(plain, rel=1e-12)
        for j, e in enumerate((0.5, 1.5)):
            weights = np.exp(-((e - np.log(values)) ** 2) / (2 * 0.3**2))
            plain = (weights * vectors[x] ** 2).sum() / weights.sum()
            assert waves[x, j] == pytest.approx(plain, rel=1e-12)


def test_heat_kernel_signature_and_trace_are_lapys():
    lapy, heat = pytest.importorskip("lapy"), pytest.importorskip("lapy.heat")
    points = SPHERE.vertices.astype(np.float64) * [1.0, 1.3, 1.7]  # no eigenvalue is multiple
    k, times = 20, np.array([[0.05, 0.3, 2.0]])
    values, vectors = lapy.Solver(lapy.TriaMesh(points, SPHERE.faces)).eigs(k + 1, rng=0)
    theirs = heat.diagonal(times, np.arange(len(points)), vectors, values[:, None], k + 1)
    spectrum = compute((points, SPHERE.faces), k)
    area = geometry.area(Mesh(points, SPHERE.faces))
    ours = heat_kernel_signature(spectrum, times[0], area=area)
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    every = np.exp(-values[:, None] * times).sum(axis=0)
    np.testing.assert_allclose(heat_trace(spectrum, times[0]), every, rtol=1e-7)


@pytest.mark.parametrize(
    ("mesh", "k", "operator", "zeros"),
    [
        (square(10), 8, Operator("dirichlet"), 0),
        (square(10), 8, Operator("dirichlet", elements="quadratic"), 0),
        (square(10), 8, Operator(np.zeros(121, dtype=bool)), 1),
        (side_by_side(square(10), square(10)), 8, Operator("dirichlet"), 0),
        (BOTH, 8, Operator("dirichlet"), 1),
        (BOTH, 8, Operator(), 2),
        (square(30), 130, Operator("dirichlet"), 0),  # so many are searched for in slices
        (square(30), 130, Operator(), 1),
    ],
)
def test_only_a_component_that_is_free_everywhere_adds_a_zero_to_the_heat_trace(
    mesh, k, operator, zeros
):
    spectrum = compute(mesh, k, operator=operator)
    assert spectrum.certificate.zeros == zeros
    decayed = np.exp(-spectrum.eigenvalues).sum()
    assert heat_trace(spectrum, 1.0) == pytest.approx(zeros + decayed, rel=1e-12)
    assert heat_trace(spectrum, 1.0, components=5) == pytest.approx(5 + decayed, rel=1e-12)


def test_a_drum_has_no_constant_in_its_heat_kernel_signature():
    drum = compute(square(10), 8, operator=Operator("dirichlet"))
    plain = heat_kernel_signature(drum, [0.1])
    np.testing.assert_array_equal(heat_kernel_signature(drum, [0.1], area=1.0), plain)
    assert plain[0] == 0  # a corner is held


@pytest.mark.parametrize(
    ("operator", "message"),
    [
        (Operator(), "the mesh has 2 components, whose constants differ: leave out area"),
        (Operator("dirichlet"), "the mesh has 2 components, whose constants differ"),
        (Operator(np.arange(len(BOTH.vertices)) < 121), "the constant is zero on components"),
    ],
)
def test_zeros_whose_constants_differ_are_one_line(operator, message):
    spectrum = compute(BOTH, 5, operator=operator)
    with pytest.raises(ValueError, match=message):
        heat_kernel_signature(spectrum, [0.1], area=2.0)


def test_default_times_and_energies_are_the_papers():
    values = FOUND.eigenvalues
    ends = 4 * np.log(10) / values[[-1, 0]]
    heat = heat_kernel_signature(FOUND)
    assert heat.shape == (len(SPHERE.vertices), 100)
    np.testing.assert_allclose(heat[:, [0, -1]], heat_kernel_signature(FOUND, ends))
    sigma = 7 * np.log(values[-1] / values[0]) / 100
    ends = np.log(values[[0, -1]]) + np.array([2 * sigma, -2 * sigma])
    waves = wave_kernel_signature(FOUND)
    np.testing.assert_allclose(waves[:, [0, -1]], wave_kernel_signature(FOUND, ends, sigma=sigma))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: shape_dna(FOUND, "areas"), "normalisation must be one of .*did you mean area"),
        (lambda: shape_dna(FOUND, "area"), "pass area=, that of the surface"),
        (lambda: shape_dna(FOUND, "volume"), r"pass volume=.*geometry\.enclosed_volume\(mesh\)"),
        (lambda: shape_dna(FOUND, "volume", volume=-1.0), "volume must be positive"),
        (lambda: shape_dna([0.0, 1.0]), "the first eigenvalue is zero"),
        (lambda: shape_dna([2.0, 1.0]), "eigenvalues must ascend"),
        (lambda: shape_dna([np.nan]), "eigenvalues must be finite"),
        (lambda: heat_trace([1.0], 0.0), "times must be positive"),
        (lambda: heat_kernel_signature(FOUND.eigenvalues), "a signature needs eigenvectors"),
        (lambda: wave_kernel_signature(FOUND, sigma=9.0), "sigma 9 is too large"),
        (lambda: wave_kernel_signature(FOUND, [np.inf]), "energies must be a list of finite"),
        (lambda: wave_kernel_signature(compute(SPHERE, 1)), "sigma must be positive"),
        (lambda: wave_kernel_signature(FOUND, sigma=-1.0), "sigma must be positive"),
        (
            lambda: wave_kernel_signature(FOUND, sigma=1e-170),
            "is a float64, got 1e-170",
        ),
        (lambda: wave_kernel_signature(FOUND, sigma=1e-160), "sigma 1e-160 is too small"),
        (lambda: wave_kernel_signature(FOUND, [1e200], sigma=1.0), "sigma 1 is too small"),
        (lambda: wave_kernel_signature(FOUND, [0.0], sigma=1e200), r"float64, got 1e\+200"),
        (lambda: wave_kernel_signature(FOUND, sigma="a"), "sigma must be one real number"),
        (lambda: wave_kernel_signature(FOUND, [1j]), "energies must be real numbers"),
        (
            lambda: heat_trace([1.0, 2.0], 1.0, components=-1),
            "components must be at least 0, got -1",
        ),
        (lambda: heat_trace([1.0], 1.0, components=0.5), "components must be an integer, got 0.5"),
        (lambda: heat_trace([1.0], [1j]), "times must be real numbers, got complex128"),
        (lambda: heat_kernel_signature(FOUND, [[1.0, 2.0]]), r"times must be of shape \(c,\)"),
        (lambda: shape_dna(np.array([1.0 + 1j])), "eigenvalues must be real numbers, got complex"),
    ],
)
def test_bad_input_is_one_line(call, message):
    with pytest.raises(ValueError, match=message):
        call()
