"""From an evaluation to a result: what was measured, on what, and with which versions."""

from collections.abc import Iterable, Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from eigbench.results import SCHEMA_VERSION, dataset_facts, overused
from eigbench.results.sources import git
from eigbench.running import predictor
from eigbench.running.evaluate import Evaluation, Options
from eigbench.running.machine import environment, hardware
from eigbench.running.process import Loaded, Status
from eigbench.scoring import scores
from eigbench.scoring.metrics import METRIC_VERSION
from eigbench.scoring.truth import Truth
from synthnet.store.files import sha256

REMEMBERS = 0.5  # of the time of a new shape, a copy takes less
SPENDS = 3.0  # times as long as a new shape: an honest predictor spends no more on a copy
BETTER = 1.2  # times as large an error of new shapes as of copies shows two kinds of answers
SURE = 5.0  # standard errors of the mean paired difference, so that it is no chance
SOME = 20  # shapes: of fewer, a mean says little
ENOUGH = 5  # batches of one size: of fewer, a time does


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

    ``code`` is the predictor's file, ``predictions`` the file of predictions, already written,
    ``contract`` as of :func:`eigbench.scoring.physics.contract`. The result is partial if only a
    part of the split was predicted.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "metric_version": METRIC_VERSION,
        "partial": partial,
        "model": model(code, evaluation.loaded, evaluation.status),
        "dataset": dataset_facts(truth),
        "predictions": {"sha256": sha256(predictions), "seeds": len(evaluation.predictions)},
        "scores": scores.of_targets(truth, evaluation.predictions),
        "cost": cost(evaluation, options),
        "physics": contract,
        "environment": environment(),
        "sandbox": options.sandbox,
        **checkout(code),
    }


def model(code: Path, loaded: Loaded, status: Status) -> dict[str, Any]:
    """Return what a result says of its predictor: META, files and parameters."""
    files = {"code": predictor.code_name(code), "sources": status.sources}
    return {**loaded.meta, **files, "parameters": loaded.parameters}


def cost(evaluation: Evaluation, options: Options) -> dict[str, Any]:
    """Return milliseconds a mesh, and the setting.

    Only batches of new shapes count. Median and quartiles are over these, the mean is over their
    meshes: the whole time divided by their number. ``cores_used`` is CPU
    time by wall time, whatever ``threads`` says. ``reference`` is LaPy on some of the same
    batches: ``ratio`` is its time by the predictor's, so more than 1 is faster than LaPy.
    """
    new = evaluation.new
    return {
        **times(evaluation.seconds[new], evaluation.cpu_seconds[new], evaluation.sizes[new]),
        "loading_seconds": evaluation.loaded.loading_seconds,
        "copies_ratio": of_copies(evaluation),
        "batch_size": options.batch_size,
        "threads": options.threads,
        "device": options.device,
        "peak_memory_mb": evaluation.status.peak_bytes / 2**20,
        "counted_by": evaluation.status.counted_by,
        "hardware": hardware(evaluation.loaded.accelerator),
        "reference": beside_reference(evaluation),
    }


def times(
    seconds: NDArray[np.float64], cpu_seconds: NDArray[np.float64], sizes: NDArray[np.int64]
) -> dict[str, Any]:
    """Return milliseconds a mesh and cores used, of batches: arrays of shape (batches,)."""
    low, middle, high = np.percentile(1e3 * seconds / sizes, [25, 50, 75])
    return {
        "ms_per_mesh": float(middle),
        "ms_per_mesh_quartiles": [float(low), float(high)],
        "ms_per_mesh_mean": float(1e3 * seconds.sum() / sizes.sum()),
        "cores_used": float(cpu_seconds.sum() / seconds.sum()),
    }


def of_copies(evaluation: Evaluation) -> float | None:
    """Return the time of a copy of a shape, as a share of that of a new one.

    A predictor that remembers shapes is much quicker for a copy. ``None`` where there are none.
    """
    new, sizes, seconds = evaluation.new, evaluation.sizes, evaluation.seconds
    if new.all():
        return None
    each = seconds[new].sum() / sizes[new].sum()
    return float(seconds[~new].sum() / sizes[~new].sum() / each)


def copies_answered_otherwise(targeted: Iterable[Truth], evaluation: Evaluation) -> list[str]:
    """Return what shows that shapes are answered in another way when they are asked again.

    Which instance of a shape is asked first, and timed, is drawn at random. So an honest
    predictor's errors on these are neither larger nor smaller than on the copies asked later,
    against the mesh as against its surface: ``targeted`` are the same instances at each target.
    """
    lines = []
    for truth in targeted:
        errors = scores.of_metric(truth, evaluation.predictions, "rpd")
        new, again = _by_turn(errors, truth, evaluation)
        if larger(new, again):
            lines.append(
                f"answers that are timed have an RPD of {new.mean():.3g} against the "
                f"{truth.target}, those on copies of the same shapes, which are not, "
                f"{again.mean():.3g}: the two are computed differently"
            )
    whole = evaluation.sizes == evaluation.sizes.max()
    each = [evaluation.seconds[whole & (evaluation.new == turn)] for turn in (True, False)]
    if min(map(len, each)) >= ENOUGH:
        ratio = float(np.median(each[1]) / np.median(each[0]))
        if ratio > SPENDS:
            lines.append(
                f"copies of shapes take {ratio:.2f} times as long as new ones, which alone are "
                "timed"
            )
    return lines


