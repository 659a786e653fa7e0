"""The command time: all rows of a board on one machine, by one clock."""

import argparse
import json
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tabulate import tabulate

from eigbench import results
from eigbench.board.tables import number
from eigbench.commands import arguments, predict
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError
from eigbench.results import timing
from eigbench.running import clock, machine, meshes, record, unseen
from eigbench.running.box import Settings
from eigbench.running.clock import Timed
from eigbench.running.meshes import Instances
from eigbench.running.predictor import check_file, code_name
from eigbench.running.process import REFERENCE_FILE
from eigbench.scoring import scores, targets, truth
from eigbench.scoring.truth import Truth
from synthnet import recipe, store
from synthnet.store.files import make_parent, write_text

FRESH = 50  # meshes that nobody has seen: five batches of ten


def add_commands(command: Command) -> None:
    """Add time to the command line."""
    text = "time several predictors and LaPy on the same meshes in turn; this runs the files' code"
    example = "a.py b.py --dataset 2.0-mini --meshes 20 --out times.json"
    sub = command("time", run_time, text, example)
    text = "the predictors' Python files"
    sub.add_argument("predictors", type=Path, nargs="+", metavar="FILE", help=text)
    text = "those of the files to which speed ratios are given, besides LaPy (default: none)"
    sub.add_argument("--against", type=Path, nargs="*", default=[], metavar="FILE", help=text)
    arguments.dataset(sub, "1.0", "a version")
    arguments.root(sub)
    count = "test meshes timed in each repeat, always the same"
    arguments.count(sub, "--meshes", "N", count, 100)
    arguments.count(sub, "--batch-size", "B", "meshes a call", 10)
    repeats = "batches of each size, of other shapes; the median of their times counts"
    arguments.count(sub, "--repeats", "R", repeats, 3)
    fresh = "meshes that nobody has seen, whose times show who knows the others; 0: none"
    arguments.count(sub, "--fresh", "N", fresh, FRESH, least=0)
    arguments.time_limit(sub, 600.0)
    predict.add_sandbox(sub)
    arguments.out(sub, "times.json", "the result")


