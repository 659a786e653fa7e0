"""The process in which a predictor runs.

It is given meshes and nothing else: ids, labels and the dataset stay in the other process.
"""

from __future__ import annotations

import os
import resource
import signal
import sys
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import PredictorError
from eigbench.running import predictor
from synthnet.types import Mesh


@dataclass(frozen=True, slots=True)
class Job:
    """Which predictor to load, and how: its file, device, seed and training; k eigenvalues."""

    path: Path
    device: str
    seed: int
    training: str
    k: int


@dataclass(frozen=True, slots=True)
class Loaded:
    """The predictor is loaded.

    Its META, its parameters, whether it takes a seed and the name of its training set, and the
    name of the accelerator.
    """

    meta: dict[str, str]
    parameters: int | None
    seeded: bool
    trained: bool
    accelerator: str


@dataclass(frozen=True, slots=True)
class Answered:
    """A batch has been answered: (B, k) values, and the wall and CPU seconds it took."""

    values: NDArray[np.float64]
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True, slots=True)
class Status:
    """Peak memory of this process so far, in bytes, and digests of the predictor's files."""

    peak_bytes: int
    sources: dict[str, str]


@dataclass(frozen=True, slots=True)
class Failed:
    """The predictor is at fault; message and traceback are for its author."""

    message: str
    traceback: str


def work(channel: Connection, job: Job) -> None:
    """Load the predictor, then answer each batch of meshes that comes; ``None`` asks for status.

    What the predictor prints goes to standard error.
    """
    os.dup2(2, 1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the other process, which ends this
    try:
        accelerator = _accelerator(job.device)
        loaded = predictor.load(job.path, device=job.device, seed=job.seed, training=job.training)
        facts = (loaded.meta, loaded.parameters, loaded.seeded, loaded.trained)
        channel.send(Loaded(*facts, accelerator))
        while True:
            meshes = channel.recv()
            if meshes is None:
                channel.send(Status(_peak_bytes(), predictor.sources(job.path, loaded.roots)))
            else:
                channel.send(_answer(loaded, meshes, job))
    except PredictorError as error:
        channel.send(Failed(str(error), "".join(traceback.format_exception(error))))
    except EOFError:
        pass  # the other side has what it wants
    finally:
        channel.close()


def _answer(loaded: predictor.Predictor, given: Sequence[Mesh], job: Job) -> Answered:
    """Predict one batch.

    The clock runs from raw vertices and faces to eigenvalues in memory, and over nothing else.
    """
    meshes = list(given)
    for mesh in meshes:  # what came through the pipe can be written to
        mesh.vertices.flags.writeable = mesh.faces.flags.writeable = False
    before = [(mesh.vertices.sum(), mesh.faces.sum()) for mesh in meshes]
    cpu, started = _cpu_seconds(), time.perf_counter()
    try:
        answer = predictor.as_array(loaded.predict(meshes))
        seconds, cpu = time.perf_counter() - started, _cpu_seconds() - cpu
    except PredictorError:
        raise
    except (Exception, SystemExit) as error:
        file, _ = predictor.split(job.path)
        described = predictor.described(error, file)
        hint = "; meshes are read-only: copy what you change" if "read-only" in str(error) else ""
        raise PredictorError(f"the predictor failed: {described}{hint}") from error
    if before != [(mesh.vertices.sum(), mesh.faces.sum()) for mesh in meshes]:
        raise PredictorError(
            "the predictor changes its input: copy vertices and faces before writing to them"
        )
    return Answered(predictor.checked(answer, len(meshes), job.k), seconds, cpu)


def _cpu_seconds() -> float:
    """Return the CPU time of this process and of the children it has waited for.

    Not by os.times, whose clock ticks a hundred times a second.
    """
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def _accelerator(device: str) -> str:
    if not device.startswith("cuda"):
        return ""
    try:
        import torch
    except ModuleNotFoundError:
        return ""  # another framework's device
    if not torch.cuda.is_available():
        raise PredictorError(f"--device {device}: PyTorch sees no CUDA device here, leave it out")
    return str(torch.cuda.get_device_name(device))


def _peak_bytes() -> int:
    status = Path("/proc/self/status")
    if status.exists():  # getrusage's peak has that of the process which started this one
        lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return 1024 * int(lines["VmHWM"].split()[0])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else 1024 * peak
