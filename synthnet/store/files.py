"""Files and directories: written under another name and moved when complete."""

import errno
import hashlib
import os
import shutil
import socket
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import filelock

from synthnet.errors import BuildError, printable

BUSY = "another build is writing to {where}: wait for it (--wait) or choose another --out"
LOADED = "$SYNTHNET_HOME or root="  # what chooses the directory of a dataset that is loaded
NO_LOCKS = (errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP)  # of file systems without flock


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def make_directory(path: Path, choose: str = "--out or $SYNTHNET_HOME") -> None:
    """Create a directory that can be written, or raise BuildError.

    ``choose`` names the option that selects another directory, for the message.
    """
    _make(path, f"choose another directory with {choose}")


def make_parent(path: Path) -> None:
    """Create the directory of a file, or raise BuildError, before the work that fills the file."""
    _make(path.absolute().parent, f"choose another place for {path.name}")


def _make(path: Path, remedy: str) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".writable"
        probe.touch()
        probe.unlink(missing_ok=True)  # another build may probe at the same time
    except OSError as error:
        raise BuildError(f"cannot write to {path} ({error.strerror}): {remedy}") from error


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a file beside ``path``, then move it there.

    Raises
    ------
    BuildError
        If the disk is full or cannot be written. Whatever is raised, nothing is left behind.
    """
    # No two writers, on whatever machine, may share a partial file.
    partial = path.with_name(f".{path.name}.{uuid.uuid4().hex}.partial")
    try:
        write(partial)
        with partial.open("rb") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        raise _cannot_write(path, error) from error
    finally:
        with suppress(OSError):  # it is gone if all went well
            partial.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8, as :func:`write_atomically` does."""
    write_atomically(path, lambda partial: partial.write_text(text, encoding="utf-8"))


def write_secret(path: Path, text: str) -> None:
    """Write a text file that only its owner may read, where none is yet.

    Raises
    ------
    FileExistsError
        If a file is there.
    BuildError
        If it cannot be written; nothing is left behind.
    """
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError:
        raise
    except OSError as error:
        raise _cannot_write(path, error) from error
    try:
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        path.unlink(missing_ok=True)
        raise _cannot_write(path, error) from error


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file of bytes, as :func:`write_atomically` does."""
    write_atomically(path, lambda partial: partial.write_bytes(content))


def _cannot_write(path: Path, error: OSError) -> BuildError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return BuildError(
            f"no space left for {path}: free some and run the same command again, with --resume if "
            "there is that; what is finished is kept"
        )
    if error.errno == errno.ENOENT and not path.parent.is_dir():
        return BuildError(
            f"cannot write {path}: there is no directory {path.parent}, make it first"
        )
    return BuildError(f"cannot write {path} ({error.strerror or one_line(error)})")


def make_in_place(
    directory: Path, is_whole: Callable[[], bool], fill: Callable[[Path], None]
) -> None:
    """Let ``fill`` fill a partial directory, then give it its name.

    A directory that is whole is left as it is. Of several processes that want the same
    directory one fills it and the others wait.

    Raises
    ------
    BuildError
        If the disk is full or cannot be written; nothing is left behind.
    """
    partial = directory.with_name(f".{directory.name}.partial")
    make_directory(directory.parent, LOADED)
    with locked(directory.with_name(f".{directory.name}.lock"), wait=True):
        if is_whole():
            return
        shutil.rmtree(partial, ignore_errors=True)  # of a process that was killed
        make_directory(partial, LOADED)
        try:
            fill(partial)
            shutil.rmtree(directory, ignore_errors=True)
            partial.rename(directory)
        except OSError as error:
            raise _cannot_write(directory, error) from error
        finally:
            shutil.rmtree(partial, ignore_errors=True)


@contextmanager
def locked(path: Path, *, wait: bool, taken: str = BUSY, needed: bool = True) -> Iterator[None]:
    """Hold the lock of a file, which says who holds it.

    The kernel gives the lock back when its process ends, however that is. Of a process on another
    machine, only the file system's server knows.

    Parameters
    ----------
    path : Path
        The file; it stays.
    wait : bool
        Whether to wait for another process that holds it.
    taken : str
        What to say of that, with ``{where}`` for the directory and the process.
    needed : bool
        Whether to fail where the file system has no locks.

    Raises
    ------
    BuildError
        If another process holds it and ``wait`` is false, the file is another user's, or the
        file system has no locks and they are needed.
    """
    directory, elsewhere = path.parent, "choose another --out or $SYNTHNET_HOME"
    lock = filelock.FileLock(path, fallback_to_soft=False)
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except filelock.Timeout as error:
        raise BuildError(taken.format(where=f"{directory}{_holder(path)}")) from error
    except PermissionError as error:
        raise BuildError(
            f"cannot lock {directory}: {path} is {_owner(path)}'s, {elsewhere}"
        ) from error
    except OSError as error:
        if error.errno not in NO_LOCKS:
            raise _cannot_write(path, error) from error
        if needed:
            raise BuildError(
                f"cannot lock {directory}, its file system has no locks ({error.strerror}): "
                f"{elsewhere} on a local disk, or a URL"
            ) from error
    try:
        with suppress(OSError):  # the disk may be full: the lock holds without its note
            path.write_text(f"{socket.gethostname()} {os.getpid()}\n", encoding="utf-8")
        yield
    finally:
        lock.release()


def _holder(path: Path) -> str:
    """Say who holds a lock, and what to do where that process may be gone."""
    try:
        host, _, pid = path.read_text(encoding="utf-8").strip().partition(" ")
    except (OSError, ValueError):
        return ""
    if not pid.isdecimal():
        return ""
    import psutil

    if host == socket.gethostname() and psutil.pid_exists(int(pid)):
        return f" (process {pid})"
    gone = f"if that is gone, remove {path}"  # the server that keeps the lock may not know
    return f" (process {pid} on {printable(host)}; {gone})"


def _owner(path: Path) -> str:
    try:
        return path.owner()
    except (OSError, KeyError):
        return "another user"


def remove_partial_files(directory: Path) -> None:
    """Remove the partial files that a killed writer left."""
    for partial in directory.glob(".*.partial"):
        partial.unlink(missing_ok=True)  # a worker that outlives its build may just move it


def one_line(error: BaseException) -> str:
    """Return an error's message on one line."""
    return " ".join(str(error).split())
