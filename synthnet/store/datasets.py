"""The dataset on disk: Parquet shards, their digests, and the manifest.

A dataset is a directory, or a place at a URL, ``<home>/<version>`` with
``shards/*.parquet`` and, written last, ``manifest.json``. Every file is written beside its
place and moved there when complete, so a file that is there is whole.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from synthnet import recipe
from synthnet.errors import DamagedError, StoreError
from synthnet.store.files import one_line
from synthnet.store.storage import Location, location, sha256, size, write_atomically, write_text
from synthnet.types import Certificate, Manifest, Mesh, Rejection, Sample, ShapeSpec, ShardRecord

SCHEMA_VERSION = 2
MANIFEST = "manifest.json"
SEAL = "sha256"
AGAIN = (
    "run `synthnet build` again, with its --version and --out, or for an import the same "
    "`synthnet import`"
)
METADATA_KEY = b"synthnet"

SCHEMA = pa.schema(
    [
        pa.field("id", pa.string(), nullable=False),
        pa.field("family", pa.string(), nullable=False),
        pa.field("index", pa.int32(), nullable=False),
        pa.field("parameters", pa.string(), nullable=False),  # JSON object
        pa.field("group", pa.string(), nullable=False),
        pa.field("split", pa.string(), nullable=False),
        pa.field("paper_splits", pa.list_(pa.string()), nullable=False),
        pa.field("eigenvalues", pa.list_(pa.float64()), nullable=False),
        pa.field("trivial", pa.float64(), nullable=False),
        pa.field("count", pa.int32(), nullable=False),  # of the certificate, as the next two
        pa.field("shift", pa.float64(), nullable=False),
        pa.field("residual", pa.float64(), nullable=False),
        pa.field("isometries", pa.list_(pa.list_(pa.float64(), 9)), nullable=False),
        pa.field("vertices", pa.list_(pa.list_(pa.float32(), 3)), nullable=False),
        pa.field("faces", pa.list_(pa.list_(pa.int32(), 3)), nullable=False),
    ]
)
# Splitting the bytes of floats and of slowly varying integers into streams makes the
# shards a third smaller than dictionaries do, and faster to write.
STREAMS = ("vertices.list.element.list.element", "faces.list.element.list.element")


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


# Shards


def write_shard(
    path: Location,
    samples: Sequence[Sample],
    rejections: Sequence[Rejection],
    *,
    family: str,
    recipe_digest: str,
) -> ShardRecord:
    """Write the samples of one shard and return its record.

    The same samples give the same bytes.
    """
    header = {
        "schema_version": SCHEMA_VERSION,
        "recipe_digest": recipe_digest,
        "family": family,
        "rejections": [asdict(r) for r in rejections],
    }
    table = _table(samples, header)
    write_atomically(path, lambda partial: _encode(table, partial))
    return _record(path, table, header)


def _table(samples: Sequence[Sample], header: dict[str, Any]) -> pa.Table:
    schema = SCHEMA.with_metadata({METADATA_KEY: json.dumps(header, sort_keys=True)})
    return pa.Table.from_arrays([_column(f.name, samples) for f in SCHEMA], schema=schema)


def _encode(table: pa.Table, where: Path | pa.BufferOutputStream) -> None:
    pq.write_table(
        table,
        where,
        compression="zstd",
        compression_level=3,
        row_group_size=max(table.num_rows, 1),
        use_dictionary=False,
        column_encoding=dict.fromkeys(STREAMS, "BYTE_STREAM_SPLIT"),
        write_page_checksum=True,
    )


def read_table(path: Location, columns: Sequence[str] | None = None) -> pa.Table:
    """Read a shard, its page checksums verified.

    Raises
    ------
    StoreError
        If the file is missing, truncated, altered or of another schema.
    """
    try:
        with (
            _opened(path, whole=columns is None) as source,
            pq.ParquetFile(source, page_checksum_verification=True) as file,
        ):
            if not file.schema_arrow.equals(SCHEMA):
                raise StoreError(f"{path} has another schema: remove it and build again")
            return file.read(columns=list(columns) if columns else None)
    except FileNotFoundError as error:
        raise DamagedError(f"{path} is missing: {AGAIN}") from error
    except PermissionError as error:
        raise StoreError(f"cannot read {path} ({error.strerror}): ask its owner") from error
    except (OSError, ValueError, pa.ArrowException) as error:
        raise DamagedError(
            f"{path} is damaged ({one_line(error)}): remove it and {AGAIN}"
        ) from error


@contextmanager
def _opened(path: Location, *, whole: bool) -> Iterator[Any]:
    """Give what pyarrow reads a file from: of a URL the object, or parts of it."""
    if isinstance(path, Path):
        yield path
    elif whole:
        yield pa.BufferReader(path.read_bytes())
    else:
        with path.open() as file:
            yield file


def read_samples(path: Location) -> Iterator[Sample]:
    """Read the samples of a shard, in order."""
    yield from _samples(read_table(path), path)


def read_record(
    path: Location, recipe_digest: str, ids: Sequence[str] | None = None
) -> ShardRecord:
    """Read a shard whole and return its record; ``ids`` are those kept or rejected in it.

    What was read is encoded again, and must give the very bytes of the file: a build that
    goes on may keep no shard that differs from the one it would write.

    Raises
    ------
    StoreError
        If it is damaged or belongs to another recipe.
    """
    table = read_table(path)
    try:
        header = json.loads((table.schema.metadata or {}).get(METADATA_KEY, b"{}"))
        buffer = pa.BufferOutputStream()
        _encode(_table(list(_samples(table, path)), header), buffer)
        same = hashlib.sha256(buffer.getvalue()).hexdigest() == sha256(path)
    except (DamagedError, ValueError, TypeError, KeyError, pa.ArrowException):
        same = False
    if not same:
        raise DamagedError(
            f"{path} is damaged (its bytes are not those of its content): remove it and {AGAIN}"
        )
    if header.get("recipe_digest") != recipe_digest:
        raise StoreError(
            f"{path} belongs to another recipe: remove {path.parent.parent} or choose another "
            "--out, or for an import another --name"
        )
    found = [*table["id"].to_pylist(), *(r["id"] for r in header["rejections"])]
    if ids is not None and sorted(found) != sorted(ids):
        raise DamagedError(
            f"{path} is damaged (it holds other shapes than it should): remove it and {AGAIN}"
        )
    return _record(path, table, header)


def recipe_digest_of(path: Path) -> str | None:
    """Return the digest in a shard's header, or ``None`` if the file is no whole shard."""
    try:
        with pq.ParquetFile(path) as file:
            header = json.loads((file.schema_arrow.metadata or {}).get(METADATA_KEY, b"{}"))
        return str(header["recipe_digest"])
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException):
        return None


