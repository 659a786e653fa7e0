"""How kernels are compiled: functions of arrays and numbers, turned into machine code by Numba."""

from __future__ import annotations

import atexit
import hashlib
import os
import sys
import tempfile
import uuid
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from llvmlite import binding
from numba import njit
from numba.core import event as events

Function = TypeVar("Function", bound=Callable[..., Any])

# Sums may be reordered and fused so that loops use the processor's vector units; infinities
# and NaN keep their meaning, and a division by zero gives them instead of an error.
# Threads may run several at once.
SETTINGS = {"nogil": True, "fastmath": {"reassoc", "contract"}, "error_model": "numpy"}

# An environment variable: a program gives it a random value, the processes that it starts inherit
# it, and of them all only the first to compile says so. If it is empty, none does.
SAID = "SYNTHNET_COMPILING"
COMPILING = "Compiling the numerical code for this machine, {how}: about 20 s for the solver"
KEPT: dict[Callable[..., Any], str] = {}  # how often each kernel is compiled


@cache
def processor() -> str:
    """Return the kind of processor that kernels are compiled for, with a hash of its features."""
    features = binding.get_host_cpu_features().flatten()
    return f"{binding.get_host_cpu_name()}-{hashlib.sha256(features.encode()).hexdigest()[:8]}"


@cache
def stamp(folder: Path) -> str:
    """Return a hash of all sources of a folder: a kernel holds the code of those it calls.

    A kernel may call kernels of its own folder only.
    """
    sources = [Path(__file__), *sorted(folder.glob("*.py"))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers to machine code at its first call.

    The code is kept beside the module, or in the user's cache, for the next process; if neither
    can be written, every process compiles again.
    """
    # Numba's cache identifies a function by its name and its own file. The name here also holds
    # the module, which may be imported by two names (baselines.gcn and gcn), and the sources of
    # the kernels that it calls.
    folder = Path(function.__code__.co_filename).parent
    function.__qualname__ += f"_{function.__module__.replace('.', '_')}_{stamp(folder)}"
    try:
        compiled: Function = njit(cache=True, **SETTINGS)(function)
        KEPT[function] = "once"
    except RuntimeError:  # Numba can write its cache nowhere
        compiled = njit(**SETTINGS)(function)
        KEPT[function] = "anew by every process, as Numba can write its cache nowhere"
    return compiled


def part(function: Function) -> Function:
    """Compile a function into every kernel that calls it, as if its code stood there.

    A long kernel can so be cut where the mathematics is and stay the same machine code.
    """
    inlined: Function = njit(inline="always", **SETTINGS)(function)
    return inlined


class _Announcement(events.Listener):  # type: ignore[misc]  # numba has no types
    """Says that kernels are compiled, the first time that one is; what is in the cache is not."""

    def on_start(self, event: Any) -> None:
        """Say so, unless the kernel is another program's or it has been said."""
        how = KEPT.get(event.data["dispatcher"].py_func)
        if how is None or not os.environ[SAID]:
            return
        try:
            _flag().touch(exist_ok=False)
        except OSError:  # it has been said, or that cannot be noted: no line is better than many
            return
        clear = "\r\033[K" if sys.stderr.isatty() else ""  # of what another process shows there
        sys.stderr.write(f"{clear}{COMPILING.format(how=how)}\n")
        sys.stderr.flush()

    def on_end(self, event: Any) -> None:
        """Nothing is said at the end."""


def _announce() -> None:
    """From now on say when kernels are compiled, in this process and those that it starts."""
    if SAID not in os.environ:
        os.environ[SAID] = uuid.uuid4().hex
        atexit.register(lambda: _flag().unlink(missing_ok=True))
    events.register("numba:compile", _Announcement())


def _flag() -> Path:
    """Return the file that the first process to compile makes."""
    return Path(tempfile.gettempdir(), f"synthnet-compiling-{os.environ[SAID]}")


_announce()
