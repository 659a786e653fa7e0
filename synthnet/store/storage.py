"""Where a dataset is: a directory on this machine, or an fsspec URL.

A directory is a :class:`pathlib.Path` and everything is as in :mod:`synthnet.store.files`. A URL
is a :class:`RemotePath`. Objects are written whole, in one request, which object stores do
atomically; elsewhere an object cut short is found when it is read. There is no lock on a
URL: two builds of one version on processors of one kind write equal bytes, so they waste
work and damage nothing.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, TypeAlias

from synthnet.errors import BuildError, MissingPackageError, StoreError, install
from synthnet.store import files
from synthnet.store.files import one_line

OBJECT_STORES = {"s3", "s3a", "gs", "gcs", "abfs", "az"}  # no directories, but buckets
PACKAGES = {"s3": "s3fs", "s3a": "s3fs"}  # by protocol, those that an extra brings


@dataclass(frozen=True, slots=True)
class RemotePath:
    """A location at an fsspec URL: as much of :class:`pathlib.Path` as the store needs.

    It is plain text, so a worker anywhere can be sent one. Every method raises
    :class:`StoreError` or :class:`MissingPackageError` where the location cannot be reached.

    Examples
    --------
    >>> path = RemotePath("s3://bucket/data/") / "1.0" / "manifest.json"
    >>> path.name, str(path.parent)
    ('manifest.json', 's3://bucket/data/1.0')
    """

    url: str

    def __truediv__(self, name: str) -> RemotePath:
        return RemotePath(f"{self.url.rstrip('/')}/{name}")

    def __str__(self) -> str:
        return self.url

    @property
    def name(self) -> str:
        """What follows the last slash."""
        return self.url.rpartition("/")[2]

    @property
    def parent(self) -> RemotePath:
        """What precedes the last slash."""
        return RemotePath(self.url.rpartition("/")[0])

    def read_bytes(self) -> bytes:
        """Read the object whole; ``FileNotFoundError`` if there is none."""
        with self._reached("read") as (system, path):
            return bytes(system.cat_file(path))

    def write_bytes(self, content: bytes) -> None:
        """Write the object whole."""
        try:
            with self._reached("write") as (system, path):
                system.pipe_file(path, content)
        except FileNotFoundError as error:
            raise StoreError(f"cannot write {self} ({one_line(error)}): make it first") from error

    def make(self) -> None:
        """Make the directory where the file system has directories; a bucket is not made."""
        with self._reached("write") as (system, path):
            protocols = [system.protocol] if isinstance(system.protocol, str) else system.protocol
            if not OBJECT_STORES.intersection(protocols):
                system.makedirs(path, exist_ok=True)

    def remove(self) -> None:
        """Remove the object."""
        with self._reached("remove") as (system, path):
            system.rm_file(path)

    def size(self) -> int | None:
        """Return the object's size in bytes, or ``None`` if there is none."""
        try:
            with self._reached("read") as (system, path):
                return int(system.info(path)["size"])
        except FileNotFoundError:
            return None

    def names(self) -> list[str]:
        """Return the names of what is in it, sorted; none if there is no such directory."""
        try:
            with self._reached("list") as (system, path):
                return sorted(
                    entry.rstrip("/").rpartition("/")[2] for entry in system.ls(path, False)
                )
        except FileNotFoundError:
            return []

    @contextmanager
    def open(self) -> Iterator[IO[bytes]]:
        """Open the object to read parts of it; only these are transferred."""
        with (
            self._reached("read") as (system, path),
            system.open(path, "rb", cache_type="none") as file,
        ):
            yield file

    @contextmanager
    def _reached(self, what: str) -> Iterator[tuple[Any, str]]:
        """Give the file system and the path in it; turn its errors into one line."""
        import fsspec

        try:
            system, path = fsspec.url_to_fs(self.url)
        except OSError as error:
            raise StoreError(
                f"cannot {what} {self} ({one_line(error)}): check the URL and the network"
            ) from error
        except ImportError as error:
            package = PACKAGES.get(self.url.partition(":")[0])
            advice = install(package) if package else one_line(error)
            raise MissingPackageError(f"cannot {what} {self}: {advice}") from error
        except ValueError as error:
            raise StoreError(
                f"cannot {what} {self} ({one_line(error)}): choose another --out"
            ) from error
        try:
            yield system, path
        except FileNotFoundError:
            raise
        except _network_errors() as error:
            raise StoreError(
                f"cannot {what} {self} ({one_line(error)}): check the URL, the network "
                "and your credentials"
            ) from error


