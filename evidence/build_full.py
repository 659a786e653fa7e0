"""The whole of 1.0, once: a plain loop over Open3D and LaPy, then the build, on as many processes.

The loop makes each mesh by Open3D's methods, calls ``lapy.Solver(...).eigs(11)`` and keeps the
eigenvalues; it checks and stores nothing. Every process has one thread. Where LaPy fails on a
shape, that shape is counted and the loop goes on. Takes a quarter of an hour on two cores;
the result goes to docs/data/build-full.json.

Usage: python benchmarks/build_full.py [--version 1.0] [--workers 2]
"""

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import lapy
import numpy as np
import threadpoolctl
from build_cost import plain_mesh
from rich.progress import track

from synthnet import recipe
from synthnet.build.versions import build
from synthnet.recipe.plan import plan_shards
from synthnet.store.files import write_text
from synthnet.types import ShapeSpec

RESULT = Path(__file__).parent.parent / "docs" / "data" / "build-full.json"
CHUNK = 50


def plain_loop(specs: list[ShapeSpec]) -> tuple[int, int]:
    """Label shapes as one would by hand; return how many were, and how many failed."""
    labels, failed = [], 0
    with threadpoolctl.threadpool_limits(1):
        for spec in specs:
            vertices, faces = plain_mesh(spec.family, dict(spec.parameters))
            try:
                labels.append(lapy.Solver(lapy.TriaMesh(vertices, faces)).eigs(11)[0][1:])
            except (RuntimeError, ValueError, np.linalg.LinAlgError):
                failed += 1
    return len(labels), failed


def main() -> None:
    """Time both and write the result."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--version", default="1.0")
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    wanted = recipe.load(options.version)
    specs = [shape.spec for plan in plan_shards(wanted) for shape in plan.shapes]
    chunks = [specs[i : i + CHUNK] for i in range(0, len(specs), CHUNK)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(options.workers, mp_context=context) as pool:
        list(pool.map(plain_loop, [specs[:1]] * 2 * options.workers))  # imports are not timed
        started = time.perf_counter()
        done = list(
            track(
                pool.map(plain_loop, chunks),
                "plain loop",
                total=len(chunks),
                disable=not sys.stderr.isatty(),
            )
        )
        plain = time.perf_counter() - started
    with tempfile.TemporaryDirectory() as home:
        report = build(wanted, root=home, workers=options.workers)
    row = {
        "version": options.version,
        "workers": options.workers,
        "drawn": len(specs),
        "plain labelled": sum(count for count, _ in done),
        "plain failed": sum(failed for _, failed in done),
        "plain seconds": round(plain, 1),
        "build seconds": round(report.wall_seconds, 1),
        "ratio": round(report.wall_seconds / plain, 3),
    }
    write_text(RESULT, json.dumps(row, indent=1) + "\n")
    print(json.dumps(row, indent=1))


if __name__ == "__main__":
    main()
