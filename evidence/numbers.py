"""The files of docs/data: what was measured, and on which machine."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from eigbench.running.machine import environment, hardware

from evidence import DATA
from synthnet.store.files import write_text


def read(name: str) -> Any:
    """Return the content of ``docs/data/<name>.json``."""
    return json.loads((DATA / f"{name}.json").read_text())


def machine() -> dict[str, Any]:
    """Return what numbers that are measured here depend on: the machine and the packages."""
    return {"hardware": hardware(), "packages": environment()}


def measured_here(name: str) -> list[dict]:
    """Return the rows of ``docs/data/<name>.json`` if they are of this machine, else none."""
    data = read(name)
    return data["rows"] if data.get("machine") == machine() else []


def write(path: Path, data: dict[str, Any]) -> None:
    """Write measured numbers, with the machine and the packages that they were measured with."""
    text = json.dumps({**data, "machine": machine()}, indent=1)
    numbers = re.compile(r'\[\n([^][{}"]*)\]')  # their lists take a line each
    write_text(path, numbers.sub(lambda match: f"[{' '.join(match[1].split())}]", text) + "\n")
