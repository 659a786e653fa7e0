"""What a process and all that it has started use, and that all of it ends."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from pathlib import Path

import psutil

from eigbench.running import calls

LIVE = 2  # the kernel's number of the clock of a process' own time
ROUNDS = 20  # of killing what goes on starting processes
_held: set[int] = set()  # processes whose trees this one answers for


def processes(root: psutil.Process) -> list[psutil.Process]:
    """Return what runs below a process; nothing if it has ended."""
    try:
        return list(root.children(recursive=True))
    except psutil.NoSuchProcess:
        return []


class Meter:
    """Processor time of what runs and ran below a process, in seconds.

    A process that has ended is counted where its parent has waited for it, as the system does. A
    parent may also have it forgotten (``SIGCHLD`` ignored); then what was last seen of it counts.
    So the time of such a process between its last look and its end is missed; the harness looks
    four times a second, and before and after each batch. On Linux times are to the microsecond
    where a process still runs, else to a hundredth of a second.
    """

    def __init__(self, root: psutil.Process) -> None:
        self._root = root
        self._seen: dict[psutil.Process, tuple[float, float]] = {}  # its own time, its children's
        self._seconds = 0.0

    def read(self, below: list[psutil.Process] | None = None) -> float:
        """Look at the processes, or at those given, and return the time so far."""
        now = {}
        for process in [self._root, *(processes(self._root) if below is None else below)]:
            with contextlib.suppress(psutil.NoSuchProcess):
                now[process] = _times(process, alone=process is self._root)
        grown = reaped = 0.0
        for process, (own, children) in now.items():
            own_before, children_before = self._seen.get(process, (0.0, 0.0))
            grown += own - own_before
            reaped += children - children_before
        gone = sum(sum(times) for process, times in self._seen.items() if process not in now)
        self._seen = now
        self._seconds += max(grown, 0.0) + max(reaped - gone, 0.0)
        return self._seconds


def _times(process: psutil.Process, *, alone: bool) -> tuple[float, float]:
    """Return a process' own time, but for the root's, and that of the children it waited for."""
    times = process.cpu_times()
    own = 0.0 if alone else times.user + times.system
    if sys.platform == "linux" and not alone:
        with contextlib.suppress(OSError):  # it has ended, and nobody has waited for it yet
            own = time.clock_gettime(~process.pid << 3 | LIVE)
    return own, times.children_user + times.children_system


def hold(root: int) -> None:
    """Answer for a process that this one has started: what it leaves is adopted, on Linux."""
    _held.add(root)
    _adopt(True)


def release(root: int) -> None:
    """Answer for a process no longer."""
    _held.discard(root)
    _adopt(bool(_held))


def orphans(since: float) -> list[psutil.Process]:
    """Return what this process has adopted, and what runs below it.

    These are its children that were started since a time, in a session of their own or of a
    process that it answers for, and are none of those.
    """
    orphaned = []
    for child in psutil.Process().children():
        with contextlib.suppress(psutil.NoSuchProcess, ProcessLookupError):
            foreign = os.getsid(child.pid) != os.getsid(0)
            if child.pid not in _held and child.create_time() >= since and foreign:
                orphaned += [child, *child.children(recursive=True)]
    return orphaned


def end(since: float) -> None:
    """Kill what this process has adopted since a time, until there is nothing left."""
    for _ in range(ROUNDS):
        if not (left := orphans(since)):
            return
        for process in left:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        psutil.wait_procs(left, timeout=1)


def _adopt(on: bool) -> None:
    if sys.platform == "linux":
        calls.prctl(calls.PR_SET_CHILD_SUBREAPER, int(on))


def resident_bytes(below: list[psutil.Process]) -> int:
    """Return the memory that processes use now; what they share counts for each."""
    total = 0
    for process in below:
        with contextlib.suppress(psutil.NoSuchProcess):
            total += process.memory_info().rss
    return total


def peak_bytes(pid: int) -> int:
    """Return the most memory that one process has had; 0 where the system does not tell."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    lines = dict(line.split(":", 1) for line in status.splitlines())
    return 1024 * int(lines.get("VmHWM", "0 kB").split()[0])
