"""Meshes of others as a dataset: read, repaired, labelled, certified and stored as drawn ones.

Each directory is a family, each file a shape. A file that cannot be opened, read, repaired or
labelled is a rejection with its reason, as a drawn shape that a filter refuses, and stops no other.
"""

import os
import re
import socket
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from synthnet import recipe, store
from synthnet.build import jobs
from synthnet.build.jobs import BuildReport, Job, Options, Task, Watcher
from synthnet.build.sources import FilePlan, Inputs, plan_files
from synthnet.build.surfaces import LIMITS, Settings, count_parts, import_file
from synthnet.build.terms import SHARDS, made_with, terms_of
from synthnet.build.workers import Engine
from synthnet.errors import BuildError, MeshImportError, StoreError, printable
from synthnet.mesh.reading import Reader
from synthnet.mesh.repair import SPLIT
from synthnet.recipe import Kind
from synthnet.store import ImportDescription, StoredDataset, limits, unpacked
from synthnet.store.storage import Location
from synthnet.types import Manifest, ShardRecord

RULES = 4  # of reading, repair and label; to be raised with any that gives a file another outcome
FACTS = (  # parameters that are no repair
    *("file", "sha256", "part", "scale", "not_orientable", "components", "largest_share"),
    *("shares", "error_bound"),
)
LESS = 0.5  # of the area: a largest component of less is a part of what the file shows


def import_meshes(
    directories: Inputs,
    name: str,
    settings: Settings | None = None,
    *,
    root: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    engine: Engine | None = None,
    watcher: Watcher | None = None,
    wait_for_lock: bool = False,
) -> BuildReport:
    """Make a dataset of mesh files.

    What is finished of an interrupted import is kept, as long as no file has changed.

    Parameters
    ----------
    directories : sequence of Path, or mapping of Path to sequence of Path
        They are searched with all directories below them; the name of each is a family's. Or
        single files, each of the family that its directory's name is. A mapping says which files
        of each directory are meant, and no other is.
    name : str
        Of the dataset: its directory under ``root``.
    settings : synthnet.build.surfaces.Settings, optional
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
    settings = settings or Settings()
    options = Options(workers, engine, watcher, wait_for_lock)
    check_name(name)
    directory = store.dataset_directory(name, root)
    _check_sources(directories, directory)
    plans = _plans(directories, settings)
    description = describe(plans, settings)
    digest = description.digest
    _check_directory(directory)
    drawn = Counter(plan.shard.family for plan in plans for _ in plan.sources)

    def complete(records: Sequence[ShardRecord]) -> StoredDataset:
        manifest = Manifest(
            name, digest, description.to_dict(), dict(drawn), tuple(records), made_with()
        )
        store.write_manifest(directory, manifest)
        return StoredDataset(directory, manifest)

    task = Task(
        directory=directory,
        folders=(directory, directory / SHARDS),
        drawn=drawn,
        jobs=partial(_jobs, plans, settings, digest, directory),
        finished=partial(_finished, directory, description, digest, plans),
        complete=complete,
    )
    return jobs.run(task, options, preload=__name__)


def _plans(directories: Inputs, settings: Settings) -> list[FilePlan]:
    """Return the shards; where each component is a shape, the files are read for that."""
    if settings.components != SPLIT:
        return plan_files(directories, settings.split)
    with Reader() as reader:
        parts = partial(count_parts, settings=settings, reader=reader)
        return plan_files(directories, settings.split, parts)


def describe(plans: Sequence[FilePlan], settings: Settings) -> ImportDescription:
    """Return all that the shards depend on, for the manifest."""
    listed = {
        shape.spec.id: dict(shape.spec.parameters)
        | ({} if source.refused is None else {"refused": ": ".join(source.refused)})
        for plan in plans
        for shape, source in zip(plan.shard.shapes, plan.sources, strict=True)
    }
    options = {**asdict(settings), "without": sorted(settings.without)}
    return ImportDescription(options, LIMITS, RULES, listed)


def file_outcomes(dataset: StoredDataset) -> list[dict[str, str | int]]:
    """Return a row for each shape: its id, file, what was repaired or why it was refused."""
    listed = store.description_of(dataset.manifest).files
    rows: dict[str, dict[str, str | int]] = {}
    for sample in dataset.samples():
        parameters = dict(sample.spec.parameters)
        repairs = {k: v for k, v in parameters.items() if k not in FACTS}
        done = [f"{count:,} {name.replace('_', ' ')}" for name, count in repairs.items()]
        if "components" in parameters:
            done.append(_said_of_components(parameters))
        rows[sample.spec.id] = {
            "outcome": "repaired" if repairs else "as it was",
            "what": ", ".join(done + ["not orientable"] * ("not_orientable" in parameters)),
            "vertices": len(sample.mesh.vertices),
            "faces": len(sample.mesh.faces),
        }
    for refused in dataset.manifest.rejections:
        detail = refused.detail.removeprefix(f"{listed[refused.id]['file']}: ")
        rows[refused.id] = {"outcome": "rejected", "what": f"{refused.reason}: {detail}"}
    return [{"id": id, "file": listed[id]["file"], **rows[id]} for id in listed]


def _said_of_components(parameters: Mapping[str, Any]) -> str:
    share = f"{parameters['components']:,} components, the largest has "
    share += f"{parameters['largest_share']:.1%} of the area"
    return share + (f"; this is part {parameters['part']}" if "part" in parameters else "")


def small_parts(dataset: StoredDataset) -> list[str]:
    """Return the files whose largest component has less than :data:`LESS` of the area."""
    parameters = [spec.parameters for spec in dataset.specs()]
    small = [p for p in parameters if float(p.get("largest_share", 1)) < LESS]
    return sorted({str(p["file"]) for p in small})


# What must hold before


def check_name(name: str) -> None:
    """Raise MeshImportError unless a dataset may have this name: versions begin with a digit."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9._-]*", name):
        raise MeshImportError(
            "--name must begin with a letter, and have letters, digits, '.', '_' or '-', "
            f"got {name!r}"
        )


