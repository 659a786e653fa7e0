"""Spectra of surfaces by elements of high degree: closed forms, other methods, and their bars."""

import math
from functools import partial

import numpy as np
import pytest

from evidence import scikit_fem
from synthnet.errors import SpectrumError
from synthnet.families import FAMILIES, drum, elements, limits, surface_limits
from synthnet.families.atlas import Atlas, lattice, rectangle
from synthnet.families.polyhedra import flat, polyhedron
from synthnet.recipe.drawing import draw_shape
from tests.datasets import home

UNKNOWN = [name for name, family in FAMILIES.items() if family.limit is None]
KNOWN = [name for name in FAMILIES if name not in UNKNOWN]


slow = partial(pytest.param, marks=pytest.mark.slow)


def drawn(family, count):
    """Evenly spaced draws of the version that the family is of."""
    resolved = home(family)
    total = resolved.families[family].count
    for index in np.linspace(0, total - 1, count).astype(int).tolist():
        yield draw_shape(resolved, family, index).parameters


def of_atlas(family, parameters):
    atlas = FAMILIES[family].atlas
    return surface_limits.limit(atlas(**parameters), 10)


# --- elements --------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [1, 2, 5, 8])
def test_bernsteins_polynomials_are_a_partition_of_unity(degree):
    points, weights = elements.quadrature(degree + 1)
    values, slopes = elements.bernstein(degree, points)
    np.testing.assert_allclose(values.sum(axis=1), 1, rtol=1e-13)
    np.testing.assert_allclose(slopes.sum(axis=2), 0, atol=1e-11)
    # Each has the same integral, by which every row of a mass matrix has a positive sum.
    expected = 1 / ((degree + 1) * (degree + 2))
    np.testing.assert_allclose(weights @ values, expected, rtol=1e-12)


@pytest.mark.parametrize("degree", [2, 5, 9])
def test_slopes_are_derivatives(degree):
    points = np.array([[0.2, 0.5, 0.3], [0.7, 0.1, 0.2]])
    _, slopes = elements.bernstein(degree, points)
    step = 1e-6
    for direction, slope in zip(([-1, 1, 0], [-1, 0, 1]), slopes, strict=True):
        ends = (
            elements.bernstein(degree, points + s * step * np.array(direction))[0] for s in (1, -1)
        )
        np.testing.assert_allclose(np.subtract(*ends) / (2 * step), slope, atol=1e-7)


@pytest.mark.parametrize("degree", [3, 6, 9])
def test_interpolation_nodes_lie_evenly_and_are_symmetric(degree):
    nodes = elements.interpolation_nodes(degree)
    np.testing.assert_allclose(nodes.sum(axis=1), 1, rtol=1e-14)
    assert (nodes >= -1e-15).all()
    known = {tuple(row) for row in (nodes + 0.0).round(12).tolist()}
    for turn in ([1, 2, 0], [1, 0, 2]):
        assert {tuple(row) for row in (nodes[:, turn] + 0.0).round(12).tolist()} == known
    i, j = lattice(degree)
    assert np.abs(nodes[:, 1] - i / degree).max() < 1.1 / degree  # in the lattice's order
    assert np.abs(nodes[:, 2] - j / degree).max() < 1.1 / degree


def test_a_mass_matrix_has_the_area_and_constants_have_no_energy():
    atlas = FAMILIES["conforming_split_sphere"].atlas(radius=2.0)
    matrices = elements.assemble(atlas, atlas.uniform(2), 6)
    assert matrices.mass.sum() == pytest.approx(16 * math.pi, rel=1e-7)
    assert (matrices.lumped > 0).all()
    sums = np.add.reduceat(matrices.stiffness, matrices.indptr[:-1])
    assert np.abs(sums).max() < 1e-11


def test_a_triangle_without_area_is_refused():
    atlas = polyhedron(np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]]))
    with pytest.raises(ValueError, match="a triangle of the surface has no area"):
        elements.assemble(atlas, atlas.uniform(1), 2)


def test_patches_that_meet_in_their_corners_only_are_refused():
    patches = rectangle(np.array([0.0, 1.0]), np.array([0.0, 1.0]))

    def chart(charts, u):
        bulge = np.where(charts == 0, u[:, 0] * (1 - u[:, 0]), 0)
        return np.column_stack([u, bulge])

    atlas = Atlas(patches, np.arange(2), chart)
    with pytest.raises(ValueError, match=r"in their common edge are 0\.25 apart"):
        elements.assemble(atlas, atlas.uniform(1), 3)


# --- triangulations --------------------------------------------------------------------


