"""Estimates of the labels' discretisation errors, in files beside the shards.

``<home>/<version>/errors/<family>-0000.parquet`` has a row for each shape of
``shards/<family>-0000.parquet``, in its order, and the SHA-256 of that shard. The shards
and the manifest do not depend on whether the estimates are there.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from functools import partial
from pathlib import PurePosixPath

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from synthnet import recipe, store
from synthnet.build import jobs
from synthnet.build.discretisation import Estimate, estimate
from synthnet.build.jobs import BuildReport, Job, Options, Task, Watcher
from synthnet.build.terms import Terms, terms_of
from synthnet.build.workers import Engine
from synthnet.errors import DamagedError, SpectrumError, StoreError
from synthnet.recipe import Recipe
from synthnet.recipe.plan import ShardPlan, plan_shards
from synthnet.store import METADATA_KEY, StoredDataset, storage
from synthnet.store.files import one_line
from synthnet.store.storage import Location
from synthnet.types import ShapeSpec, ShardRecord

DIRECTORY = "errors"
SCHEMA_VERSION = 1
AGAIN = "run `synthnet build --error-estimates` again"

SCHEMA = pa.schema(
    [
        pa.field("id", pa.string(), nullable=False),
        pa.field("error", pa.list_(pa.float64()), nullable=False),  # 1/length²
        pa.field("refined", pa.list_(pa.list_(pa.float64())), nullable=False),  # 1/length²
    ]
)


def build_estimates(
    version: str | Recipe,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> BuildReport:
    """Estimate the error of every label of a built dataset, or finish doing so.

    Parameters
    ----------
    version, root, workers, engine, watcher, wait_for_lock
        As for :func:`synthnet.build.versions.build`.

    Returns
    -------
    BuildReport
        The dataset and what the estimates took.

    Raises
    ------
    StoreError
        If the dataset has not been built there, or a shard is damaged or of another recipe.
    SpectrumError
        If the solver fails on a refined mesh.
    BuildError
        If the directory cannot be written, the disk is full, another build is at work
        there, or a worker died. Finished estimates are kept.
    """
    options = Options(workers, engine, watcher, wait_for_lock)
    resolved = version if isinstance(version, Recipe) else recipe.load(version)
    dataset = store.open_dataset(resolved.version, root)
    directory = dataset.directory
    if dataset.manifest.recipe_digest != resolved.digest:
        raise StoreError(f"{directory} holds {resolved.version} of another recipe: remove it")
    task = Task(
        directory=directory,
        folders=(directory / DIRECTORY,),
        drawn={name: resolved.drawn(name) for name in resolved.families},
        jobs=partial(_jobs, resolved, dataset),
        finished=lambda: dataset if is_complete(dataset) else None,
        complete=lambda _: dataset,
    )
    return jobs.run(task, options, preload=__name__)


def _jobs(recipe: Recipe, dataset: StoredDataset) -> Iterator[Job]:
    terms = terms_of(recipe, dataset.directory)
    for plan, record in zip(plan_shards(recipe), dataset.manifest.shards, strict=True):
        yield estimates_job(plan, record, terms)


def estimates_job(plan: ShardPlan, record: ShardRecord, terms: Terms) -> Job:
    """Return the job that estimates the errors of one shard."""
    return Job(
        plan=plan,
        path=path_of(terms.directory, record),
        read=partial(read_record, terms.directory, record),
        make=partial(estimate_shard, terms.directory, record),
        terms=terms,
    )


def read_record(directory: Location, record: ShardRecord) -> ShardRecord:
    """Read the estimates of a shard, as :func:`read_shard` does, and return the shard's record."""
    read_shard(directory, record)
    return record


def estimate_shard(directory: Location, record: ShardRecord) -> ShardRecord:
    """Estimate the errors of one shard, write them, and return the shard's record."""
    known: dict[str, NDArray[np.float64]] = {}
    estimates = [_estimate(*row, known) for row in labels(directory / record.file)]
    _write_shard(path_of(directory, record), estimates, record)
    return record


def path_of(directory: Location, record: ShardRecord) -> Location:
    """Return where the estimates of a shard are."""
    return directory / DIRECTORY / PurePosixPath(record.file).name


