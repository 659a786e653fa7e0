"""Folders of mesh files become datasets; a bad file is a rejection and stops no other."""

import json
import os
import re
import shlex
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import trimesh
from eigbench.commands import cli as eigbench_cli
from eigbench.scoring import truth

import synthnet
from evidence import fuzz_import
from evidence.thin_meshes import thin
from synthnet import spectrum, store
from synthnet.build import filters, importing, label, sources, surfaces
from synthnet.build.importing import Settings, file_outcomes, import_meshes
from synthnet.build.jobs import Watcher, exclusive
from synthnet.build.workers import given
from synthnet.errors import BuildError, MeshImportError, RecipeError, StoreError
from synthnet.families import FAMILIES
from synthnet.loaders.pyg import SynthNet
from synthnet.mesh import geometry, repair
from synthnet.store import pins
from synthnet.verify.checks import verify, verify_files
from tests.conftest import only_line
from tests.datasets import contents

SPHERE = trimesh.creation.icosphere(subdivisions=2)
TORUS = trimesh.creation.torus(3.0, 1.0, major_sections=16, minor_sections=12)
FAR = SPHERE.copy().apply_translation([10.0, 0, 0]).apply_scale(0.5)


def seamed(mesh):
    """Return OBJ text in which every face has texture coordinates of its own."""
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in mesh.vertices]
    lines += [f"vt {i / len(mesh.faces)} {c / 3}" for i in range(len(mesh.faces)) for c in range(3)]
    for i, face in enumerate(mesh.faces):
        lines.append("f " + " ".join(f"{v + 1}/{3 * i + c + 1}" for c, v in enumerate(face)))
    return "\n".join(lines) + "\n"


@pytest.fixture
def folder(tmp_path):
    """Two directories of files that each meet one rule, or none."""
    directory = tmp_path / "My Meshes"
    (directory / "below").mkdir(parents=True)
    SPHERE.export(directory / "a.ply")
    SPHERE.export(directory / "b.STL", file_type="stl")
    (directory / "below" / "c.obj").write_text(seamed(TORUS))
    (directory / "d.off").write_text("OFF\n3 nonsense")
    (SPHERE + FAR).export(directory / "e.ply")
    (directory / "f.txt").write_text("no mesh")
    return directory


@pytest.fixture
def scans(tmp_path):
    """An empty directory for mesh files."""
    (tmp_path / "scans").mkdir()
    return tmp_path / "scans"


@pytest.fixture
def root(tmp_path):
    return tmp_path / "root"


@pytest.fixture
def imported(root):
    """Return a function that imports files as ``mine``, or another, by a thread."""

    def make(*places, name="mine", root=root, watcher=None, **options):
        with ThreadPoolExecutor(1) as pool:
            where = {"root": root, "engine": given(pool, workers=1), "watcher": watcher}
            return import_meshes(places, name, Settings(**options), **where)

    return make


@pytest.fixture
def mine(printed, root):
    """Return a function that runs a command on the dataset ``mine``: its stdout."""
    return lambda *words: printed(*words, "--dataset", "mine", "--out", root)


@pytest.fixture
def run_import(run, root):
    """Return a function that runs ``synthnet import`` of ``mine``: exit code, stdout, stderr."""
    options = ["--name", "mine", "--out", root, "--workers"]
    return lambda *words, workers=1: run("import", *words, *options, workers)


def test_folder_becomes_a_dataset(folder, imported):
    dataset = imported(folder).dataset
    rows = {row["file"]: (row["outcome"], row["what"]) for row in file_outcomes(dataset)}
    merged = 3 * len(SPHERE.faces) - len(SPHERE.vertices)
    assert rows["a.ply"] == ("as it was", "")
    assert rows["b.STL"] == ("repaired", f"{merged:,} merged vertices")
    assert rows["below/c.obj"] == ("as it was", "")  # seams of a texture cut no surface
    assert rows["d.off"][0] == "rejected"
    assert rows["d.off"][1].startswith("unreadable: ")
    assert rows["e.ply"] == ("as it was", "2 components, the largest has 80.0% of the area")
    assert len(rows) == 5
    ids = [sample.spec.id for sample in dataset.samples()]
    assert ids == [f"my_meshes-{number:05d}" for number in (0, 1, 2, 4)]


def outcomes_by_file(report):
    """What became of each file, by its name."""
    return {str(row["file"]): str(row["what"]) for row in file_outcomes(report.dataset)}


def test_labels_are_those_of_the_surface(folder, imported):
    ply, stl, torus, both = imported(folder).dataset.samples()
    parts = [spectrum.compute(mesh).eigenvalues for mesh in (SPHERE, FAR)]
    merged = np.sort(np.concatenate(parts))[:10]
    assert both.eigenvalues == pytest.approx(merged, rel=1e-5)
    for sample, mesh in ((ply, SPHERE), (stl, SPHERE), (torus, TORUS)):
        expected = spectrum.compute(mesh)
        assert sample.eigenvalues == pytest.approx(expected.eigenvalues, rel=1e-5)
        assert 0 < float(sample.spec.parameters["error_bound"]) < 1e-10
        assert sample.certificate.count >= 11
        assert sample.split == "test"
        assert sample.paper_splits == ("test",)
        assert sample.isometries.tolist() == [np.eye(3).tolist()]