def test_corners_have_layers_by_their_angle():
    cube = FAMILIES["rectangular_prism"].atlas(width=1.0, height=1.0, depth=1.0)
    # 3π/2 around a corner: exponent 4/3, and 0.2^(8/3 · 3) is below 1e-5 first.
    assert surface_limits.layers_at(cube).tolist() == [3] * 8
    plane = FAMILIES["flat_rectangle"].atlas(width=1.0, height=3.0)
    assert not surface_limits.layers_at(plane).any()  # corners of π/2: functions are smooth
    ball = FAMILIES["conforming_split_sphere"].atlas(radius=1.0)
    assert not surface_limits.layers_at(ball).any()
    disc = FAMILIES["elliptic_disc"].atlas(flatness=0.7)
    layers = surface_limits.layers_at(disc)
    assert sorted(layers.tolist()) == [0] * 6 + [2]  # polar coordinates have a kink
    outline = FAMILIES["drum"].atlas(form=0, size=1.0, lean=0.0)
    assert surface_limits.layers_at(outline).max() == 6  # 3π/2 on a boundary: exponent 2/3


@pytest.mark.parametrize("family", ["rectangular_prism", "drum", "extruded_star", "elliptic_disc"])
def test_layers_leave_the_surface_as_it_is(family):
    parameters = next(drawn(family, 1))
    atlas = FAMILIES[family].atlas(**parameters)
    layers = surface_limits.layers_at(atlas)
    mesh = surface_limits.triangulation(atlas, 2, layers)
    assert len(mesh.faces) == 4 * len(atlas.charts) + 2 * layers[atlas.glued()].sum()
    plain, cut = (elements.assemble(atlas, m, 3).mass.sum() for m in (atlas.uniform(2), mesh))
    assert cut == pytest.approx(plain, rel=1e-4)
    edges, of_side = mesh.edges()
    euler = mesh.n_vertices - len(edges) + len(mesh.faces)
    assert euler == FAMILIES[family].topology(parameters).euler_characteristic
    assert np.bincount(of_side.ravel()).max() == 2


# --- theorems, and other methods -------------------------------------------------------


CLOSED = ("sphere", "flat_rectangle", "open_cylinder")
TURNED = ("torus", "cone", "cylinder", "conical_frustum", "annulus", "spherical_cap")


@pytest.mark.parametrize("family", [*CLOSED, *TURNED])
def test_closed_forms_and_the_one_dimensional_solver_are_met_within_the_bars(family):
    for parameters in drawn(family, 3):
        limit = of_atlas(family, parameters)
        known = FAMILIES[family].limit_eigenvalues(parameters)
        assert (np.abs(limit.eigenvalues - known) <= limit.bar).all()
        assert family in TURNED or (np.abs(limit.eigenvalues / known - 1) < 1e-6).all()


@pytest.mark.slow
@pytest.mark.parametrize("family", KNOWN)
def test_twenty_five_of_a_family_agree_with_what_is_known_of_them(family):
    for parameters in drawn(family, 25):
        limit = of_atlas(family, parameters)
        known = FAMILIES[family].limit_spectrum(parameters)
        assert (np.abs(limit.eigenvalues - known.eigenvalues) <= limit.bar + known.bar).all()


QUICK = ("simplex", "mobius_band", "ellipsoid", "drum")


@pytest.mark.parametrize("family", [n if n in QUICK else slow(n) for n in UNKNOWN])
def test_scikit_fem_has_the_same_spectrum(family):
    """Of 25 surfaces a family: ``python -m evidence measure limits``."""
    for parameters in drawn(family, 1):
        limit = FAMILIES[family].limit_spectrum(parameters)
        other = scikit_fem.limit(FAMILIES[family].atlas(**parameters), 10, close=1e-4)
        apart = np.abs(other.eigenvalues - limit.eigenvalues)
        assert (apart <= limit.bar + other.bar).all()
        assert (apart <= 1e-3 * limit.eigenvalues).all()
        assert (limit.bar <= 1e-3 * limit.eigenvalues).all()


@pytest.mark.parametrize("lean", [0.0, 0.17])
def test_the_two_drums_sound_alike(lean):
    """Gordon, Webb, Wolpert: two polygons that are not congruent, of one spectrum."""
    first, second = (
        surface_limits.limit(drum.atlas(form=form, size=1.0, lean=lean), 10) for form in (0, 1)
    )
    apart = np.abs(first.eigenvalues - second.eigenvalues)
    assert (apart <= first.bar + second.bar).all()
    assert (apart < 1e-5 * first.eigenvalues).all()


