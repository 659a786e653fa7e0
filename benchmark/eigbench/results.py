"""Result files: what a result holds, how it is made, and what is asserted when it is read."""

from __future__ import annotations

import json
import math
import os
import platform
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np

from eigbench import scores
from eigbench.errors import ResultError
from eigbench.evaluate import Evaluation, Options
from eigbench.metrics import METRIC_VERSION, METRICS
from eigbench.truth import Truth
from synthnet.files import one_line, sha256, write_text

SCHEMA_VERSION = 1
PACKAGES = ("synthnet", "numpy", "scipy", "lapy", "torch", "torch-geometric", "scikit-learn")


def make(
    truth: Truth,
    evaluation: Evaluation,
    options: Options,
    *,
    code: Path,
    predictions: Path,
    contract: dict[str, float | None],
    partial: bool,
) -> dict[str, Any]:
    """Return the result of an evaluation, ready for JSON.

    Parameters
    ----------
    truth, evaluation, options
        What was predicted, the answers, and how.
    code : Path
        The predictor's file.
    predictions : Path
        The file of predictions, already written.
    contract : dict
        Of :func:`eigbench.physics.contract`.
    partial : bool
        Whether only a part of the split was predicted.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "metric_version": METRIC_VERSION,
        "partial": partial,
        "model": {
            **evaluation.meta,
            "code": code.name,
            "code_sha256": sha256(code),
            "parameters": evaluation.parameters,
        },
        "dataset": dataset_facts(truth),
        "predictions": {"sha256": sha256(predictions), "seeds": len(evaluation.predictions)},
        "scores": scores.score(truth, evaluation.predictions),
        "cost": cost(evaluation, options),
        "physics": contract,
        "environment": environment(),
    }


def dataset_facts(truth: Truth) -> dict[str, Any]:
    """Return which labels were predicted."""
    return {
        "version": truth.version,
        "split": truth.split,
        "protocol": truth.protocol,
        "recipe_digest": truth.recipe_digest,
        "split_digest": truth.digest,
        "shapes": len(set(truth.shapes.tolist())),
        "instances": len(truth.ids),
    }


def cost(evaluation: Evaluation, options: Options) -> dict[str, Any]:
    """Return median and quartiles of milliseconds a mesh over the batches, and the setting."""
    each = 1e3 * evaluation.seconds / evaluation.sizes
    low, middle, high = np.percentile(each, [25, 50, 75])
    return {
        "ms_per_mesh": float(middle),
        "ms_per_mesh_quartiles": [float(low), float(high)],
        "batch_size": options.batch_size,
        "threads": options.threads,
        "device": options.device,
        "peak_memory_mb": evaluation.peak_bytes / 2**20,
        "hardware": hardware(),
    }


def hardware() -> str:
    """Return a label of this machine: times are compared only where it is the same."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].partition(":")[2].strip() if lines else model
    return f"{model}, {os.cpu_count()} cores"


def environment() -> dict[str, str]:
    """Return the versions of Python and of the packages that matter."""
    versions = {"python": platform.python_version(), "platform": platform.platform(terse=True)}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # an optional package
    return versions


def write(path: Path, result: dict[str, Any]) -> None:
    """Write a result as JSON, after checking it."""
    validate(result, path)
    text = json.dumps(result, indent=1, allow_nan=False) + "\n"
    write_text(path, text)


def read(path: Path) -> dict[str, Any]:
    """Read a result and check it.

    Raises
    ------
    ResultError
        If it is missing, no JSON, not of the schema, or contradicts itself.
    """
    try:
        result = json.loads(path.read_text(), parse_constant=_no_constant)
    except FileNotFoundError as error:
        raise ResultError(f"there is no file {path}") from error
    except (OSError, ValueError) as error:
        raise ResultError(f"{path} cannot be read: {one_line(error)}") from error
    validate(result, path)
    checked: dict[str, Any] = result
    return checked


def _no_constant(word: str) -> float:
    raise ValueError(f"{word} is no JSON number")


def schema() -> dict[str, Any]:
    """Return the published JSON Schema of results."""
    text = resources.files("eigbench").joinpath("result.schema.json").read_text()
    loaded: dict[str, Any] = json.loads(text)
    return loaded


def validate(result: Any, path: Path) -> None:
    """Check a result against the schema, and that its means agree with each other.

    Raises
    ------
    ResultError
        With the place of the first thing that is wrong.
    """
    validator = jsonschema.Draft202012Validator(schema())
    error = next(iter(sorted(validator.iter_errors(result), key=lambda e: list(e.path))), None)
    if error is not None:
        place = "/".join(map(str, error.path)) or "the top"
        raise ResultError(f"{path} is no result: at {place}: {one_line(error)[:200]}")
    _check_means(result, path)


def _check_means(result: dict[str, Any], path: Path) -> None:
    families = result["scores"]["families"].values()
    count = sum(family["count"] for family in families)
    if count != result["dataset"]["instances"]:
        raise ResultError(
            f"{path}: the families have {count} instances, "
            f"the dataset {result['dataset']['instances']}"
        )
    for key in METRICS:
        overall = result["scores"]["overall"][key]["mean"]
        means = [(family["count"], family[key]["mean"]) for family in families]
        if overall is None or any(mean is None for _, mean in means):
            consistent = overall is None and any(mean is None for _, mean in means)
        else:
            weighted = sum(n * mean for n, mean in means) / count
            consistent = math.isclose(weighted, overall, rel_tol=1e-9, abs_tol=1e-12)
        if not consistent:
            raise ResultError(f"{path}: the families' means of {key} do not give the overall mean")
