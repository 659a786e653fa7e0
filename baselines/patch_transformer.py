"""A small transformer on patches of points: a network as the field builds them, without a spectrum.

The surface is scaled to a fixed area, points are spread over it, each with its normal, and turned
into their principal axes. Sixty-four of them, far apart, are centres of patches; a small PointNet
turns each patch into a token, and a transformer mixes the tokens, in the manner of Point-BERT, at
0.6 million parameters and without pretraining. It is trained on the spectra of surfaces. Answers
are multiples of Weyl's law, so scaling is exact. The network sees no triangle, no eigenvalue and
no family.

Weights are made by `python -m baselines.train_patch_transformer`.

References
----------
X. Yu et al., "Point-BERT", CVPR 2022. Y. Pang et al., "Masked autoencoders for point cloud
self-supervised learning", ECCV 2022.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from patch_network import COUNT, PatchTransformer, answers, cloud, read_weights, views
from torch import Tensor

from synthnet import Mesh

WEIGHTS = Path(__file__).with_suffix(".safetensors")


def meta() -> dict[str, str]:
    """Return META; what training cost is read from the file of weights."""
    _, records = read_weights(WEIGHTS)
    minutes = [round(record["minutes"]) for record in records.values()]
    cost = f"{min(minutes)} to {max(minutes)} min" if len(minutes) > 1 else f"{minutes[0]} min"
    return {
        "name": "Transformer on patches of points",
        "kind": "learned",
        "paper": "in the manner of Yu et al. 2022, Point-BERT",
        "target": "surface",
        "training_data": "synthNet 2.0 train",
        "training_cost": f"{cost} for one seed on one thread",
        "hardware": "; ".join(dict.fromkeys(record["hardware"] for record in records.values())),
    }


META = meta()


class Trained:
    """The network of one training."""

    def __init__(self, model: PatchTransformer) -> None:
        self.model = model.eval()

    def parameters(self) -> list[Tensor]:
        """Return the weights, which the harness counts."""
        return list(self.model.parameters())

    @torch.inference_mode()
    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        if not meshes:
            return np.empty((0, COUNT))
        areas, clouds = zip(*map(cloud, meshes), strict=True)
        seen = views(torch.from_numpy(np.stack(clouds)))
        logs = torch.stack([self.model(view) for view in seen]).mean(dim=0)
        return answers(logs, torch.tensor(areas, dtype=torch.float64))


def load(device: str, seed: int, training: str = "2.0/grouped") -> Trained:
    """Return the network, on the CPU, trained on what the protocol of a training set leaves of 2.0.

    It is trained on no other version, and no mesh of 1.0 is in 2.0.
    """
    tensors, records = read_weights(WEIGHTS)
    _, _, protocol = training.partition("/")
    name = f"2.0/{protocol}/{seed}"
    if name not in records:
        raise ValueError(f"{WEIGHTS.name} has no {name}, only {', '.join(records)}")
    start = f"{name}."
    model = PatchTransformer()
    model.load_state_dict(
        {key.removeprefix(start): t.float() for key, t in tensors.items() if key.startswith(start)}
    )
    return Trained(model)
