"""Times of all rows of a dataset, taken in one run on one machine: ``benchmark/timing/*.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench import results
from eigbench.errors import ResultError
from eigbench.scoring import bootstrap

FOLDER = Path("benchmark", "timing")
VERSION = 1
RESAMPLES = 2000
AGREE = 1e-6  # relative, between a ratio and the quotient of the times


def ratio(theirs: NDArray[np.float64], own: NDArray[np.float64]) -> dict[str, float]:
    """Return how many times faster than a peer a predictor is, with its 95 % interval.

    The ratio of the whole times; the interval is a bootstrap over batches.

    Parameters
    ----------
    theirs, own : ndarray of shape (batches,)
        Seconds of both on the same batches.

    Examples
    --------
    >>> ratio(np.array([2.0, 4.0]), np.array([1.0, 2.0]))
    {'ratio': 2.0, 'low': 2.0, 'high': 2.0}
    """
    count = len(own)
    raw = np.random.PCG64(0).random_raw(RESAMPLES * count)
    taken = (raw % np.uint64(count)).astype(np.int64).reshape(RESAMPLES, count)
    low, high = bootstrap.interval(theirs[taken].sum(axis=1) / own[taken].sum(axis=1))
    return {"ratio": float(theirs.sum() / own.sum()), "low": low, "high": high}


def read(root: Path) -> dict[str, list[dict[str, Any]]]:
    """Return the times of a checkout by dataset, a dictionary a row.

    Raises
    ------
    ResultError
        If a file is no such JSON, or its numbers do not agree with each other.
    """
    times: dict[str, list[dict[str, Any]]] = {}
    for path in sorted((root / FOLDER).glob("*.json")):
        timed = results.load(path, below=root)
        if not isinstance(timed, dict) or timed.get("timing_version") != VERSION:
            raise ResultError(f"{path} holds no times of `eigbench time`: make it anew")
        results.check_schema(timed, schema(), path)
        means = {row["name"]: row["cost"]["ms_per_mesh_mean"] for row in timed["rows"]}
        for row in timed["rows"]:
            _check(row, means, path)
        times[path.stem] = timed["rows"]
    return times


def schema() -> dict[str, Any]:
    """Return the JSON Schema of these files; each cost has what a result's has, and more."""
    loaded = results.schema("timing")
    shared, more = results.schema()["properties"], loaded["$defs"]["row"]["properties"]
    more["sources"] = shared["model"]["properties"]["sources"]
    known = shared["cost"]["properties"]
    more["cost"]["properties"] = {**known, **more["cost"]["properties"]}
    return loaded


def _check(row: dict[str, Any], means: Mapping[str, float], path: Path) -> None:
    """Check that a row's ratios are those of its times, and lie in their intervals."""
    cost, where = row["cost"], f"{path}: {row['name']}"
    results.check_cost(cost, path)
    against = [("LaPy", cost["reference"], cost["reference"]["ms_per_mesh"])]
    against += [(name, beside, means.get(name)) for name, beside in cost["peers"].items()]
    for name, beside, theirs in against:
        if not beside["low"] <= beside["ratio"] <= beside["high"]:
            raise ResultError(f"{where}: its ratio to {name} is not in its interval")
        own = cost["ms_per_mesh_mean"]
        if theirs is not None and not math.isclose(theirs / own, beside["ratio"], rel_tol=AGREE):
            raise ResultError(
                f"{where}: its ratio to {name} is {beside['ratio']:.6g}, its times give "
                f"{theirs / own:.6g}"
            )


def cost_of(result: dict[str, Any], timed: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the cost of a result's predictor, if it was timed as it is; ``None`` if not.

    The timing may name files that the result does not: older results name none that lie beside
    a module which the predictor imports.
    """
    sources = result["model"]["sources"].items()
    for row in timed:
        if row["code"] == result["model"]["code"] and sources <= row["sources"].items():
            return {**row["cost"], "loading_seconds": row["loading_seconds"]}
    return None
