"""What certified eigenvalues cost, against LaPy's solver.

Both sides get the same meshes in this process, on one thread, in turn; a mesh's time on a
side is the median of its repetitions. Ours includes assembly, ordering, the residuals and
the count by inertia; theirs is ``lapy.Solver(...).eigs(11)``, which certifies nothing. The
answers must agree to a relative 1e-9.

Usage: python benchmarks/solver.py [--shapes 160] [--spheres 40] [--repeats 3] [--json]
"""

import argparse
import json
import statistics
import sys
import time
from collections import defaultdict
from collections.abc import Callable

import lapy
import numpy as np
import threadpoolctl
from rich.progress import track
from tabulate import tabulate

from synthnet import recipe, spectrum
from synthnet.families import FAMILIES
from synthnet.recipe.plan import PlannedShape, plan_shards
from synthnet.types import Mesh

AGREE = 1e-9


def sample(count: int, seed: int, family: str | None = None) -> list[PlannedShape]:
    """Draw shapes of 1.0 at random, the same at every call, torus-00975 left out: rejected."""
    shapes = [
        shape
        for plan in plan_shards(recipe.load("1.0"))
        for shape in plan.shapes
        if family in (None, plan.family) and shape.spec.id != "torus-00975"
    ]
    chosen = np.random.default_rng(seed).choice(len(shapes), size=count, replace=False)
    return [shapes[number] for number in sorted(chosen)]


def timed(solve: Callable[[], np.ndarray]) -> tuple[float, np.ndarray]:
    """Return core-seconds and answer of a call."""
    started = time.process_time()
    answer = solve()
    return time.process_time() - started, answer


def compare(mesh: Mesh, repeats: int) -> tuple[float, float, float]:
    """Return the median seconds of both sides and how far the answers are apart."""
    exact = mesh.vertices.astype(np.float64)
    times: tuple[list[float], list[float]] = ([], [])
    apart = 0.0
    for number in range(repeats):
        sides = [
            (0, lambda: spectrum.compute(mesh).eigenvalues),
            (1, lambda: lapy.Solver(lapy.TriaMesh(exact, mesh.faces)).eigs(11)[0][1:]),
        ]
        answers = {}
        for side, solve in sides[:: 1 if number % 2 else -1]:
            seconds, answers[side] = timed(solve)
            times[side].append(seconds)
        apart = max(apart, float(np.abs(answers[0] / answers[1] - 1).max()))
    return statistics.median(times[0]), statistics.median(times[1]), apart


def measure(name: str, shapes: list[PlannedShape], repeats: int) -> list[dict]:
    """Return a row for each family of the shapes and one for all of them."""
    found = defaultdict(list)
    for shape in track(shapes, name, disable=not sys.stderr.isatty()):
        spec = shape.spec
        mesh = FAMILIES[spec.family].generate(spec.parameters).stored()
        found[spec.family].append((*compare(mesh, repeats), len(mesh.vertices)))
    found[name] = [row for rows in list(found.values()) for row in rows]
    return [
        {
            "meshes": family,
            "number": len(rows),
            "mean vertices": round(statistics.mean(row[3] for row in rows)),
            "synthNet ms": round(1e3 * statistics.mean(row[0] for row in rows), 2),
            "LaPy ms": round(1e3 * statistics.mean(row[1] for row in rows), 2),
            "LaPy / synthNet": round(sum(r[1] for r in rows) / sum(r[0] for r in rows), 2),
            "largest difference": max(row[2] for row in rows),
        }
        for family, rows in found.items()
    ]


def main() -> int:
    """Run the comparison and print a table or JSON; return 1 if an answer differs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shapes", type=int, default=160)
    parser.add_argument("--spheres", type=int, default=40)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    spectrum.compile_solver()
    with threadpoolctl.threadpool_limits(1):
        rows = measure("1.0's mix", sample(options.shapes, 1), options.repeats)
        spheres = sample(options.spheres, 2, "split_sphere")
        rows.append({**measure("", spheres, options.repeats)[-1], "meshes": "split spheres alone"})
    if options.json:
        print(json.dumps(rows, indent=1))
    else:
        print(tabulate(rows, headers="keys"))
        print("\ncore-milliseconds a mesh, one thread; ratios are of the sums")
    return int(max(row["largest difference"] for row in rows) > AGREE)


if __name__ == "__main__":
    sys.exit(main())
