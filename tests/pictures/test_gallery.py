"""Which shapes a contact sheet shows, and how it names them."""

import numpy as np
import pytest

from synthnet import recipe
from synthnet.build import importing
from synthnet.errors import RecipeError
from synthnet.pictures import gallery
from synthnet.pictures.gallery import Candidates, candidates, chosen, spread
from synthnet.recipe.drawing import draw_shape
from synthnet.recipe.plan import plan_shards
from synthnet.types import ShapeSpec
from tests.conftest import only_line

PARAMETERS = {
    "cone": ("height", "resolution", "split"),
    "sphere": ("resolution",),
    "torus": ("tube_radius",),
    "split_sphere": ("resolution_a", "resolution_b"),
}


@pytest.mark.parametrize("family", PARAMETERS)
def test_only_parameters_that_differ_are_named(family):
    (group,) = candidates("1.0-mini", family)
    assert group.varying == PARAMETERS[family]


def test_seeds_say_nothing_to_a_reader():
    (group,) = candidates("2.0-mini", "annulus")
    assert group.varying == ("inner", "triangulation", "vertices")


def test_every_family_has_candidates_and_none_is_of_another():
    groups = candidates("2.0-mini")
    assert len(groups) == 25
    for group in groups:
        assert {spec.family for spec in group.specs} == {group.family}


def test_a_sheet_shows_low_and_high_values_of_every_parameter():
    (group,) = candidates("1.0", "cone")
    ids = [spec.id for spec, _ in chosen("1.0-mini", group, 15)]
    assert len(set(ids)) == 15
    taken = [spec for spec in group.specs if spec.id in ids]
    for name in group.varying:
        everyone = [spec.parameters[name] for spec in group.specs]
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


def obj(mesh, repeated=0):
    """Return a mesh as an OBJ file, in which some faces have a vertex of their own."""
    vertices, faces = mesh.vertices.tolist(), (mesh.faces + 1).tolist()
    for face in faces[:repeated]:
        vertices.append(vertices[face[0] - 1])
        face[0] = len(vertices)
    lines = [f"v {x} {y} {z}" for x, y, z in vertices]
    return "\n".join([*lines, *(f"f {a} {b} {c}" for a, b, c in faces)])


def imported(texts, home):
    """Import OBJ files of a directory, and return the candidates of the dataset "mine"."""
    scans = home / "scans"
    scans.mkdir()
    for name, text in texts.items():
        (scans / name).write_text(text)
    importing.import_meshes([scans], "mine", importing.Settings(), root=home, workers=1)
    (group,) = candidates("mine", root=home)
    return group


def test_an_import_is_read(tmp_path, tiny_samples):
    mesh = tiny_samples["torus"][0].mesh
    group = imported({"a.obj": obj(mesh)}, tmp_path)
    assert group.family == "scans"
    assert group.varying == ()
    ((spec, read),) = chosen("mine", group, 3, tmp_path)
    assert spec.id == group.specs[0].id
    assert len(read.faces) == len(mesh.faces)


def test_a_sheet_of_a_file_in_a_folder_is_written_here(tmp_path, tiny_samples, run, monkeypatch):
    (tmp_path / "scans" / "sub").mkdir(parents=True)
    (tmp_path / "scans" / "sub" / "a.obj").write_text(obj(tiny_samples["torus"][0].mesh))
    importing.import_meshes([tmp_path / "scans"], "mesh-x100", root=tmp_path / "home", workers=1)
    monkeypatch.chdir(tmp_path)
    titles = []
    draw = gallery.draw.picture_of_sheet
    monkeypatch.setattr(
        gallery.draw, "picture_of_sheet", lambda *a, **b: titles.append(a[2]) or draw(*a, **b)
    )
    where = ["--version", "mesh-x100", "--out", "home"]
    picture = "picture: gallery-mesh-x100-sub-a.obj.png\n"
    assert run("gallery", "sub/a.obj", *where) == (0, picture, "")
    assert titles == ["mesh-x100, scans: 1 of 1"]
    assert "mesh-x100 is no version of synthNet: " in only_line(*run("croissant", *where))


