"""What the harness adds to a predictor's time, against a bare loop over the same meshes.

    python benchmarks/harness_overhead.py [--version 1.0-mini] [--rounds 5] [--json]

Both sides run with one thread and batches of 34 meshes: the harness in its process, and a
process that makes the same batches, calls `predict` and looks at the clock. They take turns;
the ratio is that of the medians over rounds of the whole time charged. Beside it stands
what is not charged: starting, reading, sending meshes and answers.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from eigbench.running import meshes as instances
from eigbench.running import predictor
from eigbench.running.evaluate import WARM_UP, Options, evaluate
from eigbench.running.process import THREAD_VARIABLES
from eigbench.scoring import truth
from tabulate import tabulate

from synthnet import store

BASELINES = Path(__file__).parent.parent / "baselines"
PREDICTORS = ("weyl", "ritz3", "exact")
BATCH = 34


def bare(name: str, version: str) -> float:
    """Return the seconds of a plain loop over batches."""
    loaded = predictor.load(BASELINES / f"{name}.py")
    wanted = truth.load(version)
    read = instances.read(store.open_dataset(version), wanted.ids)
    ids = [wanted.ids[i] for i in wanted.order]
    loaded.predict([read.mesh(id) for id in ids[:WARM_UP]])
    total = 0.0
    for first in range(0, len(ids), BATCH):
        meshes = [read.mesh(id) for id in ids[first : first + BATCH]]
        started = time.perf_counter()
        loaded.predict(meshes)
        total += time.perf_counter() - started
    return total


def charged(name: str, version: str) -> tuple[float, float]:
    """Return the seconds the harness charges, and those of the whole evaluation."""
    with tempfile.TemporaryDirectory() as parts:
        started = time.perf_counter()
        evaluation = evaluate(
            BASELINES / f"{name}.py",
            truth.load(version),
            instances.read(store.open_dataset(version), truth.load(version).ids),
            Options(batch_size=BATCH),
            Path(parts),
        )
        return float(evaluation.seconds.sum()), time.perf_counter() - started


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--version", default="1.0-mini")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--json", action="store_true", help="print JSON, as docs/data keeps it")
    parser.add_argument("--bare", choices=PREDICTORS, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.bare:
        print(bare(options.bare, options.version))
        return
    one_thread = {**os.environ, **dict.fromkeys(THREAD_VARIABLES, "1")}
    rows = []
    count = len(truth.load(options.version).ids)
    for name in PREDICTORS:
        plain, harness, whole = [], [], []
        for _ in range(options.rounds):
            command = [sys.executable, __file__, "--bare", name, "--version", options.version]
            done = subprocess.run(command, env=one_thread, capture_output=True, check=True)
            plain.append(float(done.stdout))
            seconds, wall = charged(name, options.version)
            harness.append(seconds)
            whole.append(wall)
        rows.append(
            {
                "predictor": name,
                "bare ms": round(1e3 * float(np.median(plain)) / count, 3),
                "charged ms": round(1e3 * float(np.median(harness)) / count, 3),
                "ratio": round(float(np.median(harness) / np.median(plain)), 3),
                "not charged ms": round(
                    1e3 * float(np.median(np.subtract(whole, harness))) / count, 3
                ),
            }
        )
        print(f"{name}: done", file=sys.stderr, flush=True)
    if options.json:
        report = {"version": options.version, "meshes": count, "rounds": options.rounds}
        print(json.dumps({**report, "rows": rows}, indent=1))
    else:
        print(tabulate(rows, headers="keys"))


if __name__ == "__main__":
    main()
