import dataclasses
import itertools
import math
from collections import Counter
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from synthnet import recipe, spectrum
from synthnet.build import filters
from synthnet.errors import RecipeError
from synthnet.families import CHARTED, FAMILIES, PRIMITIVES, primitives
from synthnet.families.charted import TRIANGULATIONS
from synthnet.families.primitives import convex_hull
from synthnet.mesh import geometry
from synthnet.recipe import FamilyRecipe, distributions
from synthnet.recipe.drawing import draw_shape, draw_shapes
from synthnet.types import ShapeSpec, Topology
from tests.datasets import home

LEAST = {
    name: {p: least if isinstance(least, int) else 1.0 for p, least in family.least.items()}
    for name, family in PRIMITIVES.items()
}
INTEGERS = [
    (name, p)
    for name, family in PRIMITIVES.items()
    for p, least in family.least.items()
    if isinstance(least, int)
]
LENGTHS = [(name, p) for name in PRIMITIVES for p in LEAST[name] if (name, p) not in INTEGERS]
CASES = [(name, case) for name in PRIMITIVES for case in ("least", "low", "high", 0, 1, 2)]
CASES.remove(("torus", "high"))  # it touches itself: see below
# Appendix C.
COUNTS = {
    "rectangular_prism": 2000,
    "cone": 1000,
    "cylinder": 1000,
    "sphere": 50,
    "torus": 2000,
    "tetrahedron": 2000,
    "conical_frustum": 1000,
    "split_sphere": 2500,
    "split_cone": 1000,
    "inverted_cone": 4000,
}


def parameters_of(family, case):
    if case == "least":
        return LEAST[family]
    recipe_1_0 = recipe.load("1.0")
    if isinstance(case, int):
        return dict(draw_shape(recipe_1_0, family, case).parameters)
    value = {"low": 0.0, "high": 1 - 2**-53}[case]
    always = SimpleNamespace(random=lambda: value)  # the same number
    return distributions.draw(recipe_1_0.families[family].parameters, always)


def make(family, **changes):
    return FAMILIES[family].generate({**LEAST[family], **changes})


def polygon(n):
    """Area, side and apothem of a regular n-gon of radius 1."""
    return n / 2 * math.sin(2 * math.pi / n), 2 * math.sin(math.pi / n), math.cos(math.pi / n)


def spheres(*resolutions):
    return [primitives.sphere(radius=1.0, resolution=resolution) for resolution in resolutions]


def rounded_rows(points):
    return {tuple(row) for row in (np.round(points, 9) + 0.0).tolist()}


# --- the contract of every family -----------------------------------------------------


@pytest.mark.parametrize(("family", "case"), CASES)
def test_meshes_are_sound(family, case, limits):
    declared = FAMILIES[family].topology(parameters_of(family, case))
    mesh = FAMILIES[family].generate(parameters_of(family, case))
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)
    assert filters.check_mesh(mesh.stored(), limits, declared) is None
    facts = geometry.MeshFacts(mesh)
    assert facts.is_closed
    assert facts.volume > 0
    assert facts.euler_characteristic == declared.euler_characteristic


@pytest.mark.parametrize(
    ("family", "how"),
    [*itertools.product(PRIMITIVES, ["least", 0]), *itertools.product(CHARTED, TRIANGULATIONS)],
)
def test_a_mesh_is_a_pure_function_of_its_parameters(family, how):
    if family in PRIMITIVES:
        parameters = parameters_of(family, how)
    else:
        drawn = draw_shape(home(family), family, 0).parameters
        parameters = {**drawn, "triangulation": how, "vertices": 500, "seed": 7}
    before = dict(parameters)
    first, second = (FAMILIES[family].generate(parameters) for _ in range(2))
    assert first.vertices.tobytes() == second.vertices.tobytes()
    assert first.faces.tobytes() == second.faces.tobytes()
    assert parameters == before


@pytest.mark.parametrize("family", PRIMITIVES)
def test_writing_to_a_mesh_does_not_reach_another(family):
    first, second = make(family), make(family)
    for a, b in ((first.vertices, second.vertices), (first.faces, second.faces)):
        assert not (np.shares_memory(a, b) and a.flags.writeable)


def test_a_whole_float_is_an_integer():
    mesh = make("sphere", resolution=20.0)
    assert mesh.vertices.tobytes() == make("sphere", resolution=20).vertices.tobytes()


