"""Processor time and memory of a predictor: of its control group, or summed over its processes.

The system charges a control group (Linux, version 2) for all that its processes use, for those too
that have ended and that nobody has waited for. Where this process may not make one, the tree of
processes is sampled instead. A result says which of the two it was.
"""

import contextlib
import itertools
import os
import re
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import psutil

from eigbench.running import tree

GROUP, SAMPLED = "control group", "process tree"  # as results have them
ENTER = 'echo 0 > "$0" && exec "$@"'  # a shell's: the group first, then the command
PATIENCE = 1.0  # seconds in which processes that were killed are gone from their group
_numbers = itertools.count()


class ControlGroup:
    """A control group of its own below that of this process, so within the limits of that one."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory  # where the system shows it

    @classmethod
    def make(cls) -> Self | None:
        """Make one, unless there is no such system here or this process may not."""
        above = own_directory()
        if above is None:
            return None
        sweep(above)
        group = cls(above / f"eigbench-{os.getpid()}-{next(_numbers)}")
        try:
            group._directory.mkdir()
            group.cpu_seconds()
            subprocess.run(group.command(["true"]), check=True, stderr=subprocess.DEVNULL)
        except (OSError, subprocess.CalledProcessError):
            group.remove()
            return None
        return group

    def command(self, words: Sequence[str]) -> list[str]:
        """Return a command that runs another within the group, from its first step on."""
        return ["/bin/sh", "-c", ENTER, str(self._directory / "cgroup.procs"), *words]

    def cpu_seconds(self) -> float:
        """Return the processor time of all that has run in the group."""
        lines = (self._directory / "cpu.stat").read_text().splitlines()
        return int(dict(line.split() for line in lines)["usage_usec"]) / 1e6

    def peak_bytes(self) -> int | None:
        """Return the most memory the group has had, files in memory included.

        ``None`` where the system keeps no account of it: few hand out that controller.
        """
        try:
            return int((self._directory / "memory.peak").read_text())
        except FileNotFoundError:
            return None

    def remove(self) -> None:
        """Kill what still runs in the group, and remove it."""
        with contextlib.suppress(OSError):  # before Linux 5.14 there is no such file
            descriptor = os.open(self._directory / "cgroup.kill", os.O_WRONLY)
            with os.fdopen(descriptor, "w") as file:
                file.write("1")
        end = time.monotonic() + PATIENCE
        while self._directory.exists() and time.monotonic() < end:
            try:
                self._directory.rmdir()
            except OSError:  # busy: what was killed is not gone yet
                time.sleep(0.01)


def own_directory() -> Path | None:
    """Return where the system shows the control group of this process, if it has version 2."""
    try:
        return directory_of(
            Path("/proc/self/cgroup").read_text(), Path("/proc/self/mountinfo").read_text()
        )
    except OSError:
        return None


def directory_of(groups: str, mounts: str) -> Path | None:
    """Return a control group's directory from a process' ``cgroup`` and ``mountinfo``."""
    group = re.search(r"^0::(/.*)$", groups, re.MULTILINE)
    mount = re.search(r"^\d+ \d+ \S+ (/\S*) (\S+) .* - cgroup2 ", mounts, re.MULTILINE)
    if group is None or mount is None:
        return None
    root, point = map(Path, mount.groups())
    own = Path(group[1])
    visible = own.is_relative_to(root) and ".." not in own.parts
    return point / own.relative_to(root) if visible else None


def sweep(above: Path) -> None:
    """Remove the groups below one whose process is gone without removing them, as by ``kill -9``.

    The system refuses to remove a group in which something still runs.
    """
    for group in above.glob("eigbench-*-*"):
        pid = group.name.split("-")[1]
        if pid.isdecimal() and not psutil.pid_exists(int(pid)):
            with contextlib.suppress(OSError):
                group.rmdir()


class Usage:
    """What a process, started in a control group or in none, and all that it starts use.

    Its own time, that of a supervisor, counts in a control group alone.
    """

    def __init__(self, root: psutil.Process, group: ControlGroup | None) -> None:
        self._root, self._group = root, group
        self._meter = tree.Meter(root)
        self._peak = 0

    def cpu_seconds(self) -> float:
        """Return the processor time so far."""
        return self._meter.read() if self._group is None else self._group.cpu_seconds()

    def look(self) -> int:
        """Look at the processes; return the most bytes of memory that they have been seen with."""
        below = tree.processes(self._root)
        self._peak = max(self._peak, tree.resident_bytes(below))
        if self._group is None:
            self._meter.read(below)
        return self._peak

    def peak_bytes(self) -> int:
        """Return the most memory so far; of a single process also what it had between two looks."""
        counted = None if self._group is None else self._group.peak_bytes()
        if counted is not None:
            return counted
        alive = [tree.peak_bytes(process.pid) for process in tree.processes(self._root)]
        return max([self.look(), *alive])

    def counted_by(self) -> dict[str, str]:
        """Return where both numbers come from, as a result's ``counted_by``."""
        memory = None if self._group is None else self._group.peak_bytes()
        return {
            "processor_time": SAMPLED if self._group is None else GROUP,
            "memory": SAMPLED if memory is None else GROUP,
        }
