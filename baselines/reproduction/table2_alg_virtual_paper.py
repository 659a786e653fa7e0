"""The GCN of the configuration table2-alg-virtual, trained under the protocol paper.

Written by scripts/train_gcn.py.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from gcn.predictor import Row, load_row, meta

META = meta(__file__)


def load(device: str, seed: int) -> Row:
    """Return the trained network."""
    return load_row(__file__, device, seed)
