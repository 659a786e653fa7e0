"""How kernels are compiled: functions of arrays and numbers, turned into machine code by Numba."""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import os
import stat
import sys
import tempfile
import uuid
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import platformdirs
from llvmlite import binding
from numba import njit
from numba.core import cgutils, config
from numba.core import event as events
from numba.core.caching import _CacheLocator
from numba.extending import intrinsic

Function = TypeVar("Function", bound=Callable[..., Any])

# Sums may be reordered and fused so that loops use the processor's vector units; infinities
# and NaN keep their meaning, and a division by zero gives them instead of an error.
# Threads may run several at once.
SETTINGS = {"nogil": True, "fastmath": {"reassoc", "contract"}, "error_model": "numpy"}

# An environment variable: a program gives it a random value, the processes that it starts inherit
# it, and of them all only the first to compile says so. If it is empty, none does.
SAID = "SYNTHNET_COMPILING"
HOW = "SYNTHNET_KERNELS_KEPT"  # another, for processes whose kernels are not kept for good
COMPILING = "Compiling the numerical code for this machine, {how}: up to 20 s"
LARGEST = 2**24  # bytes of a file of sources
KEPT: dict[Callable[..., Any], str] = {}  # how often each kernel is compiled


@cache
def processor() -> str:
    """Return the kind of processor that kernels are compiled for, with a hash of its features."""
    features = binding.get_host_cpu_features().flatten()
    return f"{binding.get_host_cpu_name()}-{hashlib.sha256(features.encode()).hexdigest()[:8]}"


def is_source(path: Path) -> bool:
    """Return whether a path is a regular file, and small: another may have laid it there."""
    return path.is_file() and path.stat().st_size <= LARGEST


@cache
def stamp(room: Path) -> str:
    """Return a hash of all sources of a folder: a kernel holds the code of those it calls.

    A kernel may call kernels of its own folder only.
    """
    sources = [Path(__file__), *filter(is_source, sorted(room.glob("*.py")))]
    return hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]


def folder() -> Path:
    """Return where compiled kernels are kept: ``$NUMBA_CACHE_DIR``, else in the user's cache.

    Loading a kernel runs its machine code, and Numba unpickles it. So the folder beside a module,
    which may be of whoever installed that, is never used.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    return Path(named) if named else platformdirs.user_cache_path("synthnet-kernels")


def compiled(rooms: Iterable[Path]) -> Iterator[Path]:
    """Yield the files of :func:`folder` that hold kernels of some folders, as these are now."""
    for room in rooms:
        kept = folder() / _CacheLocator.get_suitable_cache_subpath(str(room / "any.py"))
        yield from sorted(kept.glob(f"*_{stamp(room)}-*.nb[ic]"))


@cache
def own(path: Path) -> str:
    """Make a folder that only this user may enter; return why it cannot be trusted, if so."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.mkdir(mode=0o700, exist_ok=True)
        there = path.lstat()
        if not stat.S_ISDIR(there.st_mode):
            return f"{path} is no folder: remove it"
        if there.st_uid != os.geteuid():
            return f"{path} is another user's: set NUMBA_CACHE_DIR to a folder of your own"
        if there.st_mode & 0o022:  # who may write there could have written what is loaded
            return f"others may write to {path}: remove it"
        if there.st_mode & 0o055:
            with contextlib.suppress(OSError):  # where a file system has no modes
                path.chmod(0o700)
    except OSError as error:
        return f"{path} cannot be made ({error.strerror}): set NUMBA_CACHE_DIR to one that can"
    return ""


def _kept_in(path: Path, function: Function) -> Function | None:
    """Return a kernel that Numba keeps in a folder, or ``None`` if it cannot write there."""
    before, config.CACHE_DIR = config.CACHE_DIR, str(path)  # other programs' kernels stay theirs
    try:
        dispatcher: Any = njit(cache=True, **SETTINGS)(function)
    except RuntimeError:  # nor anywhere else
        return None
    finally:
        config.CACHE_DIR = before
    there = Path(dispatcher.stats.cache_path).is_relative_to(path)
    return dispatcher if there else None  # Numba's second choice is no good


def kernel(function: Function) -> Function:
    """Compile a function of arrays and numbers to machine code at its first call.

    The code is kept in :func:`folder` for the next process; if that is not the user's own or
    cannot be written, every process compiles again. With ``NUMBA_DISABLE_JIT`` it stays Python.
    """
    if config.DISABLE_JIT:
        return function
    # Numba's cache identifies a function by its name and its own file. The name here also holds
    # the module, which may be imported by two names (baselines.gcn and gcn), and the sources of
    # the kernels that it calls.
    sources = Path(function.__code__.co_filename).parent
    function.__qualname__ += f"_{function.__module__.replace('.', '_')}_{stamp(sources)}"
    problem = own(folder())
    if not problem:
        dispatcher = _kept_in(folder(), function)
        if dispatcher is not None:
            KEPT[function] = os.environ.get(HOW, "kept from now on")
            return dispatcher
        problem = f"{folder()} cannot be written: set NUMBA_CACHE_DIR to a folder that can"
    KEPT[function] = f"anew by every process, as {problem}"
    anew: Function = njit(**SETTINGS)(function)
    return anew


def part(function: Function) -> Function:
    """Compile a function into every kernel that calls it, as if its code stood there.

    A long kernel can so be cut where the mathematics is and stay the same machine code.
    """
    inlined: Function = njit(inline="always", **SETTINGS)(function)
    return inlined


def _in_kernels(function: Callable[..., Any]) -> Callable[[Any], Any]:
    """Return an intrinsic of Numba; where kernels stay Python, what returns its argument."""
    known: Callable[[Any], Any] = intrinsic(function)
    return (lambda array: array) if config.DISABLE_JIT else known


@_in_kernels
def uncounted(context: Any, array: Any) -> Any:
    """Return an argument of a kernel as an array whose slices are not counted as references.

    Numba counts the references to an array's memory by atomic operations. Two of them for each
    slice that is passed on take as long as a loop over fifty numbers. Only a kernel's own arguments
    may be taken so, not those of a :func:`part`: its caller keeps them alive. An array that is made
    in a kernel is freed after the last line that names it.
    """

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        made = context.make_array(signature.args[0])(context, builder, values[0])
        made.meminfo = cgutils.get_null_value(made.meminfo.type)
        made.parent = cgutils.get_null_value(made.parent.type)
        return made._getvalue()

    return array(array), generate


class _Announcement(events.Listener):  # type: ignore[misc]  # numba has no types
    """Says that kernels are compiled, the first time that one is; what is in the cache is not."""

    def on_start(self, event: Any) -> None:
        """Say so, unless the kernel is another program's or it has been said."""
        how = KEPT.get(event.data["dispatcher"].py_func)
        if how is None or not os.environ[SAID]:
            return
        try:
            flag().touch(exist_ok=False)
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
        atexit.register(lambda: flag().unlink(missing_ok=True))
    events.register("numba:compile", _Announcement())


def flag(folder: Path | None = None) -> Path:
    """Return the file that the first process to compile makes, in the folder for such files."""
    return Path(folder or tempfile.gettempdir(), f"synthnet-compiling-{os.environ[SAID]}")


_announce()
