"""The peak memory of builds of growing size: of the build's process and of its largest worker.

Every build is a new process with two workers. Peaks are the kernel's own (``VmHWM`` of /proc), in
MB; Linux only. A run replaces the rows of the same families, share and scale. It keeps the others
if they were measured on this machine with these packages.
"""

from __future__ import annotations

import dataclasses
import resource
import sys
import tempfile
from collections.abc import Sequence

from evidence import markdown, numbers
from evidence.timing import in_new_process, peak_mb
from synthnet import recipe
from synthnet.build.versions import build

SAME = ("families", "scale", "share")


def measure(
    *, families: Sequence[str] = (), share: float = 1.0, scale: Sequence[int] = (1, 4)
) -> dict:
    """Build each scale of some or all families, with a share of the recipe's counts."""
    rows = numbers.measured_here("build-memory")
    names = ", ".join(families).replace("_", " ") or "all"
    for times in scale:
        sys.stderr.write(f"scale {times}\n")
        measured = in_new_process(build_once, families, share, times)
        row = {"families": names, "share": share, **measured}
        rows = [old for old in rows if any(old[key] != row[key] for key in SAME)] + [row]
    rows.sort(key=lambda r: (r["families"] != "all", r["families"], r["share"] * r["scale"]))
    return {"rows": rows}


def build_once(families: Sequence[str], share: float, scale: int) -> dict:
    """Build in this process, and return a row."""
    base = recipe.load("1.0")
    chosen = {
        name: dataclasses.replace(family, count=max(1, round(share * family.count)))
        for name, family in base.families.items()
        if not families or name in families
    }
    measured = dataclasses.replace(base, version="measured", families=chosen)
    if scale > 1:
        measured = recipe.scaled(measured, scale)
    with tempfile.TemporaryDirectory() as home:
        report = build(measured, root=home, workers=2)
        shards = len(report.dataset.manifest.shards)
    largest_worker = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1e3
    return {
        "scale": scale,
        "shapes": measured.count,
        "shards": shards,
        "build MB": round(peak_mb(), 1),
        "largest worker MB": round(largest_worker, 1),
    }


def table(data: dict) -> str:
    """Return one row per build."""
    columns = {
        "families": "{families}",
        "size": "{scale} ×",
        "shapes": "{shapes:,}",
        "shards": "{shards:,}",
        "build MB": "{build MB:,.0f}",
        "largest worker MB": "{largest worker MB:,.0f}",
    }
    return markdown.columns(data["rows"], columns, "lr")
