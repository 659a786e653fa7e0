"""Build a version: shards from its recipe, pinned limits, and the manifest that completes it."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from synthnet import recipe, store
from synthnet.build import jobs, limits
from synthnet.build.jobs import BuildReport, Job, Options, Task, Watcher
from synthnet.build.label import make_sample
from synthnet.build.terms import SHARDS, Terms, made_with, terms_of
from synthnet.build.workers import Engine
from synthnet.errors import BuildError, StoreError
from synthnet.mesh.open3d import load_open3d
from synthnet.recipe import Recipe
from synthnet.recipe.plan import ShardPlan, plan_shards
from synthnet.store import StoredDataset, pins, storage
from synthnet.store.limits import DIRECTORY as LIMITS
from synthnet.store.storage import Location
from synthnet.types import Manifest, ShardRecord

STANDARD_ERROR = 2  # the descriptor: in a notebook sys.stderr has none


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

    Where the repository pins the limits of its surfaces, they are written beside the shards.

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
        Hears of the plan and of every shard, to show progress.
    wait_for_lock : bool
        Whether to wait while another build is at work in the same directory.

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
    resolved = version if isinstance(version, Recipe) else recipe.load(version)
    options = Options(workers, engine, watcher, wait_for_lock)
    directory = store.dataset_directory(resolved.version, root)
    known = limits.pinned(resolved)
    drawn = {name: resolved.drawn(name) for name in resolved.families}

    def finished() -> StoredDataset | None:
        dataset = _finished(directory, resolved, jobs.is_whole)
        if dataset is None:
            load_open3d()  # if it cannot be imported, say so here and once
        elif known is not None:
            limits.add_pinned(directory, dataset.manifest.shards, known)
        return dataset

    def complete(records: Sequence[ShardRecord]) -> StoredDataset:
        """Write the limits, if they are pinned, and last of all the manifest."""
        if known is not None:
            limits.add_pinned(directory, records, known)
        manifest = Manifest(
            version=resolved.version,
            recipe_digest=resolved.digest,
            recipe=resolved.to_dict(),
            drawn=drawn,
            shards=tuple(records),
            packages=made_with(),
        )
        store.write_manifest(directory, manifest)
        return StoredDataset(directory, manifest)

    task = Task(
        directory=directory,
        folders=(directory, directory / SHARDS, *([] if known is None else [directory / LIMITS])),
        drawn=drawn,
        jobs=partial(_jobs, resolved, directory),
        finished=finished,
        complete=complete,
    )
    return jobs.run(task, options, preload=__name__)


def _jobs(recipe: Recipe, directory: Location) -> Iterator[Job]:
    terms = terms_of(recipe, directory)
    return (shard_job(plan, terms) for plan in plan_shards(recipe))


def shard_job(plan: ShardPlan, terms: Terms) -> Job:
    """Return the job that makes one shard."""
    path = terms.directory / plan.file
    return Job(
        plan=plan,
        path=path,
        read=partial(store.read_record, path, terms.digest, plan.ids),
        make=partial(make_shard, plan, terms.recipe, path),
        terms=terms,
    )


def make_shard(plan: ShardPlan, recipe: Recipe, path: Location) -> ShardRecord:
    """Make the shapes of one shard, label and write them."""
    made = [make_sample(shape, recipe) for shape in plan.shapes]
    return jobs.write_shapes(path, made, plan.family, recipe.digest)


def _finished(
    directory: Location, recipe: Recipe, is_kept: Callable[[Location, ShardRecord], bool]
) -> StoredDataset | None:
    manifest = store.read_manifest(directory)
    if manifest is None:
        return None
    if manifest.recipe_digest != recipe.digest:
        raise StoreError(
            f"{directory} holds {manifest.version} of another recipe: "
            "remove it or choose another --out"
        )
    if not all(is_kept(directory / shard.file, shard) for shard in manifest.shards):
        return None
    return StoredDataset(directory, manifest)


def ensure_built(version: str, root: str | os.PathLike[str] | None = None) -> StoredDataset:
    """Open a dataset; build it first, with a notice on standard error, if it is not there.

    The build runs as a command of its own, which shows how far it is. An import, a sealed set or
    what a recipe of your own made is only opened.

    Raises
    ------
    RecipeError
        If the version is unknown.
    StoreError
        If it is at a URL: it has to be on this machine.
    BuildError
        If the build fails; it has printed why.
    """
    unversioned = store.open_unversioned(version, root)
    if unversioned is not None:
        storage.local(unversioned.directory, version)
        return unversioned
    directory = storage.local(store.dataset_directory(version, root), version)
    finished = _finished(directory, recipe.load(version), jobs.is_there)
    if finished is not None:
        return finished
    if os.environ.get(pins.VARIABLE):
        raise BuildError(
            f"a predictor in a sandbox has no meshes of {version}, and builds none: train it "
            "beforehand and load its weights, see docs/submit.md"
        )
    sys.stderr.write(f"synthNet {version} is not in {directory} yet: building it\n")
    command = [sys.executable, "-m", "synthnet", "build", version]
    command += ["--out", str(store.home(root)), "--wait"]
    if subprocess.run(command, stdout=STANDARD_ERROR, check=False).returncode:
        raise BuildError(
            f"could not build {version}: run `python {' '.join(command[1:])}` to see why"
        )
    return store.open_dataset(version, root)
