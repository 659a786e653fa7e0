"""Train the network of baselines/patch_transformer.py on 2.0.

    python -m baselines.train_patch_transformer
    python -m baselines.train_patch_transformer --protocol genus --seed 1

Its weights replace those of the same protocol and seed in baselines/patch_transformer.safetensors,
with what training cost and the errors on the validation split after each epoch.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from eigbench.metrics import relative_percent_difference
from eigbench.running.machine import hardware
from eigbench.scoring import truth
from eigbench.scoring.training import protocols, training_set
from rich.progress import track
from safetensors.torch import save
from torch import Tensor

from baselines.patch_network import (
    SHOWN,
    PatchTransformer,
    answers,
    cloud,
    read_weights,
    views,
    weyl,
)
from synthnet import store
from synthnet.store import pins
from synthnet.store.files import write_bytes

VERSION = "2.0"
WEIGHTS = Path(__file__).with_name("patch_transformer.safetensors")
EPOCHS, BATCH, RATE, DECAY = 60, 64, 1e-3, 0.05


@dataclass(frozen=True, slots=True)
class Clouds:
    """Points of some shapes and the spectra of their surfaces.

    Parameters
    ----------
    points : Tensor of shape (n, 2048, 6), float32
        What :func:`patch_network.cloud` makes.
    areas : Tensor of shape (n,), float64
        In length².
    limits : Tensor of shape (n, 10), float64
        Eigenvalues of the surfaces, in 1/length².
    """

    points: Tensor
    areas: Tensor
    limits: Tensor

    def __len__(self) -> int:
        """Return n."""
        return len(self.areas)


def read(dataset: str, protocol: str, splits: Sequence[str]) -> list[Clouds]:
    """Return the shapes of some splits of a protocol of 2.0, from a dataset that has them."""
    wanted = {
        shape: number
        for number, split in enumerate(splits)
        for shape in truth.load(VERSION, split, protocol).shapes
    }
    limits, pinned = pins.read_limits(VERSION), pins.read(VERSION)
    found: list[list[tuple[float, np.ndarray, np.ndarray]]] = [[] for _ in splits]
    for path in track(store.open_dataset(dataset).paths(), "points"):
        for sample in store.read_samples(path):
            if (number := wanted.pop(sample.spec.id, None)) is not None:
                if pins.digest(sample) != pinned[sample.spec.id].digest:
                    raise ValueError(f"{sample.spec.id} of {dataset} is not that of {VERSION}")
                found[number].append((*cloud(sample.mesh), limits[sample.spec.id].eigenvalues))
    if wanted:
        raise ValueError(f"{dataset} lacks {next(iter(wanted))}: build {VERSION}")
    clouds = []
    for rows in found:
        areas, points, values = (np.stack(column) for column in zip(*rows, strict=True))
        clouds.append(Clouds(*map(torch.from_numpy, (points, areas, values))))
    return clouds


def shown(points: Tensor) -> Tensor:
    """Return random points of each cloud, mirrored at random coordinate planes."""
    chosen = torch.randperm(points.shape[1])[:SHOWN]
    signs = torch.randint(0, 2, (len(points), 1, 3)) * 2.0 - 1
    return points[:, chosen] * torch.cat([signs, signs], dim=-1)


@torch.inference_mode()
def error(model: PatchTransformer, clouds: Clouds) -> float:
    """Return the mean RPD of a network's answers from one view of each cloud."""
    model.eval()
    parts = [next(views(points)) for points in clouds.points.split(BATCH)]
    values = answers(torch.cat([model(part) for part in parts]), clouds.areas)
    model.train()
    return float(relative_percent_difference(values, clouds.limits.numpy()).mean())


def train(
    clouds: Clouds, check: Clouds, epochs: int, seed: int
) -> tuple[PatchTransformer, list[float]]:
    """Fit a network by ℓ1, AdamW and a one-cycle rate; return it and its errors by epoch."""
    torch.manual_seed(seed)
    model = PatchTransformer()
    targets = torch.log(clouds.limits / weyl(clouds.areas)).float()
    model.mean[:], model.scale[:] = targets.mean(dim=0), targets.std(dim=0)
    optimiser = torch.optim.AdamW(model.parameters(), RATE, weight_decay=DECAY)
    steps = len(clouds) // BATCH
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, RATE, total_steps=epochs * steps, pct_start=0.1
    )
    errors = []
    for epoch in range(epochs):
        order = torch.randperm(len(clouds))[: steps * BATCH]
        for chosen in track(order.split(BATCH), f"epoch {epoch + 1} of {epochs}"):
            loss = (model(shown(clouds.points[chosen])) - targets[chosen]).abs().mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
            optimiser.step()
            schedule.step()
        errors.append(round(error(model, check), 4))
        print(f"epoch {epoch + 1}: RPD {errors[-1]:.4f} on validation", flush=True)
    return model, errors


def keep(path: Path, name: str, model: PatchTransformer, record: dict[str, object]) -> None:
    """Put the weights of a training into a file, in half precision, beside those of others."""
    tensors, records = read_weights(path) if path.exists() else ({}, {})
    for key, tensor in model.state_dict().items():
        whole = key in ("mean", "scale")  # every answer is off by their rounding
        tensors[f"{name}.{key}"] = tensor if whole else tensor.half()
    write_bytes(path, save(tensors, {"trainings": json.dumps({**records, name: record})}))


def main() -> None:
    """Train one network and put its weights beside the others."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = protocols(VERSION)
    parser.add_argument("--protocol", default="grouped", choices=known, metavar="PROTOCOL")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--epochs", type=int, default=EPOCHS)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument(
        "--dataset", default=VERSION, help="a built dataset with all meshes of 2.0, as 2.1"
    )
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    clouds, check = read(options.dataset, options.protocol, ("train", "validation"))
    started = time.perf_counter()
    model, errors = train(clouds, check, options.epochs, options.seed)
    minutes = (time.perf_counter() - started) / 60
    name = f"{training_set(VERSION, options.protocol)}/{options.seed}"
    record = {
        "epochs": options.epochs,
        "meshes": len(clouds),
        "minutes": round(minutes, 1),
        "threads": options.threads,
        "hardware": hardware(),
        "rpd": errors,
    }
    keep(WEIGHTS, name, model, record)
    print(f"{name}: {minutes:.0f} min, RPD {errors[-1]:.4f} on validation")


if __name__ == "__main__":
    main()