def larger(errors: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether errors are larger than paired ones, both (n,), by more than chance explains.

    All must be finite.

    Examples
    --------
    >>> bool(larger(np.linspace(1, 2, 30), np.linspace(0.5, 1, 30)))
    True
    >>> bool(larger(np.linspace(1, 1.1, 30), np.linspace(1, 1, 30)))  # by a twentieth
    False
    """
    if len(errors) < SOME:
        return False
    apart = errors - others
    chance = float(np.std(apart, ddof=1)) / np.sqrt(len(apart))
    return bool(apart.mean() > SURE * chance and errors.mean() > BETTER * others.mean())


def oftener_larger(errors: NDArray[np.float64], others: NDArray[np.float64]) -> bool:
    """Return whether errors exceed paired ones, both (n,), more often than chance explains.

    This is a sign test; infinity is larger than any error. The medians must differ as well.

    Examples
    --------
    >>> oftener_larger(np.append(np.linspace(1, 2, 30), np.inf), np.linspace(0.5, 1, 31))
    True
    >>> oftener_larger(np.linspace(1, 1.1, 30), np.linspace(1, 1, 30))  # by a twentieth
    False
    """
    more, less = (errors > others).sum(), (errors < others).sum()
    chance = np.sqrt(more + less)
    median = np.median(errors) > BETTER * np.median(others)
    return bool(more - less > SURE * chance and median)


def _by_turn(
    errors: NDArray[np.float64], truth: Truth, evaluation: Evaluation
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean errors of the first answer of each shape, and of its others, if it has any.

    Shapes with an error that is not finite are left out.
    """
    first, each = evaluation.first, np.broadcast_to(truth.shapes, errors.shape)
    errors = np.where(np.isfinite(errors), errors, np.inf)  # NaN would be left out of a mean
    means = pd.DataFrame({"error": errors.ravel(), "first": first.ravel(), "shape": each.ravel()})
    by_turn = means.pivot_table("error", "shape", "first", dropna=False)
    if len(by_turn.columns) < 2:
        return np.empty(0), np.empty(0)
    values = by_turn.to_numpy()  # of others, and of the first
    again, new = values[np.isfinite(values).all(axis=1)].T
    return new, again


def findings(cost: dict[str, Any], refused: Sequence[str] = ()) -> list[str]:
    """Return what makes a run doubtful, a line each: its times, and what its sandbox refused."""
    lines = []
    if refused:
        more = f" and {len(refused) - 3} more" if len(refused) > 3 else ""
        first = ", ".join(refused[:3])
        lines.append(f"the sandbox refused what the predictor tried: {first}{more}")
    if overused(cost):
        lines.append(
            f"{cost['cores_used']:.1f} cores were used with --threads {cost['threads']}: a board "
            "does not take the result"
        )
    if (ratio := cost["copies_ratio"]) is not None and ratio < REMEMBERS:
        lines.append(
            f"a copy of a shape takes {ratio:.2f} of the time of a new one: the predictor "
            "remembers shapes, or the machine was busy; new ones alone are timed"
        )
    return lines


def beside_reference(evaluation: Evaluation) -> dict[str, Any] | None:
    """Return LaPy's time on the batches that it was given too, and the ratio; or ``None``."""
    both = np.isfinite(evaluation.reference_seconds)
    if not both.any():
        return None
    meshes = int(evaluation.sizes[both].sum())
    seconds = float(evaluation.reference_seconds[both].sum())
    return {
        "solver": f"LaPy {metadata.version('lapy')}",
        "meshes": meshes,
        "ms_per_mesh": 1e3 * seconds / meshes,
        "ratio": seconds / float(evaluation.seconds[both].sum()),
    }


def checkout(code: Path) -> dict[str, Any]:
    """Return the commit that a predictor lies in, as a result's ``checkout``; nothing without git.

    ``dirty``: a tracked file of the checkout differs from the commit, or that lacks the predictor.
    """
    file, _ = predictor.split(code)
    folder = file.resolve().parent
    commit = git(folder, "rev-parse", "--verify", "HEAD")
    if commit is None:
        return {}
    changed = git(folder, "status", "--porcelain", "--untracked-files=no")
    named = f":(literal){file.name}"
    untracked = git(folder, "ls-files", "--error-unmatch", "--", named) is None
    return {"checkout": {"commit": commit, "dirty": changed != "" or untracked}}
