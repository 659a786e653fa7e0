"""Pin a built version: write synthnet/recipe/versions/<version>.lock.parquet.

Run it once, when a version is frozen; an edit that changes a label is a new version.

Usage: python scripts/pin_version.py 1.0
"""

import sys
from pathlib import Path

from rich.progress import track

from synthnet import store
from synthnet.store import pins

version = sys.argv[1]
dataset = store.open_dataset(version)
target = (
    Path(__file__).parent.parent / "synthnet" / "recipe" / "versions" / f"{version}.lock.parquet"
)
samples = track(dataset.samples(), "pinning", total=dataset.manifest.rows)
pins.write(target, (pins.pin(sample) for sample in samples))
print(f"{target}: {target.stat().st_size / 1e6:.2f} MB, {dataset.manifest.rows} shapes")