@pytest.mark.parametrize(("family", "parameter"), INTEGERS)
def test_an_integer_below_its_limit_or_a_fraction_is_refused(family, parameter):
    least = FAMILIES[family].least[parameter]
    for value, what in ((least - 1, f"at least {least}"), (least + 2.5, "an integer")):
        message = f"^{family}: {parameter} must be {what}, got {value}$"
        with pytest.raises(ValueError, match=message):
            make(family, **{parameter: value})


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
@pytest.mark.parametrize(("family", "parameter"), LENGTHS)
def test_a_length_is_positive_and_finite(family, parameter, value):
    with pytest.raises(ValueError, match=f"^{family}: {parameter} must be positive, got {value}$"):
        make(family, **{parameter: value})


@pytest.mark.parametrize("family", PRIMITIVES)
def test_a_missing_or_unknown_parameter_is_refused(family):
    takes = f"^{family} takes the parameters {', '.join(LEAST[family])}; got "
    with pytest.raises(ValueError, match=takes + ".*, colour$"):
        make(family, colour=1)
    with pytest.raises(ValueError, match=takes + "none$"):
        FAMILIES[family].generate({})
    without_first = dict(list(LEAST[family].items())[1:])
    with pytest.raises(ValueError, match=takes + ", ".join(without_first) + "$"):
        FAMILIES[family].generate(without_first)


@pytest.mark.parametrize("family", PRIMITIVES)
def test_groups_differ_with_every_parameter_and_not_with_their_order(family):
    group, parameters = FAMILIES[family].group, LEAST[family]
    assert group(dict(reversed(parameters.items()))) == group(parameters)
    groups = {group({**parameters, p: value + 1}) for p, value in parameters.items()}
    mirrored = family == "split_sphere"  # changing either half gives the same shape
    assert len(groups | {group(parameters)}) == len(parameters) + 1 - mirrored


def test_groups_differ_between_families():
    tetrahedron, prism = FAMILIES["tetrahedron"], FAMILIES["rectangular_prism"]
    assert tetrahedron.least == prism.least
    assert tetrahedron.group(LEAST["tetrahedron"]) != prism.group(LEAST["tetrahedron"])


# --- closed forms ---------------------------------------------------------------------


def check_sizes(mesh, volume, area, rel=1e-13):
    assert geometry.volume(mesh) == pytest.approx(volume, rel=rel)
    assert geometry.area(mesh) == pytest.approx(area, rel=rel)


@pytest.mark.parametrize("subdivisions", [0, 3])
def test_box(subdivisions):
    w, h, d = size = (1.0, 0.25, 3.0)
    mesh = make("rectangular_prism", width=w, height=h, depth=d, subdivisions=subdivisions)
    assert len(mesh.faces) == 12 * 4**subdivisions
    check_sizes(mesh, w * h * d, 2 * (w * h + h * d + d * w))
    np.testing.assert_array_equal(mesh.vertices.min(axis=0), 0)
    np.testing.assert_array_equal(mesh.vertices.max(axis=0), size)


@pytest.mark.parametrize("subdivisions", [0, 3])
def test_tetrahedron(subdivisions):
    w, h, d = 1.0, 0.5, 7.0
    mesh = make("tetrahedron", width=w, height=h, depth=d, subdivisions=subdivisions)
    legs, slope = w * h + h * d + d * w, math.hypot(w * h, h * d, d * w)  # de Gua
    assert len(mesh.faces) == 4 * 4**subdivisions
    check_sizes(mesh, w * h * d / 6, (legs + slope) / 2)


def test_cylinder():
    n, split, height = 20, 4, 3.0
    mesh = make("cylinder", height=height, resolution=n, split=split)
    base, side, _ = polygon(n)
    assert len(mesh.vertices) == n * (split + 1) + 2
    check_sizes(mesh, base * height, 2 * base + n * side * height)


@pytest.mark.parametrize("subdivisions", [0, 2])
def test_cone(subdivisions):
    n, split, radius, height = 20, 3, 2.0, 5.0
    shape = {"radius": radius, "height": height, "resolution": n, "split": split}
    mesh = make("cone", **shape, subdivisions=subdivisions)
    base, side, apothem = polygon(n)
    lateral = n * side * radius * math.hypot(height, radius * apothem) / 2
    assert len(mesh.faces) == 2 * n * split * 4**subdivisions
    check_sizes(mesh, base * radius**2 * height / 3, base * radius**2 + lateral)