def read_shard(directory: Location, record: ShardRecord) -> list[Estimate]:
    """Read the estimates of one shard.

    What was read is encoded again, and must give the very bytes of the file.

    Raises
    ------
    DamagedError
        If they are missing, damaged, or of a shard of other bytes.
    StoreError
        If the file cannot be read.
    """
    path = path_of(directory, record)
    try:
        content = path.read_bytes()
        with pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True) as file:
            table = file.read()
        header = json.loads((table.schema.metadata or {}).get(METADATA_KEY, b"{}"))
    except FileNotFoundError as error:
        raise DamagedError(f"{path} is missing: {AGAIN}") from error
    except PermissionError as error:
        raise StoreError(f"cannot read {path} ({error.strerror}): ask its owner") from error
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DamagedError(f"{path} is damaged ({one_line(error)}): {AGAIN}") from error
    if not table.schema.equals(SCHEMA) or header != _header(record):
        raise DamagedError(f"{path} is not of {record.file} as it is: {AGAIN}")
    try:
        estimates = [
            Estimate(row["id"], np.array(row["error"]), np.array(row["refined"]))
            for row in table.to_pylist()
        ]
    except ValueError as error:  # rows of different length
        raise DamagedError(f"{path} is damaged ({one_line(error)}): {AGAIN}") from error
    if _encoded(estimates, record) != content:
        raise DamagedError(f"{path} is damaged (its bytes are not those of its content): {AGAIN}")
    return estimates


def read(dataset: StoredDataset) -> Iterator[Estimate]:
    """Read the estimates of all shapes, in the order of the shards.

    Raises
    ------
    DamagedError
        If a file of them is missing or damaged, or of another build.

    Examples
    --------
    >>> from synthnet import store
    >>> dataset = store.open_dataset("1.0-mini")  # doctest: +SKIP
    >>> {row.id: row.error for row in read(dataset)}["cone-00042"]  # doctest: +SKIP
    """
    for record in dataset.manifest.shards:
        yield from read_shard(dataset.directory, record)


def any_made(dataset: StoredDataset) -> bool:
    """Return whether estimates of any shard are there."""
    return any(
        storage.size(path_of(dataset.directory, record)) is not None
        for record in dataset.manifest.shards
    )


def find(dataset: StoredDataset, id: str) -> Estimate | None:
    """Return the estimate of a shape, or None where none have been made.

    Raises
    ------
    DamagedError
        If they have been made, but the file is missing or damaged.
    """
    if not any_made(dataset):
        return None
    family = id.rpartition("-")[0]
    shards = [record for record in dataset.manifest.shards if record.family == family]
    rows = (row for record in shards for row in read_shard(dataset.directory, record))
    return next((row for row in rows if row.id == id), None)


def is_complete(dataset: StoredDataset) -> bool:
    """Return whether the estimates of every shard are there and whole."""
    try:
        for _ in read(dataset):
            pass
    except DamagedError:
        return False
    return True


def labels(path: Location) -> Iterator[tuple[ShapeSpec, NDArray[np.float64]]]:
    """Read shapes and labels of a shard, without the meshes."""
    columns = ["id", "family", "index", "parameters", "group", "eigenvalues"]
    for row in store.read_table(path, columns).to_pylist():
        eigenvalues = np.array(row.pop("eigenvalues"))
        yield ShapeSpec(**{**row, "parameters": json.loads(row["parameters"])}), eigenvalues


def _estimate(
    spec: ShapeSpec, eigenvalues: NDArray[np.float64], known: dict[str, NDArray[np.float64]]
) -> Estimate:
    try:
        return estimate(spec, eigenvalues, known)
    except SpectrumError as error:
        raise SpectrumError(f"{spec.id}, refined: {error}") from error


def _header(record: ShardRecord) -> dict[str, object]:
    return {"schema_version": SCHEMA_VERSION, "shard_sha256": record.sha256}


def _write_shard(path: Location, estimates: list[Estimate], record: ShardRecord) -> None:
    content = _encoded(estimates, record)
    storage.write_atomically(path, lambda partial: partial.write_bytes(content))


def _encoded(estimates: list[Estimate], record: ShardRecord) -> bytes:
    header = json.dumps(_header(record), sort_keys=True)
    table = pa.Table.from_pylist(
        [
            {"id": row.id, "error": row.error.tolist(), "refined": row.refined.tolist()}
            for row in estimates
        ],
        schema=SCHEMA.with_metadata({METADATA_KEY: header}),
    )
    buffer = pa.BufferOutputStream()
    pq.write_table(
        table, buffer, compression="zstd", use_dictionary=False, write_page_checksum=True
    )
    content: bytes = buffer.getvalue().to_pybytes()
    return content