@pytest.mark.slow
@pytest.mark.parametrize("names", [("a.obj", "b.obj"), ("b.obj", "a.obj")])
def test_repairs_of_some_files_of_an_import_only(names, tmp_path, tiny_samples):
    mesh, (whole, mended) = tiny_samples["torus"][0].mesh, names
    group = imported({whole: obj(mesh), mended: obj(mesh, repeated=2)}, tmp_path)
    merged = [spec.parameters.get("merged_vertices") for spec in group.specs]
    assert merged == ([None, 2] if names[0] == "a.obj" else [2, None])
    assert group.varying == ("file",)
    shapes = list(chosen("mine", group, 2, tmp_path))
    captions = [gallery.caption(spec, group.varying) for spec, _ in shapes]
    assert sorted(lines[1] for lines in captions) == [
        f"file{gallery.NO_BREAK}{name}" for name in sorted(names)
    ]
    assert gallery.sheet(shapes, group.varying, "mine").startswith(b"\x89PNG")


@pytest.mark.slow
def test_an_import_of_which_no_file_was_kept(tmp_path, run):
    group = imported({"a.obj": "no mesh"}, tmp_path)
    assert (group.family, group.total, group.specs, group.varying) == ("scans", 0, (), ())
    picture = tmp_path / "a.png"
    where = ["--version", "mine", "--out", tmp_path, "--png", picture]
    for family, message in (([], ""), (["scans"], " of family scans")):
        assert only_line(*run("gallery", *family, *where)) == (
            f"synthnet: mine has no shape{message} to draw, every one was rejected: "
            "`synthnet info mine` says why"
        )
    assert not picture.exists()
    code, out, _ = run("info", "--version", "mine", "--out", tmp_path)
    assert code == 0
    assert "unreadable" in out


def test_a_family_of_which_every_candidate_is_refused(run, tmp_path, monkeypatch):
    monkeypatch.setattr(gallery.filters, "check_mesh", lambda *_: "a reason")
    drawn = run("gallery", "torus", "--version", "1.0-mini", "--png", tmp_path / "a.png")
    assert "1.0-mini has no shape of family torus to draw" in only_line(*drawn)


def test_captions_are_short_lines_that_break_between_parameters():
    (group,) = candidates("2.0-mini", "pretzel")
    lines = gallery.caption(group.specs[0], group.varying)
    assert lines[0] == group.specs[0].id
    assert all(len(line) <= gallery.LINE for line in lines)
    message = " ".join(lines[1:]).replace(gallery.NO_BREAK, " ").split(", ")
    assert [part.rpartition(" ")[0] for part in message] == list(group.varying)


def test_the_shapes_are_those_of_the_version():
    for version in ("1.0-mini", "2.0-mini"):
        planned = [s.spec for plan in plan_shards(recipe.load(version)) for s in plan.shapes]
        groups = candidates(version)
        assert [spec for group in groups for spec in group.specs] == planned
        assert sum(group.total for group in groups) == len(planned)
    (spheres,) = candidates("1.0", "sphere")
    assert list(spheres.specs) == [draw_shape(recipe.load("1.0"), "sphere", i) for i in range(50)]


@pytest.mark.slow
def test_of_a_scaled_version_the_first_shapes_are_enough():
    (cones,) = candidates("1.0-x100", "cone")
    assert (cones.total, len(cones.specs)) == (100_000, gallery.MOST)
    planned = plan_shards(recipe.load("1.0-x100"))[0].shapes
    (prisms,) = candidates("1.0-x100", "rectangular_prism")
    assert prisms.specs[: len(planned)] == tuple(shape.spec for shape in planned)


def test_a_version_that_is_not_there():
    with pytest.raises(RecipeError, match=r"unknown version '3\.0'"):
        candidates("3.0")