def test_every_reader_takes_it(folder, imported, root, capfd):
    dataset = imported(folder).dataset
    shapes = SynthNet(version="mine", split="test", root=root)
    assert "Unpacking mine for PyTorch Geometric" in capfd.readouterr().err
    assert len(shapes) == 4
    assert shapes[2].y[0].numpy() == pytest.approx(list(dataset.samples())[2].eigenvalues, rel=1e-6)
    assert len(synthnet.load_dataset("mine", split="test", root=root)) == 4
    with pytest.raises(StoreError, match="mine has no shape in the split train"):
        synthnet.load_dataset("mine", split="train", root=root)
    assert truth.of_dataset(dataset).eigenvalues.shape == (4, 10)
    for report in (verify("mine", root=root), verify_files("mine", root=root)):
        assert report.problems == ()


def test_verify_finds_an_altered_label(folder, imported, root):
    dataset = imported(folder).dataset
    (path,) = dataset.paths()
    samples = list(store.read_samples(path))
    for sample in samples:
        sample.eigenvalues[0] *= 1.5
    options = {"family": "my_meshes", "recipe_digest": dataset.manifest.recipe_digest}
    store.write_shard(path, samples, dataset.manifest.rejections, **options)
    counts = {c.name: len(c.problems) for c in verify("mine", root=root).checks}
    assert counts["digests"] == 1
    assert counts["labels"] == 4


def test_second_import_has_nothing_to_do(folder, imported, root):
    first = imported(folder)
    files = contents(root / "mine")
    manifest = root / "mine" / "manifest.json"
    os.utime(manifest, (1, 1))
    again = imported(folder)
    assert (first.nothing_to_do, again.nothing_to_do) == (False, True)
    assert manifest.stat().st_mtime == 1
    (shard,) = first.dataset.paths()
    Path(shard).write_bytes(Path(shard).read_bytes()[:-9])
    third = imported(folder)
    assert (third.nothing_to_do, third.reused) == (False, 0)  # made anew
    assert contents(root / "mine") == files


def test_import_that_was_interrupted_goes_on(folder, imported, root, tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "SHARD_FILES", 3)
    imported(folder, root=tmp_path / "other")
    watcher = Watcher()
    watcher.submitted = Mock(side_effect=[None, KeyboardInterrupt])  # at the second shard
    with pytest.raises(KeyboardInterrupt):
        imported(folder, watcher=watcher)
    made = contents(root / "mine")
    assert sorted(made) == ["shards/my_meshes-0000.parquet"]
    with pytest.raises(RecipeError, match="or make it of your own meshes by `synthnet import`"):
        verify("mine", root=root)
    assert imported(folder).reused == 1
    assert contents(root / "mine") == contents(tmp_path / "other" / "mine")
    assert len(contents(tmp_path / "other" / "mine")) == 3


def test_shards_are_of_few_files_and_of_few_bytes(monkeypatch):
    monkeypatch.setattr(sources, "SHARD_FILES", 3)
    monkeypatch.setattr(sources, "SHARD_BYTES", 10)
    assert list(sources._chunks([1, 1, 1, 1])) == [(0, 3), (3, 4)]
    assert list(sources._chunks([99, 4, 6, 1, 99])) == [(0, 1), (1, 3), (3, 4), (4, 5)]
    assert list(sources._chunks([0])) == [(0, 1)]


@pytest.mark.slow
def test_any_number_of_workers_makes_the_same_bytes(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(sources, "SHARD_FILES", 2)
    for workers in (1, 2):
        import_meshes([folder], "mine", root=tmp_path / str(workers), workers=workers)
    first, second = (contents(tmp_path / name / "mine") for name in "12")
    assert first == second
    assert len(first) == 4


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ("changed", r"1 changed: my_meshes/a\.ply"),
        ("added", r"1 new: my_meshes/z\.ply"),
        ("option", "other --components"),
        ("rule", "other rules"),
        ("limits", "other limits"),
        ("other", r"1 new: other/a\.ply; 5 missing: such as my_meshes/a\.ply"),
    ],
)
def test_other_import_under_the_same_name_overwrites_nothing(
    change, difference, folder, imported, root, tmp_path, monkeypatch
):
    imported(folder)
    files = contents(root / "mine")
    other = tmp_path / "other"
    other.mkdir()
    TORUS.export(other / "a.ply")
    if change == "changed":
        TORUS.export(folder / "a.ply")
    elif change == "added":
        TORUS.export(folder / "z.ply")
    elif change == "rule":
        monkeypatch.setattr(importing, "RULES", 0)
    elif change == "limits":
        monkeypatch.setattr(importing, "LIMITS", "2.0")
    place = other if change == "other" else folder
    advice = r".*: remove .*mine or choose another"
    for missing in ("", "manifest.json"):  # also where the first was never finished
        expected = rf"is of another import than this \({difference}\){advice}"
        if missing:
            expected = f"is of other directories, files, options or rules{advice}"
            (root / "mine" / missing).unlink()
            del files[missing]
        with pytest.raises(StoreError, match=expected):
            imported(place, components="largest" if change == "option" else "keep")
        assert contents(root / "mine") == files


