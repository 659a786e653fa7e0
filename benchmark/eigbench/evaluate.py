"""Run a predictor over a split, and keep what it answered."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import PredictorError
from eigbench.meshes import Instances
from eigbench.process import PredictorProcess
from eigbench.truth import Truth
from eigbench.worker import Answered, Loaded, Status
from synthnet import files
from synthnet.types import Mesh

WARM_UP = 16  # meshes predicted before the clock counts
SOURCES = "sources.json"  # of a run that has begun: digests of the predictor's files


@dataclass(frozen=True, slots=True)
class Options:
    """How to run a predictor.

    Parameters
    ----------
    device : str
        Handed to the predictor.
    batch_size : int
        Meshes in one call.
    seeds : int
        Runs, with seeds 0, 1, ...
    threads : int
        Threads of BLAS and OpenMP in the predictor's process.
    time_limit : float
        Most seconds for one batch.
    resume : bool
        Go on from the batches that an interrupted run has left.
    """

    device: str = "cpu"
    batch_size: int = 200
    seeds: int = 1
    threads: int = 1
    time_limit: float = 3600.0
    resume: bool = False


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What a predictor answered, and at what cost.

    Parameters
    ----------
    predictions : ndarray of shape (seeds, n, k), float64
        In the order of the truth's ids, in 1/length².
    seconds, cpu_seconds, sizes : ndarray of shape (batches,)
        Wall and CPU seconds, and meshes, of every batch of every seed.
    loaded : Loaded
        META and parameters of the predictor.
    status : Status
        Peak memory of its process and digests of its files.
    """

    predictions: NDArray[np.float64]
    seconds: NDArray[np.float64]
    cpu_seconds: NDArray[np.float64]
    sizes: NDArray[np.int64]
    loaded: Loaded
    status: Status


def evaluate(
    path: Path,
    truth: Truth,
    instances: Instances,
    options: Options,
    parts: Path,
    on_batch: Callable[[int], None] | None = None,
    on_restart: Callable[[], None] | None = None,
) -> Evaluation:
    """Run a predictor over the instances of a split, in the order of :attr:`Truth.order`.

    Parameters
    ----------
    path : Path
        The predictor's file; its code is run.
    truth : Truth
        What to predict.
    instances : Instances
        The meshes.
    options : Options
        How.
    parts : Path
        Directory that keeps each batch's answer until the whole is done.
    on_batch : callable, optional
        Called with the number of meshes of each batch that is done.
    on_restart : callable, optional
        Called if answers were left to go on from, but not by this code and these options.

    Raises
    ------
    PredictorError
        If the predictor fails, answers with the wrong shape or type, changes its input,
        hangs or dies. The batches before are kept in ``parts``.
    """
    runs = []
    for seed in range(options.seeds):
        place = parts / f"seed-{seed}"
        left = place.exists() and options.resume
        same = _open_parts(place, _fingerprint(path, truth, options, seed), path, options.resume)
        if left and not same and on_restart is not None:
            on_restart()
        runs.append(_run(path, truth, instances, options, seed, place, on_batch))
    saved = [part for run in runs for part in run.parts]
    predictions = np.empty((len(runs), *truth.eigenvalues.shape))
    for seed, run in enumerate(runs):
        predictions[seed, truth.order] = np.concatenate([part.values for part in run.parts])
    return Evaluation(
        predictions=predictions,
        seconds=np.array([part.seconds for part in saved]),
        cpu_seconds=np.array([part.cpu_seconds for part in saved]),
        sizes=np.array([len(part.values) for part in saved]),
        loaded=runs[0].loaded,
        status=Status(max(r.status.peak_bytes for r in runs), runs[0].status.sources),
    )


def predict_meshes(
    path: Path, ids: Sequence[str], given: Sequence[Mesh], k: int, options: Options
) -> NDArray[np.float64]:
    """Return the answers, (n, k), for given meshes; as :func:`evaluate`, without keeping them."""
    with _process(path, k, options, 0) as process:
        answers = [
            process.predict(ids[first:last], given[first:last]).values
            for first, last in _batches(len(ids), options.batch_size)
        ]
    return np.concatenate(answers)


@dataclass(frozen=True, slots=True)
class _Run:
    parts: list[Answered]
    loaded: Loaded
    status: Status


def _run(
    path: Path,
    truth: Truth,
    instances: Instances,
    options: Options,
    seed: int,
    place: Path,
    on_batch: Callable[[int], None] | None,
) -> _Run:
    parts = _read_parts(place)
    done = sum(len(part.values) for part in parts)
    if on_batch is not None and done:
        on_batch(done)
    ids = [truth.ids[i] for i in truth.order]
    with _process(path, truth.eigenvalues.shape[1], options, seed) as process:
        if options.seeds > 1 and not process.loaded.seeded:
            raise PredictorError(
                f"{path} takes no seed: define load(device, seed), or leave --seeds out"
            )
        warm = ids[: min(WARM_UP, options.batch_size)]
        process.predict(warm, [instances.mesh(id) for id in warm])
        files.write_text(place / SOURCES, json.dumps(process.status().sources))
        for first, last in _batches(len(ids), options.batch_size, done):
            batch = ids[first:last]
            answered = process.predict(batch, [instances.mesh(id) for id in batch])
            _write_part(place, len(parts), answered)
            parts.append(answered)
            if on_batch is not None:
                on_batch(len(batch))
        return _Run(parts, process.loaded, process.status())


def _process(path: Path, k: int, options: Options, seed: int) -> PredictorProcess:
    return PredictorProcess(
        path,
        k,
        device=options.device,
        seed=seed,
        threads=options.threads,
        time_limit=options.time_limit,
    )


def _batches(count: int, size: int, done: int = 0) -> list[tuple[int, int]]:
    return [(first, min(first + size, count)) for first in range(done, count, size)]


# The answers of an interrupted run


def _fingerprint(path: Path, truth: Truth, options: Options, seed: int) -> dict[str, object]:
    return {
        "predictor": path.name,
        "truth": truth.digest,
        "batch_size": options.batch_size,
        "device": options.device,
        "threads": options.threads,
        "seed": seed,
    }


def _open_parts(place: Path, fingerprint: dict[str, object], path: Path, resume: bool) -> bool:
    """Make the directory of parts; return whether what it holds is to be gone on from."""
    note = place / "run.json"
    same = resume and note.exists() and json.loads(note.read_text()) == fingerprint
    same = same and _unchanged(place / SOURCES, path.resolve().parent)
    if not same:
        shutil.rmtree(place, ignore_errors=True)
        files.make_directory(place)
        files.write_text(note, json.dumps(fingerprint))
    return same


def _unchanged(note: Path, root: Path) -> bool:
    """Whether the code of an earlier run is still what it was."""
    if not note.exists():
        return False  # it did not come as far as the first batch
    return all(
        (root / name).is_file() and files.sha256(root / name) == digest
        for name, digest in json.loads(note.read_text()).items()
    )


def _read_parts(place: Path) -> list[Answered]:
    parts = []
    for path in sorted(place.glob("*.npz")):
        with np.load(path, allow_pickle=False) as part:
            parts.append(
                Answered(part["values"], float(part["seconds"]), float(part["cpu_seconds"]))
            )
    return parts


def _write_part(place: Path, number: int, answered: Answered) -> None:
    def write(to: Path) -> None:
        with to.open("wb") as file:
            np.savez(
                file,
                values=answered.values,
                seconds=answered.seconds,
                cpu_seconds=answered.cpu_seconds,
            )

    files.write_atomically(place / f"{number:06d}.npz", write)
