"""How everything here is timed: all sides in one run, in turn, and the median of each."""

from __future__ import annotations

import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from unittest.mock import patch

from rich.console import Console
from rich.progress import track

T = TypeVar("T")


class Timed(NamedTuple):
    """The median seconds of a call's repetitions, and its last answer."""

    seconds: float
    answer: Any


def in_turn(
    sides: Mapping[str, Callable[[], Any]],
    repeats: int = 1,
    *,
    backwards: bool = False,
    clock: Callable[[], float] = time.process_time,
) -> dict[str, Timed]:
    """Call all sides in turn, ``repeats`` times over; the order is reversed every other time.

    Parameters
    ----------
    sides
        Calls by name.
    repeats
        How often each is called.
    backwards
        Whether to begin with the last side.
    clock
        Seconds; by default those of the processor, summed over the threads of this process.
    """
    seconds: dict[str, list[float]] = {name: [] for name in sides}
    answers = {}
    for number in range(repeats):
        names = list(sides)
        for name in reversed(names) if (number + backwards) % 2 else names:
            started = clock()
            answers[name] = sides[name]()
            seconds[name].append(clock() - started)
    return {name: Timed(statistics.median(seconds[name]), answers[name]) for name in sides}


def in_new_process(
    function: Callable[..., T], *arguments: Any, environment: Mapping[str, str] | None = None
) -> T:
    """Call a function in a process of its own, which has a peak of memory of its own.

    ``environment`` is set before the process imports anything.

    Raises
    ------
    concurrent.futures.process.BrokenProcessPool
        If the process dies.
    """
    context = multiprocessing.get_context("spawn")
    with (
        patch.dict(os.environ, environment or {}),
        ProcessPoolExecutor(1, mp_context=context) as pool,
    ):
        return pool.submit(function, *arguments).result()


def peak_mb() -> float:
    """Return the most memory that this process has held, shared pages included, in MB."""
    status = Path("/proc/self/status").read_text()
    (kilobytes,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(kilobytes) / 1e3


def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterable[T]:
    """Return the items, with a bar on standard error where that is a terminal."""
    bar = Console(stderr=True)
    return track(items, what, total, console=bar, disable=not sys.stderr.isatty())
