"""Files of predictions, joined strictly to a split by instance id."""

from __future__ import annotations

import json
import zlib
from collections import Counter
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import BadZipFile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eigbench import outside
from eigbench.errors import OutsideError, PredictionsError
from eigbench.results import outside_tables
from eigbench.scoring import metrics
from eigbench.scoring.names import MESH
from eigbench.scoring.truth import Truth
from synthnet.errors import missing
from synthnet.store.files import one_line, write_atomically

METADATA_KEY = b"eigbench"  # of a Parquet file: what was predicted, as JSON
SEEDS = 20  # of a file at most
# What an eigenvalue may be, in 1/length²: metrics of what lies outside may overflow
LEAST, MOST = 1e-30, 1e30
SPARE = 4  # times as many values a row as there are eigenvalues are read, to say what is wrong
DAMAGED = (
    *(OSError, EOFError, ValueError, TypeError, KeyError),
    *(BadZipFile, zlib.error, pa.ArrowException, OutsideError),
)


def write(path: Path, truth: Truth, predictions: NDArray[np.float64]) -> None:
    """Write predictions of shape (seeds, n, k) as Parquet: id, seed, eigenvalues.

    Its metadata name the dataset, the split and the protocol.
    """
    seeds, count, k = predictions.shape
    flat = pa.array(predictions.reshape(-1), pa.float64())
    table = pa.table(
        {
            "id": list(truth.ids) * seeds,
            "seed": pa.array(np.repeat(np.arange(seeds), count), pa.int32()),
            "eigenvalues": pa.FixedSizeListArray.from_arrays(flat, k),
        },
        metadata={METADATA_KEY: json.dumps(_named(truth)).encode()},
    )

    store = partial(
        pq.write_table,
        table,
        compression="zstd",
        compression_level=9,
        use_dictionary=False,
        column_encoding={"eigenvalues.list.element": "BYTE_STREAM_SPLIT"},
        write_page_checksum=True,
    )
    write_atomically(path, store)


def most_bytes(truth: Truth) -> int:
    """Return the bytes that a file of predictions of a split may have."""
    rows, k = SEEDS * len(truth.ids), truth.eigenvalues.shape[1]
    return int(2**20 + rows * (2 * outside_tables.TEXT + 32 * k))


def read(path: Path, truth: Truth, below: Path | None = None) -> NDArray[np.float64]:
    """Read predictions and put them in the order of a split. No code is run.

    Parameters
    ----------
    path : Path
        ``.parquet`` with the columns id, eigenvalues and, for several runs, seed; ``.npz``
        with the arrays ids (n,) and eigenvalues (n, k); or ``.csv`` with id, lambda_1, ...,
        lambda_k and, for several runs, seed. docs/submit.md describes them.
    truth : Truth
        The split.
    below : Path, optional
        A folder above the file, as of :func:`eigbench.outside.opened`.

    Returns
    -------
    ndarray of shape (seeds, n, k), float64

    Raises
    ------
    PredictionsError
        If the file is missing, damaged, larger than it can be, reached by a link, of an unknown
        kind or of another dataset, or its ids are not exactly the split's, once a seed.
    """
    readers = {".parquet": _read_parquet, ".npz": _read_npz, ".csv": _read_csv}
    if path.suffix not in readers:
        raise PredictionsError(f"{path} must end in {', '.join(readers)}")
    k = truth.eigenvalues.shape[1]
    try:
        with outside.opened(path, most=most_bytes(truth), below=below) as file:
            ids, seeds, values = readers[path.suffix](file, truth)
    except FileNotFoundError as error:
        raise PredictionsError(missing(path)) from error
    except DAMAGED as error:
        raise PredictionsError(f"{path} cannot be read: {one_line(error)[:300]}") from error
    if not len(ids):
        raise PredictionsError(f"{path} has no predictions")
    if values.shape != (len(ids), k):
        hint = ": leave the zero out" if metrics.has_zero(values, len(ids), k) else ""
        raise PredictionsError(
            f"{path} has predictions of shape {values.shape}, it must be ({len(ids)}, {k}){hint}"
        )
    runs = np.unique(seeds).tolist()
    if len(runs) > SEEDS:
        raise PredictionsError(f"{path} has {len(runs)} seeds, there can be {SEEDS} at most")
    return np.stack([_join(path, ids[seeds == s], values[seeds == s], truth) for s in runs])


