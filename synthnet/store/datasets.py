"""Datasets: where they are, which kind they are of, and how one is opened.

A dataset is a directory, or a location at a URL, ``<home>/<version>`` with ``shards/*.parquet``
and, written last, ``manifest.json``. Every file is written under another name and moved when
complete, so a file that is there is whole.
"""

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from synthnet import recipe
from synthnet.errors import StoreError, printable, suggestion
from synthnet.mesh.formats import kind_of
from synthnet.recipe import Kind
from synthnet.store import storage
from synthnet.store.imports import IMPORTED, description_of
from synthnet.store.manifest import read_manifest
from synthnet.store.shards import read_labels, read_samples, read_table
from synthnet.store.storage import Location, location
from synthnet.types import Manifest, Sample, ShapeSpec


def home(root: str | os.PathLike[str] | None = None) -> Location:
    """Return the directory or URL that holds the versions.

    ``root`` if given, else ``$SYNTHNET_HOME``, else the user's cache directory by the
    platform's convention.
    """
    where = root if root is not None else os.environ.get("SYNTHNET_HOME")
    if not where and root is None:
        return Path(platformdirs.user_cache_dir("synthnet"))
    return location(where or "")


def dataset_directory(version: str, root: str | os.PathLike[str] | None = None) -> Location:
    """Return where a version is or would be: ``<home>/<version>``.

    Examples
    --------
    >>> dataset_directory("1.0", "/data").as_posix()
    '/data/1.0'
    """
    return home(root) / version


@dataclass(frozen=True, slots=True)
class StoredDataset:
    """A finished dataset, on disk or at a URL."""

    directory: Location
    manifest: Manifest

    @property
    def kind(self) -> Kind:
        """The kind of dataset, by what its manifest says it was made from."""
        if IMPORTED in self.manifest.recipe:
            return Kind.IMPORTED
        if "sealed" in self.manifest.recipe:
            return Kind.SEALED
        return Kind.SCALED if "scale" in self.manifest.recipe else Kind.VERSION

    def paths(self) -> list[Location]:
        """Return the shards' paths in order of family and index."""
        return [self.directory / shard.file for shard in self.manifest.shards]

    def samples(self) -> Iterator[Sample]:
        """Read all samples, a shard at a time."""
        for path in self.paths():
            yield from read_samples(path)

    def specs(self) -> Iterator[ShapeSpec]:
        """Read the parameters of all shapes, without the meshes."""
        return (spec for path in self.paths() for spec, _ in read_labels(path))

    def find(self, id: str) -> Sample:
        """Return the sample of an id; of an import, also of a file's name.

        Raises
        ------
        StoreError
            If there is none, a filter rejected it, or several files have the name.
        """
        id = self.id_of(id)
        family = id.rpartition("-")[0]
        for shard in self.manifest.shards:
            if shard.family != family:
                continue
            for refused in shard.rejections:
                if refused.id == id:
                    raise StoreError(f"{id} was rejected by {refused.reason}: {refused.detail}")
            path = self.directory / shard.file
            if id in read_table(path, ["id"])["id"].to_pylist():
                return next(sample for sample in read_samples(path) if sample.spec.id == id)
        if family not in self.manifest.drawn and kind_of(Path(id).name) is not None:
            raise StoreError(self.no_file(id))
        if family not in self.manifest.drawn:
            families = ", ".join(self.manifest.drawn)
            raise StoreError(
                f"no shape {id!r}: an id is a family ({families}) and a number"
                f"{suggestion(family, self.manifest.drawn)}"
            )
        raise StoreError(
            f"no shape {id!r} in {self.manifest.version}: "
            f"`synthnet info {self.manifest.version} --ids` lists them{self._meant(id)}"
        )

    def files(self) -> dict[str, str]:
        """Return the file of each shape of an import by id, of those that were rejected too."""
        if self.kind is not Kind.IMPORTED:
            return {}
        listed = description_of(self.manifest).files
        return {
            id: file["file"] + (f"#{file['part']}" if "part" in file else "")
            for id, file in listed.items()
        }

    def id_of(self, name: str) -> str:
        """Return the id of a shape by itself or, of an import, by its file's path or name.

        The component of a file that is several shapes follows it: ``parts.stl#0``. Raise StoreError
        if several files have the name.
        """
        files = self.files()
        if name in files:
            return name
        name = printable(name)  # as an import keeps a name that is no text
        tests: tuple[Callable[[str], str], ...] = (
            str,
            lambda file: file.rpartition("/")[2],
            lambda file: file.rpartition("/")[2].rpartition(".")[0],
        )
        for test in tests:
            matching = [id for id, file in files.items() if test(file) == name]
            if len(matching) > 1:
                raise StoreError(
                    f"{name} is {len(matching):,} shapes, such as {matching[0]} and {matching[1]}: "
                    "name one by its id"
                )
            if matching:
                return matching[0]
        return name

    def no_file(self, name: str) -> str:
        """Return that no shape is of this file, and what to do with it."""
        version = self.manifest.version
        if self.kind is Kind.IMPORTED:
            return f"no file {name!r} in {version}: `synthnet info {version} --ids` lists them"
        return (
            f"{version} is no import, and has no file {name!r}: name yours by --dataset; `synthnet "
            f"import` makes one, `synthnet spectrum {name}` takes the file alone"
        )

    def ids(self, family: str | None = None) -> list[str]:
        """Return the ids of all shapes, or of those of a family."""
        shards = [shard for shard in self.manifest.shards if family in (None, shard.family)]
        return [
            id
            for shard in shards
            for id in read_table(self.directory / shard.file, ["id"])["id"].to_pylist()
        ]

    def _meant(self, id: str) -> str:
        """Ask whether a shape of the same number was meant: of torus-5, or of torus-00005/3."""
        family, _, number = id.rpartition("-")
        digits = number.partition("/")[0]
        meant = f"{family}-{int(digits):05d}" if digits.isdecimal() else ""
        return f"; did you mean {meant}?" if meant in self.ids(family) else ""


