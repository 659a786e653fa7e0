"""Result files: what a result holds, and what is asserted when it is read."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import jsonschema

from eigbench.errors import EigbenchError, ResultError
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.store.files import make_directory, one_line, sha256, write_atomically, write_text

SCHEMA_VERSION = 3  # 2: sources by their statements, the commit; 3: scores of both targets


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


def setting(result: dict[str, Any]) -> str:
    """Return what times are compared within: hardware, device and threads."""
    facts = result["cost"]
    threads = f"{facts['threads']} thread{'s' if facts['threads'] > 1 else ''}"
    return f"{facts['hardware']}; {facts['device']}, {threads}"


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
    result = load(path)
    validate(result, path)
    checked: dict[str, Any] = result
    return checked


def load(path: Path) -> Any:
    """Read JSON whose numbers are all finite.

    Raises
    ------
    ResultError
        If it is missing or no such JSON.
    """
    try:
        return json.loads(path.read_text(), parse_constant=_no_constant, parse_float=_finite)
    except FileNotFoundError as error:
        raise ResultError(f"there is no file {path}") from error
    except (OSError, ValueError) as error:
        raise ResultError(f"{path} cannot be read: {one_line(error)}") from error


def put(sources: Sequence[Path], targets: Sequence[Path], *, replace: bool = False) -> None:
    """Copy files to their paths on a board, the last first; all, or none if a path is taken.

    Raises
    ------
    EigbenchError
        If another file is at a path and ``replace`` is not given.
    """
    for source, target in zip(sources, targets, strict=True):
        if target.exists() and sha256(target) != sha256(source) and not replace:
            raise EigbenchError(
                f"{target} is there already: give --replace, or another name in META"
            )
    for source, target in zip(reversed(sources), reversed(targets), strict=True):
        make_directory(target.parent)
        if not target.exists() or not target.samefile(source):
            write_atomically(target, lambda to, source=source: shutil.copyfile(source, to))  # type: ignore[misc]


def _finite(digits: str) -> float:
    if not math.isfinite(number := float(digits)):
        raise ValueError(f"{digits} is too large a number")
    return number


def _no_constant(word: str) -> float:
    raise ValueError(f"{word} is no JSON number")


def title(result: dict[str, Any]) -> str:
    """Return what a result is of: ``synthNet 1.0, test split, protocol grouped``."""
    facts = result["dataset"]
    name = recipe.title(facts["version"])
    return f"{name}, {facts['split']} split, protocol {facts['protocol']}"


def declared(result: dict[str, Any], key: str) -> str:
    """Return what a model's META says of its training, or that it does not."""
    return str(result["model"].get(key, "not declared"))


def overused(cost: dict[str, Any]) -> bool:
    """Whether a run used more cores than the threads that it declares, timing's noise aside.

    Examples
    --------
    >>> overused({"cores_used": 1.1, "threads": 1}), overused({"cores_used": 1.9, "threads": 1})
    (False, True)
    """
    return bool(cost["cores_used"] > cost["threads"] + 0.5)


def schema() -> dict[str, Any]:
    """Return the published JSON Schema of results."""
    text = resources.files("eigbench.results").joinpath("result.schema.json").read_text()
    loaded: dict[str, Any] = json.loads(text)
    return loaded


def validate(result: Any, path: Path) -> None:
    """Check a result against the schema, and that its means agree with each other.

    Raises
    ------
    ResultError
        With the keys of the first thing that is wrong.
    """
    check_schema(result, schema(), path)
    for target, scored in result["scores"].items():
        if scored is not None:
            _check_means(result["dataset"]["instances"], scored, f"{path}, {target}")
    low, high = result["cost"]["ms_per_mesh_quartiles"]
    if not low <= result["cost"]["ms_per_mesh"] <= high:
        raise ResultError(f"{path}: the median time is not between the quartiles")


def check_schema(result: Any, required: dict[str, Any], path: Path) -> None:
    """Check a result against a schema.

    Raises
    ------
    ResultError
        With the keys of the first thing that is wrong.
    """
    _check_version(result, required, path)
    validator = jsonschema.Draft202012Validator(required)
    error = next(iter(sorted(validator.iter_errors(result), key=lambda e: list(e.path))), None)
    if error is not None:
        keys = "/".join(map(str, error.path)) or "the top"
        message = " ".join(error.message.split())
        raise ResultError(f"{path} is no result: at {keys}: {message[:200]}")


def _check_version(result: Any, required: dict[str, Any], path: Path) -> None:
    for key in ("schema_version", "scaling_version"):
        stored = result.get(key) if isinstance(result, dict) else None
        current = required["properties"].get(key, {}).get("const")
        if isinstance(stored, int) and current not in (None, stored):
            age = "an earlier" if stored < current else "a later"
            raise ResultError(f"{path} was made by {age} eigbench: evaluate its predictor again")


def _check_means(instances: int, scored: dict[str, Any], where: str) -> None:
    families = scored["families"].values()
    count = sum(family["count"] for family in families)
    if count != instances:
        raise ResultError(f"{where}: the families have {count} instances, the dataset {instances}")
    for key in METRICS:
        overall = scored["overall"][key]["mean"]
        means = [(family["count"], family[key]["mean"]) for family in families]
        if overall is None or any(mean is None for _, mean in means):
            consistent = overall is None and any(mean is None for _, mean in means)
        else:
            weighted = sum(n * mean for n, mean in means) / count
            consistent = math.isclose(weighted, overall, rel_tol=1e-9, abs_tol=1e-12)
        if not consistent:
            raise ResultError(f"{where}: the families' means of {key} do not give the overall mean")
