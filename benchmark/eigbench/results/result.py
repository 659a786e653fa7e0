"""Result files: what a result holds, and what is asserted when it is read."""

from __future__ import annotations

import itertools
import json
import math
import os
import re
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any

from eigbench import outside
from eigbench.errors import EigbenchError, OutsideError, ResultError
from eigbench.results import verification
from eigbench.scoring import scores
from eigbench.scoring.metrics import METRIC_VERSION, METRICS
from eigbench.scoring.names import nameless
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.errors import counted, missing
from synthnet.store.files import make_directory, sha256, write_atomically, write_text

SCHEMA_VERSION = 3  # 2: sources by their statements, the commit; 3: scores of both targets
PREDICTED = (".parquet", ".npz", ".csv")  # files that have predictions, by their suffix
SPARE_CORES = 0.5  # more than the threads: the noise of timing
APART = 10  # LaPy is timed on some of the batches; their mean time is this near that of all
ERRORS = 100  # of a schema are looked at, to name the first


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
    return f"{facts['hardware']}; {facts['device']}, {counted(facts['threads'], 'thread')}"


def read(path: Path, below: Path | None = None) -> dict[str, Any]:
    """Read a result and check it; ``below`` is as of :func:`eigbench.outside.opened`.

    Raises
    ------
    ResultError
        If it is missing, no JSON, not of the schema, or contradicts itself.
    """
    result: dict[str, Any] = load(path, below)
    validate(result, path)
    return result


def load(path: Path, below: Path | None = None) -> Any:
    """Read JSON that somebody hands in, as :func:`eigbench.outside.read_json` does.

    Raises
    ------
    ResultError
        If it is missing or no such JSON.
    """
    if path.suffix in PREDICTED and path.is_file():
        raise ResultError(f"{path} has predictions: give the result, the .json beside it")
    try:
        return outside.read_json(path, below=below)
    except FileNotFoundError as error:
        raise ResultError(missing(path)) from error
    except OutsideError as error:
        raise ResultError(str(error)) from error


def put(
    sources: Sequence[Path], targets: Sequence[Path], root: Path, *, replace: bool = False
) -> None:
    """Copy files to their paths on a board, the last first; all, or none if a path is taken.

    Raises
    ------
    EigbenchError
        If another file is at a path and ``replace`` is not given.
    OutsideError
        If a folder on the way from the board's root to a path is a symbolic link.
    """
    for source, target in zip(sources, targets, strict=True):
        outside.check_way(target, root)
        if os.path.lexists(target) and (target.is_symlink() or not target.is_file()):
            raise EigbenchError(f"{target} is no regular file: remove it")
        if target.exists() and sha256(target) != sha256(source) and not replace:
            raise EigbenchError(
                f"{target} is there already: give --replace, or another name in META"
            )
    for source, target in zip(reversed(sources), reversed(targets), strict=True):
        make_directory(target.parent)
        if not target.exists() or not target.samefile(source):
            write_atomically(target, partial(shutil.copyfile, source))


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
    return bool(cost["cores_used"] > cost["threads"] + SPARE_CORES)


def schema(name: str = "result") -> dict[str, Any]:
    """Return a JSON Schema: of results, or by name of ``timing``, ``reported``, ``not-run``."""
    text = resources.files(__package__).joinpath(f"{name}.schema.json").read_text()
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
            _check_means(result["dataset"], scored, f"{path}, {target}")
    verification.check(result, path)
    facts, families = result["dataset"], result["scores"]["mesh"]["families"].values()
    if (shapes := sum(family["shapes"] for family in families)) > facts["shapes"]:
        raise ResultError(f"{path}: the families have {shapes} shapes of {facts['shapes']}")
    if facts["shapes"] > facts["instances"]:
        raise ResultError(f"{path}: there are more shapes than instances")
    check_cost(result["cost"], path)
    if (reference := result["cost"].get("reference")) is not None:
        if reference["meshes"] > facts["instances"]:
            raise ResultError(f"{path}: LaPy is timed on more meshes than there are")
        own = reference["ms_per_mesh"] / reference["ratio"]
        apart = own / result["cost"]["ms_per_mesh_mean"]
        if not 1 / APART <= apart <= APART:
            raise ResultError(
                f"{path}: LaPy's time and the ratio give {own:.3g} ms per mesh, the mean is "
                f"{result['cost']['ms_per_mesh_mean']:.3g}"
            )


