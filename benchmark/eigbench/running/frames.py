"""What passes between the harness and a predictor's process: frames of plain bytes.

A frame is its kind (one byte), the length of what follows (eight bytes, little-endian), and that:
JSON for facts, float64 for answers. Meshes come as a file in memory that cannot be written to; its
descriptor travels with the frame, so they can be read no earlier than they are asked for, and are
not copied. Nothing is unpickled: what a predictor sends cannot run in the harness.
"""

import contextlib
import errno
import fcntl
import json
import mmap
import os
import socket
import struct
import tempfile
from collections.abc import Callable, Sequence
from typing import Any, BinaryIO, Self, cast

import numpy as np

from eigbench.running.predictor import META_KEYS, META_LENGTH, MOST_PARAMETERS
from synthnet.types import Mesh

JOB, MESHES, CLOSING = b"j", b"m", b"c"  # of the harness
LOADED, ANSWER, SOURCES, FAILED = b"l", b"a", b"s", b"f"  # of the predictor's process
HEADER = struct.Struct("<cQ")
MOST = 4 * 2**20  # bytes of a frame of facts
STEP = 0.1  # seconds between two looks at who does not answer
ALIGNED = 64  # bytes
SEALINGS = 30  # tries to seal a file in memory, each of up to 0.2 s

_PATHS = {
    "type": "array",
    "maxItems": 10_000,
    "items": {"type": "string", "pattern": r"^[^\x00-\x1f\ud800-\udfff]{1,1000}\Z"},
}
PROPERTIES: dict[bytes, dict[str, Any]] = {  # of what a predictor's process says of itself
    LOADED: {
        "meta": {
            "type": "object",
            "required": ["name", "kind"],
            "propertyNames": {"enum": list(META_KEYS)},
            "additionalProperties": {"type": "string", "maxLength": META_LENGTH},
        },
        "parameters": {"type": ["integer", "null"], "minimum": 0, "maximum": MOST_PARAMETERS},
        "seeded": {"type": "boolean"},
        "trained": {"type": "boolean"},
        "accelerator": {"type": "string", "pattern": r"^[ -~]{0,300}\Z"},
    },
    SOURCES: {"files": _PATHS, "attempts": _PATHS},
    FAILED: {"message": {"type": "string"}, "traceback": {"type": "string"}},
}


class FrameError(Exception):
    """What came is no frame, or holds what it must not."""


