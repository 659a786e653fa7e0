"""Add the numbers of a later version's training shapes to those that `surface_numbers.py` keeps.

    python baselines/more_numbers.py 2.1

from a built 2.1 adds rows to `surface_numbers.parquet`, and leaves those that are there as they
are: shapes of 2.0 have the same ids there. All rows of the boards that name this table count as
made by an earlier version from then on: run them again with those of the new version.
"""

import sys

import multilevel_masses
import numpy as np
import pyarrow.parquet as pq
import spectrum_mlp
from rich.progress import track
from surface_numbers import NUMBERS, write
from threadpoolctl import threadpool_limits

from synthnet import store


def main(version: str) -> None:
    """Append the numbers of the shapes of a training split that the table lacks."""
    table = pq.read_table(NUMBERS)
    names = table.column_names[2:]
    if names != [*spectrum_mlp.NAMES, *multilevel_masses.NAMES]:
        raise ValueError(f"{NUMBERS.name} has other columns: make it anew by surface_numbers.py")
    ids = table["id"].to_pylist()
    rows = [np.stack([table[name].to_numpy() for name in ("area", *names)], axis=1)]
    known = set(ids)
    with threadpool_limits(1):  # on small matrices BLAS's threads wait for each other
        for path in track(store.open_dataset(version).paths(), "numbers"):
            for sample in store.read_samples(path):
                if sample.split == "train" and sample.spec.id not in known:
                    area, numbers = spectrum_mlp.features(sample.mesh)
                    ids.append(sample.spec.id)
                    rows.append([[area, *numbers, *multilevel_masses.features(sample.mesh)]])
    write(ids, np.concatenate(rows), names)
    print(f"numbers of {len(ids) - len(known):,} shapes more, {len(ids):,} in all")


if __name__ == "__main__":
    main(*sys.argv[1:])
