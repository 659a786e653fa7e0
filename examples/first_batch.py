"""Load a built version into PyTorch Geometric and look at a first batch.

Usage: python examples/first_batch.py [VERSION]
"""

import sys

from torch_geometric.loader import DataLoader

from synthnet.loaders.pyg import SynthNet

version = sys.argv[1] if len(sys.argv) > 1 else "1.0-small"
train = SynthNet(version=version, split="train")
batch = next(iter(DataLoader(train, batch_size=32, shuffle=True)))

shapes = len(set(train.shape_id))
print(
    f"{len(train):,} training instances of synthNet {version}: {shapes:,} shapes, "
    f"{len(train) // shapes} of each"
)
print(f"a batch: {batch.num_nodes:,} vertices, {batch.face.shape[1]:,} faces")
print(f"labels:  {tuple(batch.y.shape)}, the first {batch.y[0].tolist()[:3]} …")
