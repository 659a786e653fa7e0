"""Run a predictor over the meshes of the scaling track; each in a process of its own.

A mesh that takes too long or too much memory, or whose process dies, is recorded as such, and the
others go on. The result is written anew after every mesh, so what is finished is never lost.
"""

import contextlib
from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from eigbench import results
from eigbench.errors import Died, EigbenchError, OverMemory, OverTime, PredictorError
from eigbench.running import box, machine, record
from eigbench.running.process import REFERENCE_FILE, Answered, PredictorProcess
from eigbench.scaling import results as scaling_results
from eigbench.scaling import surfaces
from eigbench.scaling.results import ANSWERED
from synthnet.types import Mesh

REPEATS = 5  # calls on a mesh at most; their median is the time
ENOUGH = 5.0  # seconds in all after which a mesh is not repeated
LOADING = 600.0  # seconds that loading and warming up may take, whatever the limit of a mesh
ALONE = box.Settings(time_limit=3600.0)  # how LaPy is run beside a predictor, on one thread
TRAINING = "2.0/grouped"  # of predictors that are trained: it has meshes up to 100,000 vertices
OUTCOMES = {OverTime: "over time", OverMemory: "over memory", Died: "died"}


@dataclass(frozen=True, slots=True)
class Settings(box.Settings):
    """How to run a predictor, with limits of time and memory for a mesh."""

    time_limit: float = 600.0
    memory_limit: float = 16.0
    #: Keep the meshes of an earlier result at the same path, and add those that it lacks.
    resume: bool = False


