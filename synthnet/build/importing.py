"""Meshes of others as a dataset: read, repaired, labelled, certified and stored as drawn ones.

Each directory is a family, each file a shape. A file that cannot be opened, read, repaired or
labelled is a rejection with its reason, as a drawn shape that a filter refuses, and stops no other.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import socket
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from synthnet import recipe, store
from synthnet.build import filters
from synthnet.build.versions import (
    SHARDS,
    BuildReport,
    ShardResult,
    Terms,
    Watcher,
    agree,
    check_workers,
    exclusive,
    is_whole,
    label_or_rejection,
    made_with,
    make_shards,
    report,
    terms_of,
)
from synthnet.build.workers import Engine, one_thread
from synthnet.errors import BuildError, DamagedError, MeshImportError, StoreError
from synthnet.mesh import repair
from synthnet.mesh.formats import SUFFIXES, UnreadableError
from synthnet.mesh.reading import ChangedError, Reader
from synthnet.recipe import SplitSettings, splits
from synthnet.recipe.plan import PlannedShape, ShardPlan
from synthnet.store import files, storage
from synthnet.store.files import one_line
from synthnet.store.storage import Location
from synthnet.types import Manifest, Mesh, Rejection, Sample, ShapeSpec

LIMITS = "1.0"  # the recipe whose limits labels must keep
RULES = 1  # of reading and repair; to be raised with any that gives a file another outcome
SHARD_FILES, SHARD_BYTES = 50, 8_000_000  # at most, so that Ctrl-C loses little
MOST_BYTES = 2_000_000_000  # of a file; MOST_FACES as ASCII STL, the longest, are 1 GB
SHARES = SplitSettings(0.7, 0.2, 0.1)
UNREADABLE, CHANGED, TOO_LARGE, MEMORY = "unreadable", "changed", "too_large", "memory"
FACTS = ("file", "sha256", "scale", "not_orientable")  # parameters that are no repair


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


@dataclass(frozen=True, slots=True)
class Source:
    """A file that was found.

    Parameters
    ----------
    path : Path
        Where it is.
    name : str
        Its path in the directory it was found in, without what cannot be printed.
    size : int
        In bytes.
    sha256 : str
        Of its bytes; empty if it is refused.
    refused : tuple of str
        Reason and detail, if it is not to be read at all.
    """

    path: Path
    name: str
    size: int = 0
    sha256: str = ""
    refused: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True)
class FilePlan:
    """A shard to be, the file of each of its shapes, and the directory they were found in."""

    shard: ShardPlan
    sources: tuple[Source, ...]
    place: Path


def import_meshes(
    places: Sequence[Path],
    name: str,
    settings: Settings | None = None,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
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
    root, workers, engine, watcher, wait_for_lock
        As for :func:`synthnet.build.versions.build`.

    Returns
    -------
    BuildReport
        The dataset, its rejections in the manifest.

    Raises
    ------
    MeshImportError
        If a directory is missing, has no such file or is where the dataset would be, or the
        name will not do.
    StoreError
        If another import, or something else, is there under that name; nothing is overwritten.
    BuildError
        As :func:`synthnet.build.versions.build`.
    """
    started = time.perf_counter()
    settings = settings or Settings()
    check_workers(workers, engine)
    check_name(name)
    directory = store.dataset_directory(name, root)
    _check_places(places, directory)
    plans = plan_files(places, settings)
    described = describe(plans, settings)
    digest = digest_of(described)
    _check_directory(directory)
    for folder in (directory, directory / SHARDS):
        storage.make_directory(folder)
    with exclusive(directory, wait_for_lock, directory, directory / SHARDS):
        finished = _finished(directory, described, digest, plans)
        if finished is not None:
            return replace(report(finished, [], started), nothing_to_do=True)
        terms = terms_of(recipe.load(LIMITS), directory)
        work = partial(import_work, settings=settings, digest=digest, terms=terms)
        jobs = ((plan.shard, partial(work, plan)) for plan in plans)
        drawn = Counter(plan.shard.family for plan in plans for _ in plan.sources)
        results = make_shards(
            jobs, directory, drawn, workers=workers, engine=engine, watcher=watcher
        )
        records = tuple(result.record for result in results)
        manifest = Manifest(name, digest, described, dict(drawn), records, made_with())
        store.write_manifest(directory, manifest)
    return report(store.StoredDataset(directory, manifest), results, started)


