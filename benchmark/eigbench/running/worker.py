"""The process in which a predictor runs.

It is given meshes and nothing else: ids, labels and the dataset stay in the other process.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import PredictorError
from eigbench.running import frames, predictor
from synthnet.processes import keep_freed_memory
from synthnet.types import Mesh

LONGEST, LONGEST_PATH = 10_000, 900  # letters of a message, and of a path
LONGEST_TRACE = 100_000  # letters of a traceback; each is up to twelve bytes of a frame
MOST_ATTEMPTS = 1000
# What NumPy and dataclasses say to who changes a mesh, or adds to it
CHANGES = (
    *("read-only", "cannot assign to field 'vertices'", "cannot assign to field 'faces'"),
    "super(type, obj): obj must be an instance or subtype of type",
)
FRAMEWORKS = ("torch", "jax", "tensorflow", "cupy", "mlx", "paddle")  # of other devices
OF_ONE = tuple(f"'tuple' object has no attribute '{name}'" for name in ("vertices", "faces"))
FACTS = ("meta", "parameters", "seeded", "trained")  # of a predictor that is loaded
# Python's audit events: what becomes of each name, the number of the argument that has it, and of
# the one that is a folder's descriptor, or -1: the name is relative to that folder
WATCHED: dict[str, tuple[tuple[str, int, int | None], ...]] = {
    **dict.fromkeys(("open", "os.listdir", "os.scandir"), (("read", 0, None),)),
    **dict.fromkeys(("os.remove", "os.rmdir"), (("write", 0, 1),)),
    "os.mkdir": (("write", 0, 2),),
    "os.truncate": (("write", 0, None),),
    "os.rename": (("write", 0, 2), ("write", 1, 3)),
    "os.link": (("read", 0, 2), ("write", 1, 3)),
    "os.symlink": (("write", 1, 2),),
    "socket.connect": (("connect", 1, None),),
    "socket.getaddrinfo": (("connect", 0, None),),
}


@dataclass(frozen=True, slots=True)
class Job:
    """Which predictor to load, and how: its file, device, seed and training; k eigenvalues.

    ``watched``: whether to note what it tries to reach.
    """

    path: str
    device: str
    seed: int
    training: str
    k: int
    watched: bool = False


def work(descriptor: int) -> None:
    """Load the predictor that a socket names, then answer each batch of meshes that comes.

    What the predictor prints goes to standard error.
    """
    os.dup2(2, 1)
    keep_freed_memory()  # LaPy and all others gain by it as our own solver does
    with frames.Channel(socket.socket(fileno=descriptor)) as channel:
        try:
            _, body, _ = channel.receive()
            job = Job(**json.loads(body))
            accelerator = _accelerator(job.device)
            attempts = _attempts() if job.watched else {}
            loaded = predictor.load(
                Path(job.path), device=job.device, seed=job.seed, training=job.training
            )
            facts = {name: getattr(loaded, name) for name in FACTS}
            _tell(channel, frames.LOADED, {**facts, "accelerator": accelerator})
            while True:
                kind, body, file = channel.receive()
                if kind == frames.CLOSING:
                    files = predictor.sources(Path(job.path), loaded.roots)
                    _tell(channel, frames.SOURCES, {"files": files, "attempts": list(attempts)})
                else:
                    assert file is not None
                    answer = _answer(loaded, frames.unpacked(body, file), job)
                    channel.send(frames.ANSWER, answer.astype("<f8").tobytes())
        except PredictorError as error:
            _tell(channel, frames.FAILED, _failure(error))
        except (EOFError, ConnectionError):
            pass  # the other side has what it wants


def _tell(channel: frames.Channel, kind: bytes, facts: dict[str, Any]) -> None:
    channel.send(kind, json.dumps(facts).encode())


def _failure(error: PredictorError) -> dict[str, Any]:
    """Return what a failure says, cut to what a frame may hold. The predictor may have made it."""
    try:
        message, trace = str(error), "".join(traceback.format_exception(error))
    except BaseException as another:  # noqa: BLE001 - its author's code
        name = type(another).__name__
        message, trace = f"{type(error).__name__}: its message cannot be read: {name}", ""
    if len(trace) > LONGEST_TRACE:
        trace = f"{trace[:LONGEST_TRACE]} …"
    return {"message": message[:LONGEST], "traceback": trace}


def _attempts() -> dict[str, None]:
    """From now on note what Python opens, changes and connects to, whether it succeeds or not.

    Python tells of each before it happens. Code that does not want to be seen can go without it:
    the sandbox holds all the same.
    """
    noted: dict[str, None] = {}

    def look(event: str, arguments: tuple[Any, ...]) -> None:
        for what, number, folder in WATCHED.get(event, ()):
            if folder is not None and arguments[folder] != -1:
                continue
            if event == "open" and (set("wax+") & set(arguments[1] or "") or _writes(arguments[2])):
                what = "write"
            note(what, arguments[number])

    def note(what: str, where: Any) -> None:
        if len(noted) >= MOST_ATTEMPTS:
            return
        if what == "connect":
            where = str(where)
        elif isinstance(where, str | bytes | os.PathLike):
            where = os.path.abspath(os.fsdecode(where))  # noqa: PTH100  # it follows no link
        else:
            return  # a descriptor
        if where.isprintable() and len(where) <= LONGEST_PATH:
            noted[f"{what} {where}"] = None

    sys.addaudithook(look)
    return noted


def _writes(flags: Any) -> bool:
    return isinstance(flags, int) and bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))


def _answer(loaded: predictor.Predictor, meshes: Sequence[Mesh], job: Job) -> NDArray[np.float64]:
    """Predict one batch; what comes of it is an array in memory."""
    try:
        answer = predictor.as_array(loaded.predict(meshes))
    except PredictorError:
        raise
    except BaseException as error:  # the harness ends it otherwise
        file, _ = predictor.split(Path(job.path))
        described = predictor.described(error, file)
        hint = ""
        if any(text in described for text in CHANGES):
            hint = "; meshes are read-only: copy what you change"
        elif any(text in described for text in OF_ONE):
            hint = "; predict gets a sequence of meshes, and answers a row for each"
        raise PredictorError(f"the predictor failed: {described}{hint}") from error
    _check_device(job.device)
    return predictor.checked(answer, len(meshes), job.k)


def _check_device(device: str) -> None:
    """Check that a predictor that has answered can have used a device; of cuda PyTorch says it."""
    kind = device.partition(":")[0]
    if kind not in ("cpu", "cuda") and not any(name in sys.modules for name in FRAMEWORKS):
        raise PredictorError(
            f"--device {device}: the predictor has loaded none of {', '.join(FRAMEWORKS)}, so it "
            "computes on the cpu: leave it out"
        )


def _accelerator(device: str) -> str:
    if not device.startswith("cuda"):
        return ""
    try:
        import torch
    except ModuleNotFoundError:
        return ""  # another framework's device
    if not torch.cuda.is_available():
        raise PredictorError(f"--device {device}: PyTorch sees no CUDA device here, leave it out")
    number, count = device.partition(":")[2], torch.cuda.device_count()
    if number and int(number) >= count:
        last = "" if count == 1 else f" to cuda:{count - 1}"
        raise PredictorError(f"--device {device}: PyTorch sees cuda:0{last} here")
    return str(torch.cuda.get_device_name(device))