@pytest.mark.parametrize("scaling", [0.3, 1.0, 4.0])
def test_frustum(scaling):
    n, split, height = 24, 4, 2.0
    mesh = make("conical_frustum", height=height, resolution=n, split=split, scaling=scaling)
    x, y, z = mesh.vertices.T
    radius = np.hypot(x, y)
    assert radius[np.isclose(z, height / 2)].max() == pytest.approx(scaling, rel=1e-14)
    assert radius[np.isclose(z, -height / 2)].max() == pytest.approx(1, rel=1e-14)
    volume = height / 3 * (1 + scaling + scaling**2) * polygon(n)[0]
    assert geometry.volume(mesh) == pytest.approx(volume, rel=1e-13)


def test_frustum_that_scales_by_one_is_the_cylinder():
    shape = {"height": 0.7, "resolution": 21, "split": 5}
    frustum, cylinder = make("conical_frustum", scaling=1.0, **shape), make("cylinder", **shape)
    np.testing.assert_array_equal(frustum.vertices, cylinder.vertices)
    np.testing.assert_array_equal(frustum.faces, cylinder.faces)


@pytest.mark.parametrize("n", [2, 7, 40])
def test_sphere(n):
    mesh = make("sphere", resolution=n)
    assert len(mesh.vertices) == 2 + (n - 1) * 2 * n
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=1e-14)
    latitudes = np.linspace(0, math.pi, n + 1)
    rho, z = np.sin(latitudes), np.cos(latitudes)
    frustums = (z[:-1] - z[1:]) * (rho[:-1] ** 2 + rho[:-1] * rho[1:] + rho[1:] ** 2) / 3
    assert geometry.volume(mesh) == pytest.approx(polygon(2 * n)[0] * frustums.sum(), rel=1e-12)


@pytest.mark.parametrize("tube", [0.1, 0.389910102, 10**0.5])  # 10^(+1/2): the printed sign
def test_torus(tube, limits):
    shape = {"tube_radius": tube, "radial_resolution": 30, "tubular_resolution": 20}
    mesh = make("torus", **shape)
    x, y, z = mesh.vertices.T
    # (x² + y² + z² + R² - r²)² = 4 R² (x² + y²), which holds for r > R too.
    left = (x**2 + y**2 + z**2 + 1 - tube**2) ** 2
    np.testing.assert_allclose(left, 4 * (x**2 + y**2), rtol=0, atol=1e-12 * (1 + tube) ** 4)
    assert len(mesh.vertices) == 600
    # Pappus, with a 30-gon for the circle and a 20-gon for the tube.
    volume = 2 * polygon(30)[0] * polygon(20)[0] * tube**2
    assert geometry.volume(mesh) == pytest.approx(volume, rel=1e-12)
    assert filters.check_mesh(mesh.stored(), limits, Topology(0)) is None


def test_the_torus_that_touches_itself_is_refused(limits):
    parameters = parameters_of("torus", "high")
    assert parameters["tube_radius"] == 1.0
    mesh = FAMILIES["torus"].generate(parameters).stored()
    refusal = filters.check_mesh(mesh, limits, Topology(0))
    # All 30 inner vertices are the origin, with a ring of two triangles each side.
    assert refusal is not None
    assert refusal[0] == "degenerate_face"
    assert refusal[1].startswith("60 of 1200 faces")


# --- inverted cones -------------------------------------------------------------------

CONE = {"height": 1.7, "resolution": 20, "split": 5, "subdivisions": 1}  # ten rings


@pytest.mark.parametrize("flip", [0.25, 0.5, 0.66, 0.9, 1.0])
def test_inverted_cone_has_the_spectrum_of_the_cone(flip):
    inverted = spectrum.compute(make("inverted_cone", flip=flip, **CONE))
    upright = spectrum.compute(make("cone", **CONE))
    np.testing.assert_allclose(inverted.eigenvalues, upright.eigenvalues, rtol=1e-9)


