"""The orchestrator: recipe to shards, by any number of processes."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from platform import python_version

import filelock
import threadpoolctl

from synthnet import augment, files, filters, recipe, spectrum, store
from synthnet._open3d import load_open3d
from synthnet.distributions import ISOMETRIES, generator
from synthnet.errors import BuildError, DamagedError, SpectrumError, StoreError
from synthnet.families import FAMILIES
from synthnet.interrupts import raise_if_interrupted
from synthnet.plan import PlannedShape, ShardPlan, plan_shards
from synthnet.recipe import Recipe
from synthnet.types import Manifest, Rejection, Sample, ShapeSpec, ShardRecord
from synthnet.workers import cores, local_processes

PACKAGES = ("synthnet", "numpy", "scipy", "open3d", "open3d-cpu", "trimesh", "pyarrow")
SHARDS = "shards"
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


class Watcher:
    """Is told how a build goes; override what you want to know."""

    def planned(self, plans: Sequence[ShardPlan]) -> None:
        """All shards are known."""

    def submitted(self, plan: ShardPlan) -> None:
        """A shard has been given to the workers."""

    def finished(self, plan: ShardPlan, result: ShardResult) -> None:
        """A shard is on disk."""


def build(
    version: str,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> BuildReport:
    """Build a version of the dataset, or finish a build that was interrupted.

    Parameters
    ----------
    version : str
        One of :func:`synthnet.recipe.available`.
    root : path, optional
        Directory that holds the versions, see :func:`synthnet.store.home`.
    workers : int, optional
        Processes, one thread each; all cores this process may use by default.
    watcher : Watcher, optional
        Told of the plan and of every shard, to show progress.
    wait_for_lock : bool
        Whether to wait while another build is at work in the same place.

    Returns
    -------
    BuildReport
        The dataset and what it took. The bytes do not depend on ``workers``.

    Raises
    ------
    RecipeError
        If the version is unknown.
    StoreError
        If the directory holds data of another recipe.
    BuildError
        If the directory cannot be written, the disk is full, another build is at work
        there, or a worker died. Finished shards are kept.
    """
    started = time.perf_counter()
    wanted = recipe.load(version)
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    directory = store.dataset_directory(version, root)
    finished = _finished(directory, wanted)
    if finished is not None:
        return BuildReport(finished, {}, time.perf_counter() - started, 0, nothing_to_do=True)
    load_open3d()  # if it cannot be imported, say so here and once
    for place in (directory, directory / SHARDS):
        files.make_directory(place)
    with exclusive(directory, wait_for_lock):
        finished = _finished(directory, wanted)  # by the build that was waited for
        if finished is not None:
            return BuildReport(finished, {}, time.perf_counter() - started, 0, nothing_to_do=True)
        for place in (directory, directory / SHARDS):
            files.remove_partial_files(place)
        plans = plan_shards(wanted)
        watcher = watcher or Watcher()
        watcher.planned(plans)
        results: dict[str, ShardResult] = {}
        processes = workers or cores()
        with local_processes(processes) as executor:
            ahead = processes + 1  # one shard waits, so that no worker does
            work = partial(build_shard, wanted=wanted, directory=directory)
            for plan, result in run_shards(executor, work, plans, ahead, watcher):
                results[plan.file] = result
                watcher.finished(plan, result)
        manifest = _manifest(wanted, [results[plan.file].record for plan in plans])
        store.write_manifest(directory, manifest)
    seconds = dict.fromkeys(wanted.families, 0.0)
    for plan in plans:
        seconds[plan.family] += results[plan.file].seconds
    return BuildReport(
        dataset=store.StoredDataset(directory, manifest),
        seconds=seconds,
        wall_seconds=time.perf_counter() - started,
        reused=sum(result.reused for result in results.values()),
    )


def ensure_built(version: str, root: str | os.PathLike[str] | None = None) -> store.StoredDataset:
    """Open a dataset; build it first, with a notice on standard error, if it is not there.

    The build runs as a command of its own, so that a script that calls this needs no
    ``if __name__ == "__main__"``.

    Raises
    ------
    RecipeError
        If the version is unknown.
    BuildError
        If the build fails; it has printed why.
    """
    wanted = recipe.load(version)
    directory = store.dataset_directory(version, root)
    finished = _finished(directory, wanted)
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


def build_shard(plan: ShardPlan, wanted: Recipe, directory: Path) -> ShardResult:
    """Make one shard, or read it if it is there already; runs in a worker.

    Raises
    ------
    StoreError
        If a shard of another recipe is in its place.
    """
    started = time.process_time()
    path = directory / plan.file
    damaged = None
    if path.exists():
        try:
            ids = [shape.spec.id for shape in plan.shapes]
            record = store.read_record(path, wanted.digest, ids)
            return ShardResult(record, time.process_time() - started, reused=True)
        except DamagedError as error:
            damaged = str(error)
    samples, rejections = [], []
    with threadpoolctl.threadpool_limits(1):
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
    if refused := filters.check_mesh(mesh, wanted.filters, family.euler_characteristic):
        return _rejection(spec, *refused)
    try:
        label = spectrum.compute(
            mesh,
            wanted.label.eigenvalues,
            shift=wanted.label.shift,
            tolerance=wanted.label.tolerance,
        )
    except SpectrumError as error:
        return _rejection(spec, filters.SOLVER, str(error))
    if refused := filters.check_spectrum(label, wanted.filters):
        return _rejection(spec, *refused)
    rng = generator(wanted.seed, spec.family, spec.index, ISOMETRIES)
    return Sample(
        spec=spec,
        mesh=mesh,
        eigenvalues=label.eigenvalues,
        trivial=label.trivial,
        residual=label.residual,
        isometries=augment.draw_isometries(wanted.augmentation, rng),
        split=shape.split,
        paper_splits=shape.paper_splits,
    )


def _rejection(spec: ShapeSpec, reason: str, detail: str) -> Rejection:
    return Rejection(spec.id, spec.family, reason, detail)


def _finished(directory: Path, wanted: Recipe) -> store.StoredDataset | None:
    manifest = store.read_manifest(directory)
    if manifest is None:
        return None
    if manifest.recipe_digest != wanted.digest:
        raise StoreError(
            f"{directory} holds {manifest.version} of another recipe: "
            "remove it or choose another --out"
        )
    for shard in manifest.shards:
        path = directory / shard.file
        if not path.exists() or path.stat().st_size != shard.size:
            return None
    return store.StoredDataset(directory, manifest)


def _manifest(wanted: Recipe, records: Sequence[ShardRecord]) -> Manifest:
    versions = {"python": python_version()}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # open3d comes under one of two names
    return Manifest(
        version=wanted.version,
        recipe_digest=wanted.digest,
        recipe=wanted.to_dict(),
        drawn={name: wanted.drawn(name) for name in wanted.families},
        shards=tuple(records),
        packages=versions,
    )


@contextmanager
def exclusive(directory: Path, wait_for_lock: bool) -> Iterator[None]:
    """Hold the lock of a dataset's directory.

    Raises
    ------
    BuildError
        If another build holds it, and ``wait_for_lock`` is not given.
    """
    lock = filelock.FileLock(directory / ".lock")
    try:
        lock.acquire(timeout=-1 if wait_for_lock else 0)
    except filelock.Timeout as error:
        raise BuildError(
            f"another build is writing to {directory}: wait for it (--wait) or choose another --out"
        ) from error
    try:
        yield
    finally:
        lock.release()


def run_shards(
    executor: Executor,
    work: Callable[[ShardPlan], ShardResult],
    plans: Sequence[ShardPlan],
    ahead: int,
    watcher: Watcher,
) -> Iterator[tuple[ShardPlan, ShardResult]]:
    """Yield ``work`` of each shard as it is finished, at most ``ahead`` submitted at a time."""
    waiting = deque(plans)
    running: dict[Future[ShardResult], ShardPlan] = {}
    while waiting or running:
        while waiting and len(running) < ahead:
            plan = waiting.popleft()
            watcher.submitted(plan)
            running[executor.submit(work, plan)] = plan
        done, _ = wait(running, timeout=1, return_when=FIRST_COMPLETED)
        raise_if_interrupted()
        for future in done:
            yield running.pop(future), future.result()
