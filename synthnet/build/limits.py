"""The limits of a dataset: looked up where the repository pins them, else computed."""

import os
from collections.abc import Iterable, Iterator, Mapping
from functools import partial

from synthnet import recipe, store
from synthnet.build import jobs
from synthnet.build.jobs import BuildReport, Job, Options, Task, Watcher
from synthnet.build.terms import terms_of
from synthnet.build.workers import Engine
from synthnet.errors import SpectrumError, StoreError
from synthnet.families import FAMILIES
from synthnet.families.limits import Limit
from synthnet.recipe import Recipe
from synthnet.recipe.plan import plan_shards
from synthnet.store import StoredDataset, limits, pins, storage
from synthnet.store.storage import Location
from synthnet.types import ShardRecord

NONE: Mapping[str, Limit] = {}


def build_limits(
    version: str | Recipe,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> BuildReport:
    """Store the limit of every shape of a built dataset, or finish doing so.

    Those of a version whose limits are pinned are there already, since
    :func:`synthnet.build.versions.build` looks them up.

    Parameters
    ----------
    version, root, workers, engine, watcher, wait_for_lock
        As for :func:`synthnet.build.versions.build`.

    Returns
    -------
    BuildReport
        The dataset and what the limits took.

    Raises
    ------
    StoreError
        If the dataset has not been built there, or a shard is damaged or of another recipe.
    SpectrumError
        If the eigenvalues of a surface cannot be found and counted.
    BuildError
        If the directory cannot be written, the disk is full, another build is at work
        there, or a worker died. Finished files are kept.
    """
    options = Options(workers, engine, watcher, wait_for_lock)
    resolved = version if isinstance(version, Recipe) else recipe.load(version)
    dataset = store.open_dataset(resolved.version, root)
    directory, shards = dataset.directory, dataset.manifest.shards
    if dataset.manifest.recipe_digest != resolved.digest:
        raise StoreError(f"{directory} holds {resolved.version} of another recipe: remove it")
    known = pinned(resolved)

    def finished() -> StoredDataset | None:
        if known is not None:
            add_pinned(directory, shards, known)
        return dataset if all(limits.is_whole(directory, record) for record in shards) else None

    task = Task(
        directory=directory,
        folders=(directory / limits.DIRECTORY,),
        drawn={name: resolved.drawn(name) for name in resolved.families},
        jobs=partial(_jobs, resolved, dataset),
        finished=finished,
        complete=lambda _: dataset,
    )
    return jobs.run(task, options, preload=__name__)


def add_missing(dataset: StoredDataset) -> None:
    """Write the pinned limits of a dataset that was built before there were any.

    Raise BuildError if the disk is full or cannot be written.
    """
    version, ours = dataset.manifest.version, dataset.kind is recipe.Kind.VERSION
    if ours and version in recipe.available() and not limits.any_there(dataset):
        resolved = recipe.load(version)
        known = pinned(resolved)
        if known is not None and dataset.manifest.recipe_digest == resolved.digest:
            add_pinned(dataset.directory, dataset.manifest.shards, known)


def _jobs(resolved: Recipe, dataset: StoredDataset) -> Iterator[Job]:
    terms = terms_of(resolved, dataset.directory)
    for plan, record in zip(plan_shards(resolved), dataset.manifest.shards, strict=True):
        yield Job(
            plan=plan,
            path=limits.path_of(dataset.directory, record),
            read=partial(read_record, dataset.directory, record),
            make=partial(make_shard, dataset.directory, record),
            terms=terms,
        )


def read_record(directory: Location, record: ShardRecord) -> ShardRecord:
    """Read a shard's limits, as :func:`synthnet.store.limits.read_shard`; return its record."""
    limits.read_shard(directory, record)
    return record


def pinned(resolved: Recipe) -> Mapping[str, Limit] | None:
    """Return the pinned limits of the shapes a recipe draws, by id, or None if it has none.

    A recipe of your own has none, though it may have the name of a version.
    """
    if resolved.version not in recipe.available():
        return None
    shipped = recipe.load(resolved.version).digest
    return pins.read_limits(resolved.base) if resolved.digest == shipped else None


def add_pinned(
    directory: Location, shards: Iterable[ShardRecord], known: Mapping[str, Limit]
) -> None:
    """Write the limits of the shards that have none, or damaged ones, from the pins.

    Raise BuildError if the disk is full or cannot be written.
    """
    missing = [record for record in shards if not limits.is_whole(directory, record)]
    if missing:
        storage.make_directory(directory / limits.DIRECTORY)
    for record in missing:
        make_shard(directory, record, known)


def make_shard(
    directory: Location, record: ShardRecord, known: Mapping[str, Limit] = NONE
) -> ShardRecord:
    """Write the limits of one shard, computed unless known, and return the shard's record."""
    surfaces: dict[str, Limit] = {}  # triangulations of one share its limit
    rows = []
    for spec, label in store.read_labels(directory / record.file):
        limit = known.get(spec.id)
        if limit is None:
            family = FAMILIES[spec.family]
            key = family.surface_key(spec.parameters)
            if key not in surfaces:
                try:
                    surfaces[key] = family.limit_spectrum(spec.parameters, len(label))
                except SpectrumError as error:
                    raise SpectrumError(f"{spec.id}, its surface: {error}") from error
            limit = surfaces[key]
        rows.append(limits.compare(spec.id, label, limit))
    limits.write(directory, record, rows)
    return record
