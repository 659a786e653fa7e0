"""How kernels are compiled: functions of arrays and numbers, turned into machine code by Numba."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from llvmlite import binding
from numba import njit

Function = TypeVar("Function", bound=Callable[..., Any])

# Sums may be reordered and fused so that loops use the processor's vector units; infinities
# and NaN keep their meaning, and a division by zero gives them instead of an error.
# Threads may run several at once.
SETTINGS = {"nogil": True, "fastmath": {"reassoc", "contract"}, "error_model": "numpy"}


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
    except RuntimeError:  # Numba can write its cache nowhere
        compiled = njit(**SETTINGS)(function)
    return compiled


def part(function: Function) -> Function:
    """Compile a function into every kernel that calls it, as if its code stood there.

    A long kernel can so be cut where the mathematics is and stay the same machine code.
    """
    inlined: Function = njit(inline="always", **SETTINGS)(function)
    return inlined
