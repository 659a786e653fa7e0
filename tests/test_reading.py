"""Files of each format, whole, truncated and altered; parsers that hang, die or eat memory."""

from __future__ import annotations

import os
import random
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from synthnet import reading
from synthnet.reading import SUFFIXES, Reader, UnreadableError

FORMATS = {
    "ascii.obj": {"file_type": "obj"},
    "ascii.off": {"file_type": "off"},
    "ascii.ply": {"file_type": "ply", "encoding": "ascii"},
    "binary.ply": {"file_type": "ply", "encoding": "binary"},
    "ascii.stl": {"file_type": "stl_ascii"},
    "binary.stl": {"file_type": "stl"},
}


@pytest.fixture(scope="module")
def reader() -> Iterator[Reader]:
    with Reader(seconds=20) as one:
        yield one


@pytest.fixture(scope="module")
def contents() -> dict[str, bytes]:
    """The same sphere in every format."""
    sphere = trimesh.creation.icosphere(subdivisions=1)
    made = {name: sphere.export(**options) for name, options in FORMATS.items()}
    return {name: text.encode() if isinstance(text, str) else text for name, text in made.items()}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_is_read(name: str, reader: Reader, contents, tmp_path: Path) -> None:
    path = tmp_path / name.upper()
    path.write_bytes(contents[name])
    mesh = reader.read(path)
    assert len(mesh.faces) == 80
    assert mesh.vertices.dtype == np.float64
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 1, rtol=1e-6)
    assert mesh.vertices[mesh.faces].reshape(-1, 3).std(axis=0) == pytest.approx(0.56, abs=0.05)


def test_polygons_are_cut_into_triangles(reader: Reader, tmp_path: Path) -> None:
    path = tmp_path / "square.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    assert len(reader.read(path).faces) == 2


@pytest.mark.parametrize("name", FORMATS)
def test_truncated_and_altered_files_are_read_or_refused(
    name: str, reader: Reader, contents, tmp_path: Path
) -> None:
    rng = random.Random(name)
    whole = contents[name]
    path, outcomes = tmp_path / name, set()
    for case in range(40):
        content = bytearray(whole[: rng.randrange(len(whole))] if case % 2 else whole)
        for _ in range(case % 4):
            content[rng.randrange(max(1, len(content)))] = rng.randrange(256)
        path.write_bytes(content)
        try:
            outcomes.add(type(reader.read(path)).__name__)
        except UnreadableError as error:
            outcomes.add("refused" if len(str(error).splitlines()) == 1 else "several lines")
    assert outcomes == {"Mesh", "refused"}


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("a.txt", b"", "is none of .obj, .off, .ply, .stl"),
        ("a.obj", b"", "holds no triangles"),
        ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\n", ""),
        ("a.stl", bytes(80) + (2**32 - 1).to_bytes(4, "little"), ""),
        ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", "face index outside"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n", ""),
    ],
)
def test_files_that_are_no_mesh_are_refused(
    name: str, content: bytes, told: str, reader: Reader, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(UnreadableError) as error:
        reader.read(tmp_path / name)
    assert told in str(error.value)
    assert "\n" not in str(error.value)


def test_file_that_is_not_there_is_refused(reader: Reader, tmp_path: Path) -> None:
    with pytest.raises(UnreadableError):
        reader.read(tmp_path / "none.obj")


def test_reader_goes_on_after_a_parser_that_dies_or_hangs(contents, tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_bytes(contents["ascii.obj"])
    with Reader(seconds=30) as one:
        one.read(path)
        assert one._process is not None
        assert one._process.pid is not None
        os.kill(one._process.pid, signal.SIGKILL)
        time.sleep(0.2)
        with pytest.raises(UnreadableError, match="the parser crashed"):
            one.read(path)
        one.read(path)
        os.kill(one._process.pid, signal.SIGSTOP)
        one.seconds = 0.5
        with pytest.raises(UnreadableError, match=r"not read within 0\.5 s"):
            one.read(path)
        one.seconds = 30
        assert len(one.read(path).faces) == 80
    assert one._process is None


def test_parser_that_wants_all_memory_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    path.write_bytes(bytes(80) + (10**7).to_bytes(4, "little") + bytes(50 * 10**7))
    with Reader(gigabytes=1.5) as one, pytest.raises(UnreadableError, match=r"1\.5 GB|Memory"):
        one.read(path)


def test_suffixes_are_those_of_the_documentation() -> None:
    assert SUFFIXES == (".obj", ".off", ".ply", ".stl")
    assert all(suffix[1:].upper() in (reading.__doc__ or "") for suffix in SUFFIXES)
