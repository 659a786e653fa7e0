"""Which shapes a contact sheet shows, and how it names them."""

import numpy as np
import pytest

from synthnet import gallery, importing, recipe
from synthnet.errors import RecipeError
from synthnet.families import draw_shape
from synthnet.gallery import Candidates, candidates, chosen, spread
from synthnet.plan import plan_shards
from synthnet.types import ShapeSpec

PARAMETERS = {
    "cone": ("height", "resolution", "split"),
    "sphere": ("resolution",),
    "torus": ("tube_radius",),
    "split_sphere": ("resolution_a", "resolution_b"),
}


@pytest.mark.parametrize("family", PARAMETERS)
def test_only_parameters_that_differ_are_named(family):
    (found,) = candidates("1.0-mini", family)
    assert found.varying == PARAMETERS[family]


def test_seeds_say_nothing_to_a_reader():
    (found,) = candidates("2.0-mini", "annulus")
    assert found.varying == ("inner", "triangulation", "vertices")


def test_every_family_has_candidates_and_none_is_of_another():
    found = candidates("2.0-mini")
    assert len(found) == 25
    for one in found:
        assert {spec.family for spec in one.specs} == {one.family}


def test_a_sheet_shows_low_and_high_values_of_every_parameter():
    (found,) = candidates("1.0", "cone")
    ids = [spec.id for spec, _ in chosen("1.0-mini", found, 15)]
    assert len(set(ids)) == 15
    taken = [spec for spec in found.specs if spec.id in ids]
    for name in found.varying:
        everyone = [spec.parameters[name] for spec in found.specs]
        thirds = np.quantile(everyone, [1 / 3, 2 / 3])
        counts = np.bincount(np.digitize([s.parameters[name] for s in taken], thirds), minlength=3)
        assert counts.min() >= 3


def test_the_first_shape_is_in_the_middle():
    places = np.random.default_rng(1).random((400, 3))
    first = places[spread(places, 10)[0]]
    assert np.linalg.norm(first - 0.5) == np.linalg.norm(places - 0.5, axis=1).min()


@pytest.mark.parametrize("dimensions", [0, 1, 4])
@pytest.mark.parametrize("count", [1, 7, 50, 80])
def test_an_order_has_every_point_once(dimensions, count):
    places = np.random.default_rng(1).random((50, dimensions))
    assert sorted(spread(places, count)) == list(range(50))


def test_a_shape_that_a_filter_refuses_is_passed_over():
    (tori,) = candidates("1.0-mini", "torus")
    broken = ShapeSpec(
        "torus-99999", "torus", 99999, {**tori.specs[0].parameters, "tube_radius": 1.0}, "none"
    )
    among = Candidates("torus", 2, (broken, tori.specs[0]), ())
    assert [spec.id for spec, _ in chosen("1.0-mini", among, 2)] == [tori.specs[0].id]


def test_an_import_is_read(tmp_path, tiny_samples):
    scans = tmp_path / "scans"
    scans.mkdir()
    mesh = tiny_samples["torus"][0].mesh
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices.tolist()]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.faces.tolist()]
    (scans / "a.obj").write_text("\n".join(lines))
    importing.import_meshes([scans], "mine", importing.Settings(), root=tmp_path, workers=1)
    (found,) = candidates("mine", root=tmp_path)
    assert found.family == "scans"
    assert found.varying == ()
    ((spec, read),) = chosen("mine", found, 3, tmp_path)
    assert spec.id == found.specs[0].id
    assert len(read.faces) == len(mesh.faces)


def test_captions_are_short_lines_that_break_between_parameters():
    (found,) = candidates("2.0-mini", "pretzel")
    lines = gallery.caption(found.specs[0], found.varying)
    assert lines[0] == found.specs[0].id
    assert all(len(line) <= gallery.LINE for line in lines)
    told = " ".join(lines[1:]).replace(gallery.NO_BREAK, " ").split(", ")
    assert [part.rpartition(" ")[0] for part in told] == list(found.varying)


def test_the_shapes_are_those_of_the_version():
    for version in ("1.0-mini", "2.0-mini"):
        planned = [s.spec for plan in plan_shards(recipe.load(version)) for s in plan.shapes]
        found = candidates(version)
        assert [spec for one in found for spec in one.specs] == planned
        assert sum(one.total for one in found) == len(planned)
    (spheres,) = candidates("1.0", "sphere")
    assert list(spheres.specs) == [draw_shape(recipe.load("1.0"), "sphere", i) for i in range(50)]


def test_of_a_scaled_version_the_first_shapes_are_enough():
    (cones,) = candidates("1.0-x100", "cone")
    assert (cones.total, len(cones.specs)) == (100_000, gallery.MOST)
    planned = plan_shards(recipe.load("1.0-x100"))[0].shapes
    (prisms,) = candidates("1.0-x100", "rectangular_prism")
    assert prisms.specs[: len(planned)] == tuple(shape.spec for shape in planned)


def test_a_version_that_is_not_there():
    with pytest.raises(RecipeError, match=r"unknown version '3\.0'"):
        candidates("3.0")
