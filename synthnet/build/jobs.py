"""The job engine: plan, run, resume; keep a shard that is whole, and make the others.

A :class:`Job` says how one file of a dataset is read and how it is made, a :class:`Task` which
files there are and what makes the dataset complete. The engine knows nothing of what is in the
files: :mod:`synthnet.build.versions`, :mod:`synthnet.build.importing` and
:mod:`synthnet.build.limits` each describe a task, and :func:`run` does it with the workers of
any executor.
"""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from synthnet import spectrum, store
from synthnet.build.terms import SHARED, Terms, agree
from synthnet.build.workers import Engine, Workers, local_processes, one_thread
from synthnet.errors import BuildError, DamagedError
from synthnet.processes import cores, more_memory, raise_if_interrupted
from synthnet.recipe.plan import ShardPlan
from synthnet.store import StoredDataset, files, storage
from synthnet.store.storage import Location
from synthnet.types import Rejection, Sample, ShardRecord

MOST_A_CORE = 16  # local processes: each has all libraries in memory, whether it has work or not
SEEN_WITHIN = 60.0  # seconds: a shared file system's cache may not show a new file at once


@dataclass(frozen=True, slots=True)
class Job:
    """One file to be made, or kept if it is there and whole; plain data that a worker is sent."""

    plan: ShardPlan  # the shard that is made, or that the file belongs to
    path: Location  # where the file is
    # Return the shard's record, from the file that is there. Raise DamagedError where it is to be
    # made anew, and StoreError where it bears another digest.
    read: Callable[[], ShardRecord]
    make: Callable[[], ShardRecord]  # write the file, and return the shard's record
    terms: Terms


@dataclass(frozen=True, slots=True)
class Task:
    """All files to be made in a dataset's directory, and what makes them a dataset."""

    directory: Location  # of the dataset; one task at a time writes to it
    folders: tuple[Location, ...]  # that files are written to
    drawn: Mapping[str, int]  # how many shapes a family has
    jobs: Callable[[], Iterable[Job]]  # in the order of the shards; drawn up when the work begins
    # Return the dataset if nothing is left to do. Raise StoreError if something else is there.
    finished: Callable[[], StoredDataset | None]
    complete: Callable[[Sequence[ShardRecord]], StoredDataset]  # given all records, in order


@dataclass(frozen=True, slots=True)
class ShardResult:
    """A finished job: the shard's record, and how the file came about."""

    record: ShardRecord
    size: int | None  # bytes of the file, as the worker sees it
    seconds: float  # that one core took
    reused: bool  # the file was there
    damaged: str | None = None  # what was wrong with the file that was there


@dataclass(frozen=True, slots=True)
class BuildReport:
    """What a build did.

    Parameters
    ----------
    dataset : StoredDataset
        The finished dataset.
    seconds : mapping of str to float
        Core-seconds by family of the shards made in this run, and of reading those kept.
    wall_seconds : float
        Duration of this run.
    reused : int
        Shards that an earlier run had finished.
    nothing_to_do : bool
        Whether the whole dataset was there before.
    """

    dataset: StoredDataset
    seconds: dict[str, float]
    wall_seconds: float
    reused: int
    nothing_to_do: bool = False


class Watcher:
    """Follows a build; override the methods for what you want to know."""

    def planned(self, drawn: Mapping[str, int]) -> None:
        """The shards are about to be made, of so many shapes by family."""

    def submitted(self, plan: ShardPlan) -> None:
        """A shard has been given to the workers."""

    def finished(self, plan: ShardPlan, result: ShardResult) -> None:
        """A shard is on disk."""


@dataclass(frozen=True, slots=True)
class Options:
    """How a task is run, as :func:`synthnet.build.versions.build` describes."""

    workers: int | None
    engine: Engine | None
    watcher: Watcher | None
    wait_for_lock: bool

    def __post_init__(self) -> None:
        count, most = self.workers, MOST_A_CORE * cores()
        if count is not None and count < 1:
            raise ValueError(f"workers must be at least 1, got {count}")
        if count is not None and count > most:
            raise ValueError(f"workers must be at most {most}, {MOST_A_CORE} a core, got {count}")
        if count is not None and self.engine is not None:
            raise ValueError("workers are of the local engine: a cluster has those it has")


def run(task: Task, options: Options, *, preload: str) -> BuildReport:
    """Do a task, or what is left of it; local processes import ``preload`` when they start.

    Raises
    ------
    BuildError
        If a directory cannot be written, the disk is full, another task is at work there, or a
        worker died, does not agree with the terms or writes elsewhere. Finished files are kept.
    """
    started = time.perf_counter()
    dataset = task.finished()
    if dataset is None:
        for folder in task.folders:
            storage.make_directory(folder)
        with exclusive(task.directory, options.wait_for_lock, *task.folders):
            dataset = task.finished()  # the task that this one waited for has built it
            if dataset is None:
                results = make_shards(task, options, preload)
                dataset = task.complete([result.record for result in results])
                seconds = dict.fromkeys(dataset.manifest.drawn, 0.0)
                for result in results:
                    seconds[result.record.family] += result.seconds
                reused = sum(result.reused for result in results)
                return BuildReport(dataset, seconds, time.perf_counter() - started, reused)
    return BuildReport(dataset, {}, time.perf_counter() - started, 0, nothing_to_do=True)


