"""Tensors with a record beside them, in one safetensors file: checkpoints and weights."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from synthnet.store.files import write_bytes

from .configs import TrainConfig
from .model import GCN, GCNConfig

FORMAT = 1


class WeightsError(Exception):
    """A file of weights that is missing, damaged, or of another model."""


def write(path: Path, tensors: dict[str, Tensor], record: dict[str, Any]) -> None:
    """Write tensors and what is to be known of them, atomically."""
    metadata = {"record": json.dumps({"format": FORMAT, **record})}
    kept = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    write_bytes(path, save(kept, metadata))


def read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Return the tensors and the record of a file.

    Raises
    ------
    WeightsError
        If it is missing or none of ours.
    """
    if not path.is_file():
        raise WeightsError(f"there is no file {path}")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        record = json.loads(metadata["record"])
        if record["format"] != FORMAT:
            raise WeightsError(f"{path} has the format {record['format']}, not {FORMAT}")
    except (SafetensorError, KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"{path} is damaged, or no file of this program") from error
    return tensors, record


def config_of(record: dict[str, Any]) -> TrainConfig:
    """Return the configuration in a record.

    Raises
    ------
    WeightsError
        If there is none.
    """
    try:
        given = dict(record["config"])
        return TrainConfig(**{**given, "model": GCNConfig(**given["model"])})
    except (KeyError, TypeError, ValueError) as error:
        raise WeightsError(f"the record has no configuration of this program: {error}") from error


def describe(config: TrainConfig) -> dict[str, Any]:
    """Return a configuration as a record holds it."""
    return asdict(config)


def save_model(path: Path, model: GCN, record: dict[str, Any]) -> None:
    """Write a network's weights in half precision: that is what a row is scored with.

    Raises
    ------
    WeightsError
        If a weight is too large for that, or no number.
    """
    halved = {name: tensor.to(torch.float16) for name, tensor in model.state_dict().items()}
    for name, tensor in halved.items():
        if not torch.isfinite(tensor).all():
            raise WeightsError(f"{name} is not finite in half precision: training has diverged")
    write(path, halved, record)


def load_model(path: Path, device: str = "cpu") -> tuple[GCN, dict[str, Any]]:
    """Return a network with a file's weights, in single precision, and the record.

    Raises
    ------
    WeightsError
        If the file is missing, damaged, or does not fit its own configuration.
    """
    tensors, record = read(path)
    model = GCN(config_of(record).model)
    fill(model, tensors, path)
    return model.to(device).eval(), record


def fill(model: nn.Module, tensors: dict[str, Tensor], path: Path) -> None:
    """Put tensors into a module, all of them or none.

    Raises
    ------
    WeightsError
        If names or shapes differ.
    """
    wanted = model.state_dict()
    names = sorted(set(wanted) ^ set(tensors)) or sorted(
        name for name in wanted if wanted[name].shape != tensors[name].shape
    )
    if names:
        raise WeightsError(f"{path} is of another model: {names[0]} differs")
    model.load_state_dict(tensors)
