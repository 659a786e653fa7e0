"""How soon a new process has synthnet imported, and how soon its first eigenvalue.

Each program is a fresh process, in turn with a Python that does nothing; seconds are the median of
those from its start to its end. The solver's machine code is in the cache, as after the first use.
"""

from __future__ import annotations

import subprocess
import sys
import time
from functools import partial

from evidence.timing import in_turn
from synthnet.spectrum import compile_solver

IMPORT, FIRST = 0.15, 1.5  # seconds: what `import synthnet` may add, and the first eigenvalue take
SIDE = 32  # vertices along the unit square of which it is
EIGENVALUE = f"""
import numpy as np
from synthnet.spectrum import compute

x, y = np.meshgrid(*[np.linspace(0, 1, {SIDE})] * 2)
points = np.stack([x.ravel(), y.ravel(), np.zeros({SIDE**2})], axis=1)
corners = np.arange({SIDE**2}).reshape({SIDE}, {SIDE})[:-1, :-1].ravel()
halves = [corners[:, None] + [0, 1, {SIDE + 1}], corners[:, None] + [0, {SIDE + 1}, {SIDE}]]
assert abs(compute((points, np.concatenate(halves)), 1).eigenvalues[0] / np.pi**2 - 1) < 0.01
"""
PROGRAMS = {"nothing": "", "import": "import synthnet", "eigenvalue": EIGENVALUE}


def measure(*, repeats: int = 21) -> dict:
    """Return the median seconds of each program."""
    compile_solver()
    sides = {name: partial(run, program) for name, program in PROGRAMS.items()}
    in_turn(sides)  # brings the files into memory
    timed = in_turn(sides, repeats, clock=time.perf_counter)
    return {"repeats": repeats, **{name: round(timed[name].seconds, 4) for name in PROGRAMS}}


def run(program: str) -> None:
    """Run a program in a new process."""
    subprocess.run([sys.executable, "-c", program], check=True)


def problems(data: dict) -> list[str]:
    """Return what takes longer than it may."""
    took = {"import synthnet": data["import"] - data["nothing"], "eigenvalue": data["eigenvalue"]}
    limits = {"import synthnet": IMPORT, "eigenvalue": FIRST}
    return [
        f"{name}: {seconds:.2f} s, more than {limits[name]} s"
        for name, seconds in took.items()
        if seconds > limits[name]
    ]


def claim(data: dict) -> str:
    """Return how long both take, as a part of a sentence."""
    added = max(data["import"] - data["nothing"], 0.0)
    return (
        f"`import synthnet` takes {1e3 * added:.0f} ms, and a new process has its first eigenvalue "
        f"{data['eigenvalue']:.2f} s after its start, {data['nothing']:.2f} s of them Python's own"
    )
