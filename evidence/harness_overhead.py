"""What the harness adds to a predictor's time, against a bare loop over the same meshes.

Both sides run with one thread and batches of 34 meshes: the harness in its process, and a
process that makes the same batches, calls `predict` and looks at the clock. They take turns;
the ratio is that of the medians over rounds of the whole time charged. Beside it stands
what is not charged: starting, reading, sending meshes and answers.
"""

import tempfile
import time
from pathlib import Path

import numpy as np
from eigbench.results import timing
from eigbench.running import meshes as instances
from eigbench.running import predictor
from eigbench.running.evaluate import WARM_UP, Options, evaluate
from eigbench.running.process import THREAD_VARIABLES
from eigbench.scoring import truth

from evidence import BASELINES, ROOT, markdown
from evidence.timing import in_new_process, progress
from synthnet import store

PREDICTORS = ("weyl", "ritz3", "exact")
BATCH = 34


def measure(*, version: str = "1.0-mini", rounds: int = 5) -> dict:
    """Return one row per predictor."""
    count = len(truth.load(version).ids)
    rows = [row(name, version, rounds, count) for name in progress(PREDICTORS, "predictors")]
    return {"version": version, "meshes": count, "rounds": rounds, "rows": rows}


def row(name: str, version: str, rounds: int, count: int) -> dict:
    """Return the median milliseconds a mesh of both sides, in turn, and of what is not charged."""
    one_thread = dict.fromkeys(THREAD_VARIABLES, "1")
    seconds = []
    for _ in range(rounds):
        plain = in_new_process(bare, name, version, environment=one_thread)
        harness, whole = charged(name, version)
        seconds.append((plain, harness, whole - harness))
    plain, harness, rest = np.median(seconds, axis=0).tolist()
    return {
        "predictor": name,
        "bare ms": round(1e3 * plain / count, 3),
        "charged ms": round(1e3 * harness / count, 3),
        "ratio": round(harness / plain, 3),
        "not charged ms": round(1e3 * rest / count, 3),
    }


def bare(name: str, version: str) -> float:
    """Return the seconds of a plain loop over batches."""
    loaded = predictor.load(BASELINES / f"{name}.py")
    labels = truth.load(version)
    read = instances.read(store.open_dataset(version), labels.ids)
    ids = [labels.ids[i] for i in labels.order]
    loaded.predict([read.mesh(id) for id in ids[:WARM_UP]])
    total = 0.0
    for first in range(0, len(ids), BATCH):
        meshes = [read.mesh(id) for id in ids[first : first + BATCH]]
        started = time.perf_counter()
        loaded.predict(meshes)
        total += time.perf_counter() - started
    return total


def charged(name: str, version: str) -> tuple[float, float]:
    """Return the seconds that the harness charges, and those of the whole evaluation."""
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


def call() -> str:
    """Return the time of the predictor that computes next to nothing, by the timing of 1.0."""
    (cost,) = (row["cost"] for row in timing.read(ROOT)["1.0"] if row["code"] == "mean.py")
    return f"{cost['ms_per_mesh']:.2f} ms a mesh in batches of {cost['batch_size']}"


def table(data: dict) -> str:
    """Return one row per predictor."""
    return markdown.columns(data["rows"], {name: f"{{{name}}}" for name in data["rows"][0]}, "lr")
