"""The orchestrator: recipe to shards, by the workers of any executor."""

from __future__ import annotations

import functools
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from itertools import islice
from pathlib import Path
from platform import python_version
from typing import TypeAlias

import filelock

from synthnet import recipe, spectrum, store
from synthnet.build import filters
from synthnet.build.workers import Engine, Workers, cores, local_processes, one_thread
from synthnet.errors import BuildError, CertificateError, DamagedError, SpectrumError, StoreError
from synthnet.families import FAMILIES
from synthnet.kernels import processor
from synthnet.mesh import isometries
from synthnet.mesh.open3d import load_open3d
from synthnet.processes import raise_if_interrupted
from synthnet.recipe import Recipe
from synthnet.recipe.distributions import ISOMETRIES, generator
from synthnet.recipe.plan import PlannedShape, ShardPlan, plan_shards
from synthnet.store import storage
from synthnet.store.storage import Location
from synthnet.types import Manifest, Mesh, Rejection, Sample, ShapeSpec, ShardRecord, Spectrum
from synthnet.version import __version__

PACKAGES = ("synthnet", "numpy", "scipy", "numba", "open3d", "open3d-cpu", "trimesh", "pyarrow")
SHARDS = "shards"
MOST_A_CORE = 16  # local processes: each has all libraries in memory, whether it has work or not
SEEN_WITHIN = 60.0  # seconds: a shared file system's cache may not show a new file at once
SHARED = "--out must be a directory that all machines share, or a URL"
STANDARD_ERROR = 2  # the descriptor: in a notebook sys.stderr has none


@dataclass(frozen=True, slots=True)
class ShardResult:
    """A finished shard: its record, the core-seconds spent, and how it came about."""

    record: ShardRecord
    seconds: float
    reused: bool
    damaged: str | None = None


@dataclass(frozen=True, slots=True)
class BuildReport:
    """What a build did.

    Parameters
    ----------
    dataset : StoredDataset
        The finished dataset.
    seconds : mapping of str to float
        Core-seconds by family of the shards made in this run.
    wall_seconds : float
        Duration of this run.
    reused : int
        Shards that an earlier run had finished.
    nothing_to_do : bool
        Whether the whole dataset was there before.
    """

    dataset: store.StoredDataset
    seconds: dict[str, float]
    wall_seconds: float
    reused: int
    nothing_to_do: bool = False


@dataclass(frozen=True, slots=True)
class Terms:
    """What every shard of a build has in common, and a worker must agree with.

    Parameters
    ----------
    wanted : Recipe
        The recipe.
    digest : str
        The recipe's digest as the build computed it.
    packages : mapping of str to str
        The versions the build has, by package.
    processor : str
        The kind of processor: the last digits of a label hang on it.
    directory : Path or RemotePath
        Where the dataset is to be.
    """

    wanted: Recipe
    digest: str
    packages: Mapping[str, str]
    processor: str
    directory: Location


Job: TypeAlias = Callable[[], ShardResult]


class Watcher:
    """Is told how a build goes; override what you want to know."""

    def preparing(self) -> None:
        """The solver is about to be loaded; the first time on a machine it is compiled."""

    def planned(self, drawn: Mapping[str, int]) -> None:
        """The shards are about to be made, of so many shapes by family."""

    def submitted(self, plan: ShardPlan) -> None:
        """A shard has been given to the workers."""

    def finished(self, plan: ShardPlan, result: ShardResult) -> None:
        """A shard is on disk."""


