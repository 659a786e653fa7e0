"""Reading mesh files of strangers: OBJ, OFF, PLY and STL, by trimesh in a process of its own.

A truncated or altered file may make a parser raise anything, ask for all memory or never come
back. None of that reaches the process that asks.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import signal
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from synthnet.errors import SynthNetError
from synthnet.files import one_line
from synthnet.types import Mesh

SUFFIXES = (".obj", ".off", ".ply", ".stl")
SECONDS, GIGABYTES = 120.0, 8.0


class UnreadableError(SynthNetError):
    """A file that is no mesh, or that the parser cannot read within its limits."""


@dataclass(frozen=True, slots=True)
class _Failed:
    message: str


class Reader:
    """Reads mesh files; a context manager.

    Parameters
    ----------
    seconds : float
        Most time for a file.
    gigabytes : float
        Most memory of the process that reads.

    Examples
    --------
    ::

        with Reader() as reader:
            mesh = reader.read(Path("bunny.obj"))
    """

    def __init__(self, seconds: float = SECONDS, gigabytes: float = GIGABYTES) -> None:
        self.seconds, self.gigabytes = seconds, gigabytes
        self._process: multiprocessing.process.BaseProcess | None = None
        self._channel: Connection

    def __enter__(self) -> Self:
        """Return the reader; the process starts with the first file."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the process."""
        self._end()

    def read(self, path: Path) -> Mesh:
        """Return the triangles of a file as they stand in it, polygons cut into triangles.

        Returns
        -------
        Mesh
            float64 vertices and int64 faces; it may be anything but a surface.

        Raises
        ------
        UnreadableError
            If it cannot be read; later files can be.
        """
        if path.suffix.lower() not in SUFFIXES:
            raise UnreadableError(f"{path.name} is none of {', '.join(SUFFIXES)}")
        if self._process is None:
            self._begin()
        try:
            self._channel.send(path)
            if not self._channel.poll(self.seconds):
                self._end()
                raise UnreadableError(f"not read within {self.seconds:g} s")
            answer = self._channel.recv()
        except (EOFError, OSError):
            self._end()
            raise UnreadableError("the parser crashed") from None
        if isinstance(answer, _Failed):
            raise UnreadableError(answer.message)
        vertices, faces = answer
        if not len(faces):
            raise UnreadableError("it holds no triangles, or is cut off")
        try:
            return Mesh(vertices, faces)
        except ValueError as error:
            raise UnreadableError(str(error)) from error

    def _begin(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._channel, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other, self.gigabytes), daemon=True)
        self._process.start()
        other.close()

    def _end(self) -> None:
        if self._process is None:
            return
        self._channel.close()
        self._process.kill()
        self._process.join()
        self._process = None


def _serve(channel: Connection, gigabytes: float) -> None:
    """Answer each path with vertices and faces, or with why there are none."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the other process
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for descriptor in (1, 2):  # parsers print
        os.dup2(nowhere, descriptor)
    import trimesh

    limit = round(gigabytes * 2**30)
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    while True:
        try:
            path = channel.recv()
        except EOFError:
            return
        try:
            mesh = trimesh.load(
                path, file_type=path.suffix[1:].lower(), force="mesh", process=False
            )
            answer = (
                np.array(mesh.vertices, np.float64).reshape(-1, 3),
                np.array(mesh.faces, np.int64).reshape(-1, 3),
            )
        except MemoryError:
            channel.send(_Failed(f"needs more than {gigabytes:g} GB of memory"))
        except Exception as error:  # noqa: BLE001 - a parser of others, on any bytes whatever
            channel.send(_Failed(f"{type(error).__name__}: {one_line(error)}"[:200]))
        else:
            channel.send(answer)