def test_a_dataset_that_was_built_is_refused(folder, imported, mini_home, root):
    shutil.copytree(mini_home / "1.0-mini", root / "mine")
    with pytest.raises(StoreError, match="mine was not imported, but built; nothing was overwr"):
        imported(folder)


def test_stranger_among_the_shards_is_refused(folder, imported, root):
    (root / "mine" / "shards").mkdir(parents=True)
    (root / "mine" / "shards" / "notes.txt").write_text("mine")
    with pytest.raises(StoreError, match=r"notes\.txt .*, or of none; nothing was overwritten"):
        imported(folder)
    assert contents(root) == {"mine/shards/notes.txt": b"mine"}


def test_import_waits_for_another_or_says_so(folder, imported, root):
    directory = root / "mine"
    directory.mkdir(parents=True)
    with (
        exclusive(directory, wait_for_lock=False),
        pytest.raises(BuildError, match=r"another build is writing .*: wait for it \(--wait\)"),
    ):
        imported(folder)


def test_unit_area_is_recorded(folder, imported):
    samples = list(imported(folder, unit_area=True).dataset.samples())
    assert len(samples) == 4
    for sample in samples[:3]:
        scale = float(sample.spec.parameters["scale"])
        mesh = TORUS if "below" in str(sample.spec.parameters["file"]) else SPHERE
        assert scale == pytest.approx(mesh.area**-0.5, rel=1e-6)
        expected = spectrum.compute(mesh)
        assert sample.eigenvalues * scale**2 == pytest.approx(expected.eigenvalues, rel=1e-5)


def test_largest_component_is_kept_if_asked(folder, imported):
    rows = file_outcomes(imported(folder, components="largest").dataset)
    (kept,) = [row for row in rows if row["file"] == "e.ply"]
    what = "1 components left out, 2 components, the largest has 80.0% of the area"
    assert (kept["outcome"], kept["what"]) == ("repaired", what)
    assert kept["vertices"] == len(SPHERE.vertices)


def test_the_bound_of_the_error_changes_no_pin(folder, imported):
    sample = next(iter(imported(folder).dataset.samples()))
    others = {k: v for k, v in sample.spec.parameters.items() if k != "error_bound"}
    assert len(others) == len(sample.spec.parameters) - 1
    without = replace(sample, spec=replace(sample.spec, parameters=others))
    assert pins.digest(without) == pins.digest(sample)


def test_each_component_is_a_shape_if_asked(folder, imported, root):
    dataset = imported(folder, components="split").dataset
    rows = {row["id"]: row for row in file_outcomes(dataset)}
    large, small = rows["my_meshes-00004"], rows["my_meshes-00005"]
    assert large["file"] == small["file"] == "e.ply"
    for number, row in enumerate((large, small)):
        share = "2 components, the largest has 80.0% of the area"
        assert row["what"] == f"{share}; this is part {number}"
    ends = [dataset.find(f"e.ply#{number}") for number in (0, 1)]
    for sample, mesh in zip(ends, (SPHERE, FAR), strict=True):
        assert geometry.area(sample.mesh) == pytest.approx(mesh.area, rel=1e-6)
    assert ends[0].spec.group == ends[1].spec.group
    assert verify("mine", root=root).problems == ()


@pytest.mark.parametrize(("components", "rows"), [("keep", 0), ("largest", 1), ("split", 2)])
def test_parts_far_from_each_other_are_shapes_by_themselves(components, rows, scans, imported):
    (SPHERE + FAR.copy().apply_translation([1e9, 0, 0])).export(scans / "a.off", digits=17)
    dataset = imported(scans, components=components).dataset
    assert dataset.manifest.rows == rows
    for sample, mesh in zip(dataset.samples(), (SPHERE, FAR), strict=False):
        assert geometry.area(sample.mesh) == pytest.approx(mesh.area, rel=1e-6)


def test_500_spheres_in_a_file_are_one_shape_with_all_shares(scans, imported):
    ball = trimesh.creation.icosphere(subdivisions=1)
    many = [ball.copy().apply_translation([5 * i, 0, 0]) for i in range(500)]
    many[0].apply_scale(2.0)
    trimesh.util.concatenate(many).export(scans / "many.off", digits=17)
    (sample,) = imported(scans).dataset.samples()
    facts = sample.spec.parameters
    assert (facts["components"], facts["largest_share"]) == (500, round(4 / 503, 6))
    assert facts["shares"] == f"{4 / 503:.6f} {1 / 503:.6f}*499"
    assert sample.certificate.count > 500


