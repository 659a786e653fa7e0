"""What a process and all that it has started use: processor time and memory."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil

LIVE = 2  # the kernel's number of the clock of a process' own time


def processes(root: psutil.Process) -> list[psutil.Process]:
    """Return what runs below a process; nothing if it has ended."""
    try:
        return list(root.children(recursive=True))
    except psutil.NoSuchProcess:
        return []


def cpu_seconds(root: psutil.Process) -> float:
    """Return the processor time of what runs and ran below a process, in seconds.

    On Linux to the microsecond where a process still runs, else to a hundredth of a second.
    """
    return sum(_cpu_seconds(root, processes(root)))


def _cpu_seconds(root: psutil.Process, below: list[psutil.Process]) -> Iterator[float]:
    for process in [root, *below]:
        try:
            times = process.cpu_times()
            yield times.children_user + times.children_system  # of those that have ended
            if process is root:
                continue
            if sys.platform == "linux":
                yield time.clock_gettime(~process.pid << 3 | LIVE)
            else:
                yield times.user + times.system
        except (psutil.NoSuchProcess, OSError):
            continue  # it has ended meanwhile, and counts among its parent's


def resident_bytes(root: psutil.Process) -> int:
    """Return the memory that is in use below a process now; what they share counts for each."""
    total = 0
    for process in processes(root):
        try:
            total += process.memory_info().rss
        except psutil.NoSuchProcess:
            continue
    return total


def peak_bytes(pid: int) -> int:
    """Return the most memory that one process has had; 0 where the system does not tell."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0
    lines = dict(line.split(":", 1) for line in status.splitlines())
    return 1024 * int(lines.get("VmHWM", "0 kB").split()[0])
