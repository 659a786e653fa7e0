"""The whole of a version, once: a plain loop over Open3D and LaPy, then the build.

The loop makes each mesh by Open3D's methods, calls ``lapy.Solver(...).eigs(11)`` and keeps the
eigenvalues; it checks and stores nothing. Both have as many processes, of one thread each. A shape
on which LaPy fails is counted, and the loop goes on. It takes a quarter of an hour on two cores.
"""

from __future__ import annotations

import multiprocessing
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import threadpoolctl

from evidence.build_cost import plain_label
from evidence.timing import progress
from synthnet import recipe
from synthnet.build.versions import build
from synthnet.recipe.plan import plan_shards
from synthnet.types import ShapeSpec

CHUNK = 50


def measure(*, version: str = "1.0", workers: int = 2) -> dict:
    """Time both, one after the other."""
    whole = recipe.load(version)
    specs = [shape.spec for plan in plan_shards(whole) for shape in plan.shapes]
    chunks = [specs[i : i + CHUNK] for i in range(0, len(specs), CHUNK)]
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        list(pool.map(plain_loop, [specs[:1]] * 2 * workers))  # imports are not timed
        started = time.perf_counter()
        done = list(progress(pool.map(plain_loop, chunks), "plain loop", len(chunks)))
        plain = time.perf_counter() - started
    with tempfile.TemporaryDirectory() as home:
        report = build(whole, root=home, workers=workers)
    return {
        "version": version,
        "workers": workers,
        "drawn": len(specs),
        "plain labelled": sum(labelled for labelled, _ in done),
        "plain failed": sum(failed for _, failed in done),
        "plain seconds": round(plain, 1),
        "build seconds": round(report.wall_seconds, 1),
        "ratio": round(report.wall_seconds / plain, 3),
    }


def plain_loop(specs: list[ShapeSpec]) -> tuple[int, int]:
    """Label shapes as one would by hand; return how many were labelled, and how many failed."""
    labels, failed = [], 0
    with threadpoolctl.threadpool_limits(1):
        for spec in specs:
            try:
                labels.append(plain_label(spec))
            except (RuntimeError, ValueError, np.linalg.LinAlgError):
                failed += 1
    return len(labels), failed
