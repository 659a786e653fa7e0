"""Numbers of the training shapes that a later version adds to those of `surface_numbers.py`.

    python baselines/more_numbers.py 2.1

makes `more_numbers.2.1.parquet` from a built 2.1. A version has a table of its own, so that the
rows of the boards before it, which name the tables that they have read, stay true.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import surface_numbers
from eigbench.scoring import truth
from rich.progress import track
from threadpoolctl import threadpool_limits

from synthnet import store
from synthnet.store import pins
from synthnet.store.files import write_atomically

EXTENDED = {"2.1": "2.0"}  # whose training shapes are in the other table


def file(version: str) -> Path:
    """Return the table of a version."""
    return Path(__file__).with_suffix(f".{version}.parquet")


def kept(training: str, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return what :func:`surface_numbers.kept` returns, of later versions too."""
    version, _, protocol = training.partition("/")
    if version not in EXTENDED:
        return surface_numbers.kept(training, names)
    shapes = np.unique(truth.load(version, "train", protocol).shapes)
    tables = [
        pd.read_parquet(path, columns=["id", "area", *names]).set_index("id")
        for path in (surface_numbers.NUMBERS, file(version))
    ]
    table = pd.concat(tables)
    if len(missing := np.setdiff1d(shapes, table.index)):
        raise ValueError(f"{file(version).name} lacks {missing[0]} of {training}: make it anew")
    table = table.loc[shapes]
    limits = pins.read_limits(version)
    eigenvalues = np.array([limits[id].eigenvalues for id in shapes])
    logs = np.log(eigenvalues * table["area"].to_numpy()[:, None])
    return table[[*names]].to_numpy(np.float64), logs


def main(version: str) -> None:
    """Write the numbers of the shapes that a version adds to the training split."""
    import multilevel_masses
    import spectrum_mlp

    earlier = set(truth.load(EXTENDED[version], "train").shapes)
    names = ["area", *spectrum_mlp.NAMES, *multilevel_masses.NAMES]
    rows = {}
    with threadpool_limits(1):  # on small matrices BLAS's threads wait for each other
        for path in track(store.open_dataset(version).paths(), "numbers"):
            for sample in store.read_samples(path):
                if sample.split == "train" and sample.spec.id not in earlier:
                    area, numbers = spectrum_mlp.features(sample.mesh)
                    more = multilevel_masses.features(sample.mesh)
                    rows[sample.spec.id] = np.float32([area, *numbers, *more])
    table = pd.DataFrame.from_dict(rows, orient="index", columns=names)
    table = table.rename_axis("id").reset_index()
    write_atomically(file(version), lambda to: table.to_parquet(to, compression="zstd"))
    print(f"numbers of {len(table):,} shapes")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("version", choices=EXTENDED, help="a built one")
    main(parser.parse_args().version)
