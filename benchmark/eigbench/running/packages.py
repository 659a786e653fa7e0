"""Packages that a predictor's file asks for: installed by its header of PEP 723, in a folder."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path
from typing import Any

from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import canonicalize_name

from eigbench.errors import EigbenchError, ResultError
from eigbench.running import machine

SCRIPT = re.compile(r"^# /// script\n((?:#(?: .*)?\n)+?)# ///$", re.MULTILINE)  # of PEP 723
HERE = ("synthnet", "eigbench")  # what runs the predictor is this release


def install(code: Path, folder: Path) -> Path | None:
    """Install what a file's header of PEP 723 asks for; None where it has no header.

    Wheels alone, since to build a package runs its code outside the sandbox.

    Raises
    ------
    ResultError
        If the header is no TOML, or asks for what is no name with a version.
    EigbenchError
        If it cannot be installed.
    """
    file = code.with_name(code.name.partition(":")[0])
    header = SCRIPT.search(file.read_text(encoding="utf-8"))
    if header is None:
        return None
    lines = (line[2:] if line.startswith("# ") else line[1:] for line in header[1].splitlines())
    try:
        dependencies = tomllib.loads("\n".join(lines)).get("dependencies", [])
    except tomllib.TOMLDecodeError as error:
        raise ResultError(f"{file}: its header of PEP 723 is no TOML: {error}") from error
    folder.mkdir()
    if packages := [str(package) for package in _requirements(dependencies, file)]:
        uv = shutil.which("uv")
        installer = [uv, "pip"] if uv else [sys.executable, "-m", "pip"]
        where = ["--target", str(folder), "--only-binary", ":all:"]
        command = [*installer, "install", *where, "--", *packages]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["?"])[-1]
            raise EigbenchError(f"cannot install what {file.name} asks for: {last[:300]}")
    return folder


def _requirements(dependencies: Any, file: Path) -> list[Requirement]:
    """Return what a header asks for, without what runs it: names and versions, no addresses.

    From an address, or a folder, comes what need not be a wheel.
    """
    is_list = isinstance(dependencies, list)
    if not is_list or not all(isinstance(text, str) for text in dependencies):
        raise ResultError(
            f"{file}: dependencies of PEP 723 are a list of texts, got {dependencies}"
        )
    try:
        requirements = [Requirement(text) for text in dependencies]
    except InvalidRequirement as error:
        message = " ".join(str(error).split())
        raise ResultError(f"{file}: a dependency of PEP 723: {message}") from error
    for requirement in requirements:
        if requirement.url is not None:
            raise ResultError(f"{file}: {requirement.name} comes from an address: name a version")
    return [r for r in requirements if canonicalize_name(r.name) not in HERE]


def installed(packages: Path | None) -> dict[str, str]:
    """Return the versions of the packages in a folder; of this environment, where there is none."""
    if packages is None:
        return machine.environment()
    distributions = metadata.distributions(path=[str(packages)])
    return dict(sorted((d.metadata["Name"], d.version) for d in distributions))