def describe(plans: Sequence[FilePlan], settings: Settings) -> dict[str, Any]:
    """Return all that the shards hang on, as it stands in the manifest in place of a recipe."""
    listed = {
        shape.spec.id: dict(shape.spec.parameters)
        | ({} if source.refused is None else {"refused": ": ".join(source.refused)})
        for plan in plans
        for shape, source in zip(plan.shard.shapes, plan.sources, strict=True)
    }
    return {"imported": asdict(settings), "limits": LIMITS, "rules": RULES, "files": listed}


def digest_of(described: dict[str, Any]) -> str:
    """Return the SHA-256 of what :func:`describe` returns."""
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Say in what two imports differ, each as :func:`describe` has it."""
    earlier, options = before["imported"], now["imported"]
    told = [
        f"other --{name.replace('_', '-')}"
        for name in sorted(earlier.keys() | options.keys())
        if earlier.get(name) != options.get(name)
    ]
    told += [f"other {name}" for name in ("limits", "rules") if before[name] != now[name]]
    old, new = (
        {f"{id.rpartition('-')[0]}/{f['file']}": f for id, f in described["files"].items()}
        for described in (before, now)
    )
    for word, found in (
        ("new", new.keys() - old.keys()),
        ("missing", old.keys() - new.keys()),
        ("changed", {key for key in new.keys() & old.keys() if new[key] != old[key]}),
    ):
        if found:
            such_as = "" if len(found) == 1 else "such as "
            told.append(f"{len(found):,} {word}: {such_as}{min(found)}")
    return told or ["other names of files"]


def what_was_met(dataset: store.StoredDataset) -> list[dict[str, str | int]]:
    """Return a row for each file: its id, name, what was repaired or why it was refused."""
    listed = dataset.manifest.recipe["files"]
    rows: dict[str, dict[str, str | int]] = {}
    for sample in dataset.samples():
        told = dict(sample.spec.parameters)
        repairs = {k: v for k, v in told.items() if k not in FACTS}
        done = [f"{count:,} {name.replace('_', ' ')}" for name, count in repairs.items()]
        rows[sample.spec.id] = {
            "outcome": "repaired" if repairs else "as it was",
            "what": ", ".join(done + ["not orientable"] * ("not_orientable" in told)),
            "vertices": len(sample.mesh.vertices),
            "faces": len(sample.mesh.faces),
        }
    for refused in dataset.manifest.rejections:
        detail = refused.detail.removeprefix(f"{listed[refused.id]['file']}: ")
        rows[refused.id] = {"outcome": "rejected", "what": f"{refused.reason}: {detail}"}
    return [{"id": id, "file": listed[id]["file"], **rows[id]} for id in listed]


def check_name(name: str) -> None:
    """Raise MeshImportError unless a dataset may have this name: versions begin with a digit."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]*", name):
        raise MeshImportError(
            f"--name must be a letter, then letters, digits, '.', '_' or '-', got {name!r}"
        )


def _check_places(places: Sequence[Path], directory: Location) -> None:
    """Raise MeshImportError unless the directories are there, apart, and not the dataset's."""
    seen: dict[Path, Path] = {}
    for place in places:
        if not place.is_dir():
            raise MeshImportError(f"{place} is no directory")
        where = place.resolve()
        for other, given in seen.items():
            if _overlap(where, other):
                raise MeshImportError(
                    f"{given} and {place} are the same or one within the other: give one of them"
                )
        seen[where] = place
        if isinstance(directory, Path) and _overlap(where, directory.resolve()):
            raise MeshImportError(
                f"the dataset's directory {directory} and {place} are the same or one within the "
                "other: choose another --out or --name"
            )


