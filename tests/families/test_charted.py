"""The families of 2.0 and 2.1: surfaces given by charts, in several triangulations."""

import importlib
import math
from collections import Counter, defaultdict
from functools import partial

import numpy as np
import pytest
from scipy import optimize, special
from scipy.spatial import cKDTree

from synthnet import recipe, spectrum
from synthnet.build import filters
from synthnet.families import CHARTED, FAMILIES, PRIMITIVES, drum, knotted_tube, limits, remesh
from synthnet.families.atlas import Atlas, rectangle
from synthnet.families.charted import TRIANGULATIONS, one_shape
from synthnet.families.radial import radial
from synthnet.mesh import geometry
from synthnet.recipe.drawing import draw_shape
from synthnet.recipe.plan import plan_shards
from synthnet.verify.shapes import lapy_eigenvalues
from tests.datasets import home

HOW = {"triangulation": "uniform", "vertices": 1500, "seed": 7}
FLAT = ("flat_rectangle", "elliptic_disc", "annulus", "drum")
slow = partial(pytest.param, marks=pytest.mark.slow)
# Closed and open, smooth and creased, of genus 0 and more: the quick tests are of these families.
FEW = ("conforming_split_cone", "pretzel", "extruded_star", "mobius_band", "annulus")
SOME = [name if name in FEW else slow(name) for name in CHARTED]
POLYHEDRA = (
    *("cuboid", "simplex", "extruded_star", "extruded_drum", "flat_rectangle", "drum"),
    "box_union",
)


@pytest.fixture(scope="module")
def recipe_2_0():
    return recipe.load("2.0")


def drawn(family, surface=0, **changes):
    """Parameters of a surface of 2.1, triangulated as in :data:`HOW` but for the changes."""
    spec = draw_shape(home(family), family, 3 * surface)
    return {**spec.parameters, **HOW, **changes}


def generated(family, surface=0, **changes):
    return FAMILIES[family].generate(drawn(family, surface, **changes))


def label(family, **changes):
    return spectrum.compute(generated(family, **changes)).eigenvalues


def turned(triangles):
    """Twice the signed areas of triangles of the plane, (m, 3, 2)."""
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def torus():
    def chart(_, u):
        out = 1 + 0.4 * np.cos(u[:, 1])
        return np.stack(
            [out * np.cos(u[:, 0]), out * np.sin(u[:, 0]), 0.4 * np.sin(u[:, 1])], axis=1
        )

    patches = rectangle(np.linspace(0, 2 * np.pi, 7), np.linspace(0, 2 * np.pi, 4))
    return Atlas(patches, np.zeros(len(patches), dtype=np.int64), chart)


# --- atlas -----------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 5])
def test_a_uniform_mesh_has_the_counts_of_a_subdivision(n):
    atlas = radial(lambda directions: np.ones(len(directions)))
    mesh = atlas.mesh(atlas.uniform(n))
    assert (len(mesh.vertices), len(mesh.faces)) == (10 * n**2 + 2, 20 * n**2)
    facts = geometry.MeshFacts(mesh)
    assert facts.is_closed
    assert facts.n_repeated_half_edges == 0
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=1e-14)


def test_vertices_of_a_finer_uniform_mesh_contain_those_of_the_coarse_one():
    atlas = torus()
    coarse, fine = (atlas.points(atlas.uniform(n)) for n in (3, 6))
    distances = np.linalg.norm(coarse[:, None] - fine, axis=2).min(axis=1)
    assert distances.max() < 1e-12


def test_patches_that_do_not_meet_in_whole_edges_are_refused():
    patches = rectangle(np.array([0.0, 1.0]), np.array([0.0, 1.0]))
    thrice = np.concatenate([patches, patches[:1]])
    atlas = Atlas(thrice, np.zeros(3, dtype=np.int64), lambda _, u: np.pad(u, ((0, 0), (0, 1))))
    with pytest.raises(ValueError, match="patches must meet in whole edges, at most two in each"):
        atlas.uniform(2)
    with pytest.raises(ValueError, match="n must be at least 1, got 0"):
        torus().uniform(0)