def _record(path: Location, table: pa.Table, header: dict[str, Any]) -> ShardRecord:
    return ShardRecord(
        file=f"{path.parent.name}/{path.name}",
        family=header["family"],
        sha256=sha256(path),
        size=size(path) or 0,
        rows=table.num_rows,
        vertices=_length(table["vertices"]),
        faces=_length(table["faces"]),
        rejections=tuple(Rejection(**r) for r in header["rejections"]),
    )


def _length(column: pa.ChunkedArray) -> int:
    return sum(len(chunk.flatten()) for chunk in column.chunks)


def _column(name: str, samples: Sequence[Sample]) -> pa.Array:
    field = SCHEMA.field(name)
    match name:
        case "id" | "family" | "index" | "group":
            return pa.array([getattr(s.spec, name) for s in samples], field.type)
        case "count" | "shift" | "residual":
            return pa.array([getattr(s.certificate, name) for s in samples], field.type)
        case "parameters":
            return pa.array([json.dumps(dict(s.spec.parameters)) for s in samples], field.type)
        case "vertices" | "faces":
            return _ragged([getattr(s.mesh, name) for s in samples], field.type)
        case "isometries":
            return _ragged([s.isometries.reshape(-1, 9) for s in samples], field.type)
        case _:
            return pa.array([_plain(getattr(s, name)) for s in samples], field.type)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _ragged(arrays: Sequence[NDArray[Any]], kind: pa.ListType) -> pa.Array:
    """Pack arrays of shape (n_i, c) into a list of fixed-size lists."""
    inner = kind.value_type
    offsets = np.concatenate([[0], np.cumsum([len(a) for a in arrays])]).astype(np.int32)
    flat = np.concatenate([a.ravel() for a in arrays]) if arrays else np.zeros(0)
    values = pa.FixedSizeListArray.from_arrays(pa.array(flat, inner.value_type), type=inner)
    return pa.ListArray.from_arrays(pa.array(offsets, pa.int32()), values, type=kind)


