"""Machine code that is kept for the next process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from synthnet import kernels

SOURCE = """
from synthnet.kernels import kernel

@kernel
def _twice(x):
    return 2.0 * x
"""


@pytest.mark.parametrize("order", [("room.part", "part"), ("part", "room.part")])
def test_a_module_may_be_imported_by_two_names(order: tuple[str, str], tmp_path: Path) -> None:
    """As baselines.gcn by its training, and as gcn by its rows."""
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "part.py").write_text(SOURCE)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    for name in order:
        folder = tmp_path / "room" if name == "part" else tmp_path
        code = f"import sys; sys.path.insert(0, {str(folder)!r})\n"
        code += f"import importlib; print(importlib.import_module({name!r})._twice(2.0))"
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        assert (done.returncode, done.stdout) == (0, "4.0\n"), done.stderr
    assert list((tmp_path / "cache").rglob("*.nbi"))


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


def test_a_program_and_its_processes_say_once_that_they_compile(tmp_path: Path) -> None:
    (tmp_path / "part.py").write_text(SOURCE)
    (tmp_path / "program.py").write_text(COMPILES)
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    environment["TMPDIR"] = str(tmp_path)
    del environment[kernels.SAID]  # empty in tests

    def stderr() -> str:
        command = [sys.executable, "program.py", "with others"]
        done = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return done.stderr

    assert stderr() == f"{kernels.COMPILING.format(how='once')}\n"
    assert stderr() == ""
    assert not list(tmp_path.glob("*compiling*"))