def _overlap(one: Path, other: Path) -> bool:
    return one == other or one in other.parents or other in one.parents


def _check_directory(directory: Location) -> None:
    """Raise MeshImportError if a directory holds things that are no dataset's."""
    if not isinstance(directory, Path) or not directory.exists():
        return
    if not directory.is_dir():
        raise MeshImportError(f"{directory} is no directory: choose another --out or --name")
    known = {SHARDS, ".lock", store.MANIFEST, "processed"}
    strange = sorted(p.name for p in directory.iterdir() if p.name not in known)
    strange = [name for name in strange if not re.fullmatch(r"\..*\.partial|\.writable", name)]
    if strange:
        raise MeshImportError(
            f"{directory} holds {files.printable(strange[0])}, which is of no import: nothing "
            "was overwritten, choose another --out or --name"
        )


def _finished(
    directory: Location, described: dict[str, Any], digest: str, plans: Sequence[FilePlan]
) -> store.StoredDataset | None:
    """Return the dataset if this very import is there and whole.

    Raises
    ------
    StoreError
        If another dataset is there, or a part of one.
    """
    advice = f"nothing was overwritten: remove {directory} or choose another --name"
    manifest = store.read_manifest(directory)
    if manifest is not None and manifest.recipe_digest != digest:
        if "imported" not in manifest.recipe:
            raise StoreError(f"{directory} was not imported, but built; {advice}")
        told = "; ".join(differences(manifest.recipe, described))
        raise StoreError(f"{directory} is of another import than this ({told}); {advice}")
    if isinstance(directory, Path):
        planned = {directory / plan.shard.file for plan in plans}
        for path in sorted((directory / SHARDS).glob("[!.]*")):
            if path not in planned or store.recipe_digest_of(path) not in (digest, None):
                raise StoreError(
                    f"{path} is of other directories, files, options or rules than this import, "
                    f"or of none; {advice}"
                )
    if manifest is None or not all(is_whole(directory / s.file, s) for s in manifest.shards):
        return None
    return store.StoredDataset(directory, manifest)


def plan_files(places: Sequence[Path], settings: Settings) -> list[FilePlan]:
    """Return the shards: the files of each directory in order of their path.

    The split and the group of a file hang on its bytes alone, so copies are never apart.
    """
    plans, seen = list[FilePlan](), dict[str, Path]()
    for place in (place.resolve() for place in places):  # a worker may be in another directory
        paths = list(_found(place))
        if not paths:
            raise MeshImportError(f"{place} has no {', '.join(SUFFIXES)} file")
        family = family_of(place)
        if family in seen:
            raise MeshImportError(f"{seen[family]} and {place} would both be the family {family}")
        seen[family] = place
        sources = [_source(place, path, error) for path, error in sorted(paths)]
        shapes = [_planned(family, i, source, settings) for i, source in enumerate(sources)]
        for number, (first, last) in enumerate(_chunks([source.size for source in sources])):
            file = f"{SHARDS}/{family}-{number:04d}.parquet"
            shard = ShardPlan(file, family, tuple(shapes[first:last]))
            plans.append(FilePlan(shard, tuple(sources[first:last]), place))
    return plans


def family_of(place: Path) -> str:
    """Return the name of a directory in small letters, digits and underscores.

    Examples
    --------
    >>> family_of(Path("scans/Ears (left)"))
    'ears_left'
    """
    return re.sub(r"[^a-z0-9]+", "_", place.name.lower()).strip("_") or "meshes"


def _found(place: Path) -> Iterator[tuple[Path, str]]:
    """Yield the files of a mesh's suffix; and directories that cannot be read, with why."""
    errors: list[OSError] = []
    for folder, _, names in os.walk(place, onerror=errors.append):
        for name in names:
            if Path(name).suffix.lower() in SUFFIXES:
                yield Path(folder, name), ""
    for error in errors:
        yield Path(error.filename), f"cannot be opened ({error.strerror})"