def write(
    path: Path, result: dict[str, Any], check: Callable[[Any, Path], None] = validate
) -> None:
    """Write a result as JSON, after checking it."""
    check(result, path)
    write_text(path, json.dumps(result, indent=1, allow_nan=False) + "\n")


def check_cost(cost: dict[str, Any], path: Path) -> None:
    """Check that the numbers of a cost agree with each other.

    Raises
    ------
    ResultError
        If the median is not between the quartiles, or more cores are used than there are.
    """
    low, high = cost["ms_per_mesh_quartiles"]
    if not low <= cost["ms_per_mesh"] <= high:
        raise ResultError(f"{path}: the median time is not between the quartiles")
    cores = re.search(r"([0-9]{1,5}) cores$", cost["hardware"])
    if cores and cost["cores_used"] > int(cores[1]) + SPARE_CORES:
        raise ResultError(f"{path}: {cost['cores_used']:.1f} cores used, of {cores[1]}")


def check_schema(result: Any, required: dict[str, Any], path: Path) -> None:
    """Check a result against a schema.

    Raises
    ------
    ResultError
        With the keys of the first thing that is wrong.
    """
    import jsonschema  # as late as here: beside some packages of Jupyter it takes a second

    _check_version(result, required, path)
    validator = jsonschema.Draft202012Validator(required)
    errors = itertools.islice(validator.iter_errors(result), ERRORS)
    first = min(errors, key=lambda error: list(map(str, error.path)), default=None)
    if first is not None:
        keys = "/".join(map(str, first.path)) or "the top"
        message = " ".join(first.message.split())
        raise ResultError(f"{path} is no result: at {keys}: {message[:200]}")
    try:
        outside.check(result)
    except OutsideError as error:
        raise ResultError(f"{path} is no result: it has {error}") from error
    if "model" in result and (problem := nameless(result["model"]["name"])):
        raise ResultError(f"{path} is no result: its model's name has {problem}")


def _check_version(result: Any, required: dict[str, Any], path: Path) -> None:
    for key in ("schema_version", "scaling_version"):
        stored = result.get(key) if isinstance(result, dict) else None
        current = required["properties"].get(key, {}).get("const")
        if isinstance(stored, int) and current not in (None, stored):
            age = "an earlier" if stored < current else "a later"
            raise ResultError(f"{path} was made by {age} eigbench: evaluate its predictor again")
    metric = result.get("metric_version") if isinstance(result, dict) else None
    if isinstance(metric, int) and metric != METRIC_VERSION:
        raise ResultError(
            f"{path} has scores of metric version {metric}, these are version {METRIC_VERSION}: "
            "on a board, eigbench leaderboard --rescore makes them anew from its predictions; "
            "elsewhere, evaluate its predictor again"
        )


def _check_means(facts: dict[str, Any], scored: dict[str, Any], where: str) -> None:
    instances, families = facts["instances"], scored["families"].values()
    agree = 10.0 ** (1 - scores.DIGITS) if scores.is_sealed(facts["version"]) else 1e-9
    count = sum(family["count"] for family in families)
    if count != instances:
        raise ResultError(f"{where}: the families have {count} instances, the dataset {instances}")
    for name, numbers in (("overall", scored["overall"]), *scored["families"].items()):
        if set(numbers) - {"count", "shapes"} != set(METRICS):
            raise ResultError(f"{where}: {name} does not have the metrics {', '.join(METRICS)}")
    for key in METRICS:
        overall = scored["overall"][key]["mean"]
        means = [(family["count"], family[key]["mean"]) for family in families]
        if overall is None or any(mean is None for _, mean in means):
            consistent = overall is None and any(mean is None for _, mean in means)
        else:
            weighted = sum(n * mean for n, mean in means) / count
            consistent = math.isclose(weighted, overall, rel_tol=agree, abs_tol=1e-12)
        if not consistent:
            raise ResultError(f"{where}: the families' means of {key} do not give the overall mean")
