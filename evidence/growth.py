"""How time and memory grow with the mesh: one torus from a thousand to a million vertices.

Each solve is a process of its own, on one thread: its seconds (the median of the
repetitions, one above 100,000 vertices) and by how much it raised the process's peak memory.
Meshes that are large enough for it are solved once more on two threads.
"""

from __future__ import annotations

import statistics
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from functools import partial

import numpy as np
import threadpoolctl

from evidence import markdown, solvers
from evidence.figures import drawn, label_axes
from evidence.timing import in_new_process, peak_mb, progress
from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.pictures.palette import BLUE
from synthnet.processes import THREADS
from synthnet.spectrum.ordering import LARGE
from synthnet.types import Mesh

STEPS = (1.3, 2.24, 4.08, 7.07, 12.9, 22.4, 40.83)  # a mesh has 600 step² vertices
TWICE = 100_000  # vertices up to which a solve is repeated
NAMES = {"synthnet": "synthNet, certified", "lapy": "LaPy"}  # on one thread
TWO = "synthnet, two threads"
LOOKS = {"synthnet": {"ls": "-"}, "lapy": {"ls": "--", "mfc": "white"}}  # solvers: one colour


def measure(*, largest: int = 1_000_000) -> dict:
    """Solve every size on both sides, each in a new process; what fails is left out."""
    spectrum.compile_solver()
    steps = [step for step in STEPS if 600 * step**2 <= 1.001 * largest]
    solves = [(side, step) for step in steps for side in NAMES]
    solves += [(TWO, step) for step in steps if 600 * step**2 >= LARGE]
    rows = []
    for side, step in progress(solves, "solving"):
        threads = {THREADS: "2" if side == TWO else "1"}
        try:
            rows.append(in_new_process(solve, side, step, environment=threads))
        except (BrokenProcessPool, ArithmeticError, MemoryError, RuntimeError, ValueError) as error:
            sys.stderr.write(f"{side} on {600 * step**2:,.0f} vertices: {error}\n")
    return {"rows": rows}


def torus(step: float) -> Mesh:
    """Return a torus of radii 1 and 10^-1/2 with 600 step² vertices, nearly."""
    radii = {"torus_radius": 1.0, "tube_radius": 10**-0.5}
    steps = {"radial_resolution": round(30 * step), "tubular_resolution": round(20 * step)}
    return FAMILIES["torus"].generate(radii | steps)


def solve(side: str, step: float) -> dict:
    """Solve in this process, and return what it took."""
    eigenvalues = partial(solvers.lapy if side == "lapy" else solvers.ours, k=10)
    mesh = torus(step)
    with threadpoolctl.threadpool_limits(1):
        eigenvalues(torus(1.0))
        before, seconds = peak_mb(), []
        for _ in range(3 if len(mesh.vertices) <= TWICE else 1):
            started = time.perf_counter()
            values = eigenvalues(mesh)
            seconds.append(time.perf_counter() - started)
    return {
        "side": side,
        "vertices": len(mesh.vertices),
        "seconds": statistics.median(seconds),
        "megabytes": peak_mb() - before,
        "eigenvalues": values.tolist(),
    }


def table(data: dict) -> str:
    """Return both sides, their slopes, and the largest difference between their answers."""
    solved = {
        side: {row["vertices"]: row for row in data["rows"] if row["side"] == side}
        for side in (*NAMES, TWO)
    }
    rows, difference = [], 0.0
    for n, ours in solved["synthnet"].items():
        row = [f"{n:,}", f"{ours['seconds']:.3g}", f"{ours['megabytes']:,.0f}"]
        theirs, on_two = solved["lapy"].get(n), solved[TWO].get(n)
        if theirs:
            ratio = theirs["seconds"] / ours["seconds"]
            row += [f"{theirs['seconds']:.3g}", f"{theirs['megabytes']:,.0f}", f"{ratio:.1f}"]
            quotient = np.divide(ours["eigenvalues"], theirs["eigenvalues"])
            difference = max(difference, float(np.abs(quotient - 1).max()))
        else:
            row += ["failed", "failed", ""]
        if on_two and on_two["eigenvalues"] != ours["eigenvalues"]:
            raise ValueError(f"{n:,} vertices have other eigenvalues on two threads")
        row.append(f"{on_two['seconds']:.3g}" if on_two else "")
        row.append(f"{theirs['seconds'] / on_two['seconds']:.1f}" if theirs and on_two else "")
        rows.append(row)
    headers = ["vertices", "synthNet s", "synthNet MB", "LaPy s", "LaPy MB", "ratio of times"]
    headers += ["synthNet s, two threads", "ratio"]
    slopes = ", ".join(
        f"{name} {exponent(list(solved[side].values()), 'seconds'):.2f} in time and "
        f"{exponent(list(solved[side].values()), 'megabytes'):.2f} in memory"
        for side, name in NAMES.items()
    )
    return (
        f"{markdown.table(headers, rows, 'r')}\n\nSlopes of the upper half of the log-log plot: "
        f"{slopes}. The eigenvalues differ by at most {difference:.0e} relative."
    )


def exponent(rows: list[dict], key: str) -> float:
    """Return the slope of the upper half of a log-log plot."""
    upper = rows[len(rows) // 2 :]
    x, y = (np.log([row[k] for row in upper]) for k in ("vertices", key))
    return float(np.polyfit(x, y, 1)[0])


def draw(data: dict) -> None:
    """Draw ``docs/growth.svg``: time and memory against vertices, all axes logarithmic."""
    with drawn("growth.svg") as figure:
        labels = {"seconds": "seconds", "megabytes": "MB"}
        for axes, (key, label) in zip(figure.subplots(1, 2), labels.items(), strict=True):
            for side, name in NAMES.items():
                rows = [row for row in data["rows"] if row["side"] == side]
                points = zip(*((row["vertices"], row[key]) for row in rows), strict=True)
                axes.loglog(*points, marker="o", color=BLUE, **LOOKS[side], label=name)
            label_axes(axes, "vertices", label)
            axes.legend(frameon=False)
