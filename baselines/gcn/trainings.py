"""One network trained several times: its weights in one file, by the name of the training set."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch

from . import data, weights
from .model import GCN
from .predictor import Row, told, weights_of


def gather(path: Path, runs: Mapping[str, Path], **more: object) -> None:
    """Write the weights of several runs of one configuration into one file.

    Parameters
    ----------
    path : Path
        The file.
    runs : mapping of str to Path
        Weights of each training set, ``VERSION/PROTOCOL``.
    **more
        What else is to be known of all of them.

    Raises
    ------
    WeightsError
        If one is missing, damaged, or of another configuration.
    """
    tensors, records = {}, {}
    for training, file in runs.items():
        found, record = weights.read(file)
        tensors |= {f"{training}:{name}": tensor for name, tensor in found.items()}
        records[training] = {key: record[key] for key in record if key not in ("log", "losses")}
    configs = [record.pop("config") for record in records.values()]
    if any(config != configs[0] for config in configs):
        raise weights.WeightsError(f"the runs of {path} are of several configurations")
    weights.write(path, tensors, {"config": configs[0], "trainings": records, **more})


def meta(file: str, name: str) -> dict[str, str]:
    """Return the META of a row, read from its weights."""
    _, record = weights.read(weights_of(file))
    config = weights.config_of(record)
    # Two training sets of the same meshes are one training.
    trainings = {one["protocol"]: one for one in record["trainings"].values()}.values()
    one = next(iter(trainings))
    minutes = [training["minutes"] for training in trainings]
    steps = [training["steps"] for training in trainings]
    rule = ", until they had converged" if all(t["converged"] for t in trainings) else ""
    return {
        "name": name,
        "kind": "learned",
        "paper": "https://proceedings.mlr.press/v251/wu24a.html",
        "training_data": (
            f"synthNet {one['version']} train, what the protocol leaves of it; of n vertices "
            f"a share of {record['vertices']:,} / n"
        ),
        "training_cost": (
            f"{min(minutes):.0f} to {max(minutes):.0f} min each of {len(minutes)} trainings: "
            f"{min(steps):,} to {max(steps):,} steps of {config.batch_size} meshes{rule}"
        ),
        "hardware": "; ".join(
            dict.fromkeys(told(session) for t in trainings for session in t["sessions"])
        ),
    }


class TrainedRow(Row):
    """A network as one of its trainings left it.

    Parameters
    ----------
    path : Path
        Weights of all trainings.
    training : str
        Name of the training set.
    device : str
        ``cpu`` or ``cuda``.

    Raises
    ------
    WeightsError
        If the file is missing or damaged, or has no such training.
    """

    def __init__(self, path: Path, training: str, device: str) -> None:
        tensors, record = weights.read(path)
        if training not in record["trainings"]:
            there = ", ".join(record["trainings"])
            raise weights.WeightsError(
                f"{path} has no weights trained on {training}, only on {there}"
            )
        start = f"{training}:"
        self.model = GCN(weights.config_of(record).model)
        mine = {n.removeprefix(start): t for n, t in tensors.items() if n.startswith(start)}
        weights.fill(self.model, mine, path)
        self.model = self.model.to(device).eval()
        self.record = record["trainings"][training]
        self.encode = data.encoder(self.model.config)
        self.device, self.threads = device, torch.get_num_threads()


def load_row(file: str, device: str, seed: int, training: str) -> TrainedRow:
    """Return the predictor of a row's file for a training set.

    Raises
    ------
    WeightsError
        If it was not trained on that set or with this seed, or the weights cannot be read.
    """
    row = TrainedRow(weights_of(file), training, device)
    if seed != row.record["seed"]:
        raise weights.WeightsError(
            f"{weights_of(file)} was trained with seed {row.record['seed']} alone, not {seed}"
        )
    return row
