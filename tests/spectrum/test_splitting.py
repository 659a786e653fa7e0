"""Patches cut where an edge is too long: the surface stays, and estimates come near it."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evidence.operators import scattered
from synthnet.errors import CertificateError
from synthnet.families import FAMILIES
from synthnet.mesh.isometries import random_rotation
from synthnet.spectrum import compute, splitting, surface, surface_eigenvalues
from synthnet.spectrum.bending import bend, straight
from synthnet.spectrum.splitting import shorten, split, too_long
from synthnet.types import Mesh

CUTS = list(product([False, True], repeat=3))
TRIANGLES = {
    "of all sides": [[0, 0], [1, 0], [0.3, 0.6]],
    "isosceles": [[0, 0], [1, 0], [0.5, 2]],
    "equilateral": [[0, 0], [1, 0], [0.5, np.sqrt(0.75)]],
}


def lifted(corners, heights, rises):
    """Return one patch over a plane: heights of its corners, and of its sides' middles above."""
    vertices = np.column_stack([np.array(corners, float), heights])
    patches = straight(Mesh(vertices, np.array([[0, 1, 2]])))
    above = np.zeros((3, 3))
    above[patches.sides[0], 2] = rises
    return patches._replace(rises=above)


def height(patches, face, corners):
    """Return points of a patch, (p, 3), from their barycentric coordinates, (p, 3)."""
    along = corners * np.roll(corners, -1, axis=1)
    rises = patches.rises[patches.sides[face]]
    return corners @ patches.vertices[patches.faces[face]] + 4 * along @ rises


def coarse(name):
    return FAMILIES[name], {
        "split_cone": {
            "radius": 1.0,
            "height": 6.0,
            "resolution_a": 20,
            "resolution_b": 20,
            "split_a": 1,
            "split_b": 1,
            "subdivisions": 1,
        },
        "cylinder": {"radius": 1.0, "height": 4.0, "resolution": 30, "split": 1},
        "rectangular_prism": {"width": 1.0, "height": 1.0, "depth": 30.0, "subdivisions": 2},
    }[name]


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("corners", TRIANGLES.values(), ids=TRIANGLES)
def test_parts_of_a_patch_are_on_it_and_cover_it_once(corners, cut):
    patches = lifted(corners, [0.1, -0.2, 0.3], [0.4, -0.3, 0.2])
    edges = np.zeros(3, bool)
    edges[patches.sides[0]] = cut
    parts = split(patches, edges)
    np.testing.assert_array_equal(parts.vertices[:3], patches.vertices)
    (first,) = patches.vertices[patches.faces]
    inside = np.random.default_rng(0).dirichlet(np.ones(3), 20)
    areas = []
    for face in range(len(parts.faces)):
        points = height(parts, face, inside)
        where = np.linalg.solve(_in_plane(first), _in_plane(points))
        np.testing.assert_allclose(height(patches, 0, where.T), points, atol=1e-14)
        u, v = parts.vertices[parts.faces[face], :2][1:] - parts.vertices[parts.faces[face, 0], :2]
        areas.append(u[0] * v[1] - u[1] * v[0])
    assert min(areas) > 0
    u, v = first[1:, :2] - first[0, :2]
    assert sum(areas) == pytest.approx(u[0] * v[1] - u[1] * v[0])


def _in_plane(points):
    return np.vstack([points[:, :2].T, np.ones(len(points))])


def test_what_is_left_of_a_patch_has_a_middle_only_where_both_diagonals_are_as_long():
    counts = {}
    for name, corners in TRIANGLES.items():
        patches = lifted(corners, np.zeros(3), np.zeros(3))
        for cut in (c for c in CUTS if sum(c) == 2):
            edges = np.zeros(3, bool)
            edges[patches.sides[0]] = cut
            counts.setdefault(name, []).append(len(split(patches, edges).faces))
    assert counts["of all sides"] == [3, 3, 3]
    assert sorted(counts["isosceles"]) == [3, 3, 5]
    assert counts["equilateral"] == [5, 5, 5]


@given(st.integers(0, 2**32), st.floats(0.05, 0.95))
@settings(max_examples=30)
def test_patches_that_are_cut_still_meet(seed, share):
    rng = np.random.default_rng(seed)
    patches = bend(scattered(7))
    cut = rng.random(len(patches.ends)) < share
    parts = split(patches, cut)
    counts = np.bincount(parts.sides.ravel(), minlength=len(parts.ends))
    assert (counts == 2).all()
    assert len(parts.vertices) - len(parts.ends) + len(parts.faces) == 2
    halves = (parts.ends < len(patches.vertices)).all(axis=1)
    kept = {tuple(ends) for ends in parts.ends[halves]}
    assert kept == {tuple(ends) for ends in patches.ends[~cut]}


def test_edges_are_cut_until_none_is_too_long():
    patches = bend(scattered(7))
    longest = 0.5 * np.linalg.norm(np.ptp(patches.vertices[patches.ends], axis=1), axis=1).mean()
    everything = patches
    while too_long(everything, longest).any():
        finer = shorten(everything, longest, 10**6)
        assert len(finer.vertices) > len(everything.vertices)
        everything = finer
    assert len(everything.vertices) > 4 * len(patches.vertices)
    assert shorten(everything, longest, 10**6) is everything
    assert shorten(patches, longest, len(patches.vertices) + 1) is patches