def build(
    version: str | Recipe,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> BuildReport:
    """Build a version of the dataset, or finish a build that was interrupted.

    Parameters
    ----------
    version : str or Recipe
        What :func:`synthnet.recipe.load` takes, or a recipe of your own.
    root : path or URL, optional
        What holds the versions, see :func:`synthnet.store.home`.
    workers : int, optional
        Local processes, one thread each; all cores this process may use by default.
    engine : context manager of Workers, optional
        Who does the work in their stead: :func:`synthnet.build.workers.dask_cluster`,
        :func:`~synthnet.build.workers.mpi_processes`, or :func:`~synthnet.build.workers.given` any
        ``concurrent.futures.Executor``.
    watcher : Watcher, optional
        Told of the plan and of every shard, to show progress.
    wait_for_lock : bool
        Whether to wait while another build is at work in the same place.

    Returns
    -------
    BuildReport
        The dataset and what it took. The bytes do not depend on who did the work.

    Raises
    ------
    RecipeError
        If the version is unknown.
    StoreError
        If the directory holds data of another recipe.
    BuildError
        If the directory cannot be written, the disk is full, another build is at work
        there, a worker died, has other versions or writes elsewhere. Finished shards are
        kept.
    """
    started = time.perf_counter()
    wanted = version if isinstance(version, Recipe) else recipe.load(version)
    check_workers(workers, engine)
    directory = store.dataset_directory(wanted.version, root)
    finished = _finished(directory, wanted, is_whole)
    if finished is not None:
        return BuildReport(finished, {}, time.perf_counter() - started, 0, nothing_to_do=True)
    load_open3d()  # if it cannot be imported, say so here and once
    for place in (directory, directory / SHARDS):
        storage.make_directory(place)
    with exclusive(directory, wait_for_lock, directory, directory / SHARDS):
        finished = _finished(directory, wanted, is_whole)  # by the build waited for
        if finished is not None:
            return BuildReport(finished, {}, time.perf_counter() - started, 0, nothing_to_do=True)
        terms = terms_of(wanted, directory)
        jobs = ((plan, partial(work, plan, terms)) for plan in plan_shards(wanted))
        drawn = {name: wanted.drawn(name) for name in wanted.families}
        results = make_shards(
            jobs, directory, drawn, workers=workers, engine=engine, watcher=watcher
        )
        manifest = _manifest(wanted, [result.record for result in results])
        store.write_manifest(directory, manifest)
    return report(store.StoredDataset(directory, manifest), results, started)


def make_shards(
    jobs: Iterable[tuple[ShardPlan, Job]],
    directory: Location,
    drawn: Mapping[str, int],
    *,
    workers: int | None,
    engine: Engine | None,
    watcher: Watcher | None,
) -> list[ShardResult]:
    """Have the shards of a dataset made, and return their results in the order of the jobs.

    Raises
    ------
    BuildError
        If a worker died or does not agree, or a shard is not where it should be.
    """
    watcher = watcher or Watcher()
    watcher.preparing()
    spectrum.compile_solver()  # here, and not in every worker
    results: dict[int, ShardResult] = {}
    with engine or local_processes(workers, preload=__name__) as at_work:
        watcher.planned(drawn)
        for number, plan, result in run_shards(at_work, jobs, watcher):
            see(directory / plan.file, result.record.size)
            results[number] = result
            watcher.finished(plan, result)
    return [result for _, result in sorted(results.items())]


def report(
    dataset: store.StoredDataset, results: Sequence[ShardResult], started: float
) -> BuildReport:
    """Return what a build did that began at ``started`` by :func:`time.perf_counter`."""
    seconds = dict.fromkeys(dataset.manifest.drawn, 0.0)
    for result in results:
        seconds[result.record.family] += result.seconds
    reused = sum(result.reused for result in results)
    return BuildReport(dataset, seconds, time.perf_counter() - started, reused)


def check_workers(workers: int | None, engine: Engine | None) -> None:
    """Raise ValueError if there are to be no local workers, or any beside an engine."""
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    most = MOST_A_CORE * cores()
    if workers is not None and workers > most:
        raise ValueError(f"workers must be at most {most}, {MOST_A_CORE} a core, got {workers}")
    if workers is not None and engine is not None:
        raise ValueError("workers are of the local engine: a cluster has those it has")


def ensure_built(version: str, root: str | os.PathLike[str] | None = None) -> store.StoredDataset:
    """Open a dataset; build it first, with a notice on standard error, if it is not there.

    The build runs as a command of its own, so that a script that calls this needs no
    ``if __name__ == "__main__"``. What was imported or sealed is only opened.

    Raises
    ------
    RecipeError
        If the version is unknown.
    StoreError
        If it is at a URL: it has to be on this machine.
    BuildError
        If the build fails; it has printed why.
    """
    there = store.open_unversioned(version, root)
    if there is not None:
        storage.local(there.directory, version)
        return there
    wanted = recipe.load(version)
    directory = storage.local(store.dataset_directory(version, root), version)
    finished = _finished(directory, wanted, is_there)
    if finished is not None:
        return finished
    sys.stderr.write(f"synthNet {version} is not in {directory} yet: building it\n")
    command = [sys.executable, "-m", "synthnet", "build", "--version", version]
    command += ["--out", str(store.home(root)), "--wait"]
    if subprocess.run(command, stdout=STANDARD_ERROR, check=False).returncode:
        raise BuildError(
            f"could not build {version}: run `python {' '.join(command[1:])}` to see why"
        )
    return store.open_dataset(version, root)


def work(plan: ShardPlan, terms: Terms) -> ShardResult:
    """Make one shard on the terms of a build; runs in a worker, on whatever machine.

    Raises
    ------
    BuildError
        If the worker does not agree with the terms.
    """
    agree(terms)
    return build_shard(plan, terms.wanted, terms.directory)


def agree(terms: Terms) -> None:
    """Make sure that this worker does what the build would.

    Raises
    ------
    BuildError
        If the worker has other versions of the packages that make the data, understands
        another recipe, or does not see the directory.
    """
    here, host = _packages(), socket.gethostname()
    for name in sorted({*here, *terms.packages}):
        found, expected = here.get(name), terms.packages.get(name)
        if found != expected:
            raise BuildError(
                f"the worker on {host} has {name} {found or 'missing'}, the build has "
                f"{expected or 'none'}: install the same versions there (constraints.txt)"
            )
    if processor() != terms.processor:
        raise BuildError(
            f"the worker on {host} has a processor of another kind ({processor()}) than the "
            f"build ({terms.processor}): their labels would differ in the last digits, so "
            "take machines of one kind"
        )
    if terms.wanted.digest != terms.digest:
        raise BuildError(
            f"the worker on {host} understands another recipe than the build: "
            "install the same synthnet there"
        )
    shards = terms.directory / SHARDS
    if isinstance(shards, Path) and not shards.is_dir():
        raise BuildError(f"the worker on {host} does not see {shards}: {SHARED}")


def build_shard(plan: ShardPlan, wanted: Recipe, directory: Location) -> ShardResult:
    """Make one shard, or read it if it is there already.

    Raises
    ------
    StoreError
        If a shard of another recipe is in its place.
    """
    started = time.process_time()
    path = directory / plan.file
    damaged = None
    if storage.size(path) is not None:
        try:
            ids = [shape.spec.id for shape in plan.shapes]
            record = store.read_record(path, wanted.digest, ids)
            return ShardResult(record, time.process_time() - started, reused=True)
        except DamagedError as error:
            damaged = str(error)
    samples, rejections = [], []
    with one_thread:
        for shape in plan.shapes:
            made = make_sample(shape, wanted)
            if isinstance(made, Sample):
                samples.append(made)
            else:
                rejections.append(made)
    record = store.write_shard(
        path, samples, rejections, family=plan.family, recipe_digest=wanted.digest
    )
    return ShardResult(record, time.process_time() - started, reused=False, damaged=damaged)


def make_sample(shape: PlannedShape, wanted: Recipe) -> Sample | Rejection:
    """Generate, check, label and augment one shape.

    The label is computed in float64 from the float32 vertices that are stored.
    """
    spec = shape.spec
    family = FAMILIES[spec.family]
    mesh = family.generate(spec.parameters).stored()
    if refused := filters.check_mesh(mesh, wanted.filters, family.topology(spec.parameters)):
        return _rejection(spec, *refused)
    label = label_or_rejection(spec, mesh, wanted)
    if isinstance(label, Rejection):
        return label
    rng = generator(wanted.seed, spec.family, spec.index, ISOMETRIES)
    copies = wanted.augmentation
    return Sample(
        spec=spec,
        mesh=mesh,
        eigenvalues=label.eigenvalues,
        trivial=label.trivial,
        certificate=label.certificate,
        isometries=isometries.draw_isometries(copies.rotations, copies.reflections, rng),
        split=shape.split,
        paper_splits=shape.paper_splits,
    )


def label_or_rejection(spec: ShapeSpec, mesh: Mesh, wanted: Recipe) -> Spectrum | Rejection:
    """Return the certified spectrum of a mesh, or why there is none within a recipe's limits."""
    try:
        label = spectrum.compute(mesh, wanted.label.eigenvalues)
    except CertificateError as error:
        return _rejection(spec, filters.CERTIFICATE, str(error))
    except SpectrumError as error:
        return _rejection(spec, filters.SOLVER, str(error))
    if refused := filters.check_spectrum(label, wanted.filters):
        return _rejection(spec, *refused)
    return label


def _rejection(spec: ShapeSpec, reason: str, detail: str) -> Rejection:
    return Rejection(spec.id, spec.family, reason, detail)


def is_there(path: Location, shard: ShardRecord) -> bool:
    """Return whether a shard is there with its size; takes no time."""
    return storage.size(path) == shard.size


def is_whole(path: Location, shard: ShardRecord) -> bool:
    """Return whether a shard is there with its bytes; those at a URL are its store's care."""
    if not is_there(path, shard):
        return False
    return not isinstance(path, Path) or storage.sha256(path) == shard.sha256


def _finished(
    directory: Location, wanted: Recipe, is_kept: Callable[[Location, ShardRecord], bool]
) -> store.StoredDataset | None:
    manifest = store.read_manifest(directory)
    if manifest is None:
        return None
    if manifest.recipe_digest != wanted.digest:
        raise StoreError(
            f"{directory} holds {manifest.version} of another recipe: "
            "remove it or choose another --out"
        )
    if not all(is_kept(directory / shard.file, shard) for shard in manifest.shards):
        return None
    return store.StoredDataset(directory, manifest)


def terms_of(wanted: Recipe, directory: Location) -> Terms:
    """Return what this process holds its workers to."""
    return Terms(wanted, wanted.digest, _packages(), processor(), directory)


@functools.cache
def _packages() -> dict[str, str]:
    """Return the versions of the packages that the data depend on."""
    versions = {}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # open3d comes under one of two names
    return {**versions, "synthnet": __version__}


def made_with() -> dict[str, str]:
    """Return the versions of Python and the packages, for a manifest."""
    return {"python": python_version(), **_packages()}


def _manifest(wanted: Recipe, records: Sequence[ShardRecord]) -> Manifest:
    return Manifest(
        version=wanted.version,
        recipe_digest=wanted.digest,
        recipe=wanted.to_dict(),
        drawn={name: wanted.drawn(name) for name in wanted.families},
        shards=tuple(records),
        packages=made_with(),
    )


@contextmanager
def exclusive(directory: Location, wait_for_lock: bool, *folders: Location) -> Iterator[None]:
    """Keep other builds out of a directory; at a URL they do no harm.

    Partial files in ``folders`` are removed at the beginning, and at the end, however it ends:
    they are of workers that died or were stopped, and on a full disk they are in the way.

    Raises
    ------
    BuildError
        If another build is there, and ``wait_for_lock`` is not given.
    """
    if not isinstance(directory, Path):
        yield
        return
    lock = filelock.FileLock(directory / ".lock")
    try:
        lock.acquire(timeout=-1 if wait_for_lock else 0)
    except filelock.Timeout as error:
        raise BuildError(
            f"another build is writing to {directory}: wait for it (--wait) or choose another --out"
        ) from error
    try:
        for folder in folders:
            storage.remove_partial_files(folder)
        yield
    finally:
        for folder in folders:
            storage.remove_partial_files(folder)
        lock.release()


def run_shards(
    workers: Workers, jobs: Iterable[tuple[ShardPlan, Job]], watcher: Watcher
) -> Iterator[tuple[int, ShardPlan, ShardResult]]:
    """Yield the jobs' numbers, plans and results as they finish, few submitted at a time.

    Raises
    ------
    BuildError
        If a worker ran out of memory.
    """
    waiting = iter(enumerate(jobs))
    running: dict[Future[ShardResult], tuple[int, ShardPlan]] = {}
    while True:
        for number, (plan, job) in islice(waiting, max(0, workers.ahead - len(running))):
            watcher.submitted(plan)
            running[workers.executor.submit(job)] = number, plan
        if not running:
            return
        done, _ = wait(running, timeout=1, return_when=FIRST_COMPLETED)
        raise_if_interrupted()
        for future in done:
            number, plan = running.pop(future)
            yield number, plan, _result(future, plan)


def _result(future: Future[ShardResult], plan: ShardPlan) -> ShardResult:
    try:
        return future.result()
    except (MemoryError, SystemError) as error:  # what C code raises that forgot to say which
        raise BuildError(
            f"a worker ran out of memory at {plan.file}: finished shards are kept, "
            "run the same command again, with fewer --workers or more memory"
        ) from error


def see(path: Location, size: int | None = None) -> None:
    """Wait until what a worker wrote is where it should be, of the size if that is known.

    Raises
    ------
    BuildError
        If it does not turn up.
    """
    patience = time.monotonic() + SEEN_WITHIN
    while (found := storage.size(path)) is None or size not in (None, found):
        if time.monotonic() > patience:
            raise BuildError(f"a worker has written {path}, but it is not there: {SHARED}")
        time.sleep(0.5)
