"""What the learned rows that aim at the surface are trained on: numbers of the training shapes.

    python baselines/surface_numbers.py

makes `surface_numbers.parquet` from a built 1.0 and 2.0: the numbers of `ritz_features.py`,
`two_masses.py` and `multilevel_masses.py` of each training shape. The targets are the limits that
the repository pins.
"""

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from eigbench.scoring import truth
from rich.progress import track
from threadpoolctl import threadpool_limits

from synthnet import store
from synthnet.store import pins
from synthnet.store.files import write_atomically

NUMBERS = Path(__file__).with_suffix(".parquet")
VERSIONS = ("1.0", "2.0")


def kept(training: str, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return some numbers of a training set's shapes, and log(limit · area) of each, (n, 10).

    Shapes of which the table lacks one of these numbers are left out.
    """
    version, _, protocol = training.partition("/")
    limits = pins.read_limits(version)
    if limits is None:
        raise ValueError(f"the limits of {version} are not pinned")
    shapes = np.unique(truth.load(version, "train", protocol).shapes).tolist()
    table = pq.read_table(NUMBERS, columns=["id", "area", *names])
    row_of = {id: row for row, id in enumerate(table["id"].to_pylist())}
    if missing := [id for id in shapes if id not in row_of]:
        raise ValueError(f"{NUMBERS.name} lacks {missing[0]} of {training}: make it anew")
    chosen = table.take([row_of[id] for id in shapes]).drop_null()
    numbers = np.stack([chosen[name].to_numpy() for name in names], axis=1)
    eigenvalues = np.array([limits[id].eigenvalues for id in chosen["id"].to_pylist()])
    logs = np.log(eigenvalues * chosen["area"].to_numpy()[:, None])
    return numbers.astype(np.float64), logs


def write(ids: Sequence[str], rows: np.ndarray, names: Sequence[str]) -> None:
    """Write the table: rows of the area and the named numbers; one that is NaN is left open."""
    columns = [pa.array(column, from_pandas=True) for column in rows.astype(np.float32).T]
    table = pa.table([pa.array(ids), *columns], names=["id", "area", *names])
    write_atomically(NUMBERS, lambda to: pq.write_table(table, to, compression="zstd"))


def main() -> None:
    """Write the numbers of every shape of the training splits of the built versions."""
    import multilevel_masses
    import spectrum_mlp

    started = time.perf_counter()
    ids, rows = [], []
    paths = [path for version in VERSIONS for path in store.open_dataset(version).paths()]
    with threadpool_limits(1):  # on small matrices BLAS's threads wait for each other
        for path in track(paths, "numbers"):
            for sample in store.read_samples(path):
                if sample.split == "train":
                    area, numbers = spectrum_mlp.features(sample.mesh)
                    ids.append(sample.spec.id)
                    rows.append([area, *numbers, *multilevel_masses.features(sample.mesh)])
    write(ids, np.array(rows), [*spectrum_mlp.NAMES, *multilevel_masses.NAMES])
    print(f"numbers of {len(rows):,} shapes: {time.perf_counter() - started:.0f} s on one core")


if __name__ == "__main__":
    main()
