"""Machine code that is kept for the next process."""

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import platformdirs
import pytest

from synthnet import kernels, spectrum

SOURCE = """
from synthnet.kernels import kernel

@kernel
def _twice(x):
    return 2.0 * x
"""


def python(*command, folder, cache, told=True):
    """Run Python in a folder with a cache; "told": it does not say that kernels are compiled."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "TMPDIR": str(cache.parent)}
    if not told:
        del environment[kernels.SAID]
    done = subprocess.run(
        [sys.executable, *command],
        env=environment,
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.mark.parametrize(
    "order",
    [("room.part", "part"), pytest.param(("part", "room.part"), marks=pytest.mark.slow)],
)
def test_a_module_may_be_imported_by_two_names(order, tmp_path):
    """As baselines.gcn by its training, and as gcn by its rows."""
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "part.py").write_text(SOURCE)
    for name in order:
        folder = tmp_path / "room" if name == "part" else tmp_path
        code = f"import sys; sys.path.insert(0, {str(folder)!r})\n"
        code += f"import importlib; print(importlib.import_module({name!r})._twice(2.0))"
        out, _ = python("-c", code, folder=folder, cache=tmp_path / "cache")
        assert out == "4.0\n"
    assert list((tmp_path / "cache").rglob("*.nbi"))


UNCOMPILED = """
import numpy as np
from synthnet import spectrum
from synthnet.kernels import kernel
from synthnet.types import Mesh

def plain(x):
    return x

assert kernel(plain) is plain
vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
print(spectrum.compute(Mesh(vertices, faces), 2).eigenvalues.round(6))
"""


def test_without_numbas_compiler_the_solver_runs_in_python(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    out, err = python("-c", UNCOMPILED, folder=Path.cwd(), cache=tmp_path / "cache")
    assert (out, err) == ("[2. 2.]\n", "")  # stiffness 4/√3, mass 2√3/3


COMPILES = """
import subprocess
import sys
import part

if sys.argv[1:]:
    both = [subprocess.Popen([sys.executable, __file__]) for _ in range(2)]
    assert not any(process.wait() for process in both)
part._twice(2.0)
part._twice(2)  # of whole numbers: compiled a second time
"""


@pytest.mark.slow
def test_a_program_and_its_processes_say_once_that_they_compile(tmp_path):
    (tmp_path / "part.py").write_text(SOURCE)
    (tmp_path / "program.py").write_text(COMPILES)
    for line in (f"{kernels.COMPILING.format(how='kept from now on')}\n", ""):
        command = ("program.py", "with others")
        _, err = python(*command, folder=tmp_path, cache=tmp_path / "cache", told=False)
        assert err == line
    assert not list(tmp_path.glob("*compiling*"))


@pytest.fixture(autouse=True)
def checked_anew():
    kernels.own.cache_clear()
    yield
    kernels.own.cache_clear()


def test_the_folder_is_the_users_own(tmp_path, monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    assert kernels.folder() == platformdirs.user_cache_path("synthnet-kernels")
    path = tmp_path / "cache" / "kernels"
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(path))
    assert (kernels.folder(), kernels.own(path)) == (path, "")
    assert stat.S_IMODE(path.stat().st_mode) == 0o700


@pytest.mark.attack
def test_a_folder_of_the_users_own_is_closed_to_others(tmp_path, monkeypatch):
    """As one that was made by an earlier release, or by hand; not every file system has modes."""

    def refused(path, mode):
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM), str(path))

    mine, without_modes = tmp_path / "mine", tmp_path / "without modes"
    for path in (mine, without_modes):
        path.mkdir()
        path.chmod(0o755)
    assert kernels.own(mine) == ""
    assert stat.S_IMODE(mine.stat().st_mode) == 0o700
    monkeypatch.setattr(Path, "chmod", refused)
    assert kernels.own(without_modes) == ""


@pytest.mark.attack
def test_a_folder_that_another_could_have_written_to_is_not_used(tmp_path, monkeypatch):
    open_to_all, linked, file = (tmp_path / name for name in ("open", "linked", "file"))
    open_to_all.mkdir()
    open_to_all.chmod(0o777)
    linked.symlink_to(open_to_all)
    file.touch()
    assert kernels.own(open_to_all) == f"others may write to {open_to_all}: remove it"
    assert kernels.own(linked) == f"{linked} is no folder: remove it"
    assert "cannot be made (File exists)" in kernels.own(file)
    mine = tmp_path / "mine"
    monkeypatch.setattr(kernels.os, "geteuid", lambda: os.getuid() + 1)
    remedy = "is another user's: set NUMBA_CACHE_DIR to a folder of your own"
    assert kernels.own(mine) == f"{mine} {remedy}"


@pytest.mark.attack
def test_what_lies_beside_a_module_is_never_loaded(tmp_path):
    """A kernel that is planted there would run: Numba unpickles it."""
    (tmp_path / "part.py").write_text(SOURCE)
    cache = tmp_path / "cache"
    code = "import part; print(part._twice(2.0), part._twice.stats.cache_path)"
    out, err = python("-c", code, folder=tmp_path, cache=cache, told=False)
    assert out.startswith(f"4.0 {cache}")
    assert err == f"{kernels.COMPILING.format(how='kept from now on')}\n"
    cache.chmod(0o777)
    out, err = python("-c", code, folder=tmp_path, cache=cache, told=False)
    how = f"anew by every process, as others may write to {cache}: remove it"
    assert (out, err) == ("4.0 None\n", f"{kernels.COMPILING.format(how=how)}\n")
    assert not list(tmp_path.glob("__pycache__/*.nb?"))
    assert len(list(cache.rglob("*.nbi"))) == 1


def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    full = tmp_path / "cache"
    full.touch()  # Numba can make no folder below it
    monkeypatch.setattr(kernels, "own", lambda path: "")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(full))

    def twice(x):
        return 2.0 * x

    compiled = kernels.kernel(twice)
    assert f"as {full} cannot be written: set NUMBA_CACHE_DIR" in kernels.KEPT.pop(twice)
    assert compiled.stats.cache_path is None
    assert str(full) != kernels.config.CACHE_DIR


def test_kernels_of_a_folder_are_found_where_numba_keeps_them_and_no_others():
    spectrum.compile_solver()
    room = Path(spectrum.__file__).parent
    found = list(kernels.compiled([room, room.parent / "commands"]))
    names = {path.name.split("_synthnet")[0] for path in found}
    assert {"fem._add_triangles", "lanczos._extend", "ldl._factorise"} <= names
    assert len({path.parent for path in found}) == 1
    assert list(kernels.compiled([room.parent / "commands"])) == []
