"""Times of all rows of a dataset, taken in one run on one machine: ``benchmark/timing/*.json``."""

from __future__ import annotations

from collections.abc import Sequence
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
        If a file is no such JSON.
    """
    found: dict[str, list[dict[str, Any]]] = {}
    for path in sorted((root / FOLDER).glob("*.json")):
        timed = results.load(path)
        if not isinstance(timed, dict) or timed.get("timing_version") != VERSION:
            raise ResultError(f"{path} holds no times of `eigbench time`: make it anew")
        found[path.stem] = timed["rows"]
    return found


def cost_of(result: dict[str, Any], timed: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the cost of a result's predictor, if it was timed as it is; ``None`` if not.

    The timing may name files that the result does not: older results name none that lie beside
    a module which the predictor imports.
    """
    sources = result["model"]["sources"].items()
    for row in timed:
        if row["code"] == result["model"]["code"] and sources <= row["sources"].items():
            cost: dict[str, Any] = row["cost"]
            return cost
    return None
