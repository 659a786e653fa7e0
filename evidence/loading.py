"""How long a built version takes to open in PyTorch Geometric, and how much memory an epoch."""

from __future__ import annotations

import time

from evidence.timing import peak_mb, progress


def measure(*, version: str = "1.0") -> dict:
    """Open the train split twice, and read one epoch without a model."""
    from torch_geometric.loader import DataLoader

    from synthnet.loaders.pyg import SynthNet

    SynthNet(version=version)  # unpacks, if that has not been done before
    started = time.perf_counter()
    train = SynthNet(version=version, split="train")
    opened = time.perf_counter() - started
    loader = DataLoader(train, batch_size=32, shuffle=True)
    started, vertices = time.perf_counter(), 0
    for batch in progress(loader, "an epoch"):
        vertices += batch.num_nodes
    return {
        "version": version,
        "instances": len(train),
        "vertices": vertices,
        "open_seconds": round(opened, 3),
        "epoch_seconds": round(time.perf_counter() - started, 1),
        "peak_resident_mb": round(peak_mb()),
    }
