"""Estimates of the labels' discretisation errors, in files beside the shards.

``<home>/<version>/errors/<family>-0000.parquet`` has a row for each shape of
``shards/<family>-0000.parquet``, in its order, and the SHA-256 of that shard. The shards
and the manifest do not depend on whether the estimates are there.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import threadpoolctl
from numpy.typing import NDArray

from synthnet import files, recipe, store
from synthnet.build import BuildReport, ShardResult, Watcher, exclusive, run_shards
from synthnet.discretisation import Estimate, estimate
from synthnet.errors import DamagedError, SpectrumError, StoreError
from synthnet.files import one_line, write_atomically
from synthnet.plan import ShardPlan, plan_shards
from synthnet.store import METADATA_KEY, StoredDataset
from synthnet.types import ShapeSpec, ShardRecord
from synthnet.workers import cores, local_processes

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
    version: str,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> BuildReport:
    """Estimate the error of every label of a built dataset, or finish doing so.

    Parameters
    ----------
    version, root, workers, watcher, wait_for_lock
        As for :func:`synthnet.build.build`.

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
    started = time.perf_counter()
    if workers is not None and workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    wanted = recipe.load(version)
    dataset = store.open_dataset(version, root)
    if dataset.manifest.recipe_digest != wanted.digest:
        raise StoreError(f"{dataset.directory} holds {version} of another recipe: remove it")
    if is_complete(dataset):
        return BuildReport(dataset, {}, time.perf_counter() - started, 0, nothing_to_do=True)
    files.make_directory(dataset.directory / DIRECTORY)
    watcher = watcher or Watcher()
    processes = workers or cores()
    results: list[ShardResult] = []
    with exclusive(dataset.directory, wait_for_lock):
        files.remove_partial_files(dataset.directory / DIRECTORY)
        plans = plan_shards(wanted)
        watcher.planned(plans)
        records = {record.file: record for record in dataset.manifest.shards}
        work = partial(estimate_shard, directory=dataset.directory, records=records)
        with local_processes(processes) as executor:
            for plan, result in run_shards(executor, work, plans, processes + 1, watcher):
                results.append(result)
                watcher.finished(plan, result)
    seconds = dict.fromkeys(dataset.manifest.drawn, 0.0)
    for result in results:
        seconds[result.record.family] += result.seconds
    reused = sum(result.reused for result in results)
    return BuildReport(dataset, seconds, time.perf_counter() - started, reused)


def estimate_shard(
    plan: ShardPlan, directory: Path, records: Mapping[str, ShardRecord]
) -> ShardResult:
    """Estimate the errors of one shard, or read them if they are there; runs in a worker."""
    started = time.process_time()
    record = records[plan.file]
    path = path_of(directory, record)
    damaged = None
    if path.exists():
        try:
            read_shard(directory, record)
            return ShardResult(record, time.process_time() - started, reused=True)
        except DamagedError as error:
            damaged = str(error)
    with threadpoolctl.threadpool_limits(1):
        estimates = [_estimate(*row) for row in labels(directory / record.file)]
    _write_shard(path, estimates, record)
    return ShardResult(record, time.process_time() - started, reused=False, damaged=damaged)


def path_of(directory: Path, record: ShardRecord) -> Path:
    """Return where the estimates of a shard are."""
    return directory / DIRECTORY / Path(record.file).name


def read_shard(directory: Path, record: ShardRecord) -> list[Estimate]:
    """Read the estimates of one shard.

    Raises
    ------
    DamagedError
        If they are missing, damaged, or of a shard of other bytes.
    StoreError
        If the file cannot be read.
    """
    path = path_of(directory, record)
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
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
    return [
        Estimate(row["id"], np.array(row["error"]), np.array(row["refined"]))
        for row in table.to_pylist()
    ]


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
    >>> {one.id: one.error for one in read(dataset)}["cone-00042"]  # doctest: +SKIP
    """
    for record in dataset.manifest.shards:
        yield from read_shard(dataset.directory, record)


def find(dataset: StoredDataset, id: str) -> Estimate | None:
    """Return the estimate of a shape, or None where none have been made.

    Raises
    ------
    DamagedError
        If they have been made, but the file is missing or damaged.
    """
    if not (dataset.directory / DIRECTORY).is_dir():
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


def labels(path: Path) -> Iterator[tuple[ShapeSpec, NDArray[np.float64]]]:
    """Read shapes and labels of a shard, without the meshes."""
    columns = ["id", "family", "index", "parameters", "group", "eigenvalues"]
    for row in store.read_table(path, columns).to_pylist():
        eigenvalues = np.array(row.pop("eigenvalues"))
        yield ShapeSpec(**{**row, "parameters": json.loads(row["parameters"])}), eigenvalues


def _estimate(spec: ShapeSpec, eigenvalues: NDArray[np.float64]) -> Estimate:
    try:
        return estimate(spec, eigenvalues)
    except SpectrumError as error:
        raise SpectrumError(f"{spec.id}, refined: {error}") from error


def _header(record: ShardRecord) -> dict[str, object]:
    return {"schema_version": SCHEMA_VERSION, "shard_sha256": record.sha256}


def _write_shard(path: Path, estimates: list[Estimate], record: ShardRecord) -> None:
    header = json.dumps(_header(record), sort_keys=True)
    table = pa.Table.from_pylist(
        [
            {"id": one.id, "error": one.error.tolist(), "refined": one.refined.tolist()}
            for one in estimates
        ],
        schema=SCHEMA.with_metadata({METADATA_KEY: header}),
    )
    write_atomically(
        path,
        lambda partial: pq.write_table(
            table, partial, compression="zstd", use_dictionary=False, write_page_checksum=True
        ),
    )