def unphysical(truth: Truth, answers: NDArray[np.float64]) -> str:
    """Return one line about values that no eigenvalue has, empty if there are none.

    They are scored as they are, never left out of a mean; but a board does not take them.
    """
    what, bad = impossible(answers)
    rows = np.flatnonzero(bad.any(axis=(0, 2)))
    if not len(rows):
        return ""
    first = ", ".join(truth.ids[i] for i in rows[:3])
    return (
        f"the predictions of {len(rows)} of {len(truth.ids)} instances are {what}, first "
        f"ids: {first}; they are scored as they are, but a board does not take them"
    )


def impossible(answers: NDArray[np.float64]) -> tuple[str, NDArray[np.bool_]]:
    """Return what values that no eigenvalue has are, and which: the first kind there is.

    These are values that are not finite, not positive, or not from :data:`LEAST` to :data:`MOST`.

    Examples
    --------
    >>> impossible(np.array([1.0, -1.0, np.inf]))
    ('not finite', array([False, False,  True]))
    >>> impossible(np.array([1.0, 1e41]))
    ('not from 1e-30 to 1e+30', array([False,  True]))
    """
    if not (finite := np.isfinite(answers)).all():
        return "not finite", ~finite
    if not (positive := answers > 0).all():
        return "not positive", ~positive
    return f"not from {LEAST:g} to {MOST:g}", extreme(answers)


def unordered(answers: NDArray[np.float64]) -> str:
    """Return one line about spectra that do not ascend, empty if all do; NaN is passed over.

    Examples
    --------
    >>> unordered(np.array([[[1.0, np.nan, 2.0]]]))
    ''
    >>> unordered(np.array([[[3.0, np.nan, 2.0]]])) == unordered(np.array([[[3.0, 2.0]]]))
    True
    >>> unordered(np.array([[[1.0, 2.0], [2.0, 1.0]]]))
    '1 of 2 spectra does not ascend: metrics compare λ1 with λ1 and so on, as the answers stand'
    """
    highest = np.fmax.accumulate(answers, axis=-1)  # a NaN is no number to descend from or to
    wrong = int((answers[..., 1:] < highest[..., :-1]).any(axis=-1).sum())
    if not wrong:
        return ""
    return (
        f"{wrong:,} of {answers.shape[0] * answers.shape[1]:,} spectra "
        f"{'does' if wrong == 1 else 'do'} not ascend: metrics compare λ1 with λ1 and so on, as "
        "the answers stand"
    )


