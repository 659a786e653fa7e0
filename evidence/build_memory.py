"""Measure the peak memory of builds of growing size: of the build's process and of its workers.

Every build is a new process. Peaks are the kernel's own (``VmHWM`` of /proc), in MB; Linux only.
Rows gather in docs/data/build-memory.json and docs/clusters.md:

    python benchmarks/build_memory.py --scale 1 4
    python benchmarks/build_memory.py --scale 1 20 --families split_cone conical_frustum
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
from synthnet.build.versions import build
from synthnet.store.files import write_marked, write_text

DOCS = Path(__file__).parent.parent / "docs"
RESULT, PAGE = DOCS / "data" / "build-memory.json", DOCS / "clusters.md"


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
    }


def table(rows: list[dict]) -> str:
    """Return the rows as Markdown."""
    cells = [
        [
            row["families"],
            f"{row['scale']} ×",
            *(f"{row[key]:,}" for key in ("shapes", "shards")),
            *(f"{row[key]:,.0f}" for key in ("build MB", "largest worker MB")),
        ]
        for row in rows
    ]
    headers = ["families", "size", "shapes", "shards", "build MB", "largest worker MB"]
    align = ["left"] + ["right"] * 5
    return tabulate(cells, headers, tablefmt="github", disable_numparse=True, colalign=align)


def keep(row: dict) -> list[dict]:
    """Put a row into the file and the page, in the place of an older one like it."""
    old = json.loads(RESULT.read_text()) if RESULT.exists() else []
    same = ("families", "scale", "share")
    rows = [r for r in old if any(r[key] != row[key] for key in same)] + [row]
    rows.sort(key=lambda r: (r["families"] != "all", r["families"], r["share"] * r["scale"]))
    write_text(RESULT, json.dumps(rows, indent=1) + "\n")
    write_marked(PAGE, memory=f"\n{table(rows)}\n")
    return rows


def main() -> None:
    """Measure each scale; after each, write the JSON and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--version", default="1.0")
    parser.add_argument("--families", nargs="*", default=[], help="default: all")
    parser.add_argument("--share", type=float, default=1.0, help="of the recipe's counts")
    parser.add_argument("--scale", nargs="+", type=int, default=[1, 4])
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    rows = []
    for scale in options.scale:
        sys.stderr.write(f"scale {scale}\n")
        arguments = (options.version, options.families, options.share, scale, options.workers)
        # A process has one peak in its life, so each build gets a new one.
        with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
            row = pool.submit(measure, *arguments).result()
        families = ", ".join(options.families).replace("_", " ") or "all"
        rows = keep({"families": families, "share": options.share, **row})
    print(table(rows))


if __name__ == "__main__":
    main()
