"""What copies of test shapes in training are worth.

Two predictors that see nothing of a mesh but six numbers that no isometry changes
(baselines/invariants.py), under both protocols, scored on every instance of the test split of 1.0:
the spectrum of the nearest training shape, scaled, and the boosted trees of the board. Under
`paper` nearly every test mesh has copies in training. Needs a built 1.0; docs/reproduction.md shows
the numbers.
"""

import numpy as np
from eigbench.scoring import metrics
from scipy.spatial import cKDTree

from evidence import baseline
from evidence.timing import progress
from synthnet import store
from synthnet.types import PROTOCOLS

VERSION = "1.0"


def nearest(numbers: np.ndarray, targets: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Return the log(λ · area) of the training shape with the nearest numbers."""
    scale = numbers.std(axis=0)
    return targets[cKDTree(numbers / scale).query(asked / scale)[1]]


def trees(numbers: np.ndarray, targets: np.ndarray, asked: np.ndarray) -> np.ndarray:
    """Return log(λ · area) by the ensembles of baselines/boosted_trees.py."""
    ensembles = baseline("boosted_trees").Trees(numbers, targets, seed=0).ensembles
    return np.sort(np.stack([one.predict(asked) for one in ensembles], axis=1), axis=1)


PREDICTORS = {"Nearest training shape": nearest, "Boosted trees": trees}


def measure() -> dict:
    """Return one row per predictor and protocol."""
    dataset = store.open_dataset(VERSION)
    invariants = baseline("invariants").invariants
    areas, numbers, labels, splits = [], [], [], []
    for sample in progress(dataset.samples(), "numbers of the shapes", dataset.manifest.rows):
        area, row = invariants(sample.mesh)
        areas.append(area)
        numbers.append(row)
        labels.append(sample.eigenvalues)
        copies = len(sample.paper_splits)
        splits.append({"grouped": (sample.split,) * copies, "paper": sample.paper_splits})
    area, features, label = np.array(areas)[:, None], np.array(numbers), np.array(labels)
    rows = []
    for name, predict in PREDICTORS.items():
        for protocol in PROTOCOLS:
            train = np.array(["train" in instances[protocol] for instances in splits])
            tests = np.array([instances[protocol].count("test") for instances in splits])
            shapes, weights = np.flatnonzero(tests), tests[tests > 0] / tests.sum()
            known = features[train], np.log(label * area)[train]
            predicted = np.exp(predict(*known, features[shapes])) / area[shapes]
            means = {
                "seen": train[shapes],
                "psnr20": metrics.psnr_above_20(predicted, label[shapes]),
                "rpd": metrics.relative_percent_difference(predicted, label[shapes]),
            }
            rows.append(
                {"predictor": name, "protocol": protocol, "instances": int(tests.sum())}
                | {key: round(float(weights @ values), 6) for key, values in means.items()}
            )
    return {"version": VERSION, "rows": rows}