def make_shards(task: Task, options: Options, preload: str) -> list[ShardResult]:
    """Have all files of a task made, and return the results in the order of the jobs."""
    watcher = options.watcher or Watcher()
    results: dict[int, ShardResult] = {}
    with options.engine or local_processes(options.workers, preload) as workers:
        spectrum.compile_solver()  # once here, so that no worker has to
        watcher.planned(task.drawn)
        for number, job, result in submit(workers, task.jobs(), watcher):
            see(job.path, result.size)
            results[number] = result
            watcher.finished(job.plan, result)
    return [result for _, result in sorted(results.items())]


def submit(
    workers: Workers, jobs: Iterable[Job], watcher: Watcher
) -> Iterator[tuple[int, Job, ShardResult]]:
    """Yield numbered jobs and their results as they finish, few submitted at a time."""
    waiting = iter(enumerate(jobs))
    running: dict[Future[ShardResult], tuple[int, Job]] = {}
    while True:
        for number, job in islice(waiting, max(0, workers.ahead - len(running))):
            watcher.submitted(job.plan)
            running[workers.executor.submit(work, job)] = number, job
        if not running:
            return
        done, _ = wait(running, timeout=1, return_when=FIRST_COMPLETED)
        raise_if_interrupted()
        for future in done:
            number, job = running.pop(future)
            yield number, job, _result(future, job.plan)


def _result(future: Future[ShardResult], plan: ShardPlan) -> ShardResult:
    try:
        return future.result()
    except (MemoryError, SystemError) as error:  # what C code raises that forgot to say which
        raise BuildError(
            f"a worker ran out of memory at {plan.file}: finished shards are kept, "
            f"run the same command again; {more_memory('take fewer --workers or more memory')}"
        ) from error


def see(path: Location, size: int | None) -> None:
    """Wait until the file that a worker wrote is there with its size, or raise BuildError."""
    patience = time.monotonic() + SEEN_WITHIN
    while (visible := storage.size(path)) is None or size not in (None, visible):
        if time.monotonic() > patience:
            raise BuildError(f"a worker has written {path}, but it is not there: {SHARED}")
        time.sleep(0.5)


@contextmanager
def exclusive(directory: Location, wait_for_lock: bool, *folders: Location) -> Iterator[None]:
    """Keep other builds out of a directory; at a URL they do no harm.

    Partial files in ``folders`` are removed at the beginning, and at the end, however it ends:
    they are of workers that died or were stopped, and on a full disk they are in the way. Raise
    BuildError if another build is there and ``wait_for_lock`` is not given, or no lock can be had.
    """
    if not isinstance(directory, Path):
        yield
        return
    with files.locked(directory / ".lock", wait=wait_for_lock):
        try:
            for folder in folders:
                storage.remove_partial_files(folder)
            yield
        finally:
            for folder in folders:
                storage.remove_partial_files(folder)


# In a worker


def work(job: Job) -> ShardResult:
    """Do one job in a worker, on whatever machine, if that agrees with the terms."""
    agree(job.terms)
    return keep_or_make(job)


def keep_or_make(job: Job) -> ShardResult:
    """Read a job's file if it is there and whole, else make it."""
    started = time.process_time()
    damaged = None
    size = storage.size(job.path)
    if size is not None:
        try:
            return ShardResult(job.read(), size, time.process_time() - started, reused=True)
        except DamagedError as error:
            damaged = str(error)
    with one_thread:
        record = job.make()
    size, seconds = storage.size(job.path), time.process_time() - started
    return ShardResult(record, size, seconds, reused=False, damaged=damaged)


def write_shapes(
    path: Location, made: Sequence[Sample | Rejection], family: str, digest: str
) -> ShardRecord:
    """Write the shapes of a shard, those that were kept and those that were rejected."""
    samples = [shape for shape in made if isinstance(shape, Sample)]
    rejections = [shape for shape in made if isinstance(shape, Rejection)]
    return store.write_shard(path, samples, rejections, family=family, recipe_digest=digest)


def is_there(path: Location, shard: ShardRecord) -> bool:
    """Return whether a shard is there with its size; takes no time."""
    return storage.size(path) == shard.size


def is_whole(path: Location, shard: ShardRecord) -> bool:
    """Return whether a shard is there with its bytes; those at a URL are its store's care."""
    if not is_there(path, shard):
        return False
    return not isinstance(path, Path) or storage.sha256(path) == shard.sha256
