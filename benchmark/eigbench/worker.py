"""The process in which a predictor runs: it streams meshes and sends answers back."""

from __future__ import annotations

import os
import resource
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigbench import predictor
from eigbench.errors import EigbenchError, PredictorError
from eigbench.meshes import instances, view
from synthnet import store
from synthnet.errors import SynthNetError
from synthnet.types import Mesh

WARM_UP = 16  # meshes predicted before the clock counts


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker is to do.

    Parameters
    ----------
    path : Path
        The predictor's file.
    source : StoredDataset or tuple of Mesh
        Where the meshes are, or the meshes themselves.
    ids : tuple of str
        Their ids, in order.
    skip : int
        How many of the first are done already.
    batch_size, seed : int
        As given by the user.
    device : str
        As given by the user.
    k : int
        Number of eigenvalues.
    """

    path: Path
    source: store.StoredDataset | tuple[Mesh, ...]
    ids: tuple[str, ...]
    skip: int
    batch_size: int
    seed: int
    device: str
    k: int


@dataclass(frozen=True, slots=True)
class Ready:
    """The predictor is loaded."""

    meta: dict[str, str]
    parameters: int | None


@dataclass(frozen=True, slots=True)
class Begun:
    """A batch has been handed to the predictor."""

    ids: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Answered:
    """A batch has been answered: (B, k) values and the seconds it took."""

    values: NDArray[np.float64]
    seconds: float


@dataclass(frozen=True, slots=True)
class Failed:
    """The predictor is at fault; the message is for its author."""

    message: str


@dataclass(frozen=True, slots=True)
class Done:
    """All is predicted; peak memory of this process in bytes."""

    peak_bytes: int


def work(channel: Connection, job: Job) -> None:
    """Load the predictor and predict the job's meshes batch by batch.

    The clock runs from raw vertices and faces to the answer, and over nothing else.
    What the predictor prints goes to standard error.
    """
    os.dup2(2, 1)
    try:
        loaded = predictor.load(job.path, device=job.device, seed=job.seed)
        channel.send(Ready(loaded.meta, loaded.parameters))
        warm = [mesh for _, mesh in islice(_stream(job, 0), min(WARM_UP, job.batch_size))]
        channel.send(Begun(job.ids[: len(warm)]))
        _predict(loaded, warm, job.ids[: len(warm)], job.k)
        for ids, meshes in _batches(job):
            channel.send(Begun(ids))
            values, seconds = _predict(loaded, meshes, ids, job.k)
            channel.send(Answered(values, seconds))
        channel.send(Done(_peak_bytes()))
    except (EigbenchError, SynthNetError) as error:
        channel.send(Failed(str(error)))
    finally:
        channel.close()


def _predict(
    loaded: predictor.Predictor, meshes: list[Mesh], ids: tuple[str, ...], k: int
) -> tuple[NDArray[np.float64], float]:
    before = [(mesh.vertices.sum(), mesh.faces.sum()) for mesh in meshes]
    started = time.perf_counter()
    try:
        answer = loaded.predict(meshes)
        seconds = time.perf_counter() - started
    except (Exception, SystemExit) as error:
        told = " ".join(f"{type(error).__name__}: {error}".split())
        hint = " (meshes are read-only: copy what you change)" if "read-only" in told else ""
        raise PredictorError(
            f"the predictor failed on the batch of {len(ids)} that begins with "
            f"{', '.join(ids[:3])}: {told}{hint}"
        ) from error
    after = [(mesh.vertices.sum(), mesh.faces.sum()) for mesh in meshes]
    if before != after:
        raise PredictorError(
            f"the predictor changes its input (first ids: {', '.join(ids[:3])}): "
            "copy vertices and faces before writing to them"
        )
    return predictor.checked(answer, ids, k), seconds


def _batches(job: Job) -> Iterator[tuple[tuple[str, ...], list[Mesh]]]:
    stream = _stream(job, job.skip)
    while batch := list(islice(stream, job.batch_size)):
        yield tuple(id for id, _ in batch), [mesh for _, mesh in batch]


def _stream(job: Job, skip: int) -> Iterator[tuple[str, Mesh]]:
    if isinstance(job.source, store.StoredDataset):
        return instances(job.source, job.ids, skip)
    return zip(job.ids[skip:], map(view, job.source[skip:]), strict=True)


def _peak_bytes() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