def test_a_speck_beside_a_sphere_is_labelled_and_verified(scans, root, imported):
    """Rounding in its large eigenvalues says nothing of the sphere's small ones."""
    speck = trimesh.creation.icosphere(subdivisions=2).apply_scale(1e-5)
    trimesh.util.concatenate([SPHERE, speck]).export(scans / "speck.off", digits=17)
    (sample,) = imported(scans).dataset.samples()
    assert sample.spec.parameters["components"] == 2
    assert verify("mine", root=root).problems == ()


@pytest.mark.parametrize("cut", [False, True])
def test_fins_are_cut_by_the_command_line_if_asked(scans, run_import, root, cut):
    points = SPHERE.vertices.tolist()
    a, b = SPHERE.edges_unique[0]
    points.append(3 * (SPHERE.vertices[a] + SPHERE.vertices[b]))
    faces = [*SPHERE.faces.tolist(), [a, b, len(SPHERE.vertices)]]
    fin = trimesh.Trimesh(points, faces, process=False)
    fin.export(scans / "fin.off", digits=17)
    assert run_import(scans, *["--cut-fins"] * cut)[0] == (0 if cut else 2)
    (row,) = file_outcomes(store.open_dataset("mine", root))
    if cut:
        assert "1 edges cut from fins" in str(row["what"])
    else:
        assert str(row["what"]).startswith("non_manifold_edge: 1 edge has more than two faces")


def test_a_file_alone_is_imported(folder, imported):
    dataset = imported(folder / "a.ply", folder / "b.STL").dataset
    assert [row["file"] for row in file_outcomes(dataset)] == ["a.ply", "b.STL"]
    assert list(dataset.manifest.drawn) == ["my_meshes"]
    with pytest.raises(MeshImportError, match=r"f\.txt is none of \.obj"):
        imported(folder / "f.txt", name="other")


def test_shapes_are_found_by_the_name_of_their_file(folder, imported, mine, run, root, tmp_path):
    shutil.copy(folder / "a.ply", folder / "below" / "a.ply")
    dataset = imported(folder).dataset
    for name in ("below/c.obj", "c.obj", "c", "my_meshes-00003"):
        assert dataset.find(name).spec.id == "my_meshes-00003"
    assert dataset.find("a.ply").spec.id == "my_meshes-00000"  # its whole path
    with pytest.raises(StoreError, match="a is 2 shapes, such as my_meshes-00000 and my_meshes-0"):
        dataset.find("a")
    with pytest.raises(StoreError, match="was rejected by unreadable"):
        dataset.find("d.off")
    bound = dataset.find("c.obj").spec.parameters["error_bound"]
    for words, expected in (
        (["show", "c.obj"], "my_meshes-00003"),
        (["show", "c.obj"], f"each within a relative {bound:.1g} of the mesh's, rounding included"),
        (["info", "--shape", "d.off"], "unreadable: line 2"),
        (["info", "--ids"], "my_meshes-00003  below/c.obj"),
    ):
        assert expected in mine(*words)
    assert json.loads(mine("info", "--shape", "c.obj", "--json"))["id"] == "my_meshes-00003"
    listed = json.loads(mine("info", "--ids", "--json"))
    assert {"id": "my_meshes-00003", "file": "below/c.obj"} in listed
    assert [row["id"] for row in listed] == dataset.ids()
    drawn = json.loads(mine("gallery", "c.obj", "--png", tmp_path / "c.png", "--json"))
    assert drawn["ids"] == ["my_meshes-00003"]
    for words in (["info", "--shape", "none.obj"], ["show", "none.obj"]):
        missing = run(*words, "--dataset", "mine", "--out", root)
        message = "synthnet: no file 'none.obj' in mine: `synthnet info mine --ids` lists them"
        assert only_line(*missing) == message


@pytest.mark.parametrize("words", [["show", "none.off"], ["info", "--shape", "none.off"]])
def test_a_file_that_no_version_has_is_said(words, run, mini_home):
    line = only_line(*run(*words, "--dataset", "1.0-mini", "--out", mini_home))
    assert line == (
        "synthnet: 1.0-mini is no import, and has no file 'none.off': name yours by --dataset; "
        "`synthnet import` makes one, `synthnet spectrum none.off` takes the file alone"
    )


def test_a_shape_of_a_version_is_shown_by_another_command(run, mini_home):
    line = only_line(*run("info", "1.0-mini", "--shape", "cone-00003", "--out", mini_home))
    remedy = f"`synthnet show cone-00003 --dataset 1.0-mini --out {mini_home}`"
    assert line == f"synthnet: 1.0-mini is no import: {remedy}"
    line = only_line(*run("info", "1.0-mini", "--shape", "cone-99999", "--out", mini_home))
    assert "no shape 'cone-99999'" in line