@pytest.mark.parametrize(
    ("flip", "ring"),
    [(0.5, 5), (0.74, 7), (0.75, 8), (0.849, 8), (0.949, 9), (0.95, 10), (1.0, 10)],
)
def test_inverted_cone_is_reflected_above_the_nearest_ring(flip, ring):
    cone, inverted = make("cone", **CONE), make("inverted_cone", flip=flip, **CONE)
    plane = CONE["height"] * ring / 10
    above = cone.vertices[:, 2] > plane + 1e-9
    np.testing.assert_array_equal(inverted.faces, cone.faces)
    np.testing.assert_array_equal(inverted.vertices[:, :2], cone.vertices[:, :2])
    np.testing.assert_allclose(inverted.vertices[~above], cone.vertices[~above], atol=1e-15)
    mirrored = 2 * plane - cone.vertices[above, 2]
    np.testing.assert_allclose(inverted.vertices[above, 2], mirrored, rtol=1e-14)
    assert above.any() == (ring < 10)
    # The tip is taken off and carved out: V (1 - 2 (1 - t)³).
    volume = geometry.volume(cone) * (1 - 2 * (1 - ring / 10) ** 3)
    assert geometry.volume(inverted) == pytest.approx(volume, rel=1e-12)


def test_vertices_strictly_below_the_plane_keep_their_bytes():
    cone, inverted = make("cone", **CONE), make("inverted_cone", flip=0.6, **CONE)
    below = cone.vertices[:, 2] < 0.59 * CONE["height"]
    assert below.sum() > len(below) / 2
    assert inverted.vertices[below].tobytes() == cone.vertices[below].tobytes()


def test_a_flip_above_one_is_refused():
    with pytest.raises(ValueError, match=r"inverted_cone: flip must be at most 1, got 1\.01"):
        make("inverted_cone", flip=1.01)


# --- split shapes ---------------------------------------------------------------------


def half_lattice(n):
    """Vertices of the sphere of resolution n with x ≤ 0, poles left out."""
    # 2n meridians: with n even two lie in x = 0 and n - 1 behind it, with n odd n do.
    return (n - 1) * (n + 1 if n % 2 == 0 else n)


@pytest.mark.parametrize(
    ("a", "b", "shared"),
    [
        (20, 30, 2 * 9),  # both in x = 0 at nine latitudes of gcd 10
        (30, 20, 2 * 9),
        (20, 21, 0),
        (21, 35, 0),  # no meridian in x = 0
        (20, 20, 2 * 19),
        (99, 100, 0),
    ],
)
def test_split_sphere_keeps_every_point_of_both_halves(a, b, shared):
    mesh = make("split_sphere", resolution_a=a, resolution_b=b)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=1e-14)
    assert len(mesh.vertices) == 2 + half_lattice(a) + half_lattice(b) - shared
    assert len(mesh.faces) == 2 * len(mesh.vertices) - 4
    left = make("sphere", resolution=a).vertices
    right = make("sphere", resolution=b).vertices
    halves = rounded_rows(left[left[:, 0] < 1e-9]) | rounded_rows(right[right[:, 0] > -1e-9])
    assert rounded_rows(mesh.vertices) == halves
    # First the left half, to the last bit: where points coincide, the left one is kept.
    first = left[left[:, 0] < 1e-9]
    assert mesh.vertices[: len(first)].tobytes() == first.tobytes()


@pytest.mark.parametrize("n", [6, 7, 20])
def test_split_sphere_of_equal_halves_is_the_sphere(n):
    split = make("split_sphere", resolution_a=n, resolution_b=n)
    sphere = make("sphere", resolution=n)
    assert rounded_rows(split.vertices) == rounded_rows(sphere.vertices)
    check_sizes(split, geometry.volume(sphere), geometry.area(sphere), rel=1e-12)


@pytest.mark.parametrize(
    ("family", "shape"),
    [
        ("split_sphere", {"resolution_a": 20, "resolution_b": 30}),
        ("split_sphere", {"resolution_a": 41, "resolution_b": 40}),
        ("split_sphere", {"resolution_a": 99, "resolution_b": 100}),
        ("split_cone", {"resolution_a": 20, "resolution_b": 47, "height": 0.01}),
        ("split_cone", {"resolution_a": 100, "resolution_b": 64, "height": 100.0}),
    ],
)
def test_faces_of_a_hull_do_not_hang_on_the_last_bit(family, shape):
    mesh = make(family, **shape)
    rng = np.random.default_rng(0)
    for _ in range(3):
        ulps = rng.integers(-1, 2, size=mesh.vertices.shape)
        hull = convex_hull(mesh.vertices * (1 + np.finfo(float).eps * ulps))
        np.testing.assert_array_equal(hull.faces, mesh.faces)