def test_a_graded_mesh_squares_the_distance_from_the_corner():
    patch = np.array([[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
    atlas = Atlas(
        patch,
        np.zeros(1, dtype=np.int64),
        lambda _, u: np.pad(u, ((0, 0), (0, 1))),
        np.array([[True, False, False]]),
    )
    plain, graded = (atlas.points(atlas.uniform(4, graded=g)) for g in (False, True))
    away = plain.sum(axis=1)
    np.testing.assert_allclose(graded, plain * away[:, None], rtol=1e-14)
    both = Atlas(atlas.corners, atlas.charts, atlas.chart, np.array([[True, True, False]]))
    with pytest.raises(ValueError, match="at most one singular corner"):
        both.uniform(2, graded=True)


# --- triangulations --------------------------------------------------------------------


def test_a_marked_triangle_becomes_four_and_its_neighbours_conform():
    atlas = torus()
    mesh = atlas.uniform(4)
    marked = np.zeros(len(mesh.faces), dtype=bool)
    marked[17] = True
    finer = remesh.refine(mesh, marked)
    assert len(finer.faces) == len(mesh.faces) + 3 + 3  # three neighbours are halved
    facts = geometry.MeshFacts(atlas.mesh(finer))
    assert facts.is_closed
    assert facts.n_repeated_half_edges == 0
    assert facts.euler_characteristic == 0


def test_all_triangles_marked_is_uniform_refinement():
    atlas = torus()
    mesh = atlas.uniform(3)
    finer = remesh.refine(mesh, np.ones(len(mesh.faces), dtype=bool))
    ours, theirs = (np.sort(atlas.points(m), axis=0) for m in (finer, atlas.uniform(6)))
    np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_an_adaptive_mesh_is_finest_at_its_focus():
    atlas = torus()
    focus = np.array([1.1, 0.33, 0.21])
    mesh = atlas.mesh(remesh.towards(atlas, atlas.uniform(8), focus, (0.25, 0.0625)))
    areas = geometry.face_areas(mesh)
    distance = np.linalg.norm(mesh.vertices[mesh.faces].mean(axis=1) - focus, axis=1)
    near, far = areas[distance < 0.3].mean(), areas[distance > 1.5].mean()
    assert far / near > 8  # sixteen, but for the difference of the areas on a torus


def test_an_irregular_mesh_is_delaunay_where_it_may_be():
    atlas = torus()
    mesh = remesh.irregular(atlas, atlas.uniform(10), np.random.default_rng(3))
    points = atlas.points(mesh)
    edges, of_side = mesh.edges()
    sums = np.zeros(len(edges))
    cotangents = np.zeros(mesh.faces.shape)
    for i in range(3):
        p, q, r = (points[mesh.faces[:, (i + k) % 3]] for k in (2, 0, 1))  # opposite side i
        u, v = q - p, r - p
        cotangents[:, i] = (u * v).sum(axis=1) / np.linalg.norm(np.cross(u, v), axis=1)
    np.add.at(sums, of_side, cotangents)
    u, v = mesh.corners[:, :, 0], mesh.corners[:, :, 1]
    inner = ((u > 1e-9) & (u < 2 * np.pi - 1e-9) & (v > 1e-9) & (v < 2 * np.pi - 1e-9)).all(axis=1)
    free = np.setdiff1d(of_side[inner], of_side[~inner])
    assert len(free) > 0.7 * len(edges)
    assert (sums[free] < -remesh.COCIRCULAR).sum() == 0
    jittered = remesh.jittered(atlas, atlas.uniform(10), np.random.default_rng(3))
    assert (np.sort(jittered.faces) != np.sort(mesh.faces)).any(axis=1).mean() > 0.2


def test_jittering_turns_no_triangle_over():
    atlas = torus()
    uniform = atlas.uniform(12)
    twice = uniform
    for _ in range(2):
        centres = twice.corners.mean(axis=1)
        twice = remesh.refine(twice, (centres[:, 0] > 2) & (centres[:, 0] < 4))
    for mesh, least in ((uniform, 0.9), (twice, 0.8)):
        for seed in range(5):
            moved = remesh.jittered(atlas, mesh, np.random.default_rng(seed))
            assert turned(moved.corners).min() > 0
            assert (moved.corners != mesh.corners).any(axis=(1, 2)).mean() > least


@pytest.mark.parametrize("kind", TRIANGULATIONS)
@pytest.mark.parametrize("family", ["circular_cone", "dented_cone", "conforming_split_cone"])
def test_the_tip_of_a_cone_is_a_vertex_of_every_kind(family, kind):
    parameters = {**drawn(family, triangulation=kind), "radius": 1.0, "height": 2.0}
    vertices = FAMILIES[family].generate(parameters).vertices
    tip = 2.0 if family != "dented_cone" else 4.0 * parameters["flip"] - 2.0
    assert np.linalg.norm(vertices - [0, 0, tip], axis=1).min() < 1e-12


@pytest.mark.parametrize("family", [*POLYHEDRA, "lattice"])
def test_every_mesh_of_flat_faces_has_their_exact_area(family):
    """So no triangulation cuts a crease or leaves a face."""
    for surface in range(3):
        meshes = (generated(family, surface, triangulation=kind) for kind in TRIANGULATIONS)
        areas = [geometry.area(mesh) for mesh in meshes]
        np.testing.assert_allclose(areas, areas[0], rtol=1e-12)


@pytest.mark.parametrize("family", ["cuboid", *map(slow, POLYHEDRA[1:])])
def test_labels_of_flat_faces_are_above_their_limit(family):
    """By the min-max theorem: their elements are functions on the very surface."""
    for surface in range(4):
        how = {"vertices": 6000, "triangulation": TRIANGULATIONS[surface % 3]}
        computed = label(family, surface=surface, **how)
        limit = FAMILIES[family].limit_spectrum(drawn(family, surface)).eigenvalues
        assert (computed > limit).all()
        assert (computed / limit).max() < 1.05


@pytest.mark.parametrize("family", ["drum", "extruded_drum", "extruded_star"])
def test_corners_that_turn_inwards_are_marked_in_every_patch(family):
    module = importlib.import_module(f"synthnet.families.{family}")
    for surface in range(12):
        parameters = drawn(family, surface)
        atlas = module.atlas(**one_shape(parameters))
        numbers = atlas.glued()
        of_vertex = np.unique(numbers[atlas.singular])
        assert (np.isin(numbers, of_vertex) == atlas.singular).all()
        inward = {"drum": 2, "extruded_drum": 4}.get(family) or 2 * parameters["corners"]
        assert len(of_vertex) == inward


@pytest.mark.parametrize("kind", TRIANGULATIONS)
@pytest.mark.parametrize("family", SOME)
def test_labels_and_certificates_agree_with_lapy(family, kind):
    mesh = generated(family, triangulation=kind, vertices=600).stored()
    ours = spectrum.compute(mesh)
    theirs = lapy_eigenvalues(mesh, ours.certificate.count + 1)
    np.testing.assert_allclose(ours.eigenvalues, theirs[:10], rtol=1e-8)
    assert np.count_nonzero(theirs < ours.certificate.shift) == ours.certificate.count - 1


def test_flips_keep_area_boundary_and_vertices_of_a_flat_mesh():
    uniform, irregular = (
        generated("flat_rectangle", width=1.0, height=0.6, triangulation=kind)
        for kind in ("uniform", "irregular")
    )
    assert len(uniform.vertices) == len(irregular.vertices)
    assert geometry.area(irregular) == pytest.approx(0.6, rel=1e-13)
    assert geometry.face_areas(irregular).min() > 0


# --- the contract of every family ------------------------------------------------------


@pytest.mark.parametrize("kind", TRIANGULATIONS)
@pytest.mark.parametrize("family", SOME)
def test_meshes_are_sound(family, kind, recipe_2_0):
    for surface in range(3):
        parameters = drawn(family, surface, triangulation=kind, seed=surface)
        mesh = FAMILIES[family].generate(parameters)
        assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)
        expected = FAMILIES[family].topology(parameters)
        assert filters.check_mesh(mesh.stored(), recipe_2_0.filters, expected) is None
        assert 0.4 < len(mesh.vertices) / 1500 < 2.5


@pytest.mark.parametrize("family", SOME)
def test_kinds_and_seeds_give_different_meshes_of_one_shape(family):
    parameters = [drawn(family, triangulation=kind, vertices=6000) for kind in TRIANGULATIONS]
    parameters.append({**parameters[-1], "seed": 8})
    meshes = [FAMILIES[family].generate(p) for p in parameters]
    assert len({mesh.faces.tobytes() for mesh in meshes}) == len(meshes)
    assert len({FAMILIES[family].group(p) for p in parameters}) == 1
    areas = [geometry.area(mesh) for mesh in meshes]
    np.testing.assert_allclose(areas, areas[0], rtol=0.02)


@pytest.mark.parametrize("family", CHARTED)
def test_numbers_beyond_their_limits_are_refused(family):
    parameters = drawn(family)
    for name, most in FAMILIES[family].most.items():
        with pytest.raises(ValueError, match=f"{family}: {name} must be at most {most:g}, got"):
            FAMILIES[family].generate({**parameters, name: most + 1})
    with pytest.raises(ValueError, match="triangulation must be one of uniform, adaptive"):
        FAMILIES[family].generate({**parameters, "triangulation": "regular"})
    with pytest.raises(ValueError, match=f"{family}: vertices must be at least 50, got 49"):
        FAMILIES[family].generate({**parameters, "vertices": 49})


# --- theorems --------------------------------------------------------------------------


@pytest.mark.parametrize("lean", [0.0, 0.2])
def test_the_two_drums_have_the_same_spectrum(lean):
    """Their finite elements, too, since each of the seven triangles is cut alike."""
    pair = [generated("drum", form=form, size=1.0, lean=lean) for form in (0, 1)]
    first, second = (spectrum.compute(mesh).eigenvalues for mesh in pair)
    np.testing.assert_allclose(first, second, rtol=1e-11)
    assert [geometry.area(mesh) for mesh in pair] == pytest.approx([3.5 * math.cos(lean)] * 2)
    longest = [np.linalg.norm(m.vertices[:, None] - m.vertices, axis=2).max() for m in pair]
    assert abs(longest[0] - longest[1]) > 0.05  # they are not congruent


def test_drums_turn_inwards_where_they_say():
    for form, lean in ((0, 0.0), (1, 0.0), (0, 0.3), (1, 0.3)):
        positions = drum.positions(form, 1.0, lean)
        outline = np.array([positions[name] for name in drum.OUTLINES[form].split()])
        before, after = np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0)
        bends = turned(np.stack([before, outline, after], axis=1))
        names = np.array(drum.OUTLINES[form].split())
        assert set(names[bends < -1e-9]) == set(drum.INWARD)


@pytest.mark.parametrize("genus", range(2, 8))
def test_a_pretzel_has_its_genus(genus):
    facts = geometry.MeshFacts(generated("pretzel", genus=genus))
    assert facts.euler_characteristic == 2 - 2 * genus
    assert facts.is_closed


def test_a_pretzel_that_is_not_bent_lies_on_its_quartic():
    parameters = {**drawn("pretzel"), "genus": 3, "bend": 0.0, "stretch": 1.0}
    vertices = FAMILIES["pretzel"].generate(parameters).vertices
    centre = 1 / (1 + math.sin(math.pi / 3))
    radius = parameters["hole"] * centre * math.sin(math.pi / 3)
    angles = 2 * math.pi * np.arange(3) / 3
    centres = centre * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    squares = ((vertices[:, None, :2] - centres) ** 2).sum(axis=2)
    product = np.prod((squares - radius**2) / (squares + radius**2), axis=1)
    expected = parameters["thickness"] ** 2 * (1 - (vertices[:, :2] ** 2).sum(axis=1)) * product
    np.testing.assert_allclose(vertices[:, 2] ** 2, expected, atol=1e-13)


def test_the_rolled_sheet_has_the_spectrum_of_the_flat_one():
    sheet = {"width": 2.0, "height": 1.0, "vertices": 20000}
    first, second = label("flat_rectangle", **sheet), label("rolled_sheet", angle=5.0, **sheet)
    np.testing.assert_allclose(first, second, rtol=2e-4)
    np.testing.assert_allclose(first, limits.of_rectangle(2.0, 1.0, 10), rtol=1e-3)


def test_the_dented_cone_is_isometric_to_the_cone():
    shape = {"radius": 1.0, "height": 2.0, "vertices": 20000}
    cone, dented = generated("circular_cone", **shape), generated("dented_cone", flip=0.6, **shape)
    first, second = (spectrum.compute(mesh).eigenvalues for mesh in (cone, dented))
    np.testing.assert_allclose(first, second, rtol=2e-3)
    assert geometry.volume(dented) < 0.9 * geometry.volume(cone)


@pytest.mark.slow
@pytest.mark.parametrize("family", ["conforming_split_cone", "conforming_split_sphere"])
@pytest.mark.parametrize("kind", ["adaptive", "irregular", "uniform"])
def test_split_shapes_have_the_smooth_spectrum(family, kind):
    """1.0's split cones are 3 to 25 % above the smooth cone's."""
    for seed in (4, 5):  # once finer in one half, and twice
        parameters = drawn(family, triangulation=kind, vertices=6000, seed=seed)
        mesh = FAMILIES[family].generate(parameters)
        limit = FAMILIES[family].limit_eigenvalues(parameters)
        assert np.abs(spectrum.compute(mesh).eigenvalues / limit - 1).max() < 0.04
        if kind == "uniform":
            areas, x = geometry.face_areas(mesh), mesh.vertices[mesh.faces, 0].mean(axis=1)
            ratio = np.median(areas[x < -0.05]) / np.median(areas[x > 0.05])
            assert ratio == pytest.approx(4 ** (1 + seed % 2), rel=0.35)


def of_disc():
    """Neumann's eigenvalues of the unit disc: squares of the zeros of J'ₘ, twice for m > 0."""
    return [x**2 for m in range(6) for x in special.jnp_zeros(m, 4) for _ in range(1 + (m > 0))]


def of_hemisphere():
    """Those of the sphere whose eigenfunctions are even across the rim: n(n + 1), n + 1 times."""
    return [n * (n + 1.0) for n in range(1, 6) for _ in range(n + 1)]


def of_rectangle(width, height):
    sides = [(i, j) for i in range(9) for j in range(9) if i or j]
    return [(math.pi * i / width) ** 2 + (math.pi * j / height) ** 2 for i, j in sides]


def of_open_cylinder(height):
    waves = [(m, j) for m in range(9) for j in range(9) if m or j]
    return [m**2 + (math.pi * j / height) ** 2 for m, j in waves for _ in range(1 + (m > 0))]


def of_annulus(inner):
    """Squares of the zeros of J'ₘ(k) Y'ₘ(k r) − J'ₘ(k r) Y'ₘ(k), twice for m > 0."""
    squares = []
    for m in range(9):

        def cross(k, m=m):
            return float(
                special.jvp(m, k) * special.yvp(m, k * inner)
                - special.jvp(m, k * inner) * special.yvp(m, k)
            )

        ends = np.linspace(0.1, 10.0, 500)
        signs = np.sign([cross(k) for k in ends])
        for i in np.flatnonzero(signs[1:] != signs[:-1]):
            squares += [optimize.brentq(cross, ends[i], ends[i + 1]) ** 2] * (1 + (m > 0))
    return squares


@pytest.mark.parametrize(
    ("family", "shape", "known"),
    [
        ("elliptic_disc", {"flatness": 1.0}, of_disc()),
        slow("spherical_cap", {"angle": math.pi / 2}, of_hemisphere()),
        slow("annulus", {"inner": 0.5}, of_annulus(0.5)),
        slow("annulus", {"inner": 0.1}, of_annulus(0.1)),
        slow("open_cylinder", {"height": 1.3}, of_open_cylinder(1.3)),
        ("flat_rectangle", {"width": 1.0, "height": 0.7}, of_rectangle(1.0, 0.7)),
    ],
)
def test_labels_with_a_boundary_approach_the_closed_form(family, shape, known):
    """Neumann's condition; the closed forms are of this test, not of the families."""
    limit = np.sort(known)[:10]
    for kind in TRIANGULATIONS:
        computed = label(family, vertices=3000, triangulation=kind, **shape)
        np.testing.assert_allclose(computed, limit, rtol=2e-2)
    computed = FAMILIES[family].limit_spectrum(drawn(family, **shape))
    np.testing.assert_allclose(computed.eigenvalues, limit, rtol=1e-6)


@pytest.mark.parametrize("family", ["annulus", "spherical_cap", "elliptic_disc"])
def test_flat_and_round_surfaces_with_boundary_have_their_area(family):
    shape = one_shape(drawn(family)).values()
    expected = {
        "annulus": lambda inner: math.pi * (1 - inner**2),
        "spherical_cap": lambda angle: 2 * math.pi * (1 - math.cos(angle)),
        "elliptic_disc": lambda flatness: math.pi * flatness,
    }[family](*shape)
    assert geometry.area(generated(family, vertices=20000)) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("family", FLAT)
def test_flat_families_are_flat(family):
    mesh = generated(family)
    assert np.ptp(mesh.vertices[:, 2]) == 0
    assert turned(mesh.vertices[mesh.faces][:, :, :2]).min() > 0  # they face up


def test_knots_do_not_touch_themselves():
    for knot in range(6):
        mesh, thin = (
            generated("knotted_tube", knot=knot, thickness=thickness, vertices=4000)
            for thickness in (0.95, 0.095)
        )
        # Pappus: its area is 2πr times the length of its core, while it does not fold over.
        assert geometry.area(mesh) / geometry.area(thin) == pytest.approx(10, rel=0.02)
        # No vertex is inside the tube: all are its radius away from the whole core.
        core, tangents, _ = knotted_tube._curve(
            np.linspace(0, 2 * math.pi, 3001), *knotted_tube.KNOTS[knot]
        )
        radius = 0.95 * knotted_tube._reach(core[:-1:5], tangents[:-1:5])
        nearest = cKDTree(core).query(mesh.vertices)[0]
        assert nearest.min() > 0.99 * radius


def test_a_band_with_two_sides_is_no_mobius_band():
    with pytest.raises(ValueError, match="mobius_band: half_turns must be odd, got 2"):
        generated("mobius_band", width=0.5, half_turns=2)


def test_a_tube_that_would_cut_itself_is_refused():
    with pytest.raises(ValueError, match=r"bent_tube: bend must be below length, 2\.0, got 2\.0"):
        generated("bent_tube", length=2.0, bend=2.0)


def test_a_bent_tube_has_no_crease_where_its_ends_begin():
    shape = {"length": 6.0, "flatness": 0.4, "turns": 1.0, "bend": 1.0}
    worst = []
    for vertices in (4000, 64000):
        mesh = generated("bent_tube", vertices=vertices, **shape)
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        tails, heads = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
        face = np.repeat(np.arange(len(mesh.faces)), 3)
        order, other = np.lexsort((heads, tails)), np.lexsort((tails, heads))
        cosines = (normals[face[order]] * normals[face[other]]).sum(axis=1)
        worst.append(float(np.arccos(np.clip(cosines, -1, 1)).max()))
    assert worst[1] < 0.45 * worst[0]  # a quarter of the step, a quarter of the angle


def test_a_blob_without_amplitude_is_a_sphere_and_forms_differ():
    mesh = generated("blob", amplitude=0.0, degree=4, form=1)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=1e-12)
    first, second = (generated("blob", amplitude=1.0, degree=4, form=form) for form in (1, 2))
    assert np.abs(first.vertices - second.vertices).max() > 0.1


