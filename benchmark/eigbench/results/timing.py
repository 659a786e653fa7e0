"""Times of all rows of a dataset, taken in one run on one machine: ``benchmark/timing/*.json``."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench import results
from eigbench.errors import EigbenchError, ResultError
from eigbench.results.submission import Submission
from eigbench.scoring import bootstrap, scores, targets
from eigbench.scoring.truth import Truth

FOLDER = Path("benchmark", "timing")
VERSION = 1
RESAMPLES = 2000
# Of times and of errors on meshes that nobody has seen: by chance and load they are no larger
LONGER = 3.0
AGREE = 1e-6  # relative, between a ratio and the quotient of the times
# Relative and absolute, between two means of RPD: a model that trains while it loads may end like
# another seed on another processor, and a solver may miss one eigenvalue of one mesh by chance
ALIKE, SAME_RPD = 0.25, 1e-4
# Down to this probability fresh meshes have larger errors by chance, or because a small draw has
# other shares of the families, for which an honest row had 2e-3
CHANCE = 1e-6


def ratio(theirs: NDArray[np.float64], own: NDArray[np.float64]) -> dict[str, float]:
    """Return how many times faster than a peer a predictor is, with its 95 % interval.

    The ratio of the whole times; the interval is a bootstrap over sizes. Both arrays, of shape
    (sizes,), are seconds on the same batches: of each size of meshes the median over its batches.

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
        shapes = timed["meshes"] * timed["repeats"]
        times[path.stem] = [{**row, "asked": shapes} for row in timed["rows"]]
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


def asked(truth: Truth, count: int) -> NDArray[np.int64]:
    """Return the instances to time: one of each of ``count`` shapes, drawn, always the same.

    Raises
    ------
    EigbenchError
        If there are fewer shapes.
    """
    first = np.sort(np.unique(truth.shapes[truth.order], return_index=True)[1])
    if len(first) < count:
        raise EigbenchError(
            f"{truth.version} has {len(first)} shapes in its {truth.split} split, and none is "
            f"timed twice: --meshes times --repeats may be {len(first)} at most, "
            "so give fewer --meshes"
        )
    return np.sort(truth.order[first[:count]])


def check_answers(timed: dict[str, Any], row: Submission) -> None:
    """Check that a predictor answered, while it was timed, as well as its row on the same meshes.

    Nor may it have answered these quicker, or better, than fresh ones. Nothing is checked of times
    of earlier releases, which do not say how well it answered.

    Raises
    ------
    ResultError
        If it did not.
    """
    for found in knows(timed):
        raise ResultError(f"{row.result_path}: while {timed['name']} was timed, {found}")
    for known in targets.every(row.truth):
        if known.target not in timed.get("rpd", ()):
            continue
        there = timed["rpd"][known.target]
        errors = scores.of_metric(known, row.predictions[:1], "rpd")[0]
        own = float(errors[asked(row.truth, timed["asked"])].mean())
        if not math.isclose(there, own, rel_tol=ALIKE, abs_tol=SAME_RPD):
            raise ResultError(
                f"{row.result_path}: while it was timed, {timed['name']} answered with an RPD of "
                f"{there:.3g} against the {known.target}, and the row has {own:.3g} on the same "
                "meshes: time it again"
            )


def takes_longer(ratio: float | None) -> str:
    """Return what it means that fresh meshes take so much longer than public ones; "" if nothing.

    The ratio is that of :func:`eigbench.running.unseen.longer`.
    """
    if ratio is None or ratio <= LONGER:
        return ""
    return (
        f"meshes that nobody has seen take {ratio:.1f} times as long as public ones of as many "
        "vertices: it knows these"
    )


def knows(row: dict[str, Any]) -> list[str]:
    """Return what shows that a timed row knows the public meshes from elsewhere.

    Times of earlier releases do not say how fresh meshes were answered: of them it is nothing.
    """
    if (fresh := row.get("fresh")) is None:
        return []
    found = [takes_longer(fresh.get("longer"))]
    larger = fresh["rpd"] > LONGER * fresh["rpd_public"] + SAME_RPD
    if larger and fresh.get("chance", 0.0) < CHANCE:  # 0.0: earlier timings do not say it
        found.append(
            f"meshes that nobody has seen are answered with a median RPD of {fresh['rpd']:.3g}, "
            f"public ones with {fresh['rpd_public']:.3g}: it knows these"
        )
    return [*filter(None, found)]


def row_of(result: dict[str, Any], timed: Sequence[dict[str, Any]]) -> dict[str, Any] | None:
    """Return the times of a result's predictor, if it was timed as it is; ``None`` if not.

    The timing may name files that the result does not: older results name none that lie beside
    a module which the predictor imports.
    """
    sources = result["model"]["sources"].items()
    for row in timed:
        if row["code"] == result["model"]["code"] and sources <= row["sources"].items():
            return row
    return None


def cost_of(row: dict[str, Any]) -> dict[str, Any]:
    """Return times as a result has its cost."""
    return {**row["cost"], "loading_seconds": row["loading_seconds"]}