@pytest.mark.parametrize(
    ("a", "b"), [(2, 2), (2, 9), (3, 2), (20, 20), (20, 51), (33, 22), (42, 86), (61, 60)]
)
def test_hemispheres_are_joined_as_any_halves_are(a, b):
    halves = spheres(a, b)
    expected = primitives.join_halves(*halves)
    joined = primitives.join_hemispheres(*halves)
    np.testing.assert_array_equal(joined.vertices, expected.vertices)
    np.testing.assert_array_equal(joined.faces, expected.faces)


def test_hull_of_most_of_two_hemispheres_is_known(monkeypatch):
    hull = Mock(side_effect=primitives._hull)
    monkeypatch.setattr(primitives, "_hull", hull)
    joined = primitives.join_hemispheres(*spheres(60, 70))
    hull.assert_called_once()
    (points,) = hull.call_args.args
    assert len(points) < len(joined.vertices) / 6


def test_hemispheres_with_a_gap_are_joined_by_their_whole_hull(monkeypatch):
    halves = spheres(9, 12)
    expected = primitives.join_halves(*halves)
    band = primitives._band
    monkeypatch.setattr(primitives, "_band", lambda *arguments: band(*arguments)[1:])
    joined = primitives.join_hemispheres(*halves)
    np.testing.assert_array_equal(joined.faces, expected.faces)


def test_convex_hull_drops_inner_points_and_fans_flat_facets_from_their_first_vertex():
    corners = [[i & 1, i >> 1 & 1, i >> 2] for i in range(8)]
    inner = [[0.5, 0.5, 0.5], [0.5, 0.5, 0.0], [0.5, 0.0, 0.0]]
    hull = convex_hull(np.array(inner + corners, dtype=np.float64))
    np.testing.assert_array_equal(hull.vertices, corners)
    expected = [
        *([0, 1, 5], [0, 2, 3], [0, 3, 1], [0, 4, 6], [0, 5, 4], [0, 6, 2]),
        *([1, 3, 7], [1, 7, 5], [2, 6, 7], [2, 7, 3], [4, 5, 7], [4, 7, 6]),
    ]
    np.testing.assert_array_equal(hull.faces, expected)


def test_exchanging_the_halves_of_a_split_sphere_gives_the_same_group():
    group = FAMILIES["split_sphere"].group
    shape = {"radius": 1.0, "resolution_a": 20, "resolution_b": 30}
    swapped = {"radius": 1.0, "resolution_a": 30, "resolution_b": 20}
    assert group(shape) == group(swapped)
    assert group(shape) != group({**shape, "resolution_b": 31})
    mirror = FAMILIES["split_sphere"].generate(swapped).vertices * [-1, 1, 1]
    assert rounded_rows(FAMILIES["split_sphere"].generate(shape).vertices) == rounded_rows(mirror)


