"""Reading in a process of its own: files that change, processes that die, hang or want too much."""

import errno
import os
import random
import resource
import signal
import subprocess
import sys
import time
from multiprocessing.context import SpawnProcess
from pathlib import Path

import numpy as np
import pytest
import trimesh

from synthnet.mesh import reading
from synthnet.mesh.reading import ChangedError, Reader, UnreadableError
from synthnet.store.files import sha256
from synthnet.types import Mesh

SPHERE = trimesh.creation.icosphere(subdivisions=1)


@pytest.fixture(scope="module")
def reader():
    with Reader() as shared:
        yield shared


@pytest.fixture
def sphere(tmp_path):
    path = tmp_path / "A.PLY"
    SPHERE.export(path, file_type="ply")
    return path


def test_file_is_read(reader, sphere):
    triangles = reader.triangles(sphere, sha256(sphere))
    np.testing.assert_array_equal(triangles.faces, SPHERE.faces)
    np.testing.assert_allclose(triangles.vertices, SPHERE.vertices, atol=1e-6)


def test_file_of_any_name_is_read(reader, sphere):
    odd = sphere.with_name(os.fsdecode(b"a\nb: \xff.ply"))
    sphere.rename(odd)
    assert len(reader.triangles(odd).faces) == 80


@pytest.mark.parametrize("suffix", [".obj", ".off", ".ply", ".stl"])
def test_truncated_and_altered_files_are_read_or_refused(suffix, reader, tmp_path):
    rng = random.Random(suffix)
    exported = SPHERE.export(file_type=suffix[1:])
    whole = exported.encode() if isinstance(exported, str) else exported
    path, outcomes = tmp_path / f"a{suffix}", set()
    for case in range(80):
        content = bytearray(whole[: rng.randrange(len(whole))] if case % 2 else whole)
        for _ in range(case % 4):
            content[rng.randrange(len(content))] = rng.randrange(256)
        path.write_bytes(content)
        try:
            triangles = reader.triangles(path)
            Mesh(triangles.vertices, triangles.faces)
            outcomes.add("read")
        except UnreadableError as error:
            message = str(error)
            assert message.isprintable()
            assert str(tmp_path) not in message
            assert "process" not in message  # that reads: it did not die
            outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_file_of_no_suffix_we_know_is_refused(reader, tmp_path):
    with pytest.raises(
        UnreadableError, match=r"a\.txt is none of \.obj, \.off, \.ply, \.stl, \.gii"
    ):
        reader.triangles(tmp_path / "a.txt")


def test_file_that_is_not_there_is_refused_without_its_directory(reader, tmp_path):
    with pytest.raises(UnreadableError) as error:
        reader.triangles(tmp_path / "none.obj")
    assert str(error.value) == "cannot be opened (No such file or directory)"


def test_file_of_other_bytes_is_told(reader, sphere):
    with pytest.raises(ChangedError, match="its bytes are others than when the import began"):
        reader.triangles(sphere, "0" * 64)
    assert len(reader.triangles(sphere).faces) == 80


def test_process_that_died_before_is_no_file_s_fault(sphere):
    with Reader() as reader:
        reader.triangles(sphere)
        os.kill(reader._process.pid, signal.SIGKILL)
        assert len(reader.triangles(sphere).faces) == 80
    assert reader._process is None


def test_file_of_which_two_processes_die_is_refused(sphere, monkeypatch):
    start = Reader._started

    def doomed(self):
        process, channel = start(self)
        os.kill(process.pid, signal.SIGKILL)
        return process, channel

    with Reader() as reader, monkeypatch.context() as patched:
        patched.setattr(Reader, "_started", doomed)
        with pytest.raises(UnreadableError, match="the process that reads it died twice"):
            reader.triangles(sphere)
        patched.undo()
        assert len(reader.triangles(sphere).faces) == 80


@pytest.mark.parametrize("call", ["Pipe", "Process"])
def test_machine_without_room_for_a_process_is_no_file_s_fault(call, sphere, monkeypatch):
    class Full(SpawnProcess):
        def start(self):
            raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    def no_pipe(self):
        raise OSError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    before = len([*Path("/proc/self/fd").iterdir()])
    with Reader() as reader, monkeypatch.context() as patched:
        patched.setattr(reading.WorkerContext, call, no_pipe if call == "Pipe" else Full)
        with pytest.raises(OSError, match=os.strerror(errno.EAGAIN)):
            reader.triangles(sphere)
        assert len([*Path("/proc/self/fd").iterdir()]) == before
        patched.undo()
        assert len(reader.triangles(sphere).faces) == 80


def test_file_that_hangs_is_refused(sphere, monkeypatch):
    with Reader() as reader:
        reader.triangles(sphere)
        os.kill(reader._process.pid, signal.SIGSTOP)
        monkeypatch.setattr(reading, "PATIENCE", 0.5)
        with pytest.raises(UnreadableError, match=r"not read within 0\.5 s$"):
            reader.triangles(sphere)
        monkeypatch.undo()
        assert len(reader.triangles(sphere).faces) == 80


def test_file_that_takes_too_much_processor_time_is_refused(sphere, tmp_path):
    long = tmp_path / "long.obj"
    long.write_bytes(b"v 0 0 0\n" * 6_000_000)  # some seconds
    with Reader(seconds=0.01) as reader:
        with pytest.raises(UnreadableError, match=r"not read within 0\.01 s of processor time"):
            reader.triangles(long)
        reader.seconds = 60
        assert len(reader.triangles(sphere).faces) == 80


def test_file_that_wants_all_memory_is_refused(tmp_path):
    path = tmp_path / "a.stl"
    with path.open("wb") as file:
        file.write(bytes(80) + (10**7).to_bytes(4, "little"))
        file.truncate(84 + 50 * 10**7)
    message = r"needs more than 0\.9 GB of memory"
    with Reader(gigabytes=0.9) as reader, pytest.raises(UnreadableError, match=message):
        reader.triangles(path)


def test_limits_are_at_most_those_of_who_started_it(monkeypatch):
    made = []
    monkeypatch.setattr(resource, "setrlimit", lambda kind, limits: made.append(limits))
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (100, 100))
    reading._limit(resource.RLIMIT_AS, 200)
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (100, resource.RLIM_INFINITY))
    reading._limit(resource.RLIMIT_AS, 200)
    assert made == [(100, 100), (200, resource.RLIM_INFINITY)]


PARENT = """
import os, sys
from pathlib import Path
from synthnet.mesh.reading import Reader

if __name__ == "__main__":
    reader = Reader()
    reader.triangles(Path(sys.argv[1]))
    print(reader._process.pid, flush=True)
    reader._channel.send_bytes(b'["%s", null]' % os.fsencode(sys.argv[2]))
    sys.stdin.read()
"""


def test_process_ends_with_its_parent(sphere, tmp_path, environment):
    """Also in the middle of a file."""
    long = tmp_path / "long.obj"
    long.write_bytes(b"v 0 0 0\n" * 20_000_000)
    (tmp_path / "parent.py").write_text(PARENT)
    command = [sys.executable, tmp_path / "parent.py", sphere, long]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, env=environment, **pipes) as parent:
        child = int(parent.stdout.readline())
        time.sleep(0.5)
        assert alive(child)
        parent.kill()
    patience = time.monotonic() + 5  # the file takes more
    while alive(child):
        assert time.monotonic() < patience, "it goes on reading"
        time.sleep(0.05)


def alive(pid):
    """Whether a process is there and not waiting to be reaped."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
