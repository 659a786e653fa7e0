"""How long a built version takes to open in PyTorch Geometric, and how much memory an epoch.

Usage: python benchmarks/loading.py [VERSION] [--json]
"""

import argparse
import json
import time
from pathlib import Path

from rich.console import Console
from rich.progress import track
from torch_geometric.loader import DataLoader

from synthnet.loaders.pyg import SynthNet


def peak_mb() -> float:
    """Return the most resident memory this process has had, shared pages included."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))


def main() -> None:
    """Open the train split twice and read one epoch without a model."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("version", nargs="?", default="1.0")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    SynthNet(version=options.version)  # unpacks, if that has not been done before
    started = time.perf_counter()
    train = SynthNet(version=options.version, split="train")
    opened = time.perf_counter() - started
    loader = DataLoader(train, batch_size=32, shuffle=True)
    started, vertices = time.perf_counter(), 0
    for batch in track(loader, "an epoch", console=Console(stderr=True)):
        vertices += batch.num_nodes
    measured = {
        "version": options.version,
        "instances": len(train),
        "vertices": vertices,
        "open_seconds": round(opened, 3),
        "epoch_seconds": round(time.perf_counter() - started, 1),
        "peak_resident_mb": round(peak_mb()),
    }
    print(json.dumps(measured, indent=1) if options.json else measured)


if __name__ == "__main__":
    main()
