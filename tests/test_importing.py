"""Folders of mesh files become datasets; a bad file is a rejection and stops no other."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import trimesh
from eigbench import truth

import synthnet
from synthnet import cli, spectrum, store
from synthnet.build import BuildReport
from synthnet.errors import MeshImportError, StoreError
from synthnet.importing import Settings, import_meshes, what_was_met
from synthnet.pyg import SynthNet
from synthnet.types import Mesh
from synthnet.verify import verify, verify_files
from synthnet.workers import given

SPHERE = trimesh.creation.icosphere(subdivisions=2)
TORUS = trimesh.creation.torus(3.0, 1.0, major_sections=16, minor_sections=12)
FAR = SPHERE.copy().apply_translation([10.0, 0, 0]).apply_scale(0.5)


def seamed(mesh: trimesh.Trimesh) -> str:
    """Return OBJ text in which every face has texture coordinates of its own."""
    lines = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in mesh.vertices]
    lines += [f"vt {i / len(mesh.faces)} {c / 3}" for i in range(len(mesh.faces)) for c in range(3)]
    for i, face in enumerate(mesh.faces):
        lines.append("f " + " ".join(f"{v + 1}/{3 * i + c + 1}" for c, v in enumerate(face)))
    return "\n".join(lines) + "\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two directories of files that each meet one rule, or none."""
    place = tmp_path / "My Meshes"
    (place / "below").mkdir(parents=True)
    SPHERE.export(place / "a.ply")
    SPHERE.export(place / "b.STL", file_type="stl")
    (place / "below" / "c.obj").write_text(seamed(TORUS))
    (place / "d.off").write_text("OFF\n3 nonsense")
    (SPHERE + FAR).export(place / "e.ply")
    (place / "f.txt").write_text("no mesh")
    return place


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., BuildReport]:
    def imported(*places: Path, name: str = "mine", **options: object) -> BuildReport:
        with ThreadPoolExecutor(1) as pool:
            settings = Settings(**options)  # type: ignore[arg-type]
            root = tmp_path / "root"
            return import_meshes(places, name, settings, root=root, engine=given(pool, 1))

    return imported


def test_folder_becomes_a_dataset(folder: Path, run: Callable[..., BuildReport]) -> None:
    dataset = run(folder).dataset
    rows = {row["file"]: (row["outcome"], row["what"]) for row in what_was_met(dataset)}
    merged = 3 * len(SPHERE.faces) - len(SPHERE.vertices)
    cut = 3 * len(TORUS.faces) - len(TORUS.vertices)
    assert rows["a.ply"] == ("as it was", "")
    assert rows["b.STL"] == ("repaired", f"{merged:,} merged vertices")
    assert rows["below/c.obj"] == ("repaired", f"{cut:,} merged vertices")
    assert rows["d.off"][0] == "rejected"
    assert rows["d.off"][1].startswith("unreadable: ")
    assert rows["e.ply"] == (
        "rejected",
        "components: 2 components, the largest has 80.0% of the area",
    )
    assert len(rows) == 5
    ids = [sample.spec.id for sample in dataset.samples()]
    assert ids == ["my_meshes-00000", "my_meshes-00001", "my_meshes-00002"]


def test_labels_are_those_of_the_surface(folder: Path, run: Callable[..., BuildReport]) -> None:
    ply, stl, torus = run(folder).dataset.samples()
    for sample, mesh in ((ply, SPHERE), (stl, SPHERE), (torus, TORUS)):
        wanted = spectrum.compute(Mesh(np.array(mesh.vertices), np.array(mesh.faces)))
        assert sample.eigenvalues == pytest.approx(wanted.eigenvalues, rel=1e-5)
        assert sample.certificate.count >= 11
        assert sample.split == "test"
        assert sample.paper_splits == ("test",)
        assert sample.isometries.tolist() == [np.eye(3).tolist()]


def test_every_reader_takes_it(
    folder: Path, run: Callable[..., BuildReport], tmp_path: Path
) -> None:
    dataset = run(folder).dataset
    root = tmp_path / "root"
    shapes = SynthNet(version="mine", split="test", root=root)
    assert len(shapes) == 3
    assert shapes[2].y[0].numpy() == pytest.approx(list(dataset.samples())[2].eigenvalues, rel=1e-6)
    assert len(synthnet.load_dataset("mine", split="test", root=root)) == 3
    with pytest.raises(StoreError, match="mine has no shape in the split train"):
        synthnet.load_dataset("mine", split="train", root=root)
    assert truth.of_dataset(dataset).eigenvalues.shape == (3, 10)
    for report in (verify("mine", root=root), verify_files("mine", root=root)):
        assert report.problems == ()


def test_verify_finds_an_altered_label(
    folder: Path, run: Callable[..., BuildReport], tmp_path: Path
) -> None:
    dataset = run(folder).dataset
    (path,) = dataset.paths()
    samples = list(store.read_samples(path))
    for sample in samples:
        sample.eigenvalues[0] *= 1.5
    rejections = dataset.manifest.rejections
    digest = dataset.manifest.recipe_digest
    store.write_shard(path, samples, rejections, family="my_meshes", recipe_digest=digest)
    found = {c.name: len(c.problems) for c in verify("mine", root=tmp_path / "root").checks}
    assert found["digests"] == 1
    assert found["labels"] == 3


