"""The solver beside others at their best: time, memory and missed eigenvalues by mesh and k.

Each solve is a process of its own, on one thread: the median of its repetitions, by how much it
raised the process's peak memory, and what :func:`synthnet.spectrum.certify` finds of its answer.
"""

import math
import statistics
import sys
import time
from collections.abc import Callable
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import threadpoolctl

from evidence import markdown, solvers
from evidence.figures import drawn, label_axes
from evidence.growth import torus
from evidence.timing import in_new_process, peak_mb, progress
from synthnet import spectrum
from synthnet.pictures.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION
from synthnet.spectrum import Operator
from synthnet.types import Mesh

GRID = {10_000: (10, 50, 100, 200, 500), 40_000: (10, 50, 100, 200, 500)}
MOST = 10_000_000  # vertices times pairs: all others but the fastest take minutes beyond
LONG = (100_000, 1000)  # vertices and pairs of the certified solver alone
ENOUGH = 5.0  # seconds; slower solves are not repeated
FEW = 50  # pairs; LOBPCG is asked for no more
COLOURS = BLUE, VERMILION, ORANGE, GREEN, SKY, PURPLE, GREY  # of the plot, in the order of PEERS


# Its name, the call, the operator that it solves, and up to how many pairs it is asked for.
PEERS: dict[str, tuple[Callable[[Mesh, int], np.ndarray], dict[str, str], float]] = {
    "synthNet, certified": (solvers.ours, {}, math.inf),
    "LaPy": (solvers.lapy, {}, math.inf),
    "LaPy with CHOLMOD": (solvers.lapy_cholmod, {}, math.inf),
    "robust_laplacian and SciPy": (solvers.robust, {"elements": "tufted"}, math.inf),
    "MKL PARDISO and SciPy": (solvers.pardiso, {}, math.inf),
    "pyamg and LOBPCG": (solvers.lobpcg, {}, FEW),
}
FASTEST = ("synthNet, certified", "LaPy with CHOLMOD")


def measure(*, largest: int = 40_000) -> dict:
    """Solve every mesh on every side, each in a new process; what fails is left out."""
    spectrum.compile_solver()
    cases = [
        (name, vertices, k)
        for vertices, counts in GRID.items()
        if vertices <= largest
        for k in counts
        for name, (_, _, most) in PEERS.items()
        if k <= most and (vertices * k <= MOST or name in FASTEST)
    ]
    rows = []
    for case in progress(cases, "solving"):
        try:
            rows.append(in_new_process(solve, *case))
        except (BrokenProcessPool, ImportError, ArithmeticError, RuntimeError, ValueError) as error:
            sys.stderr.write(f"{', '.join(map(str, case))}: {error}\n")
    long = in_new_process(solve, next(iter(PEERS)), *LONG) if largest >= max(GRID) else None
    return {"rows": rows, "long": long}


def solve(name: str, vertices: int, k: int) -> dict:
    """Solve in this process, and return what it took and what its answer lacks."""
    solver, operator, _ = PEERS[name]
    mesh = torus(math.sqrt(vertices / 600))
    with threadpoolctl.threadpool_limits(1):
        solver(torus(1.0), 5)
        before, seconds = peak_mb(), []
        while len(seconds) < 3 and sum(seconds) < ENOUGH:
            started = time.perf_counter()
            values = solver(mesh, k)
            seconds.append(time.perf_counter() - started)
        used = peak_mb() - before
    verdict = spectrum.certify(mesh, values, tolerance=1e-5, operator=Operator(**operator))
    return {
        "name": name,
        "vertices": len(mesh.vertices),
        "k": k,
        "seconds": statistics.median(seconds),
        "megabytes": used,
        "missed": len(verdict.missed),
        "off": len(verdict.off),
    }


def table(data: dict) -> str:
    """Return seconds by solver and case, the certified solver's ratio, memory and misses."""
    cases = list(dict.fromkeys((row["vertices"], row["k"]) for row in data["rows"]))
    body = []
    for name in PEERS:
        mine = {(row["vertices"], row["k"]): row for row in data["rows"] if row["name"] == name}
        if not mine:
            continue
        cells = [f"{mine[case]['seconds']:.2g}" if case in mine else "" for case in cases]
        memory = max(row["megabytes"] for row in mine.values())
        wrong = sum(row["missed"] + row["off"] for row in mine.values())
        body.append([name, *cells, f"{memory:,.0f}", str(wrong)])
    headers = ["seconds", *(f"{n:,}, k = {k}" for n, k in cases), "most MB", "missed or off"]
    return markdown.table(headers, body, "lr")


def long(data: dict) -> str:
    """Return what the longest spectrum took, as a sentence."""
    row = data["long"]
    return (
        f"{row['k']:,} eigenpairs of {row['vertices']:,} vertices take {row['seconds']:.0f} s on "
        f"one thread and {row['megabytes'] / 1000:.1f} GB, "
        f"{row['vertices'] * row['k'] * 8 / 1e9:.1f} of them the eigenvectors."
    )


def claim(data: dict) -> str:
    """Return the smallest and the largest ratio to LaPy with CHOLMOD, by k, as a sentence."""
    seconds = {(row["name"], row["vertices"], row["k"]): row["seconds"] for row in data["rows"]}
    first, peer = FASTEST
    ratios = {
        (n, k): seconds[peer, n, k] / seconds[first, n, k]
        for name, n, k in seconds
        if name == first and (peer, n, k) in seconds
    }
    pairs = [k for _, k in ratios]
    return (
        f"The certified solver is {min(ratios.values()):.1f} to {max(ratios.values()):.1f} times "
        f"as fast as LaPy with CHOLMOD, for {min(pairs)} to {max(pairs)} eigenpairs."
    )


def draw(data: dict) -> None:
    """Draw ``docs/peers.svg``: seconds against pairs by solver, one panel per mesh, logarithmic."""
    meshes = list(dict.fromkeys(row["vertices"] for row in data["rows"]))
    with drawn("peers.svg") as figure:
        for axes, n in zip(figure.subplots(1, len(meshes), squeeze=False)[0], meshes, strict=True):
            for name, colour in zip(PEERS, COLOURS, strict=False):
                rows = [row for row in data["rows"] if (row["name"], row["vertices"]) == (name, n)]
                points = [(row["k"], row["seconds"]) for row in rows]
                if points:
                    axes.loglog(*zip(*points, strict=True), "o-", color=colour, label=name)
            axes.set_title(f"{n:,} vertices", fontsize="medium")
            label_axes(axes, "eigenpairs", "seconds")
        handles = axes.get_legend_handles_labels()
        below = {"loc": "outside lower center", "ncols": 3, "frameon": False, "fontsize": "small"}
        figure.legend(*handles, **below)
