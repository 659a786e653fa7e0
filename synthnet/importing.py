"""Meshes of others as a dataset: read, repaired, labelled, certified and stored as drawn ones.

Each directory is a family, each file a shape. A file that cannot be read, repaired or labelled is
a rejection with its reason, as a drawn shape that a filter refuses, and stops no other.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from synthnet import files, recipe, repair, spectrum, splits, storage, store
from synthnet.build import (
    SHARDS,
    BuildReport,
    ShardResult,
    Watcher,
    exclusive,
    label_or_rejection,
    made_with,
    run_shards,
)
from synthnet.errors import DamagedError, MeshImportError
from synthnet.plan import PlannedShape, ShardPlan
from synthnet.reading import SUFFIXES, Reader, UnreadableError
from synthnet.recipe import SplitSettings
from synthnet.storage import Place
from synthnet.types import Manifest, Mesh, Rejection, Sample, ShapeSpec
from synthnet.workers import Engine, local_processes, one_thread

RULES = "1.0"  # the recipe whose limits labels must keep
SHARD_SIZE = 50
SHARES = SplitSettings(0.7, 0.2, 0.1)
UNREADABLE = "unreadable"


@dataclass(frozen=True, slots=True)
class Settings:
    """How files become shapes.

    Parameters
    ----------
    unit_area : bool
        Scale every surface to area 1; its parameter ``scale`` is the factor of lengths.
    keep_largest : bool
        Of several components keep the largest by area, instead of refusing the file.
    split : str
        ``test``: all of them are test shapes. ``hash``: 70, 20 and 10 % by the hash of the file.
    """

    unit_area: bool = False
    keep_largest: bool = False
    split: str = "test"

    def __post_init__(self) -> None:
        if self.split not in ("test", "hash"):
            raise ValueError(f"split must be test or hash, got {self.split!r}")


def import_meshes(
    places: Sequence[Path],
    name: str,
    settings: Settings | None = None,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
) -> BuildReport:
    """Make a dataset of all OBJ, OFF, PLY and STL files in some directories.

    What is finished of an interrupted import is kept, as long as no file has changed.

    Parameters
    ----------
    places : sequence of Path
        Directories, looked through with all below them; the name of each is a family's.
    name : str
        Of the dataset: its directory under ``root``.
    settings : Settings, optional
        How files become shapes.
    root, workers, engine, watcher
        As for :func:`synthnet.build.build`.

    Returns
    -------
    BuildReport
        The dataset, its rejections in the manifest.

    Raises
    ------
    MeshImportError
        If a directory is missing or has no such file, or the name will not do.
    StoreError
        If another import, or files since changed, are there under that name.
    BuildError
        As :func:`synthnet.build.build`.
    """
    started = time.perf_counter()
    settings = settings or Settings()
    check_name(name)
    plans = plan_files(places, settings)
    listed = [[s.spec.id, dict(s.spec.parameters)] for plan in plans for s in plan.shapes]
    described = {"imported": asdict(settings), "rules": RULES}
    digest = hashlib.sha256(json.dumps([described, listed], sort_keys=True).encode()).hexdigest()
    directory = store.dataset_directory(name, root)
    for folder in (directory, directory / SHARDS):
        storage.make_directory(folder)
    roots = {family_of(place): place.resolve() for place in places}
    watcher = watcher or Watcher()
    with exclusive(directory, False, directory, directory / SHARDS):
        watcher.preparing()
        spectrum.compile_solver()
        work = (
            (plan, partial(import_shard, plan, roots[plan.family], settings, digest, directory))
            for plan in plans
        )
        results: dict[int, ShardResult] = {}
        drawn = Counter(plan.family for plan in plans for _ in plan.shapes)
        with engine or local_processes(workers) as at_work:
            watcher.planned(drawn)
            for number, result in run_shards(at_work, work, watcher):
                results[number] = result
                watcher.finished(plans[number], result)
        records = tuple(results[number].record for number in range(len(plans)))
        manifest = Manifest(name, digest, described, dict(drawn), records, made_with())
        store.write_manifest(directory, manifest)
    seconds = Counter[str]()
    for result in results.values():
        seconds[result.record.family] += result.seconds  # type: ignore[assignment]
    return BuildReport(
        dataset=store.StoredDataset(directory, manifest),
        seconds=dict(seconds),
        wall_seconds=time.perf_counter() - started,
        reused=sum(result.reused for result in results.values()),
    )


def what_was_met(dataset: store.StoredDataset) -> list[dict[str, str | int]]:
    """Return a row for each file: its id, name, what was repaired or why it was refused."""
    rows: list[dict[str, str | int]] = []
    for sample in dataset.samples():
        told = dict(sample.spec.parameters)
        row = {"id": sample.spec.id, "file": str(told.pop("file"))}
        repairs = {k: v for k, v in told.items() if k not in ("sha256", "scale")}
        done = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in repairs.items())
        rows.append(
            {
                **row,
                "outcome": "repaired" if repairs else "as it was",
                "what": done,
                "vertices": len(sample.mesh.vertices),
                "faces": len(sample.mesh.faces),
            }
        )
    for refused in dataset.manifest.rejections:
        file, _, detail = refused.detail.partition(": ")
        what = f"{refused.reason}: {detail}"
        rows.append({"id": refused.id, "file": file, "outcome": "rejected", "what": what})
    return sorted(rows, key=lambda row: str(row["id"]))


def check_name(name: str) -> None:
    """Raise MeshImportError unless a dataset may have this name: versions begin with a digit."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]*", name):
        raise MeshImportError(
            f"--name must be a letter, then letters, digits, '.', '_' or '-', got {name!r}"
        )