def test_a_path_in_place_of_a_name_is_said(run, mini_home):
    path = mini_home / "1.0-mini"
    line = only_line(*run("info", path, "--out", mini_home))
    remedy = "give the name 1.0-mini, and as --out or root the directory above"
    assert line.endswith(f"holds 1.0-mini, not {path}: {remedy}")


def test_a_largest_component_of_less_than_half_is_said(folder, run_import):
    three = [SPHERE.copy().apply_translation([4.0 * i, 0, 0]) for i in range(3)]
    trimesh.util.concatenate(three).export(folder / "three.ply")
    code, _, err = run_import(folder)
    assert code == 0
    (line,) = [s for s in err.splitlines() if "warning" in s]
    assert "in 1 of the files (three.ply) the largest component has less than half" in line


def test_thin_meshes_are_labelled_within_the_limit_or_refused_and_verify_agrees(
    scans, root, imported
):
    for number in range(7):
        strip = thin(10.0**-number, "needles", seed=number)
        whole = trimesh.Trimesh(strip.vertices, strip.faces, process=False)
        whole.export(scans / f"{number}.off", digits=17)
    dataset = imported(scans).dataset
    assert {"0.off", "1.off", "2.off", "3.off"} <= {
        str(sample.spec.parameters["file"]) for sample in dataset.samples()
    }
    for sample in dataset.samples():
        assert float(sample.spec.parameters["error_bound"]) <= 1e-6
    assert {refused.reason for refused in dataset.manifest.rejections} == {"certificate"}
    details = " ".join(refused.detail for refused in dataset.manifest.rejections)
    assert "times the first, which another solver would lose in its rounding" in details
    assert verify("mine", root=root).problems == ()


def test_copies_of_a_file_are_in_one_split(scans, imported):
    for i in range(12):
        mesh = SPHERE.copy().apply_scale(1 + i / 10)
        mesh.export(scans / f"{i:02d}.off")
        mesh.export(scans / f"{i:02d}-copy.off")
    samples = list(imported(scans, split="hash").dataset.samples())
    for original, copy in zip(samples[1::2], samples[::2], strict=True):
        assert (original.split, original.spec.group) == (copy.split, copy.spec.group)
    assert len({sample.split for sample in samples}) > 1


def test_far_coordinates_keep_their_shape(scans, imported):
    SPHERE.copy().apply_translation([5e5, 4e6, 0]).export(scans / "a.ply", encoding="ascii")
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in np.add(SPHERE.vertices, [5e5, 4e6, 0])]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in SPHERE.faces]
    (scans / "b.obj").write_text("\n".join(lines))
    *_, sample = imported(scans).dataset.samples()
    assert np.abs(sample.mesh.vertices).max() < 1.1
    assert sample.eigenvalues[:3] == pytest.approx([2, 2, 2], rel=0.05)


@pytest.mark.parametrize("name", ["1.0", "../up", ""])
def test_name_that_will_not_do_is_refused(name, folder, imported, root):
    with pytest.raises(MeshImportError, match="--name must begin with a letter"):
        imported(folder, name=name)
    assert not root.exists()


def test_directories_that_will_not_do_are_refused(folder, imported, root, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "other" / "my-meshes").mkdir(parents=True)
    shutil.copy(folder / "a.ply", tmp_path / "other" / "my-meshes")
    (tmp_path / "link").symlink_to(folder)
    os.mkfifo(tmp_path / "pipe")
    for places, expected in (
        ([tmp_path / "none"], "there is no file or directory .*none"),
        ([tmp_path / "pipe"], "pipe is a pipe or a device: give directories or files"),
        ([Path("/dev/null")], "/dev/null is a pipe or a device"),
        ([tmp_path / "empty"], r"has no \.obj, \.off, \.ply, \.stl, .* file"),
        ([folder, tmp_path / "other" / "my-meshes"], "would both be the family my_meshes"),
        ([folder, folder / "."], "are the same or one within the other: give one of them"),
        ([folder, tmp_path / "link"], "are the same or one within the other: give one of them"),
        ([folder / "below", folder], "are the same or one within the other: give one of them"),
    ):
        with pytest.raises(MeshImportError, match=expected):
            imported(*places)
    assert not root.exists()


@pytest.mark.parametrize(
    ("above", "name"), [("", "scans"), ("scans", "data"), ("scans/below", "deep"), ("..", "here")]
)
def test_dataset_is_never_among_the_meshes(above, name, folder, imported, tmp_path):
    directory = tmp_path / "here" / "scans"
    directory.parent.mkdir()
    shutil.copytree(folder, directory)
    before = contents(tmp_path)
    with pytest.raises(MeshImportError, match=r"dataset's directory .* are the same or one"):
        imported(directory, name=name, root=directory.parent / above)
    assert contents(tmp_path) == before