def _network_errors() -> tuple[type[Exception], ...]:
    """Return OSError, and what the clients of S3 and HTTP that are in use raise in its stead."""
    kinds: list[type[Exception]] = [OSError]
    if s3 := sys.modules.get("botocore.exceptions"):
        kinds += [s3.BotoCoreError, s3.ClientError]
    if http := sys.modules.get("aiohttp"):
        kinds.append(http.ClientError)
    return tuple(kinds)


Location: TypeAlias = Path | RemotePath


def location(where: str | os.PathLike[str] | RemotePath) -> Location:
    """Return the location that a path or URL names; ``file://`` is a path.

    Examples
    --------
    >>> location("s3://bucket/data")
    RemotePath(url='s3://bucket/data')
    >>> location("file:///tmp/data").as_posix()
    '/tmp/data'
    """
    if isinstance(where, RemotePath):
        return where
    text = os.fspath(where)
    protocol, separator, rest = text.partition("://")
    if separator and protocol != "file":
        return RemotePath(text.rstrip("/"))
    return Path(os.path.expanduser(rest if separator else text))  # noqa: PTH111 - Path's raises for ~nobody


def local(where: Location, version: str) -> Path:
    """Return a location that is a directory on this machine.

    Raises
    ------
    StoreError
        If it is a URL: files are mapped into memory only from a local disk.
    """
    if isinstance(where, Path):
        return where
    raise StoreError(
        f"{where} is not on this machine: copy it to a directory {version} here (with "
        "`aws s3 cp --recursive`, or fsspec's get) and give the directory above it as root"
    )


def size(where: Location) -> int | None:
    """Return the size of a file in bytes, or ``None`` if there is none."""
    if isinstance(where, RemotePath):
        return where.size()
    return where.stat().st_size if where.exists() else None


def names(where: Location) -> list[str]:
    """Return the names of what is in a directory, sorted; none if there is no such directory.

    Raise StoreError if it cannot be listed.
    """
    if isinstance(where, RemotePath):
        return where.names()
    try:
        return sorted(path.name for path in where.iterdir())
    except FileNotFoundError:
        return []
    except OSError as error:
        raise StoreError(f"cannot list {where} ({error.strerror})") from error


def sha256(where: Location) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    if isinstance(where, RemotePath):
        return hashlib.sha256(where.read_bytes()).hexdigest()
    return files.sha256(where)


def make_directory(where: Location) -> None:
    """Create a directory that can be written, or raise BuildError."""
    if isinstance(where, Path):
        files.make_directory(where)
        return
    probe = where / ".writable"
    try:
        where.make()
        probe.write_bytes(b"synthnet")
        probe.remove()
    except FileNotFoundError:
        return  # removed by another build: it can be written
    except StoreError as error:
        raise BuildError(str(error)) from error


def write_atomically(where: Location, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a local file, then move or upload it to ``where``.

    Raise BuildError if it cannot be written; nothing is left behind.
    """
    if isinstance(where, Path):
        files.write_atomically(where, write)
        return
    with tempfile.TemporaryDirectory(prefix="synthnet-") as directory:
        whole = Path(directory) / where.name
        files.write_atomically(whole, write)
        try:
            where.write_bytes(whole.read_bytes())
        except StoreError as error:
            raise BuildError(str(error)) from error


def write_text(where: Location, text: str) -> None:
    """Write a text file in UTF-8, as :func:`write_atomically` does."""
    write_atomically(where, lambda partial: partial.write_text(text, encoding="utf-8"))


def remove_partial_files(where: Location) -> None:
    """Remove the partial files that a killed writer left; at a URL it leaves none."""
    if isinstance(where, Path):
        files.remove_partial_files(where)
