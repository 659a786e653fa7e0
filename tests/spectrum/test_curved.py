"""Triangles bent to the surface, and the estimate of its spectrum."""

from functools import partial

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from evidence.operators import disc, scattered, square
from synthnet import spectrum
from synthnet.errors import SpectrumError
from synthnet.families import FAMILIES
from synthnet.spectrum import Operator, curved, surface, surface_eigenvalues
from synthnet.spectrum.bending import bend, straight
from synthnet.spectrum.operators import as_sparse, discretise
from synthnet.types import Mesh
from tests.spectrum.meshes import side_by_side, sphere

CURVED = Operator(elements="curved")
SPHERE = np.repeat([2.0, 6.0, 12.0], [3, 5, 2])


@pytest.fixture
def uncut(monkeypatch):
    """Leave edges as long as they are."""
    monkeypatch.setattr(surface, "RESOLVED", np.inf)
    monkeypatch.setattr(surface, "SEEN", np.inf)


def family(name, **parameters):
    return FAMILIES[name].generate(parameters)


def cylinder():
    return family("cylinder", radius=1.0, height=2.0, resolution=24, split=4)


def middles(patches):
    return patches.vertices[patches.ends].mean(axis=1) + patches.rises


def error(values, exact):
    return float(np.abs(values / exact - 1).max())


def test_middles_of_arcs_are_on_the_sphere_to_the_fourth_order():
    off = [np.abs(np.linalg.norm(middles(bend(sphere(r))), axis=1) - 1).max() for r in (10, 20)]
    flat = np.linalg.norm(middles(bend(sphere(20))) - bend(sphere(20)).rises, axis=1)
    assert off[1] < 0.02 * (1 - flat.min())
    assert off[0] / off[1] > 12


def test_faces_of_a_box_stay_flat_and_give_quadratic_elements():
    box = family("rectangular_prism", width=1.0, height=0.6, depth=1.7, subdivisions=2)
    assert np.abs(bend(box).rises).max() < 1e-15
    flat, same = (
        spectrum.compute(box, operator=Operator(elements=e)) for e in ("quadratic", "curved")
    )
    np.testing.assert_allclose(same.eigenvalues, flat.eigenvalues, rtol=1e-10)


def test_creases_are_bent_along_themselves():
    patches = bend(cylinder())
    points, ends = patches.vertices, patches.ends
    on_rim = (np.abs(np.hypot(points[:, 0], points[:, 1]) - 1) < 1e-6) & (
        np.abs(np.abs(points[:, 2]) - np.abs(points[:, 2]).max()) < 1e-6
    )
    level = points[ends[:, 0], 2] == points[ends[:, 1], 2]
    rims = on_rim[ends].all(axis=1) & level
    assert rims.sum() == 48
    radii = np.hypot(*middles(patches)[rims, :2].T)
    chord = 1 - np.cos(np.pi / 24)
    assert np.abs(radii - 1).max() < 0.02 * chord
    assert np.abs(patches.rises[rims, 2]).max() < 1e-12
    spokes = (np.hypot(points[:, 0], points[:, 1]) < 1e-9)[ends].any(axis=1)
    assert spokes.sum() == 48
    assert np.abs(patches.rises[spokes]).max() < 1e-12  # the caps are flat


def test_a_boundary_is_bent_and_its_corners_are_not():
    radii = np.linalg.norm(middles(bend(disc(16))), axis=1)
    rim = radii > 0.97
    assert rim.sum() == 48
    assert np.abs(radii[rim] - 1).max() < 1e-4
    assert np.abs(bend(square(6)).rises).max() < 1e-15


