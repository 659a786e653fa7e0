"""The rows of baselines/ that aim at the spectrum of the surface."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.types import Mesh

BASELINES = Path(__file__).parents[2] / "baselines"
SPHERE = np.repeat([2.0, 6.0, 12.0], [3, 5, 2])


def sibling(name: str) -> ModuleType:
    """Import a file of baselines/, as those beside it do."""
    sys.path.insert(0, str(BASELINES))
    try:
        return import_module(name)
    finally:
        sys.path.remove(str(BASELINES))


def sphere(resolution: int) -> Mesh:
    return FAMILIES["sphere"].generate({"radius": 1.0, "resolution": resolution})


def box(subdivisions: int) -> tuple[Mesh, np.ndarray]:
    """A box and the spectrum of its surface."""
    parameters = {"width": 1.0, "height": 0.6, "depth": 1.7, "subdivisions": subdivisions}
    family = FAMILIES["rectangular_prism"]
    return family.generate(parameters), family.limit_spectrum(parameters).eigenvalues


def error(found: np.ndarray, limit: np.ndarray) -> float:
    return float(np.abs(found / limit - 1).max())


@pytest.mark.parametrize("row", ["quadratic", "richardson"])
def test_fourth_order_on_a_polyhedron(row: str) -> None:
    eigenvalues = sibling(row).eigenvalues
    coarse, fine = (error(eigenvalues(mesh), limit) for mesh, limit in (box(3), box(4)))
    assert fine < 2e-4
    assert coarse / fine > 6  # sixteen, but for the corners


def test_on_a_sphere_all_beat_the_consistent_mass_whose_error_is_its_inscribed_triangles() -> None:
    mesh = sphere(20)
    consistent = error(spectrum.compute(mesh).eigenvalues, SPHERE)
    for row, share in (("two_masses", 0.5), ("quadratic", 0.3), ("richardson", 0.3)):
        assert error(sibling(row).predict([mesh])[0], SPHERE) < share * consistent


def test_richardson_is_sorted() -> None:
    mesh = sphere(12)
    coarse = spectrum.compute(mesh).eigenvalues
    found = sibling("richardson").eigenvalues(mesh)
    assert (np.diff(found) >= 0).all()
    assert (found < coarse).all()


def test_quarters_are_the_same_surface_with_half_the_edges() -> None:
    mesh, _ = box(2)
    fine = sibling("refined").quartered(mesh)
    assert len(fine.faces) == 4 * len(mesh.faces)
    assert len(fine.vertices) - len(fine.faces) / 2 == 2  # Euler's formula: no vertex twice
    area, volume = sibling("ritz_features").features(mesh)[0], 1.0 * 0.6 * 1.7
    corners = fine.vertices[fine.faces]
    assert np.linalg.det(corners).sum() / 6 == pytest.approx(volume)  # all turn the same way
    assert sibling("ritz_features").features(fine)[0] == pytest.approx(area)


def test_lumped_values_are_bounds_next_to_those_of_a_solve_of_its_own() -> None:
    mesh, _ = box(3)
    consistent, lumped = sibling("two_masses").spectra(mesh)
    matrices = spectrum.assemble(mesh)
    rows = np.repeat(np.arange(len(matrices.lumped)), np.diff(matrices.indptr))
    mass = np.where(matrices.indices == rows, matrices.lumped[rows], 0.0)
    wanted = spectrum.of_matrices(matrices._replace(mass=mass)).eigenvalues
    assert (lumped >= wanted * (1 - 1e-9)).all()
    assert (lumped - wanted <= 0.2 * (consistent - wanted)).all()


def test_mean_of_both_masses_is_far_better_than_each_on_a_polyhedron() -> None:
    mesh, limit = box(4)
    both = sibling("two_masses").spectra(mesh)
    assert 3 * error(both.mean(axis=0), limit) < min(error(each, limit) for each in both)


def test_cholmod_changes_no_digit_that_counts() -> None:
    pytest.importorskip("cholespy", reason="of the extra cholmod")
    mesh = sphere(12)
    found = sibling("lapy_cholmod").eigenvalues(mesh)
    np.testing.assert_allclose(found, spectrum.compute(mesh).eigenvalues, rtol=1e-8)


def test_kriging_is_exact_for_linear_functions_and_near_its_own_points() -> None:
    kriging = sibling("kriging")
    rng = np.random.default_rng(0)
    numbers = rng.normal(size=(300, len(kriging.NAMES)))
    logs = numbers @ rng.normal(size=(len(kriging.NAMES), 10))
    model = kriging.Kriging(numbers, logs)
    other = rng.normal(size=(5, len(kriging.NAMES))) / 2
    wanted = other @ np.linalg.lstsq(numbers, logs, rcond=None)[0]
    np.testing.assert_allclose(model.logs(other), wanted, atol=1e-6)
    waves = np.sin(logs)
    own = kriging.Kriging(numbers, waves).logs(numbers[:20])
    np.testing.assert_allclose(own, waves[:20], atol=0.01)
