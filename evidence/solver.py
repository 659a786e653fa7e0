"""What certified eigenvalues cost, against LaPy's solver.

Both sides get the same meshes in this process, on one thread, in turn; a mesh's time on a
side is the median of its repetitions. Ours includes assembly, ordering, the residuals and
the count by inertia; theirs is ``lapy.Solver(...).eigs(11)``, which certifies nothing. The
answers must agree to a relative 1e-9.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from functools import partial

import numpy as np
import threadpoolctl

from evidence import markdown, solvers
from evidence.timing import in_turn, progress
from synthnet import recipe, spectrum
from synthnet.families import FAMILIES
from synthnet.recipe.plan import PlannedShape, plan_shards
from synthnet.types import Mesh

AGREE = 1e-9


def measure(*, shapes: int = 160, spheres: int = 40, repeats: int = 3) -> dict:
    """Compare on a random sample of 1.0, and on split spheres, which have the most vertices."""
    spectrum.compile_solver()
    with threadpoolctl.threadpool_limits(1):
        rows = compared("1.0's mix", sample(shapes, 1), repeats)
        spheres = sample(spheres, 2, "split_sphere")
        alone = compared("split spheres alone", spheres, repeats)[-1]
    return {"rows": [*rows, alone]}


def problems(data: dict) -> list[str]:
    """Return which answers of the two sides differ."""
    return [
        f"{row['meshes']}: eigenvalues differ by {row['largest difference']:.0e}"
        for row in data["rows"]
        if row["largest difference"] > AGREE
    ]


def sample(count: int, seed: int, family: str | None = None) -> list[PlannedShape]:
    """Draw shapes of 1.0, the same in every run; torus-00975 is left out, as it is rejected."""
    shapes = [
        shape
        for plan in plan_shards(recipe.load("1.0"))
        for shape in plan.shapes
        if family in (None, plan.family) and shape.spec.id != "torus-00975"
    ]
    chosen = np.random.default_rng(seed).choice(len(shapes), size=count, replace=False)
    return [shapes[number] for number in sorted(chosen)]


def compared(name: str, shapes: list[PlannedShape], repeats: int) -> list[dict]:
    """Return a row for each family of the shapes, and one for all of them."""
    by_family = defaultdict(list)
    for shape in progress(shapes, name):
        mesh = FAMILIES[shape.spec.family].generate(shape.spec.parameters).stored()
        by_family[shape.spec.family].append((*beside_lapy(mesh, repeats), len(mesh.vertices)))
    groups = {**by_family, name: [row for rows in by_family.values() for row in rows]}
    return [
        {
            "meshes": group,
            "number": len(rows),
            "mean vertices": round(statistics.mean(row[3] for row in rows)),
            "synthNet ms": round(1e3 * statistics.mean(row[0] for row in rows), 2),
            "LaPy ms": round(1e3 * statistics.mean(row[1] for row in rows), 2),
            "LaPy / synthNet": round(sum(r[1] for r in rows) / sum(r[0] for r in rows), 2),
            "largest difference": max(row[2] for row in rows),
        }
        for group, rows in groups.items()
    ]


def beside_lapy(mesh: Mesh, repeats: int) -> tuple[float, float, float]:
    """Return the median seconds of both sides, and the largest relative difference."""
    sides = {"ours": partial(solvers.ours, mesh, 10), "LaPy": partial(solvers.lapy, mesh, 10)}
    ours, theirs = in_turn(sides, repeats).values()
    return ours.seconds, theirs.seconds, float(np.abs(ours.answer / theirs.answer - 1).max())


def claim(data: dict) -> str:
    """Return how many times as fast the certified solver is, over kinds of meshes."""
    ratios = [row["LaPy / synthNet"] for row in data["rows"]]
    return (
        f"The certified solver, its certificate included, is {min(ratios):.1f} to "
        f"{max(ratios):.1f} times as fast as `lapy.Solver(...).eigs(11)` on the families of 1.0, "
        "on one thread."
    )


def table(data: dict) -> str:
    """Return the comparison; times are core-milliseconds a mesh, ratios those of the sums."""
    rows = [{**row, "meshes": row["meshes"].replace("_", " ")} for row in data["rows"]]
    columns = {
        "meshes": "{meshes}",
        "number": "{number}",
        "mean vertices": "{mean vertices:,}",
        "synthNet ms": "{synthNet ms:.1f}",
        "LaPy ms": "{LaPy ms:.1f}",
        "ratio": "{LaPy / synthNet:.1f}",
        "largest relative difference": "{largest difference:.0e}",
    }
    return markdown.columns(rows, columns, "lr")