def test_a_large_flat_face_beside_a_fine_fillet_stays_flat():
    """As CAD parts have them: the normals at its border are the face's, not the fillet's."""
    turns = np.radians(90 * np.arange(1, 7) / 6)
    profile = np.array([(0, 0), (10, 0), *zip(10 + np.sin(turns), 1 - np.cos(turns), strict=True)])
    steps = np.arange(8)
    points = np.array([(x, y, z) for x, z in profile for y in steps], dtype=float)
    corner = (8 * np.arange(len(profile) - 1)[:, None] + steps[:-1]).ravel()
    below = np.stack([corner, corner + 1, corner + 9], axis=1)
    above = np.stack([corner, corner + 9, corner + 8], axis=1)
    patches = bend(Mesh(points, np.concatenate([below, above])))
    middle = points[patches.ends].mean(axis=1)
    across, inside = (
        np.abs(np.diff(points[patches.ends, 0], axis=1)[:, 0]) > 1,
        middle[:, 1] % 7 > 0,
    )
    large, fillet = across & inside, (middle[:, 0] > 10) & inside
    slopes = np.abs(patches.rises[:, 2]) / np.linalg.norm(
        np.diff(points[patches.ends], axis=1)[:, 0], axis=1
    )
    assert large.sum() == 13
    assert slopes[large].max() < 0.1 * slopes[fillet].max()


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_faces_need_not_be_oriented_alike(share):
    mesh = cylinder()
    turned = np.random.default_rng(0).random(len(mesh.faces)) < share
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    as_it_is, other = bend(mesh), bend(Mesh(mesh.vertices, faces))
    rises = {tuple(e): rise for e, rise in zip(other.ends, other.rises, strict=True)}
    assert len(rises) == len(as_it_is.ends)
    for ends, rise in zip(as_it_is.ends, as_it_is.rises, strict=True):
        np.testing.assert_allclose(rises[tuple(ends)], rise, atol=1e-14)


def test_arcs_do_not_depend_on_the_order_of_faces_and_corners():
    mesh = scattered(4)  # so coarse that normals of both sides of an edge are not of the same faces
    units = np.cross(*np.moveaxis(np.diff(mesh.vertices[mesh.faces], axis=1), 1, 0))
    units /= np.linalg.norm(units, axis=1)[:, None]
    shared = (mesh.faces[:, None, :, None] == mesh.faces[None, :, None, :]).sum(axis=(2, 3)) == 2
    bends = (units @ units.T)[shared]
    assert (bends < np.cos(np.radians(55))).any()
    assert (bends > np.cos(np.radians(55))).any()
    first = bend(mesh)
    for turn in (1, 2):
        faces = np.roll(mesh.faces[::-1], turn, axis=1)
        again = bend(Mesh(mesh.vertices, faces))
        np.testing.assert_array_equal(again.ends, first.ends)
        np.testing.assert_allclose(again.rises, first.rises, atol=1e-13)


def test_a_patch_that_would_turn_over_is_made_flat():
    """In its plane, with sides bent so far, no point of the quadrature has a small area."""
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0.2, 0]]), np.array([[0, 1, 2]]))
    patches = straight(mesh)
    patches.rises[:] = [0.0, -2.0, 0.0]
    blocks = curved.hierarchical(patches)[1:]
    assert (patches.rises == 0).all()
    for block, flat in zip(blocks, curved.hierarchical(straight(mesh))[1:], strict=True):
        np.testing.assert_array_equal(block, flat)


def test_an_estimate_does_not_depend_on_how_many_are_wanted(uncut):
    """More of them may need finer triangles, which is left out here."""
    axes = np.array([1.0, 1.3, 1.7])
    sphere = scattered(14)
    ellipsoid = Mesh(sphere.vertices * axes, sphere.faces)
    many = surface_eigenvalues(ellipsoid, 12)
    np.testing.assert_allclose(surface_eigenvalues(ellipsoid, 4), many[:4], rtol=1e-7)


@pytest.mark.parametrize("shape", ["cylinder", "annulus", "capsule"])
def test_an_estimate_is_that_of_a_finer_mesh_where_triangles_are_as_long_as_a_part(shape):
    make, size = {
        "cylinder": (partial(trimesh.creation.cylinder, 1, 10), {"sections": 100}),
        "annulus": (partial(trimesh.creation.annulus, 0.5, 1, 4), {"sections": 100}),
        "capsule": (partial(trimesh.creation.capsule, height=8, radius=1), {"count": (64, 64)}),
    }[shape]
    finer = surface_eigenvalues(make(**size).subdivide_to_size(0.25))
    np.testing.assert_allclose(surface_eigenvalues(make()), finer, rtol=0.015)


def test_an_estimate_that_is_none_to_first_order_is_warned_of(uncut):
    """Cutting leaves no such mesh that is known to us."""
    with pytest.warns(UserWarning, match=r"too long, too large or too thin.*subdivide") as caught:
        surface_eigenvalues(trimesh.creation.cylinder(1, 10))
    assert caught[0].filename == __file__