def run_time(options: argparse.Namespace) -> int:
    """Time the predictors, write the file and print its table."""
    paths: list[Path] = options.predictors
    for path in paths:
        check_file(path)
    if unknown := [path for path in options.against if path not in paths]:
        raise EigbenchError(f"--against {unknown[0]}: name it among the predictors too")
    arguments.check_out("--out", options.out, ".json")
    if options.out.exists() and "timing_version" not in results.load(options.out):
        raise EigbenchError(f"{options.out} holds no times of `eigbench time`: give another --out")
    settings = predict.settings_of(options, Settings)
    make_parent(options.out)
    labels = truth.load(options.dataset)
    labels = labels.take(timing.asked(labels, options.meshes * options.repeats))
    public = len(labels.ids)
    console = Console(stderr=True)
    with console.status("reading the meshes") as status:
        instances = meshes.read(store.open_dataset(options.dataset, options.root), labels.ids)
        sizes = np.sort(instances.vertices(labels.ids))
        if options.fresh and recipe.load(options.dataset).scale is None:
            status.update(f"drawing and labelling {options.fresh} meshes that nobody has seen")
            labels, instances = with_unseen(labels, instances, options.fresh)
        timed = clock.together(
            [REFERENCE_FILE, *paths],
            labels,
            instances,
            fresh=len(labels.ids) - public,
            batch_size=options.batch_size,
            repeats=options.repeats,
            settings=settings,
            on_step=status.update,
        )
    content = described(timed, labels, sizes, options)
    write_text(options.out, json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    if options.json:
        print(json.dumps(content, indent=1, ensure_ascii=False))
    else:
        print(table(content["rows"]))
        about = f"{options.repeats} times {options.meshes} meshes of {options.dataset}"
        print(f"\n{about}, one thread each: {options.out}")
    against = [f"{row['name']}: {found}" for row in content["rows"] for found in timing.knows(row)]
    for found in against:
        print(f"eigbench: {found}, and a board refuses its times", file=sys.stderr)
    return 1 if against else 0


def with_unseen(labels: Truth, instances: Instances, count: int) -> tuple[Truth, Instances]:
    """Return labels and meshes with those of a fresh draw behind, at most ``count`` surfaces."""
    version = recipe.load(labels.version)
    surfaces = sum(map(version.drawn, version.families)) // version.copies
    with tempfile.TemporaryDirectory() as folder:
        draws = unseen.Draws(min(1.0, count / surfaces), Path(folder))
        fresh = draws.labels(labels)
        fresh = fresh.take(unseen.one_per_surface(fresh, count))
        drawn = meshes.read(draws.of(labels.version), fresh.ids)
    return unseen.mixed(labels, fresh), unseen.mixed_meshes(instances, drawn)


def described(
    timed: Sequence[Timed],
    labels: Truth,
    vertices: NDArray[np.int64],
    options: argparse.Namespace,
) -> dict[str, Any]:
    """Return what the file holds: a row for every predictor but LaPy as the reference.

    ``labels`` are those of the meshes, fresh ones behind the others; ``vertices`` the numbers of
    the others, ascending as they were timed. ``rpd`` has the errors of the answers that were timed,
    at each target: a row of the board must have the same on the same meshes.
    """
    lapy, *others = timed
    parts = clock.in_sizes(vertices, options.batch_size, options.repeats)
    sizes = np.array([len(part) // options.repeats for part in parts])
    peers = {t.loaded.meta["name"]: t.seconds for t in others if t.path in options.against}
    public = len(vertices)
    return {
        "timing_version": timing.VERSION,
        "dataset": options.dataset,
        "meshes": options.meshes,
        "fresh_meshes": len(labels.ids) - public,
        "vertices": [round(float(part.mean()), 1) for part in parts],  # mean of each size
        "repeats": options.repeats,
        "hardware": machine.hardware(),
        "environment": machine.environment(),
        "rows": [
            {**_row(row, sizes, lapy.seconds, peers, options), **errors(row, labels, public)}
            for row in others
        ],
    }


def errors(timed: Timed, labels: Truth, public: int) -> dict[str, Any]:
    """Return mean errors on the public meshes at each target, and what there is of fresh ones.

    The public meshes are the first of the labels. ``chance`` is from a rank test (Mann-Whitney, one
    side): who is often exact has few errors by which medians could be compared.
    """
    of_public = labels.take(np.arange(public))
    answered = timed.predictions[:, :public]
    said: dict[str, Any] = {
        "rpd": {
            known.target: float(scores.of_metric(known, answered, "rpd").mean())
            for known in targets.every(of_public)
        }
    }
    if public < len(labels.ids):
        from scipy.stats import mannwhitneyu  # as late as here: it takes half a second

        known, fresh = np.split(scores.of_metric(labels, timed.predictions, "rpd")[0], [public])
        said["fresh"] = {
            "rpd": float(np.median(fresh)),
            "rpd_public": float(np.median(known)),
            "chance": float(mannwhitneyu(fresh, known, alternative="greater").pvalue),
        }
        if timed.longer is not None:
            said["fresh"]["longer"] = timed.longer
    return said


def _row(
    timed: Timed,
    sizes: np.ndarray,
    lapy: np.ndarray,
    peers: dict[str, np.ndarray],
    options: argparse.Namespace,
) -> dict[str, Any]:
    each = 1e3 * timed.seconds / sizes
    return {
        "name": timed.loaded.meta["name"],
        "code": code_name(timed.path),
        "sources": timed.status.sources,
        "loading_seconds": timed.loaded.loading_seconds,
        "cost": {
            **record.times(timed.seconds, timed.cpu_seconds, sizes),
            "ms_by_batch": [float(f"{value:.5g}") for value in each],  # by size, ascending
            "batch_size": options.batch_size,
            "threads": 1,
            "device": "cpu",
            "peak_memory_mb": timed.status.peak_bytes / 2**20,
            "counted_by": timed.status.counted_by,
            "hardware": machine.hardware(),
            "reference": {
                "solver": "LaPy",
                "meshes": int(sizes.sum()),
                "ms_per_mesh": float(1e3 * lapy.sum() / sizes.sum()),
                **timing.ratio(lapy, timed.seconds),
            },
            "peers": {
                name: timing.ratio(seconds, timed.seconds) for name, seconds in peers.items()
            },
        },
    }


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the times as text, the fastest first."""
    lines = []
    for row in sorted(rows, key=lambda row: row["cost"]["ms_per_mesh_mean"]):
        cost = row["cost"]
        ratios = [cost["reference"], *cost["peers"].values()]
        cells = [f"{r['ratio']:.3g} ({r['low']:.3g} to {r['high']:.3g})" for r in ratios]
        ms, cores = number(cost["ms_per_mesh_mean"], 2), number(cost["cores_used"], 2)
        lines.append([row["name"], ms, *cells, cores])
    peers = list(rows[0]["cost"]["peers"]) if rows else []
    beside = [f"× faster than {name}" for name in ["LaPy", *peers]]
    headers = ["model", "ms per mesh", *beside, "cores"]
    return str(tabulate(lines, headers=headers, disable_numparse=True))