def ragged_arrays(column: pa.ChunkedArray) -> Iterator[NDArray[Any]]:
    """Yield the (n_i, c) array of each row of a list of fixed-size lists, without a copy."""
    for chunk in column.chunks:
        width = chunk.type.value_type.list_size
        values = chunk.flatten().flatten().to_numpy().reshape(-1, width)
        offsets = chunk.offsets.to_numpy() - chunk.offsets[0].as_py()
        for start, stop in pairwise(offsets):
            yield values[start:stop]


def _samples(table: pa.Table, path: Location) -> Iterator[Sample]:
    try:
        yield from _decoded(table)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise DamagedError(
            f"{path} is damaged ({one_line(error)}): remove it and {AGAIN}"
        ) from error


def _decoded(table: pa.Table) -> Iterator[Sample]:
    plain = table.drop_columns(["vertices", "faces", "isometries"]).to_pylist()
    ragged = (ragged_arrays(table[name]) for name in ("vertices", "faces", "isometries"))
    for row, vertices, faces, isometries in zip(plain, *ragged, strict=True):
        spec = ShapeSpec(
            id=row["id"],
            family=row["family"],
            index=row["index"],
            parameters=dict(json.loads(row["parameters"])),
            group=row["group"],
        )
        yield Sample(
            spec=spec,
            mesh=Mesh(vertices, faces),
            eigenvalues=np.array(row["eigenvalues"], dtype=np.float64),
            trivial=row["trivial"],
            certificate=Certificate(row["count"], row["shift"], row["residual"]),
            isometries=isometries.reshape(-1, 3, 3),
            split=row["split"],
            paper_splits=tuple(row["paper_splits"]),
        )


# Manifest


@dataclass(frozen=True, slots=True)
class StoredDataset:
    """A finished dataset, on disk or at a URL."""

    directory: Location
    manifest: Manifest

    def paths(self) -> list[Location]:
        """Return the shards' places in order of family and index."""
        return [self.directory / shard.file for shard in self.manifest.shards]

    def samples(self) -> Iterator[Sample]:
        """Read all samples, a shard at a time."""
        for path in self.paths():
            yield from read_samples(path)

    def find(self, id: str) -> Sample:
        """Return the sample of an id.

        Raises
        ------
        StoreError
            If there is none, or a filter rejected it.
        """
        for shard in self.manifest.shards:
            if shard.family != id.rpartition("-")[0]:
                continue
            if any(r.id == id for r in shard.rejections):
                reason = next(r for r in shard.rejections if r.id == id)
                raise StoreError(f"{id} was rejected by {reason.reason}: {reason.detail}")
            ids = read_table(self.directory / shard.file, ["id"])["id"].to_pylist()
            if id in ids:
                path = self.directory / shard.file
                table = read_table(path)
                return next(_samples(table.slice(ids.index(id), 1), path))
        family = id.rpartition("-")[0]
        if family not in self.manifest.drawn:
            families = ", ".join(self.manifest.drawn)
            raise StoreError(f"no shape {id!r}: an id is a family ({families}) and a number")
        raise StoreError(
            f"no shape {id!r} in {self.manifest.version}: "
            f"`synthnet info --version {self.manifest.version} --ids` lists them"
        )


