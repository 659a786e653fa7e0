"""The rows of the paper's Tables 1 to 3.

A row is named as ``reproduction.py:table1_rpd``; under the paper's protocol it ends in ``_paper``.
``python -m baselines.gcn.queue`` trains them.
"""

from pathlib import Path

from gcn.predictor import Row, load_row, meta

WEIGHTS = Path(__file__).resolve().with_suffix("")


def META(variant: str) -> dict[str, str]:
    """Return the META of a row, read from its weights."""
    return meta(str(WEIGHTS / f"{variant}.safetensors"))


def load(device: str, seed: int, variant: str) -> Row:
    """Return the trained network of a row and seed."""
    number = f".{seed}" if seed else ""
    return load_row(str(WEIGHTS / f"{variant}{number}.safetensors"), device, seed)