@pytest.mark.parametrize("name", ["split_cone", "cylinder", "rectangular_prism"])
def test_an_estimate_holds_where_the_mesh_shows_no_wave_along_its_triangles(name):
    family, parameters = coarse(name)
    mesh, exact = family.generate(parameters), family.limit_spectrum(parameters).eigenvalues
    assert np.abs(compute(mesh).eigenvalues / exact - 1).max() > 0.5
    np.testing.assert_allclose(surface_eigenvalues(mesh), exact, rtol=0.05)


@pytest.mark.parametrize("name", ["split_cone", "cylinder"])
def test_a_mesh_that_is_turned_or_numbered_anew_is_cut_alike(name):
    family, parameters = coarse(name)
    mesh = family.generate(parameters)
    rng = np.random.default_rng(1)
    numbers = rng.permutation(len(mesh.vertices))
    faces = np.argsort(numbers)[mesh.faces][rng.permutation(len(mesh.faces))]
    turned = mesh.vertices @ random_rotation(rng).T
    expected = surface_eigenvalues(mesh)
    for other in (
        Mesh(turned, mesh.faces),
        Mesh(turned[numbers], np.roll(faces, 1, axis=1)),
        Mesh(turned * [-1, 1, 1], mesh.faces[:, ::-1]),
    ):
        np.testing.assert_allclose(surface_eigenvalues(other), expected, rtol=1e-8)


def fan(points):
    """Return the triangles that a polygon's first corner makes with its sides, most very obtuse."""
    plane = np.column_stack([points, np.zeros(len(points))])
    return Mesh(plane, np.array([(0, i, i + 1) for i in range(1, len(points) - 1)]))


@pytest.mark.parametrize("k", [1, 8])
@pytest.mark.parametrize("sections", [24, 40])
def test_obtuse_triangles_count_as_long_as_they_are_wide_around(sections, k):
    angles = 2 * np.pi * np.arange(sections) / sections
    mesh = fan(np.column_stack([10 * np.cos(angles), np.sin(angles)]))
    known = {"flatness": 0.1, "triangulation": "uniform", "vertices": 100, "seed": 0}
    exact = FAMILIES["elliptic_disc"].limit_spectrum(known, k).eigenvalues / 100
    np.testing.assert_allclose(surface_eigenvalues(mesh, k), exact, rtol=0.03)


@pytest.mark.parametrize("k", [1, 3])
@pytest.mark.parametrize("sections", [64, 1000])
def test_needles_from_the_middle_of_a_disc_end_no_estimate_too_early(sections, k):
    angles = 2 * np.pi * np.arange(sections) / sections
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(sections)])
    faces = [(sections, i, (i + 1) % sections) for i in range(sections)]
    values = surface_eigenvalues(Mesh(np.vstack([rim, np.zeros(3)]), np.array(faces)), k)
    np.testing.assert_allclose(values[:2], 3.389958, rtol=2e-3)  # the square of J₁′'s first zero


def test_few_wide_patches_between_good_ones_are_left():
    mesh = scattered(40)
    patches = bend(mesh)
    longest = np.linalg.norm(np.diff(mesh.vertices[patches.ends], axis=1), axis=-1).max() * 1.001
    assert len(too_long(patches, longest)) == 0
    i, j, k = mesh.faces[0]
    near = 0.5 * (mesh.vertices[i] + mesh.vertices[j]) * (1 - 1e-6) + 1e-6 * mesh.vertices[k]
    faces = [*mesh.faces[1:], *((a, b, len(mesh.vertices)) for a, b in ((i, j), (j, k), (k, i)))]
    thin = straight(Mesh(np.vstack([mesh.vertices, near]), np.array(faces)))
    assert len(too_long(thin, longest)) == 0
    assert too_long(thin, longest / 2).max() > 2 * too_long(patches, longest / 2).max()


def test_where_cutting_would_make_too_many_it_is_said(monkeypatch):
    family, parameters = coarse("cylinder")
    mesh = family.generate(parameters)
    monkeypatch.setattr(surface, "MOST", 0)
    with pytest.warns(
        UserWarning, match=r"too long, too large or too thin.*subdivide the mesh"
    ) as caught:
        values = surface_eigenvalues(mesh)
    assert caught[0].filename == __file__
    exact = family.limit_spectrum(parameters).eigenvalues
    assert np.abs(values / exact - 1).max() > 0.2


def test_a_mesh_that_is_fine_enough_is_not_cut(monkeypatch):
    def never(*_):
        raise AssertionError

    monkeypatch.setattr(splitting, "split", never)
    mesh = scattered(40)
    assert len(surface_eigenvalues(mesh, 3)) == 3


def test_where_finer_patches_cannot_be_certified_the_estimate_is_that_of_the_coarse(monkeypatch):
    family, parameters = coarse("cylinder")
    mesh = family.generate(parameters)
    solved, sizes = surface._solved, []

    def once(patches, k):
        sizes.append(len(patches.vertices))
        if len(sizes) > 1:
            raise CertificateError("rounding moves the shift")
        return solved(patches, k)

    monkeypatch.setattr(surface, "_solved", once)
    with pytest.warns(UserWarning, match="too long, too large or too thin"):
        values = surface_eigenvalues(mesh)
    assert sizes[0] == len(mesh.vertices) < sizes[1]
    values_of_mesh, energies = solved(bend(mesh), 10)
    np.testing.assert_array_equal(
        values, np.sort(values_of_mesh * np.exp(-energies / values_of_mesh))
    )
