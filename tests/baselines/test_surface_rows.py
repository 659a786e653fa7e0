"""The rows of baselines/ that aim at the spectrum of the surface."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from evidence import baseline
from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.types import Mesh
from tests.spectrum.meshes import sphere

SPHERE = np.repeat([2.0, 6.0, 12.0], [3, 5, 2])


def box(subdivisions):
    """A box and the spectrum of its surface."""
    parameters = {"width": 1.0, "height": 0.6, "depth": 1.7, "subdivisions": subdivisions}
    family = FAMILIES["rectangular_prism"]
    return family.generate(parameters), family.limit_spectrum(parameters).eigenvalues


def error(values, limit):
    return float(np.abs(values / limit - 1).max())


@pytest.mark.parametrize("row", ["quadratic", "richardson"])
def test_fourth_order_on_a_polyhedron(row):
    eigenvalues = baseline(row).eigenvalues
    coarse, fine = (error(eigenvalues(mesh), limit) for mesh, limit in (box(3), box(4)))
    assert fine < 2e-4
    assert coarse / fine > 6  # sixteen, but for the corners


def test_on_a_sphere_all_beat_the_consistent_mass_whose_error_is_its_inscribed_triangles():
    mesh = sphere(20)
    consistent = error(spectrum.compute(mesh).eigenvalues, SPHERE)
    for row, share in (("two_masses", 0.5), ("quadratic", 0.3), ("richardson", 0.3)):
        assert error(baseline(row).predict([mesh])[0], SPHERE) < share * consistent


def test_richardson_keeps_the_finer_value_where_quartering_halves_an_eigenvalue():
    parameters = {"width": 1.0, "height": 0.02, "depth": 0.02, "subdivisions": 1}
    mesh = FAMILIES["rectangular_prism"].generate(parameters)
    fine = spectrum.compute(baseline("refined").quartered(mesh)).eigenvalues
    halved = spectrum.compute(mesh, k=6).eigenvalues >= 2 * fine[:6]
    assert halved.any()
    values = baseline("richardson").eigenvalues(mesh)
    assert (values > 0).all()
    assert np.isin(fine[:6][halved], values).all()


def test_richardson_is_sorted():
    mesh = sphere(12)
    coarse = spectrum.compute(mesh).eigenvalues
    values = baseline("richardson").eigenvalues(mesh)
    assert (np.diff(values) >= 0).all()
    assert (values < coarse).all()


def test_quarters_are_the_same_surface_with_half_the_edges():
    mesh, _ = box(2)
    fine = baseline("refined").quartered(mesh)
    assert len(fine.faces) == 4 * len(mesh.faces)
    assert len(fine.vertices) - len(fine.faces) / 2 == 2  # Euler's formula: no vertex twice
    area, volume = baseline("ritz_features").features(mesh)[0], 1.0 * 0.6 * 1.7
    corners = fine.vertices[fine.faces]
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(volume)  # all turn the same way
    assert baseline("ritz_features").features(fine)[0] == pytest.approx(area)


def test_lumped_values_are_bounds_next_to_those_of_a_solve_of_its_own():
    mesh, _ = box(3)
    consistent, lumped = baseline("two_masses").spectra(mesh)
    matrices = spectrum.discretise(mesh).matrices
    rows = np.repeat(np.arange(len(matrices.lumped)), np.diff(matrices.indptr))
    mass = np.where(matrices.indices == rows, matrices.lumped[rows], 0.0)
    expected = spectrum.of_matrices(matrices._replace(mass=mass)).eigenvalues
    assert (lumped >= expected * (1 - 1e-9)).all()
    assert (lumped - expected <= 0.2 * (consistent - expected)).all()


def test_mean_of_both_masses_is_far_better_than_each_on_a_polyhedron():
    mesh, limit = box(4)
    both = baseline("two_masses").spectra(mesh)
    assert 3 * error(both.mean(axis=0), limit) < min(error(each, limit) for each in both)


def test_cholmod_changes_no_digit_that_counts():
    pytest.importorskip("cholespy", reason="of the extra cholmod")
    mesh = sphere(12)
    values = baseline("lapy_cholmod").eigenvalues(mesh)
    np.testing.assert_allclose(values, spectrum.compute(mesh).eigenvalues, rtol=1e-8)


def test_kriging_goes_through_its_points_and_follows_a_trend():
    kriging = baseline("kriging")
    rng = np.random.default_rng(0)
    numbers = rng.normal(size=(400, len(kriging.NAMES)))
    slopes = rng.normal(size=(len(kriging.NAMES), 10)) / 10
    model = kriging.Kriging(numbers, np.sin(numbers @ slopes))
    np.testing.assert_allclose(model.logs(numbers[:20]), model.targets[:20], atol=1e-3)
    linear = kriging.Kriging(numbers, 3 + numbers @ slopes)
    other = rng.normal(size=(20, len(kriging.NAMES))) / 2
    np.testing.assert_allclose(linear.logs(other), 3 + other @ slopes, atol=0.01)


def test_multilevel_values_are_bounds_and_their_errors_are_seen_beside_them():
    masses = baseline("multilevel_masses")
    mesh = sphere(40)
    area = baseline("ritz_features").features(mesh)[0]
    logs, ratio, residual = masses.features(mesh).reshape(3, 10)
    exact, lumped = np.log(area * baseline("two_masses").spectra(mesh))
    assert (logs >= exact - 1e-9).all()
    assert np.abs(logs - exact).max() < 0.01
    np.testing.assert_allclose(ratio, exact - lumped, rtol=0.1, atol=1e-4)
    assert ((residual >= 0) & (residual < 1e-3)).all()
    grown = masses.features(Mesh(3 * mesh.vertices, mesh.faces))
    np.testing.assert_allclose(grown, masses.features(mesh), atol=1e-9)


def test_two_numbers_are_found_again():
    masses = baseline("multilevel_masses")
    numbers = np.abs(np.random.default_rng(0).normal(size=(50, 30)))
    fitted = masses.fit(numbers, masses.TwoNumbers(0.6, 7.0).logs(numbers))
    assert (fitted.a, fitted.b) == pytest.approx((0.6, 7.0), abs=1e-3)


@pytest.mark.slow
def test_shapes_without_a_number_are_left_out(tmp_path, monkeypatch):
    kept = baseline("surface_numbers")
    limits = kept.pins.read_limits("1.0")
    ids = np.unique(kept.truth.load("1.0", "train").shapes)
    rows = np.ones((len(ids), 3))
    rows[5:, 2] = np.nan
    rows[:, 0] = 2.0
    monkeypatch.setattr(kept, "NUMBERS", tmp_path / "numbers.parquet")
    kept.write(ids.tolist(), rows, ["a", "b"])
    numbers, logs = kept.kept("1.0/grouped", ["b"])
    assert numbers.shape == (5, 1)
    np.testing.assert_allclose(logs[0], np.log(2 * limits[ids[0]].eigenvalues))
    assert len(kept.kept("1.0/grouped", ["a"])[0]) == len(ids)
    kept.write(ids[1:].tolist(), rows[1:], ["a", "b"])
    with pytest.raises(ValueError, match=r"lacks .* of 1\.0/grouped: make it anew"):
        kept.kept("1.0/grouped", ["a"])


@pytest.mark.slow
def test_a_later_version_adds_its_shapes_to_those_of_the_one_it_extends(tmp_path, monkeypatch):
    more = baseline("more_numbers")
    for protocol in ("grouped", "cad"):
        shapes = np.unique(more.truth.load("2.1", "train", protocol).shapes)
        numbers, logs = more.kept(f"2.1/{protocol}", ["log_volume"])
        assert numbers.shape == (len(shapes), 1)
        assert logs.shape == (len(shapes), 10)
    earlier = np.unique(more.truth.load("2.0", "train").shapes)
    there = np.isin(shapes, earlier)
    assert there.sum() == len(earlier) < len(shapes)
    for mine, its in zip((numbers, logs), more.kept("2.0/grouped", ["log_volume"]), strict=True):
        np.testing.assert_allclose(mine[there], its, rtol=1e-12)
    short = pq.read_table(more.file("2.1")).slice(1)
    monkeypatch.setattr(more, "file", lambda version: tmp_path / f"{version}.parquet")
    pq.write_table(short, more.file("2.1"))
    with pytest.raises(ValueError, match=r"lacks \S+ of 2\.1/grouped: make it anew"):
        more.kept("2.1/grouped", ["log_volume"])
