"""A trained network as a predictor: what ``baselines/reproduction.py`` loads."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from synthnet.types import Mesh

from . import data, weights
from .configs import FALL, TrainConfig
from .encodings import MeshError
from .folded import each
from .graphs import Graphs
from .objective import predict

LOSS_NAMES = {"rpd": "RPDLoss", "polar": "PolarLoss", "l1": "ℓ1"}


def weights_of(file: str) -> Path:
    """Return where a row's weights are: beside its file, under the same name."""
    return Path(file).with_suffix(".safetensors")


def title(config: TrainConfig) -> str:
    """Return a network's name for a table."""
    model = config.model
    parts = [
        f"GCN {model.encoding}",
        "virtual node" if model.virtual_node else "",
        f"{model.blocks} blocks" if model.blocks != 3 else "",
        LOSS_NAMES[config.loss],
        "scale-free" if model.scale_free else "",
        "trained longer" if config.average and config.fall > FALL else "",
        "" if config.optimiser == "sgd" or config.average else "modern",
    ]
    return ", ".join(part for part in parts if part)


def meta(file: str) -> dict[str, str]:
    """Return the META of a row, read from its weights."""
    _, record = weights.read(weights_of(file))
    config = weights.config_of(record)
    return {
        "name": title(config),
        "kind": "learned",
        "paper": "https://proceedings.mlr.press/v251/wu24a.html",
        "training_data": f"synthNet {record['version']} train, {record['protocol']}",
        "training_cost": (
            f"{record['minutes']:.0f} min: {record['steps']:,} steps of {config.batch_size} "
            f"meshes, {record['epochs']:g} of {config.epochs} epochs"
            f"{', when it had converged' if record.get('converged') else ''}"
        ),
        "hardware": "; ".join(dict.fromkeys(map(told, record["sessions"]))),
    }


def told(session: dict[str, Any]) -> str:
    """Return what a session of training ran on: ``CPU, AVX2, 1 × 2 threads``."""
    return f"{session['device']}, {session['processes']} × {session['threads']} threads"


class Row:
    """A trained network with ``predict(meshes)``.

    Parameters
    ----------
    path : Path
        Weights in safetensors.
    device : str
        ``cpu`` or ``cuda``.
    """

    def __init__(self, path: Path, device: str = "cpu") -> None:
        self.model, self.record = weights.load_model(path, device)
        self.encode = data.encoder(self.model.config)
        self.device, self.threads = device, torch.get_num_threads()

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, as the network gives them, shape (B, 10).

        Raises
        ------
        MeshError
            If a mesh has no faces, too few vertices, or coordinates that are not finite.
        """
        for number, mesh in enumerate(meshes):
            least = self.model.config.outputs + 1
            if len(mesh.vertices) < least:
                raise MeshError(
                    f"mesh {number} has {len(mesh.vertices)} vertices: {least - 1} eigenvalues "
                    f"after zero need at least {least}"
                )
        if not len(meshes):
            return np.zeros((0, self.model.config.outputs))
        graphs = each(self.encoded, list(enumerate(meshes)), self.threads)
        graphs = [one.to(self.device) for one in graphs]
        return predict(self.model, graphs, self.threads).double().numpy()

    def encoded(self, numbered: tuple[int, Mesh]) -> Graphs:
        """Return an encoded mesh, or say which one cannot be."""
        number, mesh = numbered
        try:
            return self.encode(mesh)
        except MeshError as error:
            raise MeshError(f"mesh {number}: {error}") from error

    def parameters(self) -> list[torch.nn.Parameter]:
        """Return the network's parameters, which the harness counts."""
        return list(self.model.parameters())


def load_row(file: str, device: str, seed: int) -> Row:
    """Return the predictor of a row's file.

    Raises
    ------
    WeightsError
        If the weights were not trained with this seed, or cannot be read.
    """
    row = Row(weights_of(file), device)
    if seed != row.record["seed"]:
        raise weights.WeightsError(
            f"{weights_of(file)} was trained with seed {row.record['seed']} alone, not {seed}"
        )
    return row