class Channel:
    """One end of a socket on which frames go to and fro. It closes with its ``with`` block."""

    def __init__(self, end: socket.socket) -> None:
        self._socket = end

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close this end."""
        self._socket.close()

    def send(
        self,
        kind: bytes,
        body: bytes,
        file: BinaryIO | None = None,
        on_step: Callable[[], None] | None = None,
    ) -> None:
        """Send a frame, and the descriptor of a file with it.

        ``on_step`` is called ten times a second while nobody reads it; what it raises ends the
        wait.
        """
        self._socket.settimeout(None if on_step is None else STEP)
        header = HEADER.pack(kind, len(body))
        if file is None:
            self._socket.sendall(header)
        else:
            socket.send_fds(self._socket, [header], [file.fileno()])
        left = memoryview(body)
        while left:
            try:
                left = left[self._socket.send(left) :]
            except TimeoutError:
                assert on_step is not None
                on_step()

    def receive(
        self, most: int = MOST, on_step: Callable[[], None] | None = None
    ) -> tuple[bytes, bytes, int | None]:
        """Wait for a frame; return its kind, its body and a descriptor, if one came with it.

        A body of more than ``most`` bytes is refused before it is read. ``on_step`` is called ten
        times a second while nothing comes; what it raises ends the wait. A descriptor is taken
        only where it is ``None``: the harness accepts none.

        Raises
        ------
        EOFError
            If the other end is closed.
        FrameError
            If the frame is too long.
        """
        self._socket.settimeout(None if on_step is None else STEP)
        descriptor = None
        if on_step is None:
            start, descriptors, _, _ = socket.recv_fds(self._socket, HEADER.size, 1)
            descriptor = descriptors[0] if descriptors else None
            start += self._exactly(HEADER.size - len(start), None) if start else b""
            if not start:
                raise EOFError
        else:
            start = self._exactly(HEADER.size, on_step)
        kind, length = HEADER.unpack(start)
        if length > most:
            raise FrameError(f"a frame of {length:,} bytes, where at most {most:,} can come")
        return kind, self._exactly(length, on_step), descriptor

    def _exactly(self, count: int, on_step: Callable[[], None] | None) -> bytes:
        taken = bytearray(count)
        view, got = memoryview(taken), 0
        while got < count:
            try:
                more = self._socket.recv_into(view[got:])
            except TimeoutError:
                more = None
            if more == 0:
                raise EOFError
            got += more or 0
            if on_step is not None and got < count:
                on_step()
        return bytes(taken)


def facts(kind: bytes, body: bytes) -> Any:
    """Return what a frame of a predictor's process says, checked against its schema.

    Raises
    ------
    FrameError
        If it is no JSON, or something else than such a frame may say.
    """
    import jsonschema  # as late as here: beside some packages of Jupyter it takes a second

    known = PROPERTIES[kind]
    schema = {"properties": known, "required": list(known), "additionalProperties": False}
    try:
        content = json.loads(body)
        jsonschema.validate(content, {"type": "object", **schema})
    except (ValueError, RecursionError) as error:
        raise FrameError("facts that are no JSON") from error
    except jsonschema.ValidationError as error:
        raise FrameError(f"facts of another form: {error.message[:200]}") from error
    return content


def packed(meshes: Sequence[Mesh]) -> tuple[bytes, BinaryIO]:
    """Return meshes as a frame's body and a file in memory that cannot be written to any more."""
    body = json.dumps([(len(mesh.vertices), len(mesh.faces)) for mesh in meshes]).encode()
    with contextlib.ExitStack() as on_failure:
        file = on_failure.enter_context(_file_in_memory())
        for mesh in meshes:
            for array in (mesh.vertices.astype("<f8", "C"), mesh.faces.astype("<i8", "C")):
                file.write(array.data)
                file.write(bytes(-array.nbytes % ALIGNED))
        file.write(bytes(ALIGNED))  # an empty file cannot be mapped
        file.flush()
        if hasattr(os, "memfd_create"):
            _seal(file)
        on_failure.pop_all()
    return body, file


def _seal(file: BinaryIO) -> None:
    """Let nobody write to a file in memory from now on.

    The system refuses while it holds one of the pages itself, to move it for example. It waits for
    0.2 s, and on a busy machine that may be too short.
    """
    seals = fcntl.F_SEAL_WRITE | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_SEAL
    for left in reversed(range(SEALINGS)):
        try:
            fcntl.fcntl(file, fcntl.F_ADD_SEALS, seals)
        except OSError as error:
            if error.errno != errno.EBUSY or left == 0:
                raise
        else:
            return


def _file_in_memory() -> BinaryIO:
    """Open a file without a name; where there is no memory for such, on disk."""
    if not hasattr(os, "memfd_create"):
        return cast("BinaryIO", tempfile.TemporaryFile())
    return os.fdopen(os.memfd_create("meshes", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING), "w+b")


def unpacked(body: bytes, descriptor: int) -> tuple[Mesh, ...]:
    """Return the meshes of a frame: read-only arrays, float64 vertices and int64 faces."""
    with os.fdopen(descriptor, "rb") as file:
        shared = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    meshes, begin = [], 0
    for vertices, faces in json.loads(body):
        arrays = []
        for rows, dtype in ((vertices, "<f8"), (faces, "<i8")):
            array = np.frombuffer(shared, dtype, 3 * rows, begin).reshape(rows, 3)
            begin += array.nbytes + -array.nbytes % ALIGNED
            arrays.append(array)
        meshes.append(Mesh(*arrays))
    return tuple(meshes)