def plan_files(places: Sequence[Path], settings: Settings) -> list[ShardPlan]:
    """Return the shards: the files of each directory in order of their path.

    The split and the group of a file hang on its bytes alone, so copies are never apart.
    """
    plans, seen = [], dict[str, Path]()
    for place in places:
        if not place.is_dir():
            raise MeshImportError(f"{place} is no directory")
        found = sorted(p for p in place.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
        if not found:
            raise MeshImportError(f"{place} has no {', '.join(SUFFIXES)} file")
        family = family_of(place)
        if family in seen:
            raise MeshImportError(f"{seen[family]} and {place} would both be the family {family}")
        seen[family] = place
        shapes = [_planned(family, i, place, path, settings) for i, path in enumerate(found)]
        for number, first in enumerate(range(0, len(shapes), SHARD_SIZE)):
            chunk = tuple(shapes[first : first + SHARD_SIZE])
            plans.append(ShardPlan(f"{SHARDS}/{family}-{number:04d}.parquet", family, chunk))
    return plans


def family_of(place: Path) -> str:
    """Return the name of a directory in small letters, digits and underscores."""
    return re.sub(r"[^a-z0-9]+", "_", place.resolve().name.lower()).strip("_") or "meshes"


def _planned(family: str, index: int, place: Path, path: Path, settings: Settings) -> PlannedShape:
    digest = files.sha256(path)
    told = {"file": path.relative_to(place).as_posix(), "sha256": digest}
    spec = ShapeSpec(f"{family}-{index:05d}", family, index, told, digest[:16])
    split = "test" if settings.split == "test" else splits.by_hash("import", digest, SHARES, 0)
    return PlannedShape(spec, split, (split,))


def import_shard(
    plan: ShardPlan, place: Path, settings: Settings, digest: str, directory: Place
) -> ShardResult:
    """Make one shard, or keep the one that is there; runs in a worker."""
    started = time.process_time()
    path = directory / plan.file
    damaged = None
    if storage.size(path) is not None:
        try:
            record = store.read_record(path, digest, [shape.spec.id for shape in plan.shapes])
            return ShardResult(record, time.process_time() - started, reused=True)
        except DamagedError as error:
            damaged = str(error)
    samples: list[Sample] = []
    rejections: list[Rejection] = []
    with one_thread, Reader() as reader:
        for shape in plan.shapes:
            made = import_file(shape, place, settings, reader)
            if isinstance(made, Sample):
                samples.append(made)
            else:
                rejections.append(made)
    record = store.write_shard(path, samples, rejections, family=plan.family, recipe_digest=digest)
    return ShardResult(record, time.process_time() - started, reused=False, damaged=damaged)


def import_file(
    shape: PlannedShape, place: Path, settings: Settings, reader: Reader
) -> Sample | Rejection:
    """Return the labelled surface of a file, or why there is none."""
    spec = shape.spec
    file = str(spec.parameters["file"])
    try:
        mesh, found = surface(reader.read(place / file), settings)
    except UnreadableError as error:
        return Rejection(spec.id, spec.family, UNREADABLE, f"{file}: {error}")
    except repair.Refused as error:
        return Rejection(spec.id, spec.family, error.reason, f"{file}: {error.detail}")
    label = label_or_rejection(spec, mesh, recipe.load(RULES))
    if isinstance(label, Rejection):
        return replace(label, detail=f"{file}: {label.detail}")
    return Sample(
        spec=replace(spec, parameters={**spec.parameters, **found}),
        mesh=mesh,
        eigenvalues=label.eigenvalues,
        trivial=label.trivial,
        certificate=label.certificate,
        isometries=np.eye(3)[None],
        split=shape.split,
        paper_splits=shape.paper_splits,
    )


def surface(read: Mesh, settings: Settings) -> tuple[Mesh, dict[str, float | int]]:
    """Return the surface at the precision of the store, and what was done to the triangles.

    It is centred, so that float32 loses nothing far from the origin.

    Raises
    ------
    Refused
        If it cannot be repaired, or float32 makes a triangle degenerate.
    """
    done = repair.repair(read, keep_largest=settings.keep_largest)
    found: dict[str, float | int] = {k.replace(" ", "_"): v for k, v in done.repairs.items()}
    if not done.orientable:
        found["not_orientable"] = 1
    mesh = repair.centred(done.mesh)
    if settings.unit_area:
        mesh, found["scale"] = repair.unit_area(mesh)
    stored = mesh.stored()
    if flat := repair.flat_faces(stored):
        raise repair.Refused("degenerate_face", f"{flat} faces have no area in float32")
    return stored, found