def test_dataset_is_never_written_over_other_things(folder, imported, root):
    (root / "mine").mkdir(parents=True)
    (root / "mine" / "thesis.tex").write_text("mine")
    (root / "note").write_text("mine")
    with pytest.raises(MeshImportError, match=r"holds thesis\.tex, which is of no import: nothing"):
        imported(folder)
    with pytest.raises(MeshImportError, match="note is no directory: choose another --out"):
        imported(folder, name="note")
    assert len(contents(root)) == 2


def test_files_that_cannot_be_opened_are_rejections(folder, imported, monkeypatch):
    (folder / "loop.obj").symlink_to("loop.obj")
    (folder / "gone.obj").symlink_to("nowhere.obj")
    (folder / "secret").mkdir()
    (folder / "below" / "up").symlink_to(folder)
    os.mkfifo(folder / "pipe.stl")
    scan = os.scandir

    def denied(path):
        if Path(path).name == "secret":
            raise PermissionError(13, "Permission denied", path)
        return scan(path)

    monkeypatch.setattr(os, "scandir", denied)
    outcomes = outcomes_by_file(imported(folder))
    assert outcomes["gone.obj"] == "unreadable: cannot be opened (No such file or directory)"
    assert re.fullmatch(r"unreadable: cannot be opened \(.*symbolic links\)", outcomes["loop.obj"])
    assert outcomes["secret/"] == "unreadable: cannot be opened (Permission denied)"
    assert outcomes["pipe.stl"] == "unreadable: is no file"
    link = "unreadable: is a link to a directory, and not followed: name the directory"
    assert outcomes["below/up/"] == link
    assert len(outcomes) == 10
    assert outcomes["a.ply"] == ""


def test_file_that_changes_or_goes_in_between_is_a_rejection(folder, imported):
    class Meddler(Watcher):
        def planned(self, drawn):
            TORUS.export(folder / "a.ply")
            (folder / "b.STL").unlink()

    outcomes = outcomes_by_file(imported(folder, watcher=Meddler()))
    assert outcomes["a.ply"] == "changed: its bytes are others than when the import began"
    assert outcomes["b.STL"] == "unreadable: cannot be opened (No such file or directory)"
    assert outcomes["below/c.obj"] == ""


def test_directory_that_goes_in_between_stops_the_import(folder, imported):
    class Unmounted(Watcher):
        def planned(self, drawn):
            folder.rename(folder.with_name("elsewhere"))

    with pytest.raises(BuildError, match=r"the worker on .* does not see .*My Meshes: the meshes"):
        imported(folder, watcher=Unmounted())


def test_files_of_odd_names(folder, imported, run_import, mine):
    names = [b"a: b.ply", b"\xff.ply", b"new\nline.ply", b"\x1b[31m.ply", "é.ply".encode()]
    for name in names:
        shutil.copy(folder / "a.ply", folder / os.fsdecode(name))
    (folder / "x: y.off").write_text("OFF\n3 nonsense")
    result = imported(folder)
    outcomes = outcomes_by_file(result)
    by_its_bytes, as_listed = map(result.dataset.find, (os.fsdecode(b"\xff.ply"), r"\udcff.ply"))
    assert by_its_bytes.spec.id == as_listed.spec.id
    assert outcomes["a: b.ply"] == outcomes["é.ply"] == outcomes[r"\udcff.ply"] == ""
    assert outcomes[r"new\nline.ply"] == outcomes[r"\x1b[31m.ply"] == ""
    assert outcomes["x: y.off"] == "unreadable: line 2: '3 nonsense': no whole numbers"
    assert len(outcomes) == 11
    code, out, _ = run_import(folder)
    assert code == 0
    out += mine("info")
    assert "x: y.off: line 2: '3 nonsense'" in out.encode().decode()  # all of it can be encoded
    assert "imported already: nothing to do" in out


def test_too_large_files_are_rejections(folder, imported, monkeypatch):
    size = (folder / "below" / "c.obj").stat().st_size
    monkeypatch.setattr(sources, "MOST_BYTES", size - 1)
    monkeypatch.setattr(repair, "MOST_VERTICES", 161)
    outcomes = outcomes_by_file(imported(folder))
    assert outcomes["below/c.obj"] == f"too_large: {size:,} bytes, more than {size - 1:,}"
    assert outcomes["a.ply"] == outcomes["b.STL"] == "too_large: 162 vertices, more than 161"
    assert len(outcomes) == 5


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        (MemoryError(), "memory: its surface or label needs more memory than there is"),
        (ValueError("a vertex\nno triangle"), "solver: a vertex no triangle"),
    ],
)
def test_label_that_fails_is_the_file_s_own_rejection(
    error, expected, folder, imported, monkeypatch
):
    solve = label.unwarned

    def failing(mesh, *options, **more):
        if len(mesh.vertices) == len(TORUS.vertices):
            raise error
        return solve(mesh, *options, **more)

    monkeypatch.setattr(label, "unwarned", failing)
    outcomes = outcomes_by_file(imported(folder))
    assert outcomes["below/c.obj"] == expected
    assert outcomes["a.ply"] == ""


