"""Reading mesh files from any source, in a process of its own.

A truncated or altered file may ask for all memory or take for ever. None of that reaches the
process that asks.
"""

import hashlib
import json
import math
import multiprocessing
import resource
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Self

import numpy as np

from synthnet.errors import MissingPackageError, SynthNetError
from synthnet.mesh import formats
from synthnet.mesh.formats import Triangles, UnreadableError, kind_of, no_mesh
from synthnet.processes import WorkerContext

SECONDS, GIGABYTES = 120.0, 8.0
PATIENCE = 10 * SECONDS  # by the clock, for a disk that hangs: processor time does not pass then


class ChangedError(SynthNetError):
    """A file whose bytes are not those that were to be read."""


class Reader:
    """Reads mesh files; a context manager. The process starts with the first file.

    Parameters
    ----------
    seconds : float
        Most processor time for a file; it does not depend on what else the machine does.
    gigabytes : float
        Most memory of the process that reads.

    Examples
    --------
    ::

        with Reader() as reader:
            triangles = reader.triangles(Path("bunny.obj"))
    """

    def __init__(self, seconds: float = SECONDS, gigabytes: float = GIGABYTES) -> None:
        self.seconds, self.gigabytes = seconds, gigabytes
        self._process: multiprocessing.process.BaseProcess | None = None
        self._channel: Connection

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._end()

    def triangles(self, path: Path, sha256: str | None = None) -> Triangles:
        """Return the triangles of a file as they stand in it, polygons cut into triangles.

        They are float64 vertices and int64 faces, with the number of polygons that were not convex,
        and may be anything but a surface. A process that dies is no proof against the file: it may
        have died before, or for want of memory elsewhere. So a second process tries once more.

        Raise UnreadableError if it cannot be read; later files can be. Raise ChangedError if its
        bytes are not those of ``sha256``.
        """
        if kind_of(path.name) is None:
            raise UnreadableError(no_mesh(path.name))
        request = json.dumps([str(path), sha256]).encode()
        for _ in range(2):
            if self._process is None:
                self._process, self._channel = self._started()
            try:
                return self._ask(request)
            except (EOFError, OSError) as error:
                if self._end() == -signal.SIGXCPU:
                    raise UnreadableError(
                        f"not read within {self.seconds:g} s of processor time"
                    ) from error
        raise UnreadableError("the process that reads it died twice")

    def _ask(self, request: bytes) -> Triangles:
        self._channel.send_bytes(request)
        if not self._channel.poll(PATIENCE):
            self._end()
            raise UnreadableError(f"not read within {PATIENCE:g} s")
        answer = json.loads(self._channel.recv_bytes())
        if "changed" in answer:
            raise ChangedError(answer["changed"])
        if "unreadable" in answer:
            raise UnreadableError(answer["unreadable"])
        vertices = np.frombuffer(self._channel.recv_bytes(), np.float64)
        faces = np.frombuffer(self._channel.recv_bytes(), np.int64)
        return Triangles(vertices.reshape(-1, 3), faces.reshape(-1, 3), answer["clipped"])

    def _started(self) -> tuple[multiprocessing.process.BaseProcess, Connection]:
        """Return a process that has started, and the channel to it."""
        context = WorkerContext()
        channel, other = context.Pipe()
        with other:
            arguments = other, self.seconds, self.gigabytes
            process = context.Process(target=_serve, args=arguments, daemon=True)
            try:
                process.start()
            except OSError:  # the machine has no memory or no number left for one
                channel.close()
                raise
        return process, channel

    def _end(self) -> int | None:
        """End the process and return its exit code; it may have ended before."""
        if self._process is None:
            return None
        process, self._process = self._process, None
        self._channel.close()
        process.kill()
        process.join()
        return process.exitcode


def _serve(channel: Connection, seconds: float, gigabytes: float) -> None:
    """Answer each request, until there is nobody to ask."""
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_AS, round(gigabytes * 2**30))
    while True:
        try:
            request = channel.recv_bytes()
        except EOFError:
            return
        _limit(resource.RLIMIT_CPU, math.ceil(time.process_time() + seconds))
        path, sha256 = json.loads(request)
        _send(channel, *_answer(path, sha256, gigabytes))


def _limit(kind: int, most: int) -> None:
    """Limit this process, but to no more than whoever started it allows."""
    hard = resource.getrlimit(kind)[1]
    resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def _answer(
    path: str, sha256: str | None, gigabytes: float
) -> tuple[dict[str, Any], Triangles | None]:
    """Return why a file's triangles cannot be had, or nothing and the triangles."""
    try:
        content = Path(path).read_bytes()
        if sha256 is not None and hashlib.sha256(content).hexdigest() != sha256:
            return {"changed": "its bytes are others than when the import began"}, None
        triangles = formats.read(content, kind_of(Path(path).name) or "")
    except OSError as error:
        return {"unreadable": f"cannot be opened ({error.strerror})"}, None
    except (UnreadableError, MissingPackageError) as error:
        return {"unreadable": str(error)}, None
    except MemoryError:
        return {"unreadable": f"needs more than {gigabytes:g} GB of memory"}, None
    return {"clipped": triangles.clipped}, triangles


def _send(channel: Connection, answer: dict[str, Any], triangles: Triangles | None) -> None:
    channel.send_bytes(json.dumps(answer).encode())
    for values in () if triangles is None else (triangles.vertices, triangles.faces):
        channel.send_bytes(np.ascontiguousarray(values).data.cast("B"))
