"""Rayleigh-Ritz values of degree 4, corrected by a small network.

A perceptron maps the 28 numbers of `ritz_features.py` to the logarithms of label / Ritz value,
so scaling is exact, and no isometry changes an answer. It is not told a shape's family.

Weights of three seeds trained on 1.0 and on 2.0 stand in `ritz_mlp.safetensors` and
`ritz_mlp.2.0.safetensors`, made by

    python baselines/ritz_mlp.py 1.0
    python baselines/ritz_mlp.py 2.0

from the built versions. For 2.0's other protocols it is trained when it is loaded, a minute a seed,
on the numbers of 2.0's shapes that the second command keeps in `ritz_mlp.parquet`.
"""

import argparse
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from eigbench.scoring import truth
from rich.progress import track
from ritz_features import CORRECTED, NAMES, features
from safetensors import safe_open
from safetensors.numpy import save
from scipy.special import expit
from threadpoolctl import threadpool_limits

from synthnet import Mesh, store
from synthnet.store.files import write_atomically, write_bytes

META = {
    "name": "Ritz values, degree 4, corrected by an MLP",
    "kind": "learned",
    "training_data": "the training split, one instance a shape",
    "training_cost": "minutes on one core: see docs/learned.md",
}
WEIGHTS, NUMBERS = (Path(__file__).with_suffix(kind) for kind in (".safetensors", ".parquet"))
TRAINED = {"1.0/grouped": WEIGHTS, "2.0/grouped": WEIGHTS.with_suffix(".2.0.safetensors")}
SEEDS, WIDTH, DEPTH, EPOCHS, BATCH, RATE = 3, 256, 3, 400, 256, 3e-3


class Corrected:
    """The network of one seed, in NumPy."""

    def __init__(self, tensors: dict[str, np.ndarray]) -> None:
        self.mean, self.scale = tensors["mean"], tensors["scale"]
        depth = sum(name.endswith(".weight") for name in tensors)
        self.layers = [(tensors[f"{i}.weight"].T, tensors[f"{i}.bias"]) for i in range(depth)]

    def parameters(self) -> list[np.ndarray]:
        """Return the weights and biases, which the harness counts."""
        return [array for layer in self.layers for array in layer]

    def correct(self, numbers: np.ndarray) -> np.ndarray:
        """Return log(label / Ritz value) of each row of features, (B, 10)."""
        x = ((numbers - self.mean) / self.scale).astype(np.float32)
        for i, (weight, bias) in enumerate(self.layers):
            if i:
                x = x * expit(x)  # SiLU
            x = x @ weight + bias
        return x

    def predict(self, meshes: Sequence[Mesh]) -> np.ndarray:
        """Return the eigenvalues, ascending, shape (B, 10)."""
        if not meshes:
            return np.empty((0, CORRECTED))
        areas, rows = zip(*map(features, meshes), strict=True)
        numbers = np.array(rows)
        logs = numbers[:, :CORRECTED] + self.correct(numbers)
        return np.sort(np.exp(logs), axis=1) / np.array(areas)[:, None]


def load(device: str, seed: int, training: str = "1.0/grouped") -> Corrected:
    """Return the network that was trained with a seed, or train it."""
    weights = TRAINED.get(training)
    if weights is None:
        numbers, logs = kept(training)
        return Corrected(train(numbers, logs - numbers[:, :CORRECTED], seed))
    if not 0 <= seed < SEEDS:
        raise ValueError(f"{weights.name} has the seeds 0 to {SEEDS - 1}, not {seed}")
    prefix = f"seed{seed}."
    with safe_open(weights, framework="np") as file:
        mine = [name for name in file.keys() if name.startswith(prefix)]  # noqa: SIM118
        return Corrected({name.removeprefix(prefix): file.get_tensor(name) for name in mine})


def read(version: str = "1.0", split: str = "train") -> tuple[np.ndarray, ...]:
    """Return families, features and log(label · area) of a split's shapes."""
    labels = truth.load(version, split)
    wanted = dict(zip(labels.shapes, labels.eigenvalues, strict=True))
    families, rows, logs = [], [], []
    with threadpool_limits(1):  # on small matrices BLAS's threads wait for each other
        for path in track(store.open_dataset(version).paths(), f"features, {split}"):
            for sample in store.read_samples(path):
                if sample.spec.id in wanted:
                    area, numbers = features(sample.mesh)
                    families.append(sample.spec.family)
                    rows.append(numbers)
                    logs.append(np.log(wanted[sample.spec.id] * area))
    return np.array(families), np.array(rows), np.array(logs)