def test_mobius_band_is_not_called_repaired(scans, imported):
    band = FAMILIES["mobius_band"].generate(
        {"width": 1.0, "half_turns": 1, "triangulation": "uniform", "vertices": 50, "seed": 0}
    )
    trimesh.Trimesh(band.vertices, band.faces, process=False).export(scans / "a.off", digits=17)
    (row,) = file_outcomes(imported(scans).dataset)
    assert (row["outcome"], row["what"]) == ("as it was", "not orientable")


@pytest.mark.parametrize("n", [9, 10, 11, 12, 25])
def test_smallest_surfaces_are_labelled_and_verified(n, scans, root, imported):
    """Pyramids over a polygon: n + 2 vertices."""
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.column_stack([np.cos(angle), 1.1 * np.sin(angle), 0.1 * np.sin(3 * angle)])
    faces = [[i, (i + 1) % n, n] for i in range(n)] + [[(i + 1) % n, i, n + 1] for i in range(n)]
    mesh = trimesh.Trimesh([*rim, [0, 0, 1], [0, 0, -1]], faces, process=False)
    mesh.export(scans / "a.off")
    assert imported(scans).dataset.manifest.rows == 1
    assert verify("mine", root=root).problems == ()


def test_ten_vertices_are_too_few(scans, imported):
    trimesh.creation.box().export(scans / "a.off")
    assert outcomes_by_file(imported(scans)) == {
        "a.off": "few_vertices: 8 vertices, a spectrum needs at least 11"
    }


@pytest.mark.parametrize("size", [1e-3, 1e5])
def test_any_unit_is_verified(size, scans, root, imported):
    TORUS.copy().apply_scale(size).export(scans / "a.off", digits=17)
    (sample,) = imported(scans).dataset.samples()
    expected = spectrum.compute(TORUS)
    assert sample.eigenvalues * size**2 == pytest.approx(expected.eigenvalues, rel=1e-5)
    assert verify("mine", root=root).problems == ()


def test_eigenvalues_next_to_zero_are_verified(scans, root, imported):
    """One vertex of a torus far away: relative to itself no solver is exact to 1e-8 there."""
    spiked = TORUS.copy()
    spiked.vertices[7] *= 1e4
    spiked.export(scans / "a.off", digits=17)
    (sample,) = imported(scans).dataset.samples()
    assert sample.eigenvalues[0] < 1e-4 * 40 * np.pi / spiked.area
    assert verify("mine", root=root).problems == ()


def test_verify_compares_the_shapes_with_the_list_of_files(folder, imported, root):
    dataset = imported(folder).dataset
    (path,) = dataset.paths()
    manifest = dataset.manifest
    samples = list(store.read_samples(path))
    spec = samples[0].spec
    altered = [
        replace(samples[0], spec=replace(spec, parameters={**spec.parameters, "file": "b"})),
        replace(samples[1], isometries=-np.eye(3)[None], split="train"),
        replace(samples[2], spec=replace(samples[2].spec, id="my_meshes-00009")),
        samples[3],
    ]
    options = {"family": "my_meshes", "recipe_digest": manifest.recipe_digest}
    record = store.write_shard(path, altered, manifest.rejections, **options)
    listed = {**manifest.recipe, "limits": "1.0-mini"}
    store.write_manifest(dataset.directory, replace(manifest, shards=(record,), recipe=listed))
    problems = {c.name: list(c.problems) for c in verify("mine", root=root).checks}
    assert problems["manifest"] == ["manifest: its digest is not that of its options and files"]
    assert problems["recipe"] == [
        "my_meshes-00000: file or SHA-256 differ from the manifest's list",
        "my_meshes-00001: group or splits differ from those of its file",
        "my_meshes-00001: isometries are not the identity alone",
        "my_meshes-00009: not in the manifest's list of files",
        "my_meshes-00002: 0 times among those stored or rejected",
    ]
    assert problems["digests"] == problems["shards"] == problems["labels"] == []


def test_import_without_a_list_of_files_cannot_be_verified(folder, imported, root):
    dataset = imported(folder).dataset
    old = replace(dataset.manifest, recipe={"imported": {}, "rules": "1.0"})
    store.write_manifest(dataset.directory, old)
    with pytest.raises(StoreError, match="imported by an older synthnet: remove it and import"):
        verify("mine", root=root)


