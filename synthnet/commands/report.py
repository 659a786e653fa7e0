"""What the command line prints of a dataset and shows of a build: tables and progress."""

import argparse
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from rich.progress import TaskID
from tabulate import tabulate

from synthnet.build.jobs import BuildReport, ShardResult, Watcher
from synthnet.recipe.plan import ShardPlan
from synthnet.terminal import progress
from synthnet.types import Manifest

Made = TypeVar("Made")  # what a build returns: a report, perhaps with more


def summary(manifest: Manifest, report: BuildReport | None = None) -> dict[str, Any]:
    """Return a dataset's numbers by family as JSON-ready data; a build's own with ``report``."""
    families = []
    for family, drawn in manifest.drawn.items():
        shards = [s for s in manifest.shards if s.family == family]
        rejected = Counter(r.reason for s in shards for r in s.rejections)
        row: dict[str, Any] = {
            "family": family,
            "drawn": drawn,
            "rejected": dict(rejected),
            "kept": sum(s.rows for s in shards),
            "vertices": sum(s.vertices for s in shards),
            "faces": sum(s.faces for s in shards),
        }
        if report is not None:
            row["core_seconds"] = round(report.seconds.get(family, 0.0), 3)
        families.append(row)
    summary: dict[str, Any] = {
        "version": manifest.version,
        "recipe_digest": manifest.recipe_digest,
        "families": families,
        "bytes": sum(s.size for s in manifest.shards),
        "packages": dict(manifest.packages),
    }
    if report is not None:
        summary |= {"directory": str(report.dataset.directory), **of_run(report)}
    return summary


def of_run(report: BuildReport) -> dict[str, Any]:
    """Return what a run took as JSON-ready data, but for what it took by family."""
    return {
        "wall_seconds": round(report.wall_seconds, 3),
        "nothing_to_do": report.nothing_to_do,
        "reused_shards": report.reused,
    }


def family_table(manifest: Manifest, seconds: dict[str, float] | None = None) -> str:
    """Return the table that ends a build: drawn, rejected and kept by family."""
    rows = summary(manifest)["families"]
    counted = ("drawn", "kept", "vertices", "faces")
    rejected: Counter[str] = Counter()
    for row in rows:
        rejected.update(row["rejected"])
    totals = {name: sum(row[name] for row in rows) for name in counted}
    rows.append({"family": "all", "drawn": 0, "rejected": rejected, **totals})
    for row in rows:
        reasons = (f"{count} {reason}" for reason, count in row["rejected"].items())
        row["rejected"] = ", ".join(reasons) or "0"
    if seconds is not None:
        for row in rows:
            row["core-seconds"] = round(seconds.get(row["family"], 0.0), 1)
        rows[-1]["core-seconds"] = round(sum(seconds.values()), 1)
    return str(tabulate(rows, headers="keys", intfmt=",", floatfmt=",.1f"))


def with_bars(make: Callable[..., Made], options: argparse.Namespace, of: str = "") -> Made:
    """Make something where and by whom the options of a command say, with a bar a family."""
    bars = FamilyBars(of)
    where = {"root": options.out, "workers": options.workers, "wait_for_lock": options.wait}
    with bars.progress:
        return make(watcher=bars, **where)


class FamilyBars(Watcher):
    """A progress bar for each family, on standard error; ``of``, what is made, before its name."""

    def __init__(self, of: str = "") -> None:
        self.of = of
        self.progress = progress(f"{{task.description:<{len(of) + 18}}}")
        self.tasks: dict[str, TaskID] = {}

    def planned(self, drawn: Mapping[str, int]) -> None:
        """Show the families with the number of their shapes."""
        for family, count in drawn.items():
            text = f"{self.of}{family}"
            self.tasks[family] = self.progress.add_task(text, total=count, start=False)

    def submitted(self, plan: ShardPlan) -> None:
        """Start the family's clock with its first shard."""
        task = self.tasks[plan.family]
        if not self.progress.tasks[task].started:
            self.progress.start_task(task)

    def finished(self, plan: ShardPlan, result: ShardResult) -> None:
        """Count a finished shard, and report what was wrong with a damaged one."""
        task = self.tasks[plan.family]
        self.progress.advance(task, len(plan.shapes))
        if not self.progress.console.is_terminal and self.progress.tasks[task].finished:
            self.progress.console.print(f"{self.of}{plan.family}: done")  # no bar moves in a log
        if result.damaged:
            self.progress.console.print(
                f"built again: {result.damaged}", highlight=False, markup=False, soft_wrap=True
            )