def kept(training: str) -> tuple[np.ndarray, np.ndarray]:
    """Return features and log(label · area) of a training set whose numbers are kept."""
    version, _, protocol = training.partition("/")
    labels = truth.load(version, "train", protocol)
    table = pq.read_table(NUMBERS)
    row_of = {id: row for row, id in enumerate(table["id"].to_pylist())}
    shapes, first = np.unique(labels.shapes, return_index=True)
    if missing := [id for id in shapes if id not in row_of]:
        raise ValueError(f"{NUMBERS.name} lacks {missing[0]} of {training}: make it anew")
    rows = [row_of[id] for id in shapes]
    numbers = np.stack([table[name].to_numpy() for name in NAMES], axis=1)[rows]
    areas = table["area"].to_numpy()[rows]
    return numbers.astype(np.float64), np.log(labels.eigenvalues[first] * areas[:, None])


def keep(version: str) -> None:
    """Write the features of a version's training shapes."""
    wanted = set(truth.load(version, "train").shapes.tolist())
    ids, rows = [], []
    with threadpool_limits(1):
        for path in track(store.open_dataset(version).paths(), "features"):
            for sample in store.read_samples(path):
                if sample.spec.id in wanted:
                    area, numbers = features(sample.mesh)
                    ids.append(sample.spec.id)
                    rows.append([area, *numbers])
    columns = np.array(rows, dtype=np.float32).T
    table = pa.table([pa.array(ids), *columns], names=["id", "area", *NAMES])
    write_atomically(NUMBERS, lambda to: pq.write_table(table, to, compression="zstd"))


def train(
    numbers: np.ndarray, targets: np.ndarray, seed: int, *, depth: int = DEPTH, epochs: int = EPOCHS
) -> dict[str, np.ndarray]:
    """Fit a network to log(label / Ritz value) by ℓ1, AdamW and a one-cycle rate."""
    import torch

    torch.set_num_threads(1)
    torch.manual_seed(seed)
    mean, scale = numbers.mean(axis=0), numbers.std(axis=0) + 1e-9
    x = torch.tensor((numbers - mean) / scale, dtype=torch.float32)
    y = torch.tensor(targets, dtype=torch.float32)
    sizes = [x.shape[1], *[WIDTH] * depth, y.shape[1]]
    linear = [torch.nn.Linear(i, o) for i, o in pairwise(sizes)]
    layers = [part for one in linear for part in (one, torch.nn.SiLU())][:-1]
    network = torch.nn.Sequential(*layers)
    optimiser = torch.optim.AdamW(network.parameters(), RATE, weight_decay=1e-4)
    steps = len(x) // BATCH
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, RATE, total_steps=epochs * steps, pct_start=0.1
    )
    for _ in track(range(epochs), f"seed {seed}"):
        order = torch.randperm(len(x))
        for step in range(steps):
            chosen = order[step * BATCH : (step + 1) * BATCH]
            loss = (network(x[chosen]) - y[chosen]).abs().mean()
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
            optimiser.step()
            schedule.step()
    tensors = {"mean": mean, "scale": scale}
    for i, one in enumerate(linear):
        tensors[f"{i}.weight"] = one.weight.detach().numpy().copy()
        tensors[f"{i}.bias"] = one.bias.detach().numpy().copy()
    return tensors


def fit(version: str) -> None:
    """Train the seeds on a built version and write their weights; keep the numbers of 2.0."""
    started = time.perf_counter()
    if version == "2.0":
        keep(version)
        numbers, logs = kept("2.0/grouped")
    else:
        _, numbers, logs = read()
    read_in = time.perf_counter()
    tensors = {}
    for seed in range(SEEDS):
        fitted = train(numbers, logs - numbers[:, :CORRECTED], seed)
        tensors |= {f"seed{seed}.{name}": value for name, value in fitted.items()}
    write_bytes(TRAINED[f"{version}/grouped"], save(tensors, {"features": ",".join(NAMES)}))
    print(f"features of {len(numbers):,} shapes: {read_in - started:.0f} s on one core")
    print(f"training {SEEDS} seeds: {time.perf_counter() - read_in:.0f} s on one core")


def main() -> None:
    """Fit to the version that is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("version", choices=("1.0", "2.0"))
    fit(parser.parse_args().version)


if __name__ == "__main__":
    main()
