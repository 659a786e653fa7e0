"""Shards: labelled shapes in a Parquet file. The same samples give the same bytes."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from synthnet.arrays import Floats
from synthnet.errors import DamagedError, StoreError
from synthnet.store.files import one_line
from synthnet.store.storage import Location, sha256, size, write_atomically
from synthnet.types import Certificate, Mesh, Rejection, Sample, ShapeSpec, ShardRecord

SCHEMA_VERSION = 2  # of shards and manifests
AGAIN = (
    "run `synthnet build` again, with the same dataset and --out, or for an import the same "
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

    Raise StoreError if the file is missing, truncated, altered or of another schema.
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
        raise damaged(path, one_line(error)) from error


def damaged(path: Location, why: str) -> DamagedError:
    """Return the error for a file that a build makes anew."""
    return DamagedError(f"{path} is damaged ({why}): remove it and {AGAIN}")


@contextmanager
def _opened(path: Location, *, whole: bool) -> Iterator[Any]:
    """Give what pyarrow reads a file from: of a URL the object, or parts of it."""
    if isinstance(path, Path):
        yield path
    elif whole:
        yield pa.BufferReader(path.read_bytes())
    else:
        with path.open() as file:
            source: Any = file
            try:
                file.seek(1)
                file.read(1)
                file.seek(0)
            except ValueError:  # a server that sends no parts
                source = pa.BufferReader(path.read_bytes())
            yield source


def read_samples(path: Location) -> Iterator[Sample]:
    """Read the samples of a shard, in order."""
    yield from _samples(read_table(path), path)


def read_labels(path: Location) -> Iterator[tuple[ShapeSpec, Floats]]:
    """Read the shapes and labels of a shard, in order, without the meshes."""
    table = read_table(path, ["id", "family", "index", "parameters", "group", "eigenvalues"])
    try:
        for row in table.to_pylist():
            yield _spec(row), np.array(row["eigenvalues"], dtype=np.float64)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise damaged(path, one_line(error)) from error


def _header(schema: pa.Schema) -> Any:
    return json.loads((schema.metadata or {}).get(METADATA_KEY, b"{}"))


def read_record(
    path: Location, recipe_digest: str, ids: Sequence[str] | None = None
) -> ShardRecord:
    """Read a shard whole and return its record; ``ids`` are those kept or rejected in it.

    What was read is encoded again, and must give the very bytes of the file: a build that
    goes on may keep no shard that differs from the one it would write.

    Raise StoreError if it is damaged or belongs to another recipe.
    """
    table = read_table(path)
    try:
        header = _header(table.schema)
        buffer = pa.BufferOutputStream()
        _encode(_table(list(_samples(table, path)), header), buffer)
        same = hashlib.sha256(buffer.getvalue()).hexdigest() == sha256(path)
    except (DamagedError, ValueError, TypeError, KeyError, pa.ArrowException):
        same = False
    if not same:
        raise damaged(path, "its bytes are not those of its content")
    if header.get("recipe_digest") != recipe_digest:
        raise StoreError(
            f"{path} belongs to another recipe: remove {path.parent.parent} or choose another "
            "--out, or for an import another --name"
        )
    stored = [*table["id"].to_pylist(), *(r["id"] for r in header["rejections"])]
    if ids is not None and sorted(stored) != sorted(ids):
        raise damaged(path, "it holds other shapes than it should")
    return _record(path, table, header)


def recipe_digest_of(path: Path) -> str | None:
    """Return the digest in a shard's header, or ``None`` if the file is no whole shard."""
    try:
        with pq.ParquetFile(path) as file:
            return str(_header(file.schema_arrow)["recipe_digest"])
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
            return pa.array([getattr(s, name) for s in samples], field.type)


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


def _spec(row: dict[str, Any]) -> ShapeSpec:
    parameters = dict(json.loads(row["parameters"]))
    return ShapeSpec(row["id"], row["family"], row["index"], parameters, row["group"])


def _samples(table: pa.Table, path: Location) -> Iterator[Sample]:
    try:
        plain = table.drop_columns(["vertices", "faces", "isometries"]).to_pylist()
        ragged = (ragged_arrays(table[name]) for name in ("vertices", "faces", "isometries"))
        for row, vertices, faces, isometries in zip(plain, *ragged, strict=True):
            yield Sample(
                spec=_spec(row),
                mesh=Mesh(vertices, faces),
                eigenvalues=np.array(row["eigenvalues"], dtype=np.float64),
                trivial=row["trivial"],
                certificate=Certificate(row["count"], row["shift"], row["residual"]),
                isometries=isometries.reshape(-1, 3, 3),
                split=row["split"],
                paper_splits=tuple(row["paper_splits"]),
            )
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise damaged(path, one_line(error)) from error