# --- the recipe ------------------------------------------------------------------------


def test_surfaces_come_in_three_triangulations_of_one_split():
    shapes = [shape for plan in plan_shards(recipe.load("2.0")) for shape in plan.shapes]
    by_group = defaultdict(list)
    for shape in shapes:
        by_group[shape.spec.group].append(shape)
    for same in by_group.values():
        assert len({shape.split for shape in same}) == 1
        assert len(same) % 3 == 0
        kinds = {shape.spec.parameters["triangulation"] for shape in same}
        assert kinds == set(TRIANGULATIONS)
    sizes = [shape.spec.parameters["vertices"] for shape in shapes]
    assert min(sizes) < 600
    assert 90_000 < max(sizes) <= 100_000


def test_the_mini_version_takes_whole_surfaces():
    mini = [shape for plan in plan_shards(recipe.load("2.0-mini")) for shape in plan.shapes]
    counts = Counter(shape.spec.group for shape in mini)
    assert set(counts.values()) == {3}
    for split in ("train", "validation", "test"):
        families = {shape.spec.family for shape in mini if shape.split == split}
        assert families == set(recipe.load("2.0").families)


def test_no_family_has_two_homes_and_each_is_registered():
    assert set(recipe.load("2.1").families) <= set(CHARTED)
    assert [family for family in FAMILIES if home(family) is None] == []
    assert not set(CHARTED) & set(PRIMITIVES)
    assert {*FAMILIES} == {*CHARTED, *PRIMITIVES}