def test_second_import_keeps_the_shards_and_changed_files_are_refused(
    folder: Path, run: Callable[..., BuildReport], tmp_path: Path
) -> None:
    first = run(folder)
    files = {p: p.read_bytes() for p in (tmp_path / "root" / "mine").rglob("*") if p.is_file()}
    again = run(folder)
    assert (first.reused, again.reused) == (0, 1)
    assert all(p.read_bytes() == content for p, content in files.items())
    (shard,) = first.dataset.paths()
    Path(shard).write_bytes(Path(shard).read_bytes()[:-9])
    assert run(folder).reused == 0  # made anew
    assert all(p.read_bytes() == content for p, content in files.items())
    TORUS.export(folder / "a.ply")
    with pytest.raises(StoreError, match="belongs to another recipe: remove"):
        run(folder)
    shutil.rmtree(tmp_path / "root" / "mine")
    assert run(folder).dataset.manifest.rows == 3


def test_unit_area_is_recorded(folder: Path, run: Callable[..., BuildReport]) -> None:
    for sample in run(folder, unit_area=True).dataset.samples():
        scale = float(sample.spec.parameters["scale"])
        mesh = TORUS if "below" in str(sample.spec.parameters["file"]) else SPHERE
        assert scale == pytest.approx(mesh.area**-0.5, rel=1e-6)
        wanted = spectrum.compute(Mesh(np.array(mesh.vertices), np.array(mesh.faces)))
        assert sample.eigenvalues * scale**2 == pytest.approx(wanted.eigenvalues, rel=1e-5)


def test_largest_component_is_kept_if_asked(folder: Path, run: Callable[..., BuildReport]) -> None:
    rows = what_was_met(run(folder, keep_largest=True).dataset)
    (kept,) = [row for row in rows if row["file"] == "e.ply"]
    assert (kept["outcome"], kept["what"]) == ("repaired", "1 components left out")
    assert kept["vertices"] == len(SPHERE.vertices)


def test_copies_of_a_file_are_in_one_split(tmp_path: Path, run: Callable[..., BuildReport]) -> None:
    place = tmp_path / "many"
    place.mkdir()
    for i in range(12):
        mesh = SPHERE.copy().apply_scale(1 + i / 10)
        mesh.export(place / f"{i:02d}.off")
        mesh.export(place / f"{i:02d}-copy.off")
    samples = list(run(place, split="hash").dataset.samples())
    for one, copy in zip(samples[1::2], samples[::2], strict=True):
        assert (one.split, one.spec.group) == (copy.split, copy.spec.group)
    assert len({sample.split for sample in samples}) > 1


def test_far_coordinates_keep_their_shape(tmp_path: Path, run: Callable[..., BuildReport]) -> None:
    place = tmp_path / "far"
    place.mkdir()
    SPHERE.copy().apply_translation([5e5, 4e6, 0]).export(place / "a.ply", encoding="ascii")
    lines = [f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in np.add(SPHERE.vertices, [5e5, 4e6, 0])]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in SPHERE.faces]
    (place / "b.obj").write_text("\n".join(lines))
    *_, sample = run(place).dataset.samples()
    assert np.abs(sample.mesh.vertices).max() < 1.1
    assert sample.eigenvalues[:3] == pytest.approx([2, 2, 2], rel=0.05)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("1.0", "--name must be a letter"),
        ("../up", "--name must be a letter"),
        ("", "--name must be a letter"),
    ],
)
def test_name_that_will_not_do_is_refused(
    name: str, told: str, folder: Path, run: Callable[..., BuildReport], tmp_path: Path
) -> None:
    with pytest.raises(MeshImportError, match=told):
        run(folder, name=name)
    assert not (tmp_path / "root").exists()


def test_directories_that_will_not_do_are_refused(
    folder: Path, run: Callable[..., BuildReport], tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "other" / "my-meshes").mkdir(parents=True)
    shutil.copy(folder / "a.ply", tmp_path / "other" / "my-meshes")
    for places, told in (
        ([tmp_path / "none"], "is no directory"),
        ([tmp_path / "empty"], r"has no \.obj, \.off, \.ply, \.stl file"),
        ([folder, tmp_path / "other" / "my-meshes"], "would both be the family my_meshes"),
    ):
        with pytest.raises(MeshImportError, match=told):
            run(*places)
    assert not (tmp_path / "root").exists()


def test_command_line(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = ["--name", "mine", "--out", str(tmp_path / "root"), "--workers", "1"]
    assert cli.main(["import", str(folder), *where]) == 0
    out = capsys.readouterr().out
    assert "5 files: 1 as it was, 2 repaired, 2 rejected" in out
    assert "a.ply" not in out  # nothing befell it
    assert "components: 2 components" in out
    assert cli.main(["import", str(folder), *where, "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["files"]) == 5
    assert cli.main(["info", "--version", "mine", "--out", str(tmp_path / "root")]) == 0


def test_folder_without_one_good_file_exits_with_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "a.obj").write_text("f 1 2 3\n")
    where = ["--name", "bad", "--out", str(tmp_path / "root"), "--workers", "1"]
    assert cli.main(["import", str(tmp_path / "bad"), *where]) == 2
    captured = capsys.readouterr()
    assert "unreadable" in captured.out
    assert "synthnet: no file became a shape" in captured.err


@pytest.mark.slow
def test_altered_files_become_certified_shapes_or_rejections(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(Path(__file__).parent.parent / "scripts")
    import fuzz_import

    found = fuzz_import.run(cases=36, seed=1)
    assert found["problems"] == []
    assert sum(sum(row.values()) for row in found["outcomes"].values()) == 36
    assert "unreadable" in {name for row in found["outcomes"].values() for name in row}
