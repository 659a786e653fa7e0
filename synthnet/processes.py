"""Every process notices an interrupt and a limit, and a worker ends when its parent is gone.

An exception that a signal raises inside a destructor or a C extension's callback is printed
or dropped there, and the program continues. So Ctrl-C, and SIGTERM as schedulers send it,
are also recorded, and long loops check the record.
"""

import functools
import multiprocessing
import os
import resource
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import FrameType, ModuleType
from typing import Any

EXIT_CODE = 130  # by the shell's convention 128 + SIGINT; for SIGTERM too: both are interruptions
THREADS = "OMP_NUM_THREADS"  # the environment variable

_seen = threading.Event()
_starting = threading.Lock()  # one process at a time


def notice_interrupts() -> None:
    """From now on record Ctrl-C and SIGTERM, and raise ``KeyboardInterrupt``."""
    for number, default in (
        (signal.SIGINT, signal.default_int_handler),
        (signal.SIGTERM, signal.SIG_DFL),
    ):
        if signal.getsignal(number) == default:
            signal.signal(number, _notice)


def raise_if_interrupted() -> None:
    """Raise ``KeyboardInterrupt`` if Ctrl-C has been pressed, or SIGTERM sent."""
    if _seen.is_set():
        raise KeyboardInterrupt


def _notice(number: int, frame: FrameType | None) -> None:
    _seen.set()
    raise KeyboardInterrupt


@functools.cache
def keep_freed_memory() -> None:
    """Have this process keep the memory of freed arrays of up to 32 MB, for those that come next.

    glibc gives the memory of a large array back to the system as soon as it is freed, and to get
    it again page by page took a fifth of a small solve. Once an array of nearly 32 MB has been
    freed, it keeps that of smaller ones, up to 64 MB altogether (mallopt(3), M_MMAP_THRESHOLD).
    Other C libraries do as they did.
    """
    import numpy as np

    np.empty(2**25 - 2**17, np.uint8)


def run(program: str, main: Callable[[], int]) -> int:
    """Run a command line that imports what it needs, and return its exit code.

    Every line begins with the name of the ``program``. ``main`` imports the command line and runs
    it; of an interrupt it may say what is kept.
    """
    notice_interrupts()
    try:
        return main()
    except (ImportError, MemoryError, OSError) as error:  # of what every command needs
        limited = more_memory("")
        # An OSError of the system has a number; that of a library that ctypes cannot load has none
        if not limited or getattr(error, "errno", None) is not None:
            raise
        reason = " ".join(str(error).split()) or "out of memory"
        sys.stderr.write(f"{program}: a library cannot be loaded ({reason}): {limited}\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write(f"{program}: interrupted\n")
        return EXIT_CODE


def more_memory(otherwise: str) -> str:
    """Return how to have more memory: raise a limit that is set, or do what fits else.

    Examples
    --------
    >>> more_memory("take fewer --workers")  # with `ulimit -v unlimited`
    'take fewer --workers'
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return otherwise
    return (
        f"a process may address {limit / 2**30:.1f} GiB here (`ulimit -v`), and libraries that it "
        "loads count: raise that limit or lift it"
    )


class _Worker(SpawnProcess):
    """A process that leaves Ctrl-C to its parent, ends with it, and does not run its script.

    A spawned process imports ``__main__`` anew, for what may be defined there. Here that is
    nothing, and a script without ``if __name__ == "__main__":`` would start more processes.
    """

    def start(self) -> None:
        """Start with SIGINT blocked: while it imports its modules, it would print a traceback."""
        resource_tracker.ensure_running()  # which unblocks SIGINT when it starts
        with _starting:
            main = sys.modules["__main__"]
            mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            sys.modules["__main__"] = ModuleType("__main__")
            try:
                super().start()
            finally:
                sys.modules["__main__"] = main
                signal.pthread_sigmask(signal.SIG_SETMASK, mask)

    def run(self) -> None:
        """Do the work, in the process itself: SIGINT is ignored now, and need not be blocked."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        follow_parent()
        super().run()


class WorkerContext(SpawnContext):
    """Spawns worker processes: no fork copies the threads that Open3D and BLAS have.

    Attributes
    ----------
    started : list of multiprocessing.Process
        Those it has made.
    """

    def __init__(self) -> None:
        super().__init__()
        self.started: list[_Worker] = []

    def Process(self, *args: Any, **options: Any) -> _Worker:  # type: ignore[override]
        """Return a process that is still to be started."""
        process = _Worker(*args, **options)
        self.started.append(process)
        return process


@contextmanager
def worker_pool(count: int, begin: Callable[[], None] | None = None) -> Iterator[Executor]:
    """Give worker processes that call ``begin`` first; on an error or Ctrl-C they end at once."""
    from concurrent.futures import ProcessPoolExecutor  # which most commands need not load

    context = WorkerContext()
    pool = ProcessPoolExecutor(count, context, begin)
    try:
        yield pool
    except BaseException:
        for process in {*context.started} & {*multiprocessing.active_children()}:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def follow_parent() -> None:
    """From now on end this process when its parent is gone, whatever it is doing."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


def cores() -> int:
    """Return the number of cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def threads() -> int:
    """Return how many threads to compute on: ``$OMP_NUM_THREADS`` if set, else the cores."""
    named = os.environ.get(THREADS, "").partition(",")[0].strip()
    return max(1, int(named)) if named.isdigit() else cores()