def write_manifest(directory: Location, manifest: Manifest) -> None:
    """Write the manifest, the mark of a finished dataset."""
    content = {"schema_version": SCHEMA_VERSION, **asdict(manifest)}
    write_text(directory / MANIFEST, _sealed(content))


def _sealed(content: dict[str, Any]) -> str:
    """Return content as JSON text; its last key is the SHA-256 of the other ones.

    So no byte of the text can be altered without a trace.
    """
    seal = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    return json.dumps({**content, SEAL: seal}, indent=1) + "\n"


def read_manifest(directory: Location) -> Manifest | None:
    """Read the manifest, or return ``None`` where no build has finished.

    Raises
    ------
    StoreError
        If it is not JSON, lacks a key, has another schema version, or was altered.
    """
    path = directory / MANIFEST
    try:
        written = path.read_bytes()
        content = json.loads(written)
        content.pop(SEAL, None)
        sealed = _sealed(content)
        found = content.pop("schema_version")
        if found != SCHEMA_VERSION:
            raise StoreError(
                f"{path} has schema version {found}, this synthnet reads {SCHEMA_VERSION}: "
                "remove its directory or choose another --out, and build it again"
            )
        shards = tuple(
            ShardRecord(**{**s, "rejections": tuple(Rejection(**r) for r in s["rejections"])})
            for s in content.pop("shards")
        )
        manifest = Manifest(**content, shards=shards)
        _check_types(manifest)
        _check_bytes(written, sealed)
        return manifest  # noqa: TRY300 - all of it may raise
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise StoreError(f"cannot read {path} ({error.strerror}): choose another --out") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DamagedError(
            f"{path} is damaged ({one_line(error)}): remove it and {AGAIN}"
        ) from error


def _check_types(manifest: Manifest) -> None:
    """Raise TypeError where a value of the manifest is of the wrong kind."""
    wanted: list[tuple[Any, type]] = [
        (manifest.version, str),
        (manifest.recipe_digest, str),
        (manifest.recipe, dict),
        (manifest.drawn, dict),
        (manifest.packages, dict),
        *((count, int) for count in manifest.drawn.values()),
    ]
    for shard in manifest.shards:
        wanted += [(getattr(shard, name), str) for name in ("file", "family", "sha256")]
        wanted += [(getattr(shard, name), int) for name in ("size", "rows", "vertices", "faces")]
    for value, kind in wanted:
        if type(value) is not kind:
            raise TypeError(f"{value!r} is no {kind.__name__}")
    if {shard.family for shard in manifest.shards} - set(manifest.drawn):
        raise ValueError("a shard is of a family that was not drawn")


def _check_bytes(written: bytes, sealed: str) -> None:
    """Raise ValueError where a byte of the manifest was altered."""
    if written != sealed.encode():
        raise ValueError("its bytes are not those of its content")


def open_imported(name: str, root: str | os.PathLike[str] | None = None) -> StoredDataset | None:
    """Open the dataset of that name if :mod:`synthnet.build.importing` has made one."""
    directory = dataset_directory(name, root)
    manifest = read_manifest(directory)
    if manifest is None or "imported" not in manifest.recipe:
        return None
    return open_dataset(name, root)


def open_unversioned(name: str, root: str | os.PathLike[str] | None = None) -> StoredDataset | None:
    """Open what no recipe of a version makes: an import, if it is one, or a sealed set.

    Raises
    ------
    StoreError
        If it is the name of a sealed set that is not there.
    """
    return open_dataset(name, root) if recipe.is_sealed(name) else open_imported(name, root)


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
    if manifest is None and recipe.is_sealed(version):
        raise StoreError(
            f"the sealed set {version} is not in {directory}: name the directory above it, or "
            "make it with its salt, by `synthnet seal` or `synthnet verify --sealed`"
        )
    if manifest is None:
        recipe.load(version)
        out = "" if root is None else f" --out {root}"
        raise StoreError(
            f"no finished dataset in {directory}: run `synthnet build --version {version}{out}`"
        )
    if manifest.version != version:
        raise StoreError(f"{directory} holds {manifest.version}, not {version}")
    return StoredDataset(directory, manifest)