@pytest.mark.slow
def test_predictor_is_evaluated_on_an_import(folder, imported, root, tmp_path, capsys):
    imported(folder)
    code = "import numpy as np\n\ndef predict(meshes):\n    return np.ones((len(meshes), 10))\n"
    (tmp_path / "ones.py").write_text(code)
    where = ["--dataset", "mine", "--root", str(root)]
    out = ["--out", str(tmp_path / "ones.json")]
    assert eigbench_cli.main(["evaluate", str(tmp_path / "ones.py"), *where, *out]) == 0
    result = json.loads((tmp_path / "ones.json").read_text())
    assert result["dataset"]["version"] == "mine"
    assert result["dataset"]["shapes"] == 4
    submit = ["submit", str(tmp_path / "ones.json"), *where, "--board", str(tmp_path / "board")]
    assert eigbench_cli.main(submit) == 2
    assert "the labels of mine are not pinned" in capsys.readouterr().err
    (tmp_path / "board" / "benchmark" / "results").mkdir(parents=True)
    assert eigbench_cli.main([*submit, "--dry-run"]) == 0
    assert "would have rank 1 of 1" in capsys.readouterr().out


def test_reasons_are_those_of_the_documentation():
    code = Path(repair.__file__).read_text()
    reasons = set(re.findall(r'Refused\(\s*"(\w+)"', code))
    reasons |= {sources.UNREADABLE, sources.TOO_LARGE, surfaces.CHANGED, surfaces.MEMORY}
    reasons |= {filters.SOLVER, filters.CERTIFICATE, *filters.SPECTRUM_CHECKS}
    assert len(reasons) == 18
    assert reasons <= set(re.findall(r"`(\w+)`", PAGE))


def test_command_line(folder, run_import, mine):
    for name in ("more.txt", "a.mtl", "b.MTL", "LICENSE"):
        (folder / name).write_text("no mesh")
    code, out, _ = run_import(folder)
    assert code == 0
    assert "5 other files, not read as meshes: 2 .mtl, 2 .txt, 1 without a suffix" in out
    assert "5 files: 3 as it was, 1 repaired, 1 rejected" in out
    assert "a.ply" in out  # though nothing befell it
    assert "2 components, the largest has 80.0% of the area" in out
    code, out, _ = run_import(folder, "--json")
    printed = json.loads(out)
    assert (code, len(printed["files"])) == (0, 5)
    assert printed["not_meshes"] == {".mtl": 2, ".txt": 2, "without a suffix": 1}
    assert mine("info")


PAGE = (Path(__file__).parents[2] / "docs" / "import.md").read_text()


def test_the_command_for_thingi10k_imports_a_folder_of_its_layout(run, root, tmp_path, monkeypatch):
    directory = tmp_path / "Thingi10K" / "raw_meshes"
    directory.mkdir(parents=True)
    SPHERE.export(directory / "32770.stl")
    (SPHERE + FAR).export(directory / "36082.stl")
    (directory / "37322.stl").write_bytes(b"solid")
    monkeypatch.chdir(tmp_path)
    (line,) = re.findall(r"^synthnet import Thingi10K.*$", PAGE, flags=re.M)
    code, out, _ = run(*shlex.split(line)[1:], "--out", root, "--workers", 1)
    assert code == 0
    for number, outcome in (
        ("32770", "repaired"),
        ("36082", "1 components left out"),
        ("37322", "rejected"),
    ):
        (row,) = (row for row in out.splitlines() if f"{number}.stl" in row)
        assert outcome in row
    stored = store.open_dataset("thingi10k", root)
    areas = [geometry.area(sample.mesh) for sample in stored.samples()]
    assert areas == pytest.approx([1.0, 1.0], rel=1e-6)


def test_page_shows_what_became_of_the_hostile_files():
    data = Path(__file__).parents[2] / "docs" / "data" / "import-hostile.json"
    files = json.loads(data.read_text())["files"]
    assert len(files) == 10
    for file in files:
        assert f"| `{file['file']}` | {file['outcome']} | {file['what']} |\n" in PAGE


def test_number_of_workers_is_checked(folder, run_import, root):
    line = only_line(*run_import(folder, workers=0))
    assert "argument --workers: must be at least 1, got 0" in line
    assert not root.exists()


def test_verify_tells_of_an_import_what_makes_it_anew(folder, imported, run, root):
    (shard,) = imported(folder).dataset.paths()
    Path(shard).unlink()
    code, out, _ = run("verify", "--files", "--dataset", "mine", "--out", root)
    assert code == 1
    assert "or for an import the same `synthnet import`" in out
    assert "run the `synthnet import` of mine again" in out


def test_folder_without_one_good_file_exits_with_2(scans, run_import, root):
    (scans / "a.obj").write_text("f 1 2 3\n")
    code, out, err = run_import(scans)
    assert code == 2
    assert "unreadable" in out
    assert "synthnet: no file became a shape" in err
    with pytest.raises(StoreError, match=r"mine has no shape: `synthnet info mine` says why$"):
        SynthNet(root, "mine", split="test")


@pytest.mark.slow
def test_altered_files_become_certified_shapes_or_rejections():
    measured = fuzz_import.measure(cases=36, seed=1)
    assert measured["problems"] == []
    assert sum(sum(row.values()) for row in measured["outcomes"].values()) == 36
    assert "unreadable" in {name for row in measured["outcomes"].values() for name in row}