def _check_sources(directories: Inputs, target: Location) -> None:
    """Raise MeshImportError unless the directories are there, apart, and not the dataset's."""
    seen: dict[Path, Path] = {}
    for directory in directories:
        if not directory.exists():
            raise MeshImportError(f"there is no file or directory {directory}")
        if not (directory.is_dir() or directory.is_file()):
            raise MeshImportError(f"{directory} is a pipe or a device: give directories or files")
        resolved = directory.resolve()
        for other, given in seen.items():
            if _overlap(resolved, other):
                raise MeshImportError(
                    f"{given} and {directory} are the same or one within the other: give one of "
                    "them"
                )
        seen[resolved] = directory
        if isinstance(target, Path) and _overlap(resolved, target.resolve()):
            raise MeshImportError(
                f"the dataset's directory {target} and {directory} are the same or one within the "
                "other: choose another --out or --name"
            )


def _overlap(first: Path, second: Path) -> bool:
    return first.is_relative_to(second) or second.is_relative_to(first)


def _check_directory(directory: Location) -> None:
    """Raise MeshImportError if a directory holds things that are no dataset's."""
    if not isinstance(directory, Path) or not directory.exists():
        return
    if not directory.is_dir():
        raise MeshImportError(f"{directory} is no directory: choose another --out or --name")
    known = {SHARDS, ".lock", store.MANIFEST, limits.DIRECTORY, *unpacked.FOLDERS}
    strange = sorted(p.name for p in directory.iterdir() if p.name not in known)
    strange = [name for name in strange if not re.fullmatch(r"\..*\.partial|\.writable", name)]
    if strange:
        raise MeshImportError(
            f"{directory} holds {printable(strange[0])}, which is of no import: nothing "
            "was overwritten, choose another --out or --name"
        )


def _finished(
    directory: Location, description: ImportDescription, digest: str, plans: Sequence[FilePlan]
) -> StoredDataset | None:
    """Return the dataset if this very import is there and whole; raise if another is there."""
    advice = f"nothing was overwritten: remove {directory} or choose another --name"
    manifest = store.read_manifest(directory)
    dataset = None if manifest is None else StoredDataset(directory, manifest)
    if dataset is not None and dataset.manifest.recipe_digest != digest:
        if dataset.kind is not Kind.IMPORTED:
            raise StoreError(f"{directory} was not imported, but built; {advice}")
        differences = "; ".join(store.description_of(dataset.manifest).differences(description))
        raise StoreError(f"{directory} is of another import than this ({differences}); {advice}")
    if isinstance(directory, Path):
        planned = {directory / plan.shard.file for plan in plans}
        for path in sorted((directory / SHARDS).glob("[!.]*")):
            if path not in planned or store.recipe_digest_of(path) not in (digest, None):
                raise StoreError(
                    f"{path} is of other directories, files, options or rules than this import, "
                    f"or of none; {advice}"
                )
    if dataset is None:
        return None
    whole = all(jobs.is_whole(directory / s.file, s) for s in dataset.manifest.shards)
    return dataset if whole else None


# The work


def _jobs(
    plans: Sequence[FilePlan], settings: Settings, digest: str, directory: Location
) -> Iterator[Job]:
    terms = terms_of(recipe.load(LIMITS), directory)
    for plan in plans:
        path = directory / plan.shard.file
        yield Job(
            plan=plan.shard,
            path=path,
            read=partial(store.read_record, path, digest, plan.shard.ids),
            make=partial(make_shard, plan, settings, digest, path),
            terms=terms,
        )


def make_shard(plan: FilePlan, settings: Settings, digest: str, path: Location) -> ShardRecord:
    """Read, repair, label and write the files of one shard."""
    if not plan.directory.is_dir():  # or all files of it would be rejected as unreadable
        raise BuildError(
            f"the worker on {socket.gethostname()} does not see {plan.directory}: the meshes must "
            "be in a directory that all machines share"
        )
    with Reader() as reader:
        made = [
            import_file(shape, source, settings, reader)
            for shape, source in zip(plan.shard.shapes, plan.sources, strict=True)
        ]
    return jobs.write_shapes(path, made, plan.shard.family, digest)
