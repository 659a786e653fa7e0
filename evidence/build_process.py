"""Builds of 1.0-mini as processes that can be killed, and what they leave behind."""

from __future__ import annotations

import contextlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

VERSION = "1.0-mini"
PATIENCE = 300.0  # seconds: a build that takes longer hangs
LARGE = ("split_sphere", "inverted_cone", "rectangular_prism", "cone", "cylinder")
Files = dict[str, bytes]  # contents by name, relative to the dataset's directory


class Build:
    """``synthnet build`` in a process group of its own."""

    def __init__(self, home: Path | str, *options: str) -> None:
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - as long as the process
        self.text = ""
        command = [sys.executable, "-m", "synthnet", "build", VERSION]
        self.process = subprocess.Popen(
            [*command, "--out", str(home), *options],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
            # A shell's background job ignores Ctrl-C, and its children would too.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            stdout=subprocess.DEVNULL,
            stderr=self.errors,
        )

    def wait(self) -> int:
        """Return the exit code; a build that hangs is killed, and its code is not 0 or 2."""
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.kill_all()
        code = self.process.wait()
        if not self.errors.closed:
            self.errors.seek(0)
            self.text = self.errors.read()
            self.errors.close()
        return code

    def failure(self) -> str:
        """Return the exit code and the end of what it wrote to standard error."""
        return f"exit code {self.wait()}: {self.text[-500:]}"

    def refusal(self) -> str | None:
        """Return the one line of a build that has ended with exit code 2."""
        code = self.wait()
        lines = [line for line in self.text.splitlines() if line.startswith("synthnet: ")]
        alone = len(lines) == 1 and "Traceback" not in self.text
        return lines[0] if alone and code == 2 else None

    def workers(self) -> list[int]:
        """Return the processes that make shards."""
        return [pid for pid, line in group(self.process.pid) if "spawn_main" in line]

    def kill(self, victim: str, rng: random.Random) -> None:
        """Kill the build, a worker or all its processes, which do not get to notice."""
        if victim == "all its processes":
            self.kill_all()
        elif victim == "a worker" and (workers := self.workers()):
            with contextlib.suppress(ProcessLookupError):
                os.kill(rng.choice(workers), signal.SIGKILL)
        else:
            self.process.kill()

    def kill_all(self) -> None:
        """Kill the group."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)


def group(leader: int) -> Iterator[tuple[int, str]]:
    """Yield number and command line of the processes alive in a group."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        with contextlib.suppress(OSError):  # it may end meanwhile
            state, _, pgrp = (entry / "stat").read_text().rpartition(") ")[2].split()[:3]
            if int(pgrp) == leader and state not in "ZX":
                yield int(entry.name), (entry / "cmdline").read_text().replace("\0", " ")


def contents(home: Path) -> Files:
    """Return all files of a dataset but the lock."""
    directory = home / VERSION
    return {
        str(path.relative_to(directory)): path.read_bytes()
        for path in sorted(directory.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def shards_written(home: Path) -> int:
    """Return how many shards and files of limits are complete."""
    return sum(1 for _ in (home / VERSION).glob("*/[!.]*.parquet"))


@contextlib.contextmanager
def begun(parent: Path, files: Files, missing: Callable[[str], bool]) -> Iterator[Path]:
    """Lay out a dataset that lacks some files, and so the manifest; it is removed at the end."""
    home = Path(tempfile.mkdtemp(dir=parent))
    lay_out(home, files, missing)
    yield home
    shutil.rmtree(home)


def lay_out(home: Path, files: Files, missing: Callable[[str], bool]) -> None:
    """Write the files that are not to be missing."""
    for name, content in files.items():
        if not missing(name):
            path = home / VERSION / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def everything(name: str) -> bool:
    """Leave out every file: a build from nothing."""
    return True


def small_ones(name: str) -> bool:
    """Leave out the manifest, and the shards that take little time, with their limits."""
    return not Path(name).name.startswith(LARGE)


def finish(home: Path, expected: Files) -> str | None:
    """Run the build again; return how its files differ from the expected ones."""
    build = Build(home)
    return build.failure() if build.wait() else difference(contents(home), expected)


def difference(files: Files, expected: Files) -> str | None:
    """Return the names of files that are too few, too many or of other bytes."""
    names = [n for n in sorted({*files, *expected}) if files.get(n) != expected.get(n)]
    return f"differ: {', '.join(names)}" if names else None
