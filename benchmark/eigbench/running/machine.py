"""The machine at hand, as results name it: its processor, and the versions of what runs on it."""

import os
import platform
from importlib import metadata
from pathlib import Path

from synthnet.kernels import processor

PACKAGES = ("synthnet", "numpy", "scipy", "lapy", "torch", "torch-geometric", "scikit-learn")


def hardware(accelerator: str = "") -> str:
    """Return a label of this machine: times are compared only where it is the same.

    The model's name alone will not do: a virtual machine's "AMD EPYC" may be of any
    generation, and one may be twice as fast as another. The kind is LLVM's name of it.
    """
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = [line for line in info.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].partition(":")[2].strip() if lines else model
    kind = processor().rpartition("-")[0]
    host = f"{model} ({kind}), {os.cpu_count()} cores"
    return f"{accelerator}, {host}" if accelerator else host


def environment() -> dict[str, str]:
    """Return the versions of Python and of the packages that matter."""
    versions = {"python": platform.python_version(), "platform": platform.platform(terse=True)}
    for name in PACKAGES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue  # an optional package
    return versions
