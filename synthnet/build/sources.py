"""Find mesh files, and plan the shards and shapes they become: the first half of an import."""

import os
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

from synthnet.build.terms import SHARDS
from synthnet.errors import MeshImportError, printable
from synthnet.mesh.formats import SUFFIXES, kind_of, no_mesh
from synthnet.recipe import SplitSettings, splits
from synthnet.recipe.plan import PlannedShape, ShardPlan
from synthnet.store import files
from synthnet.types import ShapeSpec

SHARD_FILES, SHARD_BYTES = 50, 8_000_000  # at most, so that Ctrl-C loses little
MOST_BYTES = 2_000_000_000  # of a file; MOST_FACES as ASCII STL, the longest, are 1 GB
SHARES = SplitSettings(0.7, 0.2, 0.1)
UNREADABLE, TOO_LARGE = "unreadable", "too_large"


@dataclass(frozen=True, slots=True)
class Source:
    """A mesh file."""

    path: Path
    name: str  # its path in the directory it was found in, without what cannot be printed
    size: int = 0  # in bytes
    sha256: str = ""  # of its bytes; empty if it is refused
    refused: tuple[str, str] | None = None  # reason and detail, if it is not to be read at all
    part: int | None = None  # the component, if each is a shape, by area from the largest, 0


@dataclass(frozen=True, slots=True)
class FilePlan:
    """A shard to be made, the source of each of its shapes, and the directory that has them."""

    shard: ShardPlan
    sources: tuple[Source, ...]
    directory: Path


Inputs: TypeAlias = Sequence[Path] | Mapping[Path, Sequence[Path]]


def plan_files(
    inputs: Inputs, split: str, parts: Callable[[Source], int] | None = None
) -> list[FilePlan]:
    """Return the shards: the files of each directory in order of their path.

    The split and the group of a file depend on its bytes alone, so copies are never apart.
    ``inputs`` are directories, and single files; or directories and which files of each. ``split``
    is as for :func:`split_of`; ``parts`` says how many shapes a file is, one for each of its
    components. Raise MeshImportError if a directory has no mesh file, or two of them would be the
    same family.
    """
    plans, seen = list[FilePlan](), dict[str, Path]()
    for directory, paths in _by_directory(inputs).items():
        if not paths:
            raise MeshImportError(f"{directory} has no {', '.join(SUFFIXES)} file")
        family = family_of(directory)
        if family in seen:
            raise MeshImportError(
                f"{seen[family]} and {directory} would both be the family {family}"
            )
        seen[family] = directory
        sources = [_source(directory, path, error) for path, error in sorted(paths)]
        if parts is not None:
            sources = [part for source in sources for part in _parts(source, parts)]
        shapes = [_planned(family, i, source, split) for i, source in enumerate(sources)]
        for number, (first, last) in enumerate(_chunks([source.size for source in sources])):
            file = f"{SHARDS}/{family}-{number:04d}.parquet"
            shard = ShardPlan(file, family, tuple(shapes[first:last]))
            plans.append(FilePlan(shard, tuple(sources[first:last]), directory))
    return plans


def _by_directory(inputs: Inputs) -> dict[Path, list[tuple[Path, str]]]:
    """Return the files of each directory, absolute, and why those that cannot be opened cannot.

    A file that is given by itself belongs to the directory that it is in.
    """
    if isinstance(inputs, Mapping):
        resolved = {given: given.resolve() for given in inputs}
        return {
            resolved[given]: [(resolved[given] / path.relative_to(given), "") for path in chosen]
            for given, chosen in inputs.items()
        }
    files = defaultdict[Path, list[tuple[Path, str]]](list)
    for given in inputs:
        path = given.absolute()  # a worker may be elsewhere
        if path.is_file():
            if kind_of(path.name) is None:
                raise MeshImportError(no_mesh(str(given)))
            directory = path.parent.resolve()
            files[directory].append((directory / path.name, ""))
        else:
            directory = path.resolve()
            files[directory] += _mesh_files(directory)
    return files


def _parts(source: Source, parts: Callable[[Source], int]) -> Iterator[Source]:
    """Yield a source for each component of a file, or the file itself if it has but one."""
    count = 1 if source.refused is not None else parts(source)
    if count == 1:
        yield source
    else:
        yield from (replace(source, part=part) for part in range(count))


def family_of(directory: Path) -> str:
    """Return the name of a directory in small letters, digits and underscores.

    Examples
    --------
    >>> family_of(Path("scans/Ears (left)"))
    'ears_left'
    """
    return re.sub(r"[^a-z0-9]+", "_", directory.name.lower()).strip("_") or "meshes"


def _mesh_files(directory: Path) -> Iterator[tuple[Path, str]]:
    """Yield the files of a mesh's suffix; and directories that are not read, with why.

    A link to one may lead round in a circle, or to files that are here already.
    """
    errors: list[OSError] = []
    for folder, folders, names in os.walk(directory, onerror=errors.append):
        for path in (Path(folder, name) for name in folders):
            if path.is_symlink():
                yield path, "is a link to a directory, and not followed: name the directory"
        for name in names:
            if kind_of(name) is not None:
                yield Path(folder, name), ""
    for error in errors:
        yield Path(error.filename), f"cannot be opened ({error.strerror})"


def not_meshes(directories: Sequence[Path]) -> Counter[str]:
    """Count the files that an import does not read, by the ends of their names."""
    return Counter(
        Path(name).suffix.lower() or "without a suffix"
        for directory in directories
        for _, _, names in os.walk(directory)
        for name in names
        if kind_of(name) is None
    )


def _source(directory: Path, path: Path, error: str) -> Source:
    name = printable(path.relative_to(directory).as_posix())
    if error:
        return Source(path, f"{name}/", refused=(UNREADABLE, error))
    try:
        size = path.stat().st_size
        if not path.is_file():
            return Source(path, name, refused=(UNREADABLE, "is no file"))
        if size > MOST_BYTES:
            detail = f"{size:,} bytes, more than {MOST_BYTES:,}"
            return Source(path, name, refused=(TOO_LARGE, detail))
        return Source(path, name, size, files.sha256(path))
    except OSError as wrong:
        detail = f"cannot be opened ({wrong.strerror})"
        return Source(path, name, refused=(UNREADABLE, detail))


def _chunks(sizes: Sequence[int]) -> Iterator[tuple[int, int]]:
    """Yield the first and past the last file of each shard."""
    first, total = 0, 0
    for i, size in enumerate(sizes):
        if i > first and (i - first == SHARD_FILES or total + size > SHARD_BYTES):
            yield first, i
            first, total = i, 0
        total += size
    yield first, len(sizes)


def _planned(family: str, index: int, source: Source, rule: str) -> PlannedShape:
    parameters: dict[str, float | int | str] = {"file": source.name, "sha256": source.sha256}
    if source.part is not None:
        parameters["part"] = source.part
    spec = ShapeSpec(f"{family}-{index:05d}", family, index, parameters, source.sha256[:16])
    split = split_of(source.sha256, rule)
    return PlannedShape(spec, split, (split,))


def split_of(sha256: str, rule: str) -> str:
    """Return the split of a file by its hash: ``rule`` is ``test`` or ``hash``."""
    return "test" if rule == "test" else splits.by_hash("import", sha256, SHARES, 0)
