"""What tests look at of datasets on disk."""

from __future__ import annotations

from pathlib import Path


def contents(directory: Path) -> dict[str, bytes]:
    """Return the bytes of all files below a directory but the locks, by name, in order."""
    files = (p for p in sorted(directory.rglob("*")) if p.is_file() and p.name != ".lock")
    return {p.relative_to(directory).as_posix(): p.read_bytes() for p in files}
