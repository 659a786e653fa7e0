"""Workers: who builds the shards, on this machine or on many.

An engine is a context manager that gives :class:`Workers`: an executor, and how many
shards to keep submitted to it. On the way out it ends what it started, and turns what its
machinery raises into one line.
"""

import importlib
import logging
import os
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import resources
from typing import Any, TypeAlias

import threadpoolctl

from synthnet.errors import BuildError, MissingPackageError, needed_by
from synthnet.processes import THREADS, cores, more_memory, worker_pool

CONNECT_SECONDS = 10


@dataclass(frozen=True, slots=True)
class Workers:
    """An executor, and the number of workers it has at the moment.

    Parameters
    ----------
    executor : concurrent.futures.Executor
        Runs the shards.
    count : callable
        Asked before every submission, since a cluster grows and shrinks.
    """

    executor: Executor
    count: Callable[[], int]

    @property
    def ahead(self) -> int:
        """Shards to keep submitted: a few wait, so that no worker does; memory is bounded."""
        count = self.count()
        return count + 1 + count // 8


Engine: TypeAlias = AbstractContextManager[Workers]


@contextmanager
def given(executor: Executor, workers: int) -> Iterator[Workers]:
    """Give an executor of the caller's, which stays open; ``workers`` work in it."""
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    yield Workers(executor, lambda: workers)


@contextmanager
def local_processes(workers: int | None = None, preload: str | None = None) -> Iterator[Workers]:
    """Give spawned processes, one a core by default; on an error or Ctrl-C they end at once.

    Each imports the module ``preload`` when it starts. Raise BuildError if one of them died.
    """
    count = workers or cores()
    try:
        begin = None if preload is None else partial(_load, preload)
        with worker_pool(count, begin) as pool:
            yield Workers(pool, lambda: count)
    except BrokenProcessPool as error:
        raise BuildError(
            "a worker process died (out of memory?): finished shards are kept, run the same "
            f"command again; {more_memory('take fewer --workers if memory is short')}"
        ) from error


def _load(module: str) -> None:
    """Import a module that the work needs."""
    try:
        importlib.import_module(module)
    except MemoryError:
        os._exit(1)  # the parent says so in one line; here it would be a traceback


# Clusters


@contextmanager
def dask_cluster(scheduler: str) -> Iterator[Workers]:
    """Give the workers of a Dask cluster that is running.

    Dask gives the shard of a worker that dies to another one.

    Parameters
    ----------
    scheduler : str
        Its address, for example ``tcp://10.0.0.1:8786``.

    Raises
    ------
    MissingPackageError
        If ``distributed`` is not installed.
    BuildError
        If no scheduler answers there, it goes away, the workers lack synthnet, or they die
        of one shard after the other.
    """
    with needed_by("--engine dask"):
        import distributed
        from distributed.comm import CommClosedError, resolve_address
        from distributed.scheduler import KilledWorker
    with _quiet("distributed"):
        try:
            resolve_address(scheduler)
            client = distributed.Client(scheduler, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            raise BuildError(
                f"no Dask scheduler answers at {scheduler}: give the address that "
                "`dask scheduler` printed, for example --scheduler tcp://10.0.0.1:8786"
            ) from error
        executor = client.get_executor()
        try:
            if not client.nthreads():
                sys.stderr.write(f"{scheduler} has no workers yet: waiting for the first\n")
            _refuse_workers_without_synthnet(client)
            yield Workers(executor, lambda: sum(client.nthreads().values()))
        except KilledWorker as error:
            raise BuildError(
                f"{error.allowed_failures + 1} workers died of one shard (out of memory?): "
                "finished shards are kept, run the same command again with more memory a worker"
            ) from error
        except (CancelledError, CommClosedError, TimeoutError) as error:
            raise BuildError(
                f"the Dask scheduler at {scheduler} has gone: finished shards are kept, "
                "start it and run the same command again"
            ) from error
        finally:
            executor.shutdown(wait=False)
            client.close(timeout=CONNECT_SECONDS)


def mpi_processes() -> Engine:
    """Give the other processes of the MPI job that this process is the first of.

    A worker that dies ends the whole job, as MPI has it; finished shards are kept.

    Raises
    ------
    MissingPackageError
        If ``mpi4py`` or an MPI library is not installed.
    BuildError
        If the job was not started as ``mpiexec -n N python -m mpi4py.futures -m synthnet``.
    """
    try:
        with needed_by("--engine mpi"):
            from mpi4py import MPI
            from mpi4py.futures import MPIPoolExecutor, _core
    except RuntimeError as error:
        raise MissingPackageError(
            "--engine mpi finds no MPI library: load your cluster's MPI module, "
            "or pip install mpich"
        ) from error
    if MPI.COMM_WORLD.Get_size() < 2 or _core.SharedPool is None:
        raise BuildError(
            "--engine mpi needs an MPI job of two processes or more: "
            "mpiexec -n 5 python -m mpi4py.futures -m synthnet build --engine mpi"
        )
    return _mpi_pool(MPIPoolExecutor())  # what is wrong was said by every process alike


@contextmanager
def _mpi_pool(executor: Any) -> Iterator[Workers]:
    with executor:
        workers = executor.num_workers
        try:
            yield Workers(executor, lambda: workers)
        except BaseException:
            executor.shutdown(wait=False, cancel_futures=True)
            raise


def _refuse_workers_without_synthnet(client: Any) -> None:
    """Raise BuildError if one has none: it would die of the first shard it reads."""
    answers = client.run(resources.files, "synthnet", on_error="return")
    for address, answer in answers.items():
        if isinstance(answer, ImportError):
            raise BuildError(
                f"the Dask worker at {address} has no synthnet: start it in an environment "
                "like this one"
            )


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Silence a package's loggers: what matters is raised."""
    loggers = [logging.getLogger(n) for n in logging.root.manager.loggerDict if n.startswith(name)]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


# In a worker


class OneThread:
    """Keeps BLAS and the solver to one thread while any shard is being made.

    So bits never differ, and a worker takes one core.

    Workers may be threads of one process, so the last shard that ends gives the threads
    back; a limit of each shard's own would be lifted while others still compute.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._users = 0
        self._limits: Any = None
        self._named: str | None = None

    def __enter__(self) -> None:
        with self._lock:
            limits = threadpoolctl.threadpool_limits(1)  # OpenMP's holds in this thread only
            if self._users == 0:
                self._limits = limits
                self._named = os.environ.get(THREADS)
                os.environ[THREADS] = "1"
            self._users += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._users -= 1
            if self._users == 0:
                self._limits.restore_original_limits()
                os.environ.pop(THREADS)
                if self._named is not None:
                    os.environ[THREADS] = self._named


one_thread = OneThread()
