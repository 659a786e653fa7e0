"""How large an installation is, with a torch for the CPU and with that of PyPI, which brings CUDA.

Each is made afresh in a temporary directory: an environment, then torch, then this checkout with
its extras. The installation has to keep the torch that is there before. Bytes are those of all
files of the environment; seconds depend on the network, and are not shown.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

from evidence import ROOT

INDEX = "https://download.pytorch.org/whl/cpu"


def measure(*, extras: str = "all,dev") -> dict:
    """Return a row for each torch: its version before and after, and the size of the whole."""
    version = pinned_torch()
    torches = {
        "CPU": [f"torch=={version}+cpu", "--extra-index-url", INDEX],
        "CUDA": [f"torch==={version}"],  # this very version, not one with a suffix
    }
    return {"extras": extras, "rows": [row(kind, torches[kind], extras) for kind in torches]}


def pinned_torch() -> str:
    """Return the version of torch in the constraints."""
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    (version,) = (line.removeprefix("torch==") for line in lines if line.startswith("torch=="))
    return version


def row(kind: str, torch: list[str], extras: str) -> dict:
    """Install a torch, then the project, and measure."""
    with tempfile.TemporaryDirectory() as folder:
        environment = Path(folder, "environment")
        python = environment / "bin" / "python"
        run(sys.executable, ROOT / "scripts" / "make_venv.py", environment)
        install = (python, "-m", "pip", "install", "--quiet", "--no-cache-dir")
        run(*install, "--no-deps", *torch)  # these come with the project
        before = torch_of(python)
        run(*install, "-c", ROOT / "constraints.txt", f"{ROOT}[{extras}]")
        files = (path for path in environment.rglob("*") if not path.is_symlink())
        size = sum(path.stat().st_size for path in files if path.is_file())
        return {"torch": kind, "before": before, "after": torch_of(python), "bytes": size}


def torch_of(python: Path) -> str:
    """Return the version of torch that an environment has."""
    code = "from importlib.metadata import version; print(version('torch'))"
    return run(python, "-c", code).strip()


def run(*command: str | Path) -> str:
    """Run a command and return what it prints."""
    words = [str(word) for word in command]
    return subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True).stdout


def problems(data: dict) -> list[str]:
    """Return where the installation did not keep the torch that was there."""
    return [
        f"torch {row['before']} became {row['after']}"
        for row in data["rows"]
        if row["before"] != row["after"]
    ]


def sizes(data: dict) -> str:
    """Return the sizes as a part of a sentence."""
    parts = (f"{row['bytes'] / 1e9:.1f} GB with a {row['torch']} torch" for row in data["rows"])
    return ", ".join(parts)