def extreme(answers: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which values are finite, not 0, and too large or too small for an eigenvalue.

    Examples
    --------
    >>> extreme(np.array([2.0, 0.0, -1.7e308, 5e-324, np.inf])).tolist()
    [False, False, True, True, False]
    """
    size = np.abs(answers)
    return np.isfinite(answers) & (size > 0) & ((size < LEAST) | (size > MOST))


def looked_up(kind: str, truth: Truth, answers: NDArray[np.float64]) -> str:
    """Return one line where answers are the target to the bit and cannot have been computed.

    Other solvers differ from the labels by rounding, models by more. The certified solver, which
    declares itself classical, has those of meshes to the bit. Nothing that sees a mesh has the
    spectrum of its surface so.
    """
    solves = kind == "classical" and truth.target == MESH
    count = 0 if solves else int((answers == truth.eigenvalues).all(axis=-1).sum())
    if not count:
        return ""
    some = f"{count:,} of {answers.shape[0] * answers.shape[1]:,} spectra are"
    if truth.target == MESH:
        why = "the labels to the last bit: only an exact solver can say where it has them from"
        return f"{some} {why}, and it declares itself classical"
    return f"{some} those of the surfaces to the last bit: no mesh shows these so exactly"


def _join(
    path: Path, ids: NDArray[np.str_], values: NDArray[np.float64], truth: Truth
) -> NDArray[np.float64]:
    row_of = {id: row for row, id in enumerate(ids.tolist())}
    twice = [id for id, count in Counter(ids.tolist()).items() if count > 1]
    known = set(truth.ids)
    unknown = sorted(set(row_of) - known)
    lacking = [id for id in truth.ids if id not in row_of]
    problems = (
        ("predicts twice", twice),
        ("lacks", lacking),
        ("has ids that are not in the split:", unknown),
    )
    if said := [f"{what} {_first(which)}" for what, which in problems if which]:
        if any(f"{id}/0" in known for id in unknown):
            remedy = f"an id ends in the number of its instance, as {truth.ids[0]}"
        elif unknown or lacking:
            remedy = "--dataset, --split and --protocol say what was predicted"
        else:
            remedy = "give each id one row, or tell the runs apart by a column seed"
        raise PredictionsError(
            f"{path} {', and '.join(said)} ({truth.version}, {truth.split}, {truth.protocol}): "
            f"{remedy}"
        )
    return values[[row_of[id] for id in truth.ids]]


def _first(ids: Sequence[str]) -> str:
    """Return a few ids, and how many more there are."""
    more = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
    return ", ".join(map(_shown, ids[:3])) + more


def _shown(id: str) -> str:
    """Return an id of a file as a message may show it."""
    return ascii(id[:60])[1:-1] if len(id) > 60 or outside.strange(id) else id


def _named(truth: Truth) -> dict[str, str]:
    return {"dataset": truth.version, "split": truth.split, "protocol": truth.protocol}


Read = tuple[NDArray[np.str_], NDArray[np.int64], NDArray[np.float64]]


def _read_parquet(file: BinaryIO, truth: Truth) -> Read:
    k = truth.eigenvalues.shape[1]
    columns = {"id": 1, "seed": 1, "eigenvalues": SPARE * k}
    rows = SEEDS * len(truth.ids)
    table = outside_tables.parquet(
        file, columns, text="id", rows=rows, check=lambda schema: _check(schema, truth)
    )
    ids = np.array(table["id"].to_pylist(), dtype=np.str_)
    seeds = _seeds(table["seed"].to_numpy() if "seed" in table.column_names else None, len(ids))
    lists = table["eigenvalues"].to_pylist()
    counts = [0 if values is None else len(values) for values in lists]
    if len(set(counts)) > 1:
        row = next(row for row, count in enumerate(counts) if count != k)
        raise ValueError(f"{_shown(ids[row])} has {counts[row]} eigenvalues, there are {k}")
    return ids, seeds, np.array(lists, dtype=np.float64)


def _check(schema: pa.Schema, truth: Truth) -> None:
    """Check a Parquet file's columns, and that it says of no other split that it is of that."""
    if "eigenvalues" not in schema.names:
        raise ValueError("it has no column eigenvalues, which has a list in each row")
    if not outside_tables.is_text(schema.field("id").type):
        raise ValueError(f"the ids have type {schema.field('id').type}, they must be text")
    kind: Any = schema.field("eigenvalues").type
    lists = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    numbers = (pa.types.is_floating, pa.types.is_integer)
    if not (any(a(kind) for a in lists) and any(a(kind.value_type) for a in numbers)):
        raise ValueError(f"eigenvalues have type {kind}, they must be lists of numbers")
    if "seed" in schema.names and not pa.types.is_integer(schema.field("seed").type):
        raise ValueError("the seeds must be integers, none missing")
    stored = (schema.metadata or {}).get(METADATA_KEY)
    if stored is not None and (of := outside.parsed(stored)) != _named(truth):
        of = of if isinstance(of, dict) else {}
        what = ", ".join(str(of.get(key, "?")) for key in _named(truth))
        raise ValueError(
            f"it says that it is of {what}, not of {', '.join(_named(truth).values())}: "
            "--dataset, --split and --protocol say what was predicted"
        )


def _read_npz(file: BinaryIO, truth: Truth) -> Read:
    n, k = truth.eigenvalues.shape
    size = n * (4 * outside_tables.TEXT + 16 * SPARE * k) + 2**20
    arrays = outside_tables.npz(file, ("ids", "eigenvalues"), size=size)
    ids, values = np.atleast_1d(arrays["ids"]).astype(np.str_), arrays["eigenvalues"]
    if values.dtype.kind not in "fiu":
        raise ValueError(f"eigenvalues have dtype {values.dtype}, they must be real numbers")
    if ids.ndim != 1:
        raise ValueError(f"ids have shape {ids.shape}, it must be (n,)")
    return ids, _seeds(None, len(ids)), values.astype(np.float64)


def _read_csv(file: BinaryIO, truth: Truth) -> Read:
    k = truth.eigenvalues.shape[1]
    numbers = [f"lambda_{i}" for i in range(1, k + 1)]
    columns = ["id", "seed", *numbers, beyond := f"lambda_{k + 1}"]
    frame = outside_tables.csv_table(
        file, columns, text="id", numbers=numbers, rows=SEEDS * len(truth.ids)
    )
    if beyond in frame:
        raise ValueError(f"it has {beyond}, there are {k} eigenvalues")
    values = frame[numbers].to_numpy(dtype=np.float64)
    ids = frame["id"].to_numpy(dtype=np.str_)
    return ids, _seeds(frame["seed"].to_numpy() if "seed" in frame else None, len(ids)), values


def _seeds(column: NDArray[np.int64] | None, count: int) -> NDArray[np.int64]:
    if column is None:
        return np.zeros(count, dtype=np.int64)
    if column.dtype.kind not in "iu":
        raise ValueError("the seeds must be integers, none missing")
    return column.astype(np.int64)