def test_without_an_estimate_there_is_no_answer(monkeypatch):
    """No mesh is known to us whose rounding leaves none."""
    blocks = -np.ones((1, 6)), np.zeros((1, 6))
    energies = surface._energies(
        np.array([[0, 1, 2]], np.int32),
        *blocks,
        np.zeros(1),
        np.array([1.0, 2.0]),
        np.ones(3),
        np.array([[1.0, 0], [0, 0], [0, 0]]),
    )
    np.testing.assert_array_equal(np.isnan(energies), [True, False])  # nothing was left of one
    monkeypatch.setattr(surface, "_edge_energies", lambda *_: np.array([0.0, np.nan]))
    with pytest.raises(SpectrumError, match="rounding leaves no estimate"):
        surface_eigenvalues(sphere(10), 2)


def rounded(segments, length):
    """Return a rectangle's outline with round ends, (n, 2): straight sides beside short ones."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, segments + 1)
    end = np.column_stack([length / 2 + np.cos(angles), np.sin(angles)])
    return np.vstack([end, -end])


def disc_of(outline):
    """Return the triangles from the middle of an outline to its sides."""
    n = len(outline)
    vertices = np.column_stack([np.vstack([outline, np.zeros(2)]), np.zeros(n + 1)])
    return Mesh(vertices, np.array([(n, i, (i + 1) % n) for i in range(n)]))


def prism_of(outline, depth):
    """Return the prism over an outline: two such discs, and two triangles a side."""
    base, n = disc_of(outline), len(outline)
    faces = [*base.faces[:, ::-1], *(base.faces + n + 1)]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, j + n + 1), (i, j + n + 1, i + n + 1)]
    above = base.vertices + np.array([0, 0, depth])
    return Mesh(np.vstack([base.vertices, above]), np.array(faces))


def bent_area(mesh):
    return float(curved.hierarchical(bend(mesh))[0].lumped.sum())


@pytest.mark.parametrize("segments", [4, 16])
@pytest.mark.parametrize("length", [4.0, 20.0])
def test_straight_sides_beside_round_ends_stay_straight(segments, length):
    outline, base = rounded(segments, length), np.pi + 2 * length
    assert bent_area(disc_of(outline)) == pytest.approx(base, rel=0.01)
    wall = np.pi + length  # half of its circumference
    prism = prism_of(outline, 0.5)
    assert bent_area(prism) == pytest.approx(2 * base + wall, rel=0.01)
    fine = prism_of(rounded(64, length), 0.5)
    fine = Mesh(*trimesh.remesh.subdivide_to_size(fine.vertices, fine.faces, 0.5)[:2])
    exact = spectrum.compute(fine, 3, operator=Operator(elements="quadratic")).eigenvalues
    np.testing.assert_allclose(surface_eigenvalues(prism, 3), exact, rtol=0.01)


def test_rows_of_a_tube_may_be_of_any_height():
    """The large faces of two sides, as large as each other, share the normal between them."""
    angles = 2 * np.pi * np.arange(16) / 16
    heights = np.array([0.0, 0.1, 0.2, 1.2, 2.2])
    points = [(np.cos(a), np.sin(a), z) for z in heights for a in angles]
    faces = []
    for row in range(4):
        for i in range(16):
            a, b = 16 * row + i, 16 * row + (i + 1) % 16
            faces += [(a, b, b + 16), (a, b + 16, a + 16)]
    patches = bend(Mesh(np.array(points), np.array(faces)))
    np.testing.assert_allclose(np.linalg.norm(middles(patches)[:, :2], axis=1), 1, atol=2e-3)


def test_a_lone_short_side_between_long_ones_bends_none():
    corners = np.array([[1.0, 0.95], [0.95, 1.0]])
    turns = [np.array([[c, -s], [s, c]]) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    outline = np.vstack([corners @ turn.T for turn in turns])  # a square with its corners cut off
    assert bent_area(disc_of(outline)) == pytest.approx(4, rel=2e-3)


@given(st.integers(0, 2**32))
@settings(max_examples=20)
def test_arcs_of_a_circle_are_on_it_however_its_points_are_spread(seed):
    angles = np.linspace(0, 2 * np.pi, 25)[:-1] + np.random.default_rng(seed).uniform(0, 0.2, 24)
    patches = bend(disc_of(np.column_stack([np.cos(angles), np.sin(angles)])))
    on_rim = (patches.ends < 24).all(axis=1)
    assert on_rim.sum() == 24
    np.testing.assert_allclose(np.linalg.norm(middles(patches)[on_rim], axis=1), 1, atol=2e-3)


def test_an_edge_of_three_faces_stays_straight():
    fan = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0.5], [0.9, 0.4, 0.5], [-1, 0, 0.5]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4]])
    patches = bend(Mesh(fan, faces))
    shared = (patches.ends == [0, 1]).all(axis=1)
    assert shared.sum() == 1
    assert (patches.rises[shared] == 0).all()


@given(st.integers(0, 2**32), st.floats(0.001, 1.0))
@settings(max_examples=60)
def test_mass_is_above_its_bound_on_any_mesh(seed, size):
    """Random heights make creases, folds and thin triangles; random turns, bad orientations."""
    rng = np.random.default_rng(seed)
    mesh = square(5)
    heights = size * rng.standard_normal(len(mesh.vertices))
    vertices = mesh.vertices + rng.uniform(-0.08, 0.08, mesh.vertices.shape)
    vertices[:, 2] += heights
    turned = rng.random(len(mesh.faces)) < rng.choice([0.0, 0.3])
    faces = np.where(turned[:, None], mesh.faces[:, ::-1], mesh.faces)
    for matrices in (
        discretise(Mesh(vertices, faces), CURVED).matrices,
        curved.hierarchical(bend(Mesh(vertices, faces)))[0],
    ):
        stiffness, mass = (matrix.toarray() for matrix in as_sparse(matrices))
        scaled = mass / np.sqrt(np.outer(matrices.lumped, matrices.lumped))
        assert np.linalg.eigvalsh(scaled)[0] >= matrices.least * (1 - 1e-9)
        assert matrices.least > 0
        values = np.linalg.eigvalsh(stiffness)
        assert values[0] > -1e-12 * values[-1]
        assert np.abs(stiffness.sum(axis=0)).max() < 1e-12 * values[-1]


def test_the_estimate_is_near_curved_elements_and_ten_times_nearer_the_sphere_than_flat():
    mesh = sphere(20)
    values = surface_eigenvalues(mesh)
    quadratic = spectrum.compute(mesh, operator=CURVED).eigenvalues
    assert error(values, quadratic) < 1e-3
    assert error(values, SPHERE) < 0.03 * error(spectrum.compute(mesh).eigenvalues, SPHERE)


def test_the_estimate_converges_faster_than_linear_elements(uncut):
    coarse, fine = (error(surface_eigenvalues(sphere(r)), SPHERE) for r in (10, 20))
    assert coarse / fine > 7


def test_the_estimate_holds_where_a_mesh_is_too_coarse_for_an_eigenvalue(uncut):
    """There θ M is larger than C on some patches; an answer must stay between zero and θ."""
    cone = family(
        "split_cone",
        radius=1.0,
        height=1.0,
        resolution_a=20,
        resolution_b=20,
        split_a=1,
        split_b=1,
        subdivisions=1,
    )
    with pytest.warns(UserWarning, match="too long, too large or too thin"):
        values = surface_eigenvalues(cone, 20)
    linear = spectrum.of_matrices(curved.hierarchical(bend(cone))[0], 20).eigenvalues
    assert (values > 0.4 * linear).all()
    assert (values < linear).all()


def test_each_component_has_its_surface():
    one, other = sphere(10), sphere(14)
    expected = np.sort(np.concatenate([surface_eigenvalues(one, 3), surface_eigenvalues(other, 3)]))
    both = side_by_side(one, other)
    np.testing.assert_allclose(surface_eigenvalues(both, 6), expected, rtol=1e-9)


def test_bad_meshes_end_in_one_line():
    points, face = np.eye(3), np.array([[0, 1, 2]])
    for vertices, faces, match in (
        (points[:, :1] * np.ones(3), face, "have no area"),
        (np.vstack([points, points[:1]]), face, "1 vertices belong to no triangle"),
        (np.where(points == 1, np.nan, points), face, "NaN"),
    ):
        with pytest.raises(ValueError, match=match):
            surface_eigenvalues((vertices, faces))
    with pytest.raises(ValueError, match=r"k must be between 1 and \d+ for \d+ unknowns"):
        surface_eigenvalues(sphere(9), 10_000)
