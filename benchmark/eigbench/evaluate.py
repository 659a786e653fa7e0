"""Run a predictor over a split in a process of its own, and keep what it answered."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import PredictorError
from eigbench.truth import Truth
from eigbench.worker import Answered, Begun, Done, Failed, Job, Ready, work
from synthnet import files, store
from synthnet.types import Mesh

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


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
    seconds, sizes : ndarray of shape (batches,)
        Seconds and meshes of every batch of every seed.
    peak_bytes : int
        Peak memory of the predictor's process.
    meta : dict of str to str
        Of the predictor.
    parameters : int or None
        Of a torch module.
    """

    predictions: NDArray[np.float64]
    seconds: NDArray[np.float64]
    sizes: NDArray[np.int64]
    peak_bytes: int
    meta: dict[str, str]
    parameters: int | None


def evaluate(
    path: Path,
    truth: Truth,
    dataset: store.StoredDataset,
    options: Options,
    parts: Path,
    on_batch: Callable[[int], None] | None = None,
) -> Evaluation:
    """Run a predictor over the instances of a split.

    Parameters
    ----------
    path : Path
        The predictor's file; its code is run.
    truth : Truth
        What to predict.
    dataset : StoredDataset
        Where the meshes are.
    options : Options
        How.
    parts : Path
        Directory that keeps each batch's answer until the whole is done.
    on_batch : callable, optional
        Called with the number of meshes of each batch that is done.

    Raises
    ------
    PredictorError
        If the predictor fails, answers with the wrong shape or type, changes its input,
        hangs or dies. The batches before are kept in ``parts``.
    """
    runs = []
    for seed in range(options.seeds):
        place = parts / f"seed-{seed}"
        _open_parts(place, _fingerprint(path, truth, options, seed), options.resume)
        runs.append(_run(path, truth, dataset, options, seed, place, on_batch))
    saved = [part for run in runs for part in run.parts]
    return Evaluation(
        predictions=np.stack([np.concatenate([values for values, _ in r.parts]) for r in runs]),
        seconds=np.array([seconds for _, seconds in saved]),
        sizes=np.array([len(values) for values, _ in saved]),
        peak_bytes=max(run.peak_bytes for run in runs),
        meta=runs[0].meta,
        parameters=runs[0].parameters,
    )


@dataclass(frozen=True, slots=True)
class _Run:
    parts: list[tuple[NDArray[np.float64], float]]
    peak_bytes: int
    meta: dict[str, str]
    parameters: int | None


def _run(
    path: Path,
    truth: Truth,
    dataset: store.StoredDataset,
    options: Options,
    seed: int,
    place: Path,
    on_batch: Callable[[int], None] | None,
) -> _Run:
    parts = _read_parts(place)
    done = sum(len(values) for values, _ in parts)
    if on_batch is not None and done:
        on_batch(done)
    k = truth.eigenvalues.shape[1]
    job = Job(path, dataset, truth.ids, done, options.batch_size, seed, options.device, k)
    ready, peak = None, 0
    for message in _messages(job, options):
        match message:
            case Ready():
                ready = message
            case Answered(values, seconds):
                _write_part(place, len(parts), values, seconds)
                parts.append((values, seconds))
                if on_batch is not None:
                    on_batch(len(values))
            case Done(peak_bytes):
                peak = peak_bytes
    if ready is None:
        raise PredictorError("the predictor's process ended before it was loaded")
    return _Run(parts, peak, ready.meta, ready.parameters)


def predict_meshes(
    path: Path, ids: tuple[str, ...], meshes: tuple[Mesh, ...], k: int, options: Options
) -> NDArray[np.float64]:
    """Return the answers, (n, k), for given meshes; as :func:`evaluate`, without keeping them."""
    job = Job(path, meshes, ids, 0, options.batch_size, 0, options.device, k)
    answers = [m.values for m in _messages(job, options) if isinstance(m, Answered)]
    return np.concatenate(answers)


def _messages(job: Job, options: Options) -> Iterator[Ready | Answered | Done]:
    """Yield a worker's messages; end it when it fails, hangs or dies."""
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=work, args=(sender, job), daemon=False)
    with _threads(options.threads):
        process.start()
    sender.close()
    at = "while loading"
    try:
        while True:
            if not receiver.poll(options.time_limit):
                raise PredictorError(
                    f"the predictor took more than {options.time_limit:g} s {at}: "
                    "raise --time-limit or lower --batch-size"
                )
            try:
                message = receiver.recv()
            except EOFError:
                process.join()
                raise PredictorError(
                    f"the predictor's process died {at} (exit code {process.exitcode}; "
                    "-9 is often lack of memory)"
                ) from None
            match message:
                case Failed(told):
                    raise PredictorError(told)
                case Begun(ids):
                    at = f"on the batch of {len(ids)} that begins with {', '.join(ids[:3])}"
                case Done():
                    yield message
                    return
                case _:
                    yield message
    finally:
        receiver.close()
        process.terminate()
        process.join(5)
        if process.is_alive():
            process.kill()
            process.join()


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let a process started here use ``count`` threads: libraries read this when loaded."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


# The answers of an interrupted run


def _fingerprint(path: Path, truth: Truth, options: Options, seed: int) -> dict[str, object]:
    code = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
    return {
        "predictor": code,
        "truth": truth.digest,
        "batch_size": options.batch_size,
        "device": options.device,
        "threads": options.threads,
        "seed": seed,
    }


def _open_parts(place: Path, fingerprint: dict[str, object], resume: bool) -> None:
    note = place / "run.json"
    same = resume and note.exists() and json.loads(note.read_text()) == fingerprint
    if not same:
        shutil.rmtree(place, ignore_errors=True)
        files.make_directory(place)
        files.write_text(note, json.dumps(fingerprint))


def _read_parts(place: Path) -> list[tuple[NDArray[np.float64], float]]:
    parts = []
    for path in sorted(place.glob("*.npz")):
        with np.load(path, allow_pickle=False) as part:
            parts.append((part["values"], float(part["seconds"])))
    return parts


def _write_part(place: Path, number: int, values: NDArray[np.float64], seconds: float) -> None:
    def write(to: Path) -> None:
        with to.open("wb") as file:
            np.savez(file, values=values, seconds=seconds)

    files.write_atomically(place / f"{number:06d}.npz", write)
