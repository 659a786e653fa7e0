"""Pin the error estimates of a built version: synthnet/recipe/versions/<version>.errors.parquet.

The build that goes before takes several times the work of the build itself:

    synthnet build --version 1.0 --error-estimates
    python scripts/pin_errors.py 1.0

A second argument is another place for the file.
"""

import sys
from pathlib import Path

from synthnet import store
from synthnet.build import estimates
from synthnet.store import pins

version = sys.argv[1]
target = (
    Path(__file__).parent.parent / "synthnet" / "recipe" / "versions" / f"{version}.errors.parquet"
)
if len(sys.argv) > 2:
    target = Path(sys.argv[2])
dataset = store.open_dataset(version)
labels = (label for path in dataset.paths() for _, label in estimates.labels(path))
rows = zip(estimates.read(dataset), labels, strict=True)
pins.write_errors(target, {row.id: row.error / label for row, label in rows})
print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, {dataset.manifest.rows} shapes")
