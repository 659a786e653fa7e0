"""synthNet as a Hugging Face ``datasets.Dataset``: local Parquet, no hub, no network."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import pyarrow as pa
import pyarrow.compute as pc

from synthnet import store
from synthnet.errors import StoreError, needed_by
from synthnet.store import StoredDataset, limits, shards, storage, unpacked
from synthnet.types import SPLITS

if TYPE_CHECKING:
    import datasets

ROWS = "rows.arrow"


def load_dataset(
    version: str, split: str = "train", *, root: str | os.PathLike[str] | None = None
) -> datasets.Dataset:
    """Open a split of a version as a Hugging Face dataset, one row a shape.

    The rows are those of the Parquet shards: ``vertices`` (n, 3), ``faces`` (m, 3),
    ``eigenvalues`` (10,), float64 in 1/length², ``isometries`` (9, 9) as flattened matrices, ids,
    splits. Where the dataset has the limits of its surfaces, there are ``surface_eigenvalues``
    (10,) and ``surface_bar`` (10,) too, in the same unit. A version that is not there is built
    first, and this says so on standard error. The first use of a split unpacks it into a file
    beside the shards, which is checked whole whenever it is opened.

    Parameters
    ----------
    version : str
        For example ``1.0``.
    split : str
        ``train``, ``validation`` or ``test`` of the protocol ``grouped``.
    root : path, optional
        Directory that holds the versions, see :func:`synthnet.store.home`.

    Raises
    ------
    ValueError
        If the split is unknown.
    MissingPackageError
        If the package ``datasets`` is not installed.
    RecipeError
        If the version is unknown.
    BuildError
        If the version is not there and cannot be built, its directory cannot be written to, or the
        disk is full.
    StoreError
        If there is no shape in the split, a shard is damaged, or the dataset is at a URL.
    """
    if split not in SPLITS:
        raise ValueError(f"split must be one of {', '.join(SPLITS)}, got {split!r}")
    with needed_by("synthnet.load_dataset"):
        import datasets
    from synthnet.build.limits import add_missing
    from synthnet.build.versions import ensure_built

    stored = ensure_built(version, root)
    if not any(
        split in store.read_table(p, ["split"])["split"].to_pylist() for p in stored.paths()
    ):
        raise StoreError(f"{version} has no shape in the split {split}: choose another")
    where = storage.local(stored.directory, version) / unpacked.HUGGING_FACE / split
    rows = unpacked.open_or_unpack(
        where,
        stored,
        lambda: datasets.Dataset.from_file(str(where / ROWS), split=datasets.NamedSplit(split)),
        lambda to: _write_rows(to / ROWS, stored, split),
        by_item=(),
        reader="Hugging Face datasets",
    )
    add_missing(stored)
    if not limits.any_there(stored):
        return rows
    known = {row.id: row for row in limits.read(stored)}
    matched = [known[id] for id in rows["id"]]
    for column, name in (("surface_eigenvalues", "eigenvalues"), ("surface_bar", "bar")):
        rows = rows.add_column(column, [getattr(row, name).tolist() for row in matched])
    return rows


def _write_rows(path: Path, dataset: StoredDataset, split: str) -> None:
    """Write the rows of a split as the stream of Arrow's that ``datasets`` maps into memory."""
    with pa.ipc.new_stream(path, store.SCHEMA.remove_metadata()) as stream:
        for record, shard in zip(dataset.manifest.shards, dataset.paths(), strict=True):
            if storage.sha256(shard) != record.sha256:
                raise shards.damaged(shard, "its SHA-256 is another")
            table = store.read_table(shard).replace_schema_metadata()
            stream.write_table(table.filter(pc.equal(table["split"], split)))
