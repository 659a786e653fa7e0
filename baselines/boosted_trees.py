"""Gradient-boosted trees on isometry-invariant numbers, trained when the file is loaded.

The trees predict log(λ · area) from the numbers of `invariants.py`, so scaling is exact. What
they learn from stands in `boosted_trees.parquet`: the numbers of each training shape, made by

    python baselines/boosted_trees.py

from a built 1.0 and 2.0. Their labels are those the repository pins.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from eigbench.scoring import truth
from invariants import NAMES, invariants
from rich.progress import track
from sklearn.ensemble import HistGradientBoostingRegressor

from synthnet import Mesh, store

META = {
    "name": "Boosted trees",
    "kind": "learned",
    "training_data": "the training split, one instance a shape",
    "training_cost": "10 s on one core at loading, after a minute for the numbers of the shapes",
}
NUMBERS = Path(__file__).with_suffix(".parquet")
VERSIONS = ("1.0", "2.0")
ROUNDS = 1000  # 1,000 do better on the validation split than 300


class Trees:
    """One ensemble an eigenvalue."""

    def __init__(self, numbers: np.ndarray, targets: np.ndarray, seed: int) -> None:
        self.ensembles = [
            HistGradientBoostingRegressor(
                max_iter=ROUNDS, max_features=0.5, early_stopping=False, random_state=seed
            ).fit(numbers, target)
            for target in targets.T
        ]

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        areas, numbers = zip(*map(invariants, meshes), strict=True)
        logs = np.stack([trees.predict(np.array(numbers)) for trees in self.ensembles], axis=1)
        return np.sort(np.exp(logs), axis=1) / np.array(areas)[:, None]


def load(device: str, seed: int, training: str = "1.0/grouped") -> Trees:
    """Train on the shapes of a training split."""
    table = pq.read_table(NUMBERS).to_pandas().set_index("id")
    version, _, protocol = training.partition("/")
    labels = truth.load(version, "train", protocol)
    first = [i for i, id in enumerate(labels.ids) if id.endswith("/0")]
    rows = table.loc[labels.shapes[first]]
    targets = np.log(labels.eigenvalues[first] * rows[["area"]].to_numpy(np.float64))
    return Trees(rows[list(NAMES)].to_numpy(np.float64), targets, seed)


def main() -> None:
    """Write the numbers of every shape of the training splits of the built versions."""
    started = time.perf_counter()
    ids, rows = [], []
    paths = [path for version in VERSIONS for path in store.open_dataset(version).paths()]
    for path in track(paths, "numbers"):
        for sample in store.read_samples(path):
            if sample.split == "train":
                area, numbers = invariants(sample.mesh)
                ids.append(sample.spec.id)
                rows.append([area, *numbers])
    columns = np.array(rows, dtype=np.float32).T
    table = pa.table([ids, *columns], names=["id", "area", *NAMES])
    pq.write_table(table, NUMBERS, compression="zstd")
    written = time.perf_counter()
    load("cpu", 0)
    print(f"numbers of {len(rows):,} shapes: {written - started:.0f} s")
    print(f"training: {time.perf_counter() - written:.0f} s")


if __name__ == "__main__":
    main()
