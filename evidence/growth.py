"""How time and memory grow with the mesh: one torus from a thousand to a million vertices.

Each solve is a process of its own, on one thread: its seconds (the median of the
repetitions, one above 100,000 vertices) and by how much it raised the process's peak memory.
Writes docs/data/growth.json, docs/growth.svg and the table in docs/labels.md.

Usage: python benchmarks/growth.py [--largest 1000000]
"""

import argparse
import json
import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

import matplotlib
import numpy as np
import threadpoolctl
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from rich.progress import track
from tabulate import tabulate

from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.store.files import write_marked, write_text
from synthnet.types import Mesh

DOCS = Path(__file__).parent.parent / "docs"
STEPS = (1.3, 2.24, 4.08, 7.07, 12.9, 22.4, 40.83)  # of a mesh of 600 step² vertices
TWICE = 100_000  # vertices up to which a solve is repeated
NAMES = {"synthnet": "synthNet, certified", "lapy": "LaPy"}
COLOURS = {"synthnet": "#0072b2", "lapy": "#d55e00"}


def torus(step: float) -> Mesh:
    """Return a torus of radii 1 and 10^-1/2 with 600 step² vertices, nearly."""
    return FAMILIES["torus"].generate(
        {
            "torus_radius": 1.0,
            "tube_radius": 10**-0.5,
            "radial_resolution": round(30 * step),
            "tubular_resolution": round(20 * step),
        }
    )


def peak() -> float:
    """Return the most memory this process has held, in MB."""
    text = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+) kB", text).group(1)) / 1e3


def solve_one(side: str, step: float) -> dict:
    """Solve in this process and return what it took."""
    import lapy

    mesh = torus(step)
    small = torus(1.0)

    def solve(mesh: Mesh) -> np.ndarray:
        if side == "synthnet":
            return spectrum.compute(mesh).eigenvalues
        return lapy.Solver(lapy.TriaMesh(mesh.vertices, mesh.faces)).eigs(11)[0][1:]

    with threadpoolctl.threadpool_limits(1):
        solve(small)
        before, seconds = peak(), []
        for _ in range(3 if len(mesh.vertices) <= TWICE else 1):
            started = time.perf_counter()
            values = solve(mesh)
            seconds.append(time.perf_counter() - started)
    return {
        "side": side,
        "vertices": len(mesh.vertices),
        "seconds": statistics.median(seconds),
        "megabytes": peak() - before,
        "eigenvalues": values.tolist(),
    }


def measure(largest: int) -> list[dict]:
    """Solve every size on both sides, each in a new process."""
    rows = []
    steps = [step for step in STEPS if 600 * step**2 <= 1.001 * largest]
    jobs = [(side, step) for step in steps for side in NAMES]
    for side, step in track(jobs, "solving", disable=not sys.stderr.isatty()):
        command = [sys.executable, __file__, "--one", side, str(step)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.stderr.write(f"{side} on {600 * step**2:,.0f} vertices: {done.stderr[-200:]}\n")
            continue
        rows.append(json.loads(done.stdout))
    return rows


def exponent(rows: list[dict], key: str) -> float:
    """Return the slope of the upper half of a log-log plot."""
    upper = rows[len(rows) // 2 :]
    x, y = (np.log([row[k] for row in upper]) for k in ("vertices", key))
    return float(np.polyfit(x, y, 1)[0])


def table(rows: list[dict]) -> str:
    """Return the Markdown table, and the largest difference between the sides."""
    sides = {side: {r["vertices"]: r for r in rows if r["side"] == side} for side in NAMES}
    lines, apart = [], 0.0
    for n, ours in sides["synthnet"].items():
        theirs = sides["lapy"].get(n)
        line = [f"{n:,}", f"{ours['seconds']:.3g}", f"{ours['megabytes']:,.0f}"]
        if theirs is None:
            lines.append([*line, "failed", "failed", ""])
            continue
        ratio = theirs["seconds"] / ours["seconds"]
        line += [f"{theirs['seconds']:.3g}", f"{theirs['megabytes']:,.0f}", f"{ratio:.1f}"]
        lines.append(line)
        pair = (np.array(r["eigenvalues"]) for r in (ours, theirs))
        apart = max(apart, float(np.abs(np.divide(*pair) - 1).max()))
    headers = ["vertices", "synthNet s", "synthNet MB", "LaPy s", "LaPy MB", "ratio of times"]
    slopes = ", ".join(
        f"{NAMES[side]} {exponent(list(found.values()), 'seconds'):.2f} in time and "
        f"{exponent(list(found.values()), 'megabytes'):.2f} in memory"
        for side, found in sides.items()
    )
    grid = tabulate(
        lines, headers, tablefmt="github", disable_numparse=True, colalign=["right"] * 6
    )
    return (
        f"{grid}\n\nSlopes of the upper half of the log-log plot: {slopes}. The eigenvalues "
        f"differ by at most {apart:.0e} relative."
    )


def draw(rows: list[dict], path: Path) -> None:
    """Draw time and memory against vertices, both axes logarithmic."""
    matplotlib.rcParams["svg.hashsalt"] = "synthnet"
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    FigureCanvasSVG(figure)
    for axes, key, label in zip(
        figure.subplots(1, 2), ("seconds", "megabytes"), ("seconds", "MB"), strict=True
    ):
        for side, name in NAMES.items():
            mine = [(r["vertices"], r[key]) for r in rows if r["side"] == side]
            axes.loglog(*zip(*mine, strict=True), "o-", color=COLOURS[side], label=name)
        axes.set_xlabel("vertices")
        axes.set_ylabel(label)
        axes.grid(True, which="both", alpha=0.2)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False)
    figure.savefig(path, metadata={"Date": None, "Creator": None})


def main() -> None:
    """Measure, write the numbers, the plot and the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=1_000_000)
    parser.add_argument("--one", nargs=2, metavar=("SIDE", "STEP"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(solve_one(options.one[0], float(options.one[1]))))
        return
    spectrum.compile_solver()
    rows = measure(options.largest)
    write_text(DOCS / "data" / "growth.json", json.dumps(rows, indent=1) + "\n")
    draw(rows, DOCS / "growth.svg")
    write_marked(DOCS / "labels.md", growth=f"\n{table(rows)}\n")
    print(table(rows))


if __name__ == "__main__":
    main()