def there(root: str | os.PathLike[str] | None = None) -> dict[str, Manifest]:
    """Return the manifests of the datasets that are in a directory or at a URL, by name.

    What belongs to another program, or may not be read, is passed over. Raise StoreError if the
    directory cannot be listed.
    """
    manifests = {}
    for name in storage.names(home(root)):
        try:
            manifest = read_manifest(dataset_directory(name, root))
        except (StoreError, PermissionError):
            continue
        if manifest is not None and manifest.version == name:
            manifests[name] = manifest
    return manifests


def known_names(root: str | os.PathLike[str] | None = None) -> list[str]:
    """Return the names that a user may mean: of all versions, and of what is in a directory.

    What is at a URL, or cannot be listed, is left out.
    """
    local = isinstance(home(root), Path)
    try:
        return sorted({*recipe.available(), *(there(root) if local else ())})
    except StoreError:
        return list(recipe.available())


def open_dataset(version: str, root: str | os.PathLike[str] | None = None) -> StoredDataset:
    """Open a finished dataset.

    Raises
    ------
    StoreError
        If it has not been built there.
    RecipeError
        If moreover there is no such version.
    """
    directory = dataset_directory(version, root)
    manifest = read_manifest(directory)
    if manifest is None and recipe.parse_name(version).kind is Kind.SEALED:
        raise StoreError(
            f"the sealed set {version} is not in {directory}: name the directory above it, or "
            "make it with its salt, by `synthnet seal` or `synthnet verify --sealed`"
        )
    if manifest is None:
        recipe.load(version, known=known_names(root))
        out = "" if root is None else f" --out {root}"
        raise StoreError(f"no finished dataset in {directory}: run `synthnet build {version}{out}`")
    if manifest.version != version:
        hint = ""
        if os.sep in version:
            hint = f": give the name {manifest.version}, and as --out or root the directory above"
        raise StoreError(f"{directory} holds {manifest.version}, not {version}{hint}")
    dataset = StoredDataset(directory, manifest)
    if not _may_have_name(dataset.kind, recipe.parse_name(version)):
        raise StoreError(
            f"by its manifest {directory} is of the kind {dataset.kind.value!r}, which cannot have "
            f"the name {version}: remove the folder and make it again"
        )
    return dataset


def _may_have_name(kind: Kind, name: recipe.Name) -> bool:
    if kind is Kind.IMPORTED:  # free names, such as mesh-x100
        return name.version not in recipe.available()
    return kind is name.kind or (kind, name.kind) == (Kind.VERSION, Kind.IMPORTED)  # your recipe's


def open_unversioned(name: str, root: str | os.PathLike[str] | None = None) -> StoredDataset | None:
    """Open a dataset that no version's recipe makes: an import, a sealed set, or your own recipe's.

    Return ``None`` if the name is a version's, built or not, or nothing is there; raise StoreError
    if it is the name of a sealed set that is not there.
    """
    parsed = recipe.parse_name(name)
    sealed = parsed.kind is Kind.SEALED
    if not sealed and read_manifest(dataset_directory(name, root)) is None:
        return None
    dataset = open_dataset(name, root)
    return dataset if sealed or parsed.version not in recipe.available() else None
