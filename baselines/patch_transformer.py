"""A plain transformer on patches of points: a modern network of the field, without a spectrum.

Points are sampled from the surface, each with its normal, and moved to the principal axes of a
surface of area 1. Sixty-four of them, far apart, are centres of patches; a small PointNet turns
each patch into a token, and a transformer mixes the tokens. Answers are factors to Weyl's law, so
scaling is exact. The network sees no triangle, no eigenvalue and no family.

Weights are made by `python -m baselines.train_patch_transformer`.

References
----------
X. Yu et al., "Point-BERT", CVPR 2022. Y. Pang et al., "Masked autoencoders for point cloud
self-supervised learning", ECCV 2022.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from patch_network import PatchTransformer, cloud, views, weyl
from safetensors import safe_open
from torch import Tensor

from synthnet import Mesh

WEIGHTS = Path(__file__).with_suffix(".safetensors")


class Predictor:
    """The network of one training."""

    def __init__(self, model: PatchTransformer) -> None:
        self.model = model.eval()

    def parameters(self) -> list[Tensor]:
        """Return the weights, which the harness counts."""
        return list(self.model.parameters())

    @torch.inference_mode()
    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        areas, clouds = zip(*map(cloud, meshes), strict=True)
        seen = views(torch.from_numpy(np.stack(clouds)))
        logs = torch.stack([self.model(shown) for shown in seen]).mean(dim=0)
        values = weyl(torch.tensor(areas, dtype=torch.float64)) * logs.double().exp()
        return values.sort(dim=1).values.numpy()


def read_weights() -> tuple[dict[str, Tensor], dict[str, dict[str, Any]]]:
    """Return the tensors of all trainings, and of each what is known, by training set and seed."""
    with safe_open(WEIGHTS, framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        return tensors, json.loads(file.metadata()["trainings"])


def meta() -> dict[str, str]:
    """Return the META, whose cost is that of the trainings whose weights are there."""
    _, records = read_weights()
    minutes = [record["minutes"] for record in records.values()]
    return {
        "name": "Transformer on patches of points",
        "kind": "learned",
        "paper": "Yu et al. 2022 (Point-BERT), without its pretraining",
        "target": "surface",
        "training_data": "synthNet 2.0 train, what the protocol leaves of it",
        "training_cost": f"{max(minutes):.0f} min at most, each of {len(minutes)} trainings",
        "hardware": "; ".join(dict.fromkeys(record["hardware"] for record in records.values())),
    }


META = meta()


def load(device: str, seed: int, training: str = "2.0/grouped") -> Predictor:
    """Return the network of a training set and seed."""
    tensors, records = read_weights()
    name = f"{training}/{seed}"
    if name not in records:
        raise ValueError(f"{WEIGHTS.name} has no {name}, only {', '.join(records)}")
    mine = {key: tensor for key, tensor in tensors.items() if key.startswith(f"{name}.")}
    model = PatchTransformer()
    model.load_state_dict({key.removeprefix(f"{name}."): t.float() for key, t in mine.items()})
    return Predictor(model)
