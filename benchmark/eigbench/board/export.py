"""Boards for programs: the scores of a board as JSON, and every prediction as one tidy table."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from eigbench.board import generalisation
from eigbench.board.columns import six_digits
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.results.submission import Submission
from eigbench.results.verification import is_verified
from eigbench.scoring import neighbours as near
from eigbench.scoring import targets
from eigbench.scoring.names import SURFACE
from synthnet.store.files import make_directory, sha256, write_atomically

COLUMNS = (
    *("row", "seed", "shape", "instance", "group", "family", "index"),
    *("mesh", "surface", "surface_bar", "prediction"),
)
FORMATS = ("parquet", "csv")
COSTS = ("ms_per_mesh", "threads", "device", "hardware", "counted_by")  # old results lack the last


def as_json(rows: Sequence[Ranked]) -> str:
    """Return the scores of a board, best first, with the digests of the files they follow from.

    On a board with verified rows no other has costs.
    """
    submission = rows[0].submission
    board = {
        "board": submission.board,
        "target": submission.target,
        "ranked_by": RANKED_BY,
        "dataset": submission.result["dataset"],
        "floor": targets.floor(submission.truth, RANKED_BY),
        "rows": [_row(row) for row in rows],
    }
    return json.dumps(board, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _row(row: Ranked) -> dict[str, object]:
    submission = row.submission
    model, cost = submission.result["model"], row.cost
    return {
        "slug": submission.slug,
        "name": submission.name,
        "kind": model["kind"],
        "rank": row.ranks,
        "exact": row.exact,
        "verified": is_verified(submission.result),
        "scores": row.scores,
        "cost": cost and {key: cost[key] for key in COSTS if key in cost},
        "speed_against_lapy": cost and (cost.get("reference") or {}).get("ratio"),
        "speed_against": cost and _speeds(cost),
        "parameters": model["parameters"],
        "training_data": model.get("training_data"),
        "seeds": len(submission.predictions),
        "remark": submission.remark,
        "sha256": {
            "result": sha256(submission.result_path),
            "predictions": sha256(submission.predictions_path),
        },
    }


def _speeds(cost: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """Return how many times as fast as each peer a run was, with 95 % intervals where known."""
    beside = {**cost.get("peers", {}), "LaPy": cost.get("reference")}
    return {
        name: {key: six_digits(ratio[key]) for key in ("ratio", "low", "high") if key in ratio}
        for name, ratio in beside.items()
        if ratio is not None
    }


def generalised_as_json(board: generalisation.Board) -> str:
    """Return the scores of a version's models under each of its protocols, with their drops.

    The rows are in the order of their ranks under the first protocol.
    """
    protocols = {
        protocol: {
            "meshes": board.count(protocol),
            "nearest_of_training": six_digits(
                float(np.median(distances := near.distances(board.version, protocol)))
            ),
            "share_within_1_percent": six_digits(float(np.mean(distances <= near.SIMILAR))),
        }
        for protocol in board.protocols
    }
    rows = [
        {
            "slug": row.submission.slug,
            "name": row.submission.name,
            "protocols": {
                protocol: _held_out(board, row.submission, protocol) for protocol in board.protocols
            },
        }
        for row in board.models
    ]
    named = {"version": board.version, "target": board.target}
    content = {**named, "protocols": protocols, "rows": rows}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _held_out(board: generalisation.Board, model: Submission, protocol: str) -> dict[str, object]:
    """Return a model's rank, seeds and scores under a protocol; null where it was not run."""
    row = board.row(protocol, model.slug)
    reason = board.why_not(model, protocol)
    return {
        **({} if reason is None else {"not_run": reason.reason}),
        "rank": row and row.ranks,
        "exact": row and row.exact,
        "verified": row and is_verified(row.submission.result),
        "seeds": row and len(row.submission.predictions),
        **{key: _in_digits(board.scored(model, protocol, key)) for key in generalisation.SHOWN},
    }


def _in_digits(held_out: generalisation.HeldOut) -> dict[str, float | None]:
    numbers = held_out.numbers or {}
    return {
        "score": six_digits(held_out.score),
        **{key: six_digits(numbers.get(key)) for key in ("low", "high", "seed_std")},
        "drop": six_digits(held_out.drop),
    }


def tidy(submission: Submission) -> pa.Table:
    """Return a submission's predictions, one line per eigenvalue, in the columns :data:`COLUMNS`.

    ``shape`` and ``instance`` name a mesh, ``group`` the surface that intervals resample as one,
    ``index`` counts eigenvalues from 1; ``mesh`` and ``surface`` are the two targets and
    ``surface_bar`` the bar of the latter, in 1/length², these two null where it is not known.
    """
    truth = submission.truth
    seeds, n, k = submission.predictions.shape
    surface = targets.at(truth, SURFACE)
    instances = [int(id.rpartition("/")[2]) for id in truth.ids]
    missing = np.full((n, k), np.nan)
    limits, bars = (
        (missing, missing) if surface is None else (surface.eigenvalues, surface.tolerance)
    )

    def of_mesh(values: Any) -> pa.Array:  # one a mesh
        return pa.array(np.tile(np.repeat(values, k), seeds))

    def of_target(values: np.ndarray) -> pa.Array:  # one an eigenvalue
        return pa.array(np.tile(values.ravel(), seeds), from_pandas=True)

    values = {
        "row": pa.array([submission.slug]).dictionary_encode().take(pa.array([0] * seeds * n * k)),
        "seed": pa.array(np.repeat(np.arange(seeds, dtype=np.int32), n * k)),
        "shape": of_mesh(truth.shapes).dictionary_encode(),
        "instance": of_mesh(np.array(instances, np.int32)),
        "group": of_mesh(truth.groups).dictionary_encode(),
        "family": of_mesh(truth.families).dictionary_encode(),
        "index": pa.array(np.tile(np.arange(1, k + 1, dtype=np.int32), seeds * n)),
        "mesh": of_target(truth.eigenvalues),
        "surface": of_target(limits),
        "surface_bar": of_target(bars),
        "prediction": pa.array(submission.predictions.ravel()),
    }
    return pa.table(values)


def write(
    out: Path, boards: Sequence[Sequence[Submission]], formats: Sequence[str] = FORMATS
) -> Iterator[Path]:
    """Write every board's predictions as ``BOARD.parquet`` and ``BOARD.csv``; yield the paths."""
    make_directory(out, "--out")
    for submissions in boards:
        whole = pa.concat_tables([tidy(s) for s in submissions], promote_options="permissive")
        whole = whole.unify_dictionaries()
        stores = {
            "parquet": partial(pq.write_table, whole, compression="zstd"),
            "csv": partial(pyarrow.csv.write_csv, whole),
        }
        for suffix in dict.fromkeys(formats):
            path = out / f"{submissions[0].board}.{suffix}"
            write_atomically(path, stores[suffix])
            yield path