def run(
    path: Path,
    sizes: Sequence[int],
    settings: Settings,
    out: Path,
    on_mesh: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Run a predictor and write its result; return the result.

    Parameters
    ----------
    path : Path
        The predictor's file; its code is run.
    sizes : sequence of int
        Of :data:`scaling.SIZES`.
    settings : Settings
        How.
    out : Path
        Of the result, written anew after each mesh.
    on_mesh : callable, optional
        Called with the name of each mesh before it is made.

    Raises
    ------
    EigbenchError
        If a label is not pinned, there is a result already and ``resume`` is not set, or it was
        made by other code, on another machine or with other settings.
    PredictorError
        If the predictor does not load or fails on a small mesh; nothing is written then. Or if
        LaPy fails: the predictor's answer on that mesh is kept, and never has LaPy's time.
    """
    chosen = [surfaces.pinned(surface, size) for size in sizes for surface in surfaces.SURFACES]
    if out.exists() and not settings.resume:
        raise EigbenchError(f"{out} is there already: --resume adds what it lacks, or give another")
    result = _described(path, settings)
    asked = {(expected.surface, expected.size) for expected in chosen}
    done = _done(out, result, settings, asked) if out.exists() else {}
    with contextlib.ExitStack() as stack:
        peer: PredictorProcess | None = None
        for expected in chosen:
            if (expected.surface, expected.size) in done:
                continue
            on_mesh(expected.pin.id)
            mesh = surfaces.mesh(expected.surface, expected.size)
            surfaces.check(expected, mesh)
            entry, failure = _measured(path, expected, mesh, settings), None
            if expected.size <= surfaces.TIMED_BESIDE:
                try:
                    if peer is None:
                        lapy = PredictorProcess(REFERENCE_FILE, surfaces.K, ALONE)
                        peer = stack.enter_context(lapy)
                        peer.warm_up(1)
                    answers = _repeated(peer, expected.pin.id, mesh)
                    entry["reference_seconds"] = float(np.median([a.seconds for a in answers]))
                except PredictorError as error:
                    failure = error
            done[expected.surface, expected.size] = entry
            order = list(surfaces.SURFACES)
            keys = sorted(done, key=lambda key: (key[1], order.index(key[0])))
            result["meshes"] = [done[key] for key in keys]
            results.write(out, result, scaling_results.validate)
            if failure is not None:
                raise PredictorError(
                    f"LaPy, timed beside the predictor, failed ({failure}): --resume goes on with "
                    "the next mesh"
                ) from failure
    return result if "meshes" in result else scaling_results.read(out).result


def _described(path: Path, settings: Settings) -> dict[str, Any]:
    """Load the predictor once, and return a result without meshes."""
    with _process(path, settings) as process:
        process.warm_up(1)
        loaded, status = process.loaded, process.status()
    return {
        "scaling_version": scaling_results.VERSION,
        "model": record.model(path, loaded, status),
        "cost": {
            "threads": settings.threads,
            "device": settings.device,
            "hardware": machine.hardware(loaded.accelerator),
        },
        "environment": machine.environment(),
        **record.checkout(path),
    }


def _done(
    out: Path, result: dict[str, Any], settings: Settings, chosen: Set[tuple[str, int]]
) -> dict[tuple[str, int], dict[str, Any]]:
    """Return the meshes of an earlier run, without the chosen that broke a limit now higher."""
    earlier = scaling_results.read(out)
    for part in ("model", "cost", "environment"):
        before, now = earlier.result[part], result[part]
        for name in sorted(before.keys() | now.keys()):
            if before.get(name) != now.get(name):
                problem = f"was made with another {name} ({part})"
                raise EigbenchError(f"{out} {problem}: give another --out")
    again = {
        "over time": ("time_limit", settings.time_limit),
        "over memory": ("memory_limit_gib", settings.memory_limit),
    }

    def stays(mesh: dict[str, Any]) -> bool:
        name, limit = again.get(mesh["outcome"], ("time_limit", 0.0))
        return bool(mesh[name] >= limit)

    return {k: mesh for k, mesh in earlier.meshes.items() if k not in chosen or stays(mesh)}


def _measured(
    path: Path, expected: surfaces.Pinned, mesh: Mesh, settings: Settings
) -> dict[str, Any]:
    """Return what became of a mesh, ready for JSON."""
    entry: dict[str, Any] = {
        "surface": expected.surface,
        "size": expected.size,
        "digest": expected.pin.digest,
        "outcome": ANSWERED,
        "detail": "",
        "time_limit": settings.time_limit,
        "memory_limit_gib": settings.memory_limit,
        "eigenvalues": None,
        "seconds": [],
        "cpu_seconds": [],
        "peak_memory_mb": None,
        "counted_by": None,
        "reference_seconds": None,
    }
    try:
        with _process(path, settings) as process:
            process.warm_up(1)
            process.time_limit = settings.time_limit
            answers = _repeated(process, expected.pin.id, mesh)
            status = process.status()
    except PredictorError as error:
        detail = " ".join(str(error).split())[:300]
        return {**entry, "outcome": OUTCOMES.get(type(error), "failed"), "detail": detail}
    values = answers[0].values[0]
    if not (np.isfinite(values) & (values > 0)).all():
        return {**entry, "outcome": "failed", "detail": "the answer is not finite and positive"}
    return {
        **entry,
        "eigenvalues": values.tolist(),
        "seconds": [a.seconds for a in answers],
        "cpu_seconds": [a.cpu_seconds for a in answers],
        "peak_memory_mb": status.peak_bytes / 2**20,
        "counted_by": status.counted_by,
    }


def _repeated(process: PredictorProcess, id: str, mesh: Mesh) -> list[Answered]:
    answers: list[Answered] = []
    while len(answers) < REPEATS and sum(a.seconds for a in answers) < ENOUGH:
        answers.append(process.predict([id], [mesh]))
    return answers


def _process(path: Path, settings: Settings) -> PredictorProcess:
    """Return the predictor's process, its time not limited to that of a mesh yet."""
    patient = replace(settings, time_limit=max(settings.time_limit, LOADING))
    return PredictorProcess(path, surfaces.K, patient, training=TRAINING)