@pytest.mark.parametrize(("a", "b"), [(20, 20), (20, 32), (22, 20), (22, 26), (98, 100)])
@pytest.mark.parametrize("split", [1, 7])
def test_split_cone_has_no_vertices_but_the_base_circle_and_the_apex(a, b, split):
    mesh = make("split_cone", resolution_a=a, resolution_b=b, split_a=split, split_b=2 * split)
    # A circle of n = 4 m points has two in x = 0; so 2 m + 1 in a closed half. One of
    # n = 4 m + 2 has none, so 2 m + 1 too. Shared are those in x = 0 of both.
    shared = 2 if a % 4 == b % 4 == 0 else 0
    base = 2 * (a // 4) + 1 + 2 * (b // 4) + 1 - shared
    assert len(mesh.vertices) == base + 1
    assert (mesh.vertices[:, 2] > 0).sum() == 1
    np.testing.assert_allclose(np.hypot(*mesh.vertices[:, :2].T) + mesh.vertices[:, 2], 1)


def test_split_cone_of_equal_halves_encloses_the_cone():
    split = make("split_cone", height=2.0, resolution_a=20, resolution_b=20, subdivisions=1)
    cone = make("cone", height=2.0, resolution=20, split=4)
    check_sizes(split, geometry.volume(cone), geometry.area(cone), rel=1e-12)
    assert len(split.faces) == 4 * (20 + 18)  # 20 sides, a base fan of 18, each in four


# --- the draw -------------------------------------------------------------------------


def with_family(base, name, family):
    return dataclasses.replace(base, families={**base.families, name: family})


def test_an_unknown_family_is_refused(recipe_1_0):
    changed = with_family(recipe_1_0, "klein_bottle", FamilyRecipe(1, {}))
    message = f"unknown family 'klein_bottle': choose from {', '.join(FAMILIES)}"
    with pytest.raises(RecipeError, match=message):
        draw_shapes(changed)


@pytest.mark.parametrize("parameters", [{"radius": 1.0}, {"radius": 1.0, "n": 3}])
def test_wrong_parameters_in_a_recipe_are_refused(recipe_1_0, parameters):
    changed = with_family(recipe_1_0, "sphere", FamilyRecipe(1, parameters))
    message = "family sphere takes the parameters radius, resolution; the recipe gives "
    with pytest.raises(RecipeError, match=message + ", ".join(parameters)):
        draw_shapes(changed)


def test_the_draw_of_1_0_has_the_counts_of_the_paper(specs):
    assert len(specs) == 16_550
    assert Counter(spec.family for spec in specs) == COUNTS
    assert list(dict.fromkeys(spec.family for spec in specs)) == list(COUNTS)


def test_ids_are_unique_and_say_family_and_index(specs):
    assert len({spec.id for spec in specs}) == len(specs)
    assert all(spec.id == f"{spec.family}-{spec.index:05d}" for spec in specs)
    assert [s.index for s in specs if s.family == "cone"] == list(range(1000))


def test_one_shape_drawn_alone_is_the_one_drawn_among_all(recipe_1_0, specs):
    assert len(specs[::-97]) > 100
    for spec in specs[::-97]:
        assert draw_shape(recipe_1_0, spec.family, spec.index) == spec


def test_drawn_shapes_do_not_hang_on_other_families(recipe_1_0):
    alone = dataclasses.replace(recipe_1_0, families={"sphere": recipe_1_0.families["sphere"]})
    assert draw_shapes(alone) == [draw_shape(recipe_1_0, "sphere", i) for i in range(50)]


def test_a_drawn_shape_is_what_it_always_was(recipe_1_0):
    assert draw_shape(recipe_1_0, "split_sphere", 7) == ShapeSpec(
        id="split_sphere-00007",
        family="split_sphere",
        index=7,
        parameters={"radius": 1.0, "resolution_a": 35, "resolution_b": 94},
        group="466be67f8af9ea93",
    )
    assert draw_shape(recipe_1_0, "torus", 42).parameters["tube_radius"] == 0.389910102


def test_parameters_of_1_0_stay_within_three_standard_deviations(specs):
    for spec in specs:
        for name in ("height", "depth", "scaling"):
            assert 0.01 <= spec.parameters.get(name, 1.0) <= 100
    tubes = [s.parameters["tube_radius"] for s in specs if s.family == "torus"]
    assert (min(tubes), max(tubes)) == (0.1, 1.0)  # the clamp is met
    flips = [s.parameters["flip"] for s in specs if s.family == "inverted_cone"]
    assert 0.5 <= min(flips) < 0.501 < 0.999 < max(flips) <= 1
    for family, name, low, high in (
        ("cone", "resolution", 20, 100),
        ("cylinder", "split", 4, 20),
        ("tetrahedron", "subdivisions", 3, 5),
        ("inverted_cone", "split", 10, 30),
    ):
        drawn = {s.parameters[name] for s in specs if s.family == family}
        assert drawn == set(range(low, high + 1))


# --- surfaces -------------------------------------------------------------------------

BOX = {"width": 1.0, "height": 0.6, "depth": 1.7}
ROUND = {"radius": 1.0, "height": 2.0, "resolution": 9, "split": 2}
HALVES = {"resolution_a": 9, "resolution_b": 12, "split_a": 2, "split_b": 3}
TUBE = {"torus_radius": 1.0, "tube_radius": 0.4}
SMALL = {
    "rectangular_prism": {**BOX, "subdivisions": 1},
    "cone": {**ROUND, "subdivisions": 1},
    "cylinder": ROUND,
    "sphere": {"radius": 1.5, "resolution": 8},
    "torus": {**TUBE, "radial_resolution": 16, "tubular_resolution": 12},
    "tetrahedron": {**BOX, "subdivisions": 1},
    "conical_frustum": {**ROUND, "scaling": 0.3},
    "split_sphere": {"radius": 1.5, "resolution_a": 8, "resolution_b": 11},
    "split_cone": {"radius": 1.0, "height": 2.0, **HALVES, "subdivisions": 1},
    "inverted_cone": {**ROUND, "subdivisions": 1, "flip": 0.6},
}
CONE_AREA = math.pi * (1 + math.hypot(1, 2))
AREAS = {  # of the smooth surfaces of SMALL
    "rectangular_prism": 2 * (0.6 + 1.7 + 0.6 * 1.7),
    "cone": CONE_AREA,
    "cylinder": math.pi * (2 + 2 * 2),
    "sphere": 4 * math.pi * 1.5**2,
    "torus": 4 * math.pi**2 * 0.4,
    # Three right triangles, and half the product of two edges of the fourth.
    "tetrahedron": 0.5 * (0.6 + 1.7 + 0.6 * 1.7 + math.hypot(0.6, 1.7, 0.6 * 1.7)),
    "conical_frustum": math.pi * (1 + 0.3**2 + 1.3 * math.hypot(0.7, 2)),
    "split_sphere": 4 * math.pi * 1.5**2,
    "split_cone": CONE_AREA,
    "inverted_cone": CONE_AREA,
}
POLYHEDRA = ("rectangular_prism", "tetrahedron")


@pytest.mark.parametrize("family", PRIMITIVES)
def test_triangulations_of_the_surface_approach_its_area_by_a_quarter(family):
    meshes = [FAMILIES[family].at_level(SMALL[family], level) for level in (1, 2, 3)]
    missing = [AREAS[family] - geometry.area(mesh) for mesh in meshes]
    if family in POLYHEDRA:
        np.testing.assert_allclose(missing, 0, atol=1e-12)
    else:
        ratios = np.divide(missing[:-1], missing[1:])
        np.testing.assert_allclose(ratios, 4, rtol=0.06)  # at a tip h² log h
    counts = [len(mesh.faces) for mesh in meshes]
    assert counts == [counts[0], 4 * counts[0], 16 * counts[0]]
    assert 2000 < len(meshes[0].vertices) < 8000


@pytest.mark.parametrize("family", PRIMITIVES)
def test_meshes_are_inscribed_and_their_labels_above_the_limit(family):
    mesh = FAMILIES[family].generate(SMALL[family])
    missing = AREAS[family] - geometry.area(mesh)
    assert missing == pytest.approx(0, abs=1e-12) if family in POLYHEDRA else missing > 0.01
    limit = FAMILIES[family].limit_spectrum(SMALL[family], 6)
    assert (spectrum.compute(mesh, 6).eigenvalues > limit.eigenvalues + limit.bar).all()


def test_a_level_below_one_is_refused():
    with pytest.raises(ValueError, match=r"^level must be at least 1, got 0$"):
        FAMILIES["sphere"].at_level(LEAST["sphere"], 0)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("strut", 5e-324, r"strut must be at least 0\.0001, got 5e-324"),
        ("strut", None, "strut must be a number, got None"),
        ("columns", "2", "columns must be a number, got '2'"),
        ("columns", True, "columns must be a number, got True"),
        ("triangulation", ["uniform"], r"triangulation must be one of .*, got \['uniform'\]"),
    ],
)
def test_a_parameter_of_another_kind_is_named(name, value, message):
    lattice = FAMILIES["lattice"]
    parameters = {"columns": 1, "rows": 1, "layers": 1, "strut": 0.2, "form": 0}
    parameters |= {"triangulation": "uniform", "vertices": 300, "seed": 0}
    assert len(lattice.generate(parameters).vertices) > 100
    with pytest.raises(ValueError, match=f"^lattice: {message}$"):
        lattice.generate({**parameters, name: value})


def test_the_topology_of_whole_numbers_as_floats_is_theirs():
    for family in ("lattice", "sheet_metal", "perforated_plate"):
        how = {"triangulation": "uniform", "vertices": 300}
        whole = {**FAMILIES[family].least, **how}
        floats = {n: float(v) if isinstance(v, int) else v for n, v in whole.items()}
        assert FAMILIES[family].topology(floats) == FAMILIES[family].topology(whole)
