"""Files of predictions, joined strictly to a split by instance id."""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eigbench.errors import PredictionsError
from eigbench.scoring.truth import Truth
from synthnet.store.files import one_line, write_atomically

DAMAGED = (
    *(OSError, EOFError, ValueError, TypeError, KeyError),
    *(BadZipFile, zlib.error, pa.ArrowException),
)


def write(path: Path, truth: Truth, predictions: NDArray[np.float64]) -> None:
    """Write predictions of shape (seeds, n, k) as Parquet: id, seed, eigenvalues."""
    seeds, count, k = predictions.shape
    flat = pa.array(predictions.reshape(-1), pa.float64())
    table = pa.table(
        {
            "id": list(truth.ids) * seeds,
            "seed": pa.array(np.repeat(np.arange(seeds), count), pa.int32()),
            "eigenvalues": pa.FixedSizeListArray.from_arrays(flat, k),
        }
    )

    def store(partial: Path) -> None:
        pq.write_table(
            table,
            partial,
            compression="zstd",
            compression_level=9,
            use_dictionary=False,
            column_encoding={"eigenvalues.list.element": "BYTE_STREAM_SPLIT"},
            write_page_checksum=True,
        )

    write_atomically(path, store)


def read(path: Path, truth: Truth) -> NDArray[np.float64]:
    """Read predictions and put them in the order of a split. No code is run.

    Parameters
    ----------
    path : Path
        ``.parquet`` with the columns id, eigenvalues and, for several runs, seed; ``.npz``
        with the arrays ids (n,) and eigenvalues (n, k); or ``.csv`` with id, lambda_1, ...,
        lambda_k and, for several runs, seed.
    truth : Truth
        The split.

    Returns
    -------
    ndarray of shape (seeds, n, k), float64

    Raises
    ------
    PredictionsError
        If the file is missing, damaged or of an unknown kind, or its ids are not exactly
        the split's, once a seed.
    """
    readers = {".parquet": _read_parquet, ".npz": _read_npz, ".csv": _read_csv}
    if path.suffix not in readers:
        raise PredictionsError(f"{path} must end in {', '.join(readers)}")
    k = truth.eigenvalues.shape[1]
    try:
        ids, seeds, values = readers[path.suffix](path, k)
    except FileNotFoundError as error:
        raise PredictionsError(f"there is no file {path}") from error
    except DAMAGED as error:
        raise PredictionsError(f"{path} cannot be read: {one_line(error)}") from error
    if not len(ids):
        raise PredictionsError(f"{path} has no predictions")
    if values.shape != (len(ids), k):
        raise PredictionsError(
            f"{path} has predictions of shape {values.shape}, it must be ({len(ids)}, {k})"
        )
    return np.stack([_join(path, ids[seeds == s], values[seeds == s], truth) for s in _runs(seeds)])


def unphysical(truth: Truth, answers: NDArray[np.float64]) -> str:
    """Return one line about values that are not finite or not positive, empty if there are none.

    They are scored as they are, never left out of a mean; but a board does not take them.
    """
    for what, bad in (("not finite", ~np.isfinite(answers)), ("not positive", ~(answers > 0))):
        rows = np.flatnonzero(bad.any(axis=(0, 2)))
        if len(rows):
            first = ", ".join(truth.ids[i] for i in rows[:3])
            return (
                f"the predictions of {len(rows)} of {len(truth.ids)} instances are {what}, first "
                f"ids: {first}; they are scored as they are, but a board does not take them"
            )
    return ""


def _runs(seeds: NDArray[np.int64]) -> Sequence[int]:
    runs: list[int] = np.unique(seeds).tolist()
    return runs


def _join(
    path: Path, ids: NDArray[np.str_], values: NDArray[np.float64], truth: Truth
) -> NDArray[np.float64]:
    row_of = {id: row for row, id in enumerate(ids.tolist())}
    twice = [id for id, count in Counter(ids.tolist()).items() if count > 1]
    problems = (
        ("predicts twice", twice),
        ("lacks", [id for id in truth.ids if id not in row_of]),
        ("has ids that are not in the split:", sorted(set(row_of) - set(truth.ids))),
    )
    for what, which in problems:
        if which:
            more = f" and {len(which) - 3} more" if len(which) > 3 else ""
            raise PredictionsError(
                f"{path} {what} {', '.join(which[:3])}{more} "
                f"({truth.version}, {truth.split}, {truth.protocol}): --dataset, --split and "
                "--protocol say what was predicted"
            )
    return values[[row_of[id] for id in truth.ids]]


Read = tuple[NDArray[np.str_], NDArray[np.int64], NDArray[np.float64]]


def _read_parquet(path: Path, k: int) -> Read:
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        table = file.read()
    ids = np.array(table["id"].to_pylist(), dtype=np.str_)
    seeds = _seeds(table["seed"].to_numpy() if "seed" in table.column_names else None, len(ids))
    values = np.array(table["eigenvalues"].to_pylist(), dtype=np.float64)
    return ids, seeds, values


def _read_npz(path: Path, k: int) -> Read:
    with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        ids, values = np.atleast_1d(arrays["ids"]).astype(np.str_), arrays["eigenvalues"]
    if values.dtype.kind not in "fiu":
        raise ValueError(f"eigenvalues have dtype {values.dtype}, they must be real numbers")
    values = values.astype(np.float64)
    return ids, _seeds(None, len(ids)), values


def _read_csv(path: Path, k: int) -> Read:
    frame = pd.read_csv(path, dtype={"id": str})
    if f"lambda_{k + 1}" in frame:
        raise ValueError(f"it has lambda_{k + 1}, there are {k} eigenvalues")
    values = frame[[f"lambda_{i}" for i in range(1, k + 1)]].to_numpy(dtype=np.float64)
    ids = frame["id"].to_numpy(dtype=np.str_)
    return ids, _seeds(frame["seed"].to_numpy() if "seed" in frame else None, len(ids)), values


def _seeds(column: NDArray[np.int64] | None, count: int) -> NDArray[np.int64]:
    if column is None:
        return np.zeros(count, dtype=np.int64)
    if column.dtype.kind not in "iu":
        raise ValueError("the seeds must be integers, none missing")
    return column.astype(np.int64)
