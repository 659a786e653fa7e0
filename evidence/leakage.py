"""Measure what copies of test shapes in training are worth: docs/data/leakage.json.

    synthnet build --version 1.0
    python scripts/leakage.py

Two predictors that see nothing of a mesh but six numbers that no isometry changes
(baselines/invariants.py), under both protocols, scored on every instance of the test split:
the spectrum of the nearest training shape, scaled, and the boosted trees of the board. Under
`paper` nearly every test mesh has copies in training. Then `make tables`.
"""

import json
import sys
from pathlib import Path

import numpy as np
from rich.progress import track
from scipy.spatial import cKDTree

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "baselines"))
DATA = ROOT / "docs" / "data" / "leakage.json"
VERSION = "1.0"


class Nearest:
    """The spectrum of the training shape with the nearest numbers."""

    name = "Nearest training shape"

    def __init__(self, numbers: np.ndarray, targets: np.ndarray) -> None:
        self.scale = numbers.std(axis=0)
        self.tree, self.targets = cKDTree(numbers / self.scale), targets

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        """Return log(λ · area) of each shape."""
        return self.targets[self.tree.query(numbers / self.scale)[1]]


class Trees:
    """The ensembles of baselines/boosted_trees.py."""

    name = "Boosted trees"

    def __init__(self, numbers: np.ndarray, targets: np.ndarray) -> None:
        from boosted_trees import Trees as Ensembles

        self.ensembles = Ensembles(numbers, targets, seed=0).ensembles

    def __call__(self, numbers: np.ndarray) -> np.ndarray:
        """Return log(λ · area) of each shape."""
        return np.sort(np.stack([one.predict(numbers) for one in self.ensembles], axis=1), axis=1)


def main() -> int:
    """Measure and write."""
    from eigbench.scoring import metrics
    from invariants import invariants

    from synthnet import store
    from synthnet.store.files import write_text
    from synthnet.types import PROTOCOLS

    dataset = store.open_dataset(VERSION)
    areas, numbers, labels, splits = [], [], [], []
    paths = [dataset.directory / record.file for record in dataset.manifest.shards]
    samples = (sample for path in paths for sample in store.read_samples(path))
    for sample in track(samples, "Numbers of the shapes", total=dataset.manifest.rows):
        area, own = invariants(sample.mesh)
        areas.append(area)
        numbers.append(own)
        labels.append(sample.eigenvalues)
        copies = len(sample.paper_splits)
        splits.append({"grouped": (sample.split,) * copies, "paper": sample.paper_splits})
    area, features, label = np.array(areas)[:, None], np.array(numbers), np.array(labels)
    targets = np.log(label * area)
    rows = []
    for kind in (Nearest, Trees):
        for protocol in PROTOCOLS:
            seen = np.array(["train" in one[protocol] for one in splits])
            tests = np.array([one[protocol].count("test") for one in splits])
            shapes = np.flatnonzero(tests)
            predict = kind(features[seen], targets[seen])
            found = np.exp(predict(features[shapes])) / area[shapes]
            weights = tests[shapes] / tests.sum()
            psnr20 = metrics.psnr_above_20(found, label[shapes])
            rpd = metrics.relative_percent_difference(found, label[shapes])
            rows.append(
                {
                    "predictor": kind.name,
                    "protocol": protocol,
                    "instances": int(tests.sum()),
                    "seen": round(float(weights @ seen[shapes]), 6),
                    "psnr20": round(float(weights @ psnr20), 6),
                    "rpd": round(float(weights @ rpd), 6),
                }
            )
            print(rows[-1], flush=True)
    write_text(DATA, json.dumps({"version": VERSION, "rows": rows}, indent=2) + "\n")
    print(f"{DATA} written")
    return 0


if __name__ == "__main__":
    sys.exit(main())