def test_a_box_as_thin_as_a_sheet_is_a_sheet_twice():
    """Even functions obey Neumann's condition on the edges, odd ones Dirichlet's nearly."""
    thin = {"width": 1.0, "height": 1e-4, "depth": 0.7}
    values = of_atlas("rectangular_prism", thin).eigenvalues
    i, j = np.indices((6, 6))
    even = ((i / 1.0) ** 2 + (j / 0.7) ** 2).ravel()[1:]
    odd = ((i[1:, 1:] / 1.0) ** 2 + (j[1:, 1:] / 0.7) ** 2).ravel()
    expected = np.pi**2 * np.sort(np.concatenate([even, odd]))[:10]
    np.testing.assert_allclose(values, expected, rtol=1e-3)


def test_a_regular_tetrahedron_is_a_flat_torus_under_a_half_turn():
    r"""Functions on it are the even ones on :math:`\mathbb{R}^2 / 2\Lambda`, with edges 1.

    So its eigenvalues are :math:`4\pi^2 |w|^2 / 4` over the dual lattice, each pair ±w once:
    :math:`\pi^2 \cdot \frac{4}{3} (a^2 + ab + b^2)`.
    """
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(8)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    limit = surface_limits.limit(polyhedron(*(corners[face][None] for face in faces)), 10)
    a, b = np.indices((9, 9)) - 4
    norms = np.sort((a * a + a * b + b * b).ravel())[1::2]
    expected = 4 / 3 * np.pi**2 * norms[:10]
    assert (np.abs(limit.eigenvalues - expected) <= limit.bar).all()


def test_a_surface_twice_the_size_has_a_quarter_of_the_eigenvalues():
    size = {"width": 1.0, "height": 0.4, "depth": 2.0}
    single = of_atlas("rectangular_prism", size)
    double = of_atlas("rectangular_prism", {name: 2 * value for name, value in size.items()})
    np.testing.assert_allclose(single.eigenvalues, 4 * double.eigenvalues, rtol=1e-9)


def test_bars_cover_what_more_elements_change(monkeypatch):
    parameters = [
        {"width": 1.0, "height": 0.7, "depth": 1.6},
        {"width": 1.0, "height": 0.01, "depth": 100.0},
        {"width": 1.0, "height": 100.0, "depth": 90.0},
    ]
    coarse = [of_atlas("tetrahedron", each) for each in parameters]
    monkeypatch.setattr(surface_limits, "ELEMENTS", 4 * surface_limits.ELEMENTS)
    monkeypatch.setattr(surface_limits, "LEFT", 1e-7)
    for limit, each in zip(coarse, parameters, strict=True):
        finer = of_atlas("tetrahedron", each).eigenvalues
        assert (limit.eigenvalues != finer).any()
        assert (np.abs(limit.eigenvalues - finer) <= limit.bar).all()
        assert (np.diff(limit.eigenvalues) >= 0).all()
        assert (limit.bar <= 1e-4 * limit.eigenvalues).all()


@pytest.mark.parametrize("family", [slow(name) if name == "lattice" else name for name in FAMILIES])
def test_every_family_has_a_limit(family):
    parameters = next(drawn(family, 1))
    limit = FAMILIES[family].limit_spectrum(parameters, 4)
    assert limit.eigenvalues.shape == limit.bar.shape == (4,)
    assert (limit.eigenvalues > 0).all()
    assert (np.diff(limit.eigenvalues) >= 0).all()
    relative = limit.bar / limit.eigenvalues
    assert (relative <= (1e-4 if family in UNKNOWN else limits.KNOWN * (1 + 1e-9))).all()
    assert (relative > 0).all()


PLATE = polyhedron(flat(rectangle(np.array([0.0, 1.0]), np.array([0.0, 30.0]))))


def check_that_the_target_is_missed():
    limit = surface_limits.limit(PLATE, 10)
    known = limits.of_rectangle(1.0, 30.0, 10)
    assert limit.bar.max() > surface_limits.TARGET * known[-1]
    assert (np.abs(limit.eigenvalues - known) <= limit.bar).all()


def test_the_target_is_given_up_where_it_would_take_too_much(monkeypatch):
    monkeypatch.setattr(surface_limits, "MOST", 0)
    check_that_the_target_is_missed()


def test_what_the_solver_fails_on_leaves_the_bar_that_was_reached(monkeypatch):
    computed = surface_limits.spectrum

    def failing(atlas, mesh, degree, k):
        if len(mesh.faces) > most:
            raise SpectrumError("no convergence")
        return computed(atlas, mesh, degree, k)

    monkeypatch.setattr(surface_limits, "spectrum", failing)
    most = 60
    check_that_the_target_is_missed()
    most = 0
    with pytest.raises(SpectrumError, match="no convergence"):
        surface_limits.limit(PLATE, 10)