def _source(place: Path, path: Path, error: str) -> Source:
    name = files.printable(path.relative_to(place).as_posix())
    if error:
        return Source(path, f"{name}/", refused=(UNREADABLE, error))
    try:
        size = path.stat().st_size
        if not path.is_file():
            return Source(path, name, refused=(UNREADABLE, "is no file"))
        if size > MOST_BYTES:
            told = f"{size:,} bytes, more than {MOST_BYTES:,}"
            return Source(path, name, refused=(TOO_LARGE, told))
        return Source(path, name, size, files.sha256(path))
    except OSError as wrong:
        told = f"cannot be opened ({wrong.strerror})"
        return Source(path, name, refused=(UNREADABLE, told))


def _chunks(sizes: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield the first and past the last file of each shard."""
    first, total = 0, 0
    for i, size in enumerate(sizes):
        if i > first and (i - first == SHARD_FILES or total + size > SHARD_BYTES):
            yield first, i
            first, total = i, 0
        total += size
    yield first, len(sizes)


def _planned(family: str, index: int, source: Source, settings: Settings) -> PlannedShape:
    told = {"file": source.name, "sha256": source.sha256}
    spec = ShapeSpec(f"{family}-{index:05d}", family, index, told, source.sha256[:16])
    split = split_of(source.sha256, settings.split)
    return PlannedShape(spec, split, (split,))


def split_of(sha256: str, rule: str) -> str:
    """Return the split of a file by the rule of :class:`Settings`."""
    return "test" if rule == "test" else splits.by_hash("import", sha256, SHARES, 0)


def import_work(plan: FilePlan, *, settings: Settings, digest: str, terms: Terms) -> ShardResult:
    """Make one shard on the terms of an import; runs in a worker, on whatever machine."""
    agree(terms)
    if not plan.place.is_dir():  # or all files of it would be rejected as unreadable
        raise BuildError(
            f"the worker on {socket.gethostname()} does not see {plan.place}: the meshes must be "
            "in a directory that all machines share"
        )
    return import_shard(plan, settings, digest, terms.directory)


def import_shard(
    plan: FilePlan, settings: Settings, digest: str, directory: Location
) -> ShardResult:
    """Make one shard, or keep the one that is there."""
    started = time.process_time()
    path = directory / plan.shard.file
    damaged = None
    if storage.size(path) is not None:
        try:
            ids = [shape.spec.id for shape in plan.shard.shapes]
            record = store.read_record(path, digest, ids)
            return ShardResult(record, time.process_time() - started, reused=True)
        except DamagedError as error:
            damaged = str(error)
    samples: list[Sample] = []
    rejections: list[Rejection] = []
    with one_thread, Reader() as reader:
        for shape, source in zip(plan.shard.shapes, plan.sources, strict=True):
            made = import_file(shape, source, settings, reader)
            if isinstance(made, Sample):
                samples.append(made)
            else:
                rejections.append(made)
    family = plan.shard.family
    record = store.write_shard(path, samples, rejections, family=family, recipe_digest=digest)
    return ShardResult(record, time.process_time() - started, reused=False, damaged=damaged)


def import_file(
    shape: PlannedShape, source: Source, settings: Settings, reader: Reader
) -> Sample | Rejection:
    """Return the labelled surface of a file, or why there is none."""
    spec = shape.spec

    def rejected(reason: str, detail: str) -> Rejection:
        return Rejection(spec.id, spec.family, reason, f"{source.name}: {detail}")

    if source.refused is not None:
        return rejected(*source.refused)
    try:
        mesh, found = surface(reader.read(source.path, source.sha256), settings)
        label = label_or_rejection(spec, mesh, recipe.load(LIMITS))
    except UnreadableError as error:
        return rejected(UNREADABLE, str(error))
    except ChangedError as error:
        return rejected(CHANGED, str(error))
    except repair.Refused as error:
        return rejected(error.reason, error.detail)
    except MemoryError:
        return rejected(MEMORY, "its surface or label needs more memory than there is")
    except ValueError as error:
        return rejected(filters.SOLVER, one_line(error))
    if isinstance(label, Rejection):
        return rejected(label.reason, label.detail)
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
