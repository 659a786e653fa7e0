r"""The limits of a dataset's shapes, in files beside the shards.

``<home>/<version>/limits/<family>-0000.parquet`` has a row for each shape of
``shards/<family>-0000.parquet``, in its order, and the SHA-256 of that shard. A limit is the
spectrum of the smooth or polyhedral surface that the mesh approximates; with it stands how far
the label is from it. The shards and the manifest do not depend on whether these files are there.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import PurePosixPath

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from synthnet.arrays import Floats
from synthnet.errors import DamagedError, StoreError
from synthnet.families.limits import Limit
from synthnet.store import storage
from synthnet.store.datasets import StoredDataset
from synthnet.store.files import one_line
from synthnet.store.shards import METADATA_KEY
from synthnet.store.storage import Location
from synthnet.types import ShardRecord

DIRECTORY = "limits"
SCHEMA_VERSION = 1
AGAIN = "run `synthnet build --limits` again, with the same dataset and --out"
ACCURATE = 20.0  # dB: paper, section 4.3
NUMBERS = ("eigenvalues", "bar", "error")

SCHEMA = pa.schema(
    [
        pa.field("id", pa.string(), nullable=False),
        pa.field("eigenvalues", pa.list_(pa.float64()), nullable=False),  # 1/length²
        pa.field("bar", pa.list_(pa.float64()), nullable=False),  # 1/length²
        pa.field("error", pa.list_(pa.float64()), nullable=False),
        pa.field("above_20_db", pa.bool_(), nullable=False),
    ]
)


@dataclass(frozen=True, slots=True)
class StoredLimit:
    """The limit of a shape, and how far its label is from it.

    Parameters
    ----------
    id : str
        The shape.
    eigenvalues, bar : ndarray of shape (k,), float64
        Of the surface, as in :class:`~synthnet.families.limits.Limit`, in 1/length².
    error : ndarray of shape (k,), float64
        Label / limit − 1, positive where the label is too large.
    above_20_db : bool
        Whether the label's PSNR against its own surface is above 20 dB, see :func:`psnr`.
    """

    id: str
    eigenvalues: Floats
    bar: Floats
    error: Floats
    above_20_db: bool


def compare(id: str, label: Floats, limit: Limit) -> StoredLimit:
    """Return the limit of a shape beside its label, shape (k,), in 1/length²."""
    error = label / limit.eigenvalues - 1
    above = psnr(label, limit.eigenvalues) > ACCURATE
    return StoredLimit(id, limit.eigenvalues, limit.bar, error, above)


def psnr(label: Floats, limit: Floats) -> float:
    r"""Return how near a label p is to its limit g, :math:`10 \log_{10}(R^2 / \mathrm{MSE})` in dB.

    R is the range of g; the mean square error is over the k eigenvalues. Paper, section 4.3.

    Examples
    --------
    >>> round(psnr(np.array([1.0, 3.0]), np.array([2.0, 4.0])), 4)  # R² / MSE = 4
    6.0206
    """
    with np.errstate(divide="ignore"):
        return float(10 * np.log10(np.ptp(limit) ** 2 / np.mean((label - limit) ** 2)))


def path_of(directory: Location, record: ShardRecord) -> Location:
    """Return where the limits of a shard are."""
    return directory / DIRECTORY / PurePosixPath(record.file).name


def write(directory: Location, record: ShardRecord, rows: Sequence[StoredLimit]) -> None:
    """Write the limits of a shard; the same rows give the same bytes.

    Raise BuildError if the disk is full or cannot be written; nothing is left behind.
    """
    content = _encoded(rows, record)
    path = path_of(directory, record)
    storage.write_atomically(path, lambda partial: partial.write_bytes(content))


def read_shard(directory: Location, record: ShardRecord) -> list[StoredLimit]:
    """Read the limits of one shard.

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
    rows = [
        StoredLimit(**{**row, **{name: np.array(row[name]) for name in NUMBERS}})
        for row in table.to_pylist()
    ]
    if _encoded(rows, record) != content:
        raise DamagedError(f"{path} is damaged (its bytes are not those of its content): {AGAIN}")
    return rows


def read(dataset: StoredDataset) -> Iterator[StoredLimit]:
    """Read the limits of all shapes, in the order of the shards.

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


def any_there(dataset: StoredDataset) -> bool:
    """Return whether limits of any shard are there."""
    shards = dataset.manifest.shards
    return any(storage.size(path_of(dataset.directory, record)) is not None for record in shards)


def find(dataset: StoredDataset, id: str) -> StoredLimit | None:
    """Return the limit of a shape, or None where the dataset has none.

    Raises
    ------
    DamagedError
        If there are some, but the file is missing or damaged.
    """
    if not any_there(dataset):
        return None
    family = id.rpartition("-")[0]
    shards = [record for record in dataset.manifest.shards if record.family == family]
    rows = (row for record in shards for row in read_shard(dataset.directory, record))
    return next((row for row in rows if row.id == id), None)


def is_whole(directory: Location, record: ShardRecord) -> bool:
    """Return whether the limits of a shard are there and whole."""
    try:
        read_shard(directory, record)
    except DamagedError:
        return False
    return True


def _header(record: ShardRecord) -> dict[str, object]:
    return {"schema_version": SCHEMA_VERSION, "shard_sha256": record.sha256}


def _encoded(rows: Sequence[StoredLimit], record: ShardRecord) -> bytes:
    header = json.dumps(_header(record), sort_keys=True)
    table = pa.Table.from_pylist(
        [asdict(row) for row in rows], schema=SCHEMA.with_metadata({METADATA_KEY: header})
    )
    buffer = pa.BufferOutputStream()
    pq.write_table(
        table, buffer, compression="zstd", use_dictionary=False, write_page_checksum=True
    )
    content: bytes = buffer.getvalue().to_pybytes()
    return content
