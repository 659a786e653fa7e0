"""Write the digests of the packages that CI installs, to ``.ci/hashes.txt``.

They are what ``synthnet[all,dev]`` needs in the environment that runs this, in the versions of
``constraints.txt``: of each, all files of the package index that Linux on x86-64 may take, for any
Python. PyTorch is left out, as its builds with and without CUDA come from two indexes. Run it after
``constraints.txt`` has changed: ``.venv/bin/python scripts/hash_pins.py``.
"""

from __future__ import annotations

import json
import urllib.request
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name as normal

ROOT = Path(__file__).parents[1]
OUT = ROOT / ".ci" / "hashes.txt"
INDEX = "https://pypi.org/simple"
SIMPLE = "application/vnd.pypi.simple.v1+json"
TIMEOUT = 60  # seconds without a byte
LEFT_OUT = {"torch"}
ABOUT = "# What CI installs, PyTorch apart; scripts/hash_pins.py makes this of constraints.txt."


def pins() -> dict[str, str]:
    """Return the version of each package in ``constraints.txt``."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    split = (line.split("==") for line in lines if line and not line.startswith("#"))
    return {normal(name): version for name, version in split}


def needed(*requirements: str) -> set[str]:
    """Return the packages that requirements bring here, themselves among them."""
    seen: set[tuple[str, str]] = set()
    left = [Requirement(line) for line in requirements]
    while left:
        requirement = left.pop()
        for extra in ["", *requirement.extras]:
            package = normal(requirement.name)
            if (package, extra) in seen or package in LEFT_OUT:
                continue
            seen.add((package, extra))
            parts = map(Requirement, metadata.requires(package) or [])
            left += [
                part for part in parts if not part.marker or part.marker.evaluate({"extra": extra})
            ]
    return {package for package, _ in seen}


def wanted() -> dict[str, str]:
    """Return the pins of what the project needs."""
    here = needed("synthnet[all,dev]")
    return {name: version for name, version in pins().items() if name in here}


def digests(name: str, version: str) -> list[str]:
    """Return the SHA-256 of all files of a version that may be installed, ascending."""
    request = urllib.request.Request(f"{INDEX}/{name}/", headers={"Accept": SIMPLE})
    with urllib.request.urlopen(request, timeout=TIMEOUT) as answer:
        files = json.load(answer)["files"]
    found = {file["hashes"]["sha256"] for file in files if taken(file["filename"], name, version)}
    if not found:
        raise LookupError(f"{INDEX} has no file of {name} {version} for Linux on x86-64")
    return sorted(found)


def taken(file: str, name: str, version: str) -> bool:
    """Return whether a file is of a version, and for Linux on x86-64 or for all platforms."""
    if file.endswith(".tar.gz"):
        stem, _, ending = file.removesuffix(".tar.gz").rpartition("-")
        return (normal(stem), ending) == (name, version)
    parts = file.removesuffix(".whl").split("-")
    fits = parts[-1] == "any" or ("linux" in parts[-1] and "x86_64" in parts[-1])
    return file.endswith(".whl") and (normal(parts[0]), parts[1]) == (name, version) and fits


def lines() -> Iterator[str]:
    """Yield the file's lines."""
    yield ABOUT
    chosen = wanted()
    with ThreadPoolExecutor(8) as pool:
        for (name, version), found in zip(
            chosen.items(), pool.map(digests, chosen, chosen.values()), strict=True
        ):
            yield " \\\n    ".join([f"{name}=={version}", *(f"--hash=sha256:{h}" for h in found)])


if __name__ == "__main__":
    OUT.write_text("\n".join(lines()) + "\n")
