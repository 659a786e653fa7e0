"""Measure the peak memory of builds of growing size: of the build's process and of its workers.

Every build is a new process. Peaks are the kernel's own (``VmHWM`` of /proc), in MB; Linux only.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import multiprocessing
import resource
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from tabulate import tabulate

from synthnet import recipe
from synthnet.build import build

RESULT = Path(__file__).parent.parent / "docs" / "data" / "build-memory.json"


def peak_mb() -> float:
    """Return the peak resident memory of this process in MB."""
    status = Path("/proc/self/status").read_text()
    (kilobytes,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(kilobytes) / 1e3


def measure(version: str, families: list[str], share: float, scale: int, workers: int) -> dict:
    """Build once, here, and return a row; run it in a process of its own."""
    base = recipe.load(version)
    chosen = {
        name: dataclasses.replace(family, count=max(1, round(share * family.count)))
        for name, family in base.families.items()
        if not families or name in families
    }
    wanted = dataclasses.replace(base, version="measured", families=chosen)
    if scale > 1:
        wanted = recipe.scaled(wanted, scale)
    with tempfile.TemporaryDirectory() as home:
        report = build(wanted, root=home, workers=workers)
        shards = len(report.dataset.manifest.shards)
    workers_peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    return {
        "scale": scale,
        "shapes": wanted.count,
        "shards": shards,
        "build MB": round(peak_mb(), 1),
        "largest worker MB": round(workers_peak, 1),
        "seconds": round(report.wall_seconds, 1),
    }


def main() -> None:
    """Measure each scale, print a table and write the JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--version", default="1.0")
    parser.add_argument("--families", nargs="*", default=[], help="default: all")
    parser.add_argument("--share", type=float, default=1.0, help="of the recipe's counts")
    parser.add_argument("--scale", nargs="+", type=int, default=[1, 4])
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=RESULT)
    options = parser.parse_args()
    rows = []
    for scale in options.scale:
        sys.stderr.write(f"scale {scale}\n")
        arguments = (options.version, options.families, options.share, scale, options.workers)
        # A process has one peak in its life, so each build gets a new one.
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            rows.append(pool.submit(measure, *arguments).result())
    print(tabulate(rows, headers="keys"))
    families = options.families or list(recipe.load(options.version).families)
    found = {
        "version": options.version,
        "families": families,
        "share": options.share,
        "workers": options.workers,
        "rows": rows,
    }
    options.out.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
