"""A training run: its batches, steps, checkpoints and record."""

from __future__ import annotations

import copy
import csv
import io
import math
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from eigbench.scoring.metrics import METRICS
from torch import Tensor, distributed, nn
from torch.nn.parallel import DistributedDataParallel

from synthnet.store.files import write_text

from . import data, weights
from .configs import TrainConfig
from .model import GCN
from .objective import Objective, mean_outputs, predict

CHECKPOINT, LOG, WEIGHTS = "checkpoint.safetensors", "log.csv", "weights.safetensors"
COLUMNS = ("epoch", "steps", "minutes", "loss", "validation_psnr20", "validation_rpd")
LOGGED = 10  # steps after which the log gets a row
EVERY = 100  # steps, or an epoch if that is less, after which the network is validated
VALIDATED = 200  # shapes of the validation split, always the same
ROWS = 2000  # of a log without scores; when it has more, every second of these is dropped
WARM = 0.1  # of the steps, in which a one-cycle schedule rises
RISE = 300  # steps in which a trapezoid rises
RECENT = 9  # power of its number by which a step counts in an average of the weights
QUARTER = 0.75  # of the steps: what comes after is the last quarter


class TrainingError(Exception):
    """Training cannot begin, or go on; what was finished is kept."""


@dataclass(slots=True)
class Progressed:
    """How far a run is; the losses are those since the last row of the log."""

    steps: int = 0
    minutes: float = 0.0
    losses: list[float] = field(default_factory=list)
    log: list[dict[str, float]] = field(default_factory=list)
    sessions: list[dict[str, Any]] = field(default_factory=list)


class Run:
    """A training run that can be stopped and taken up again at any step.

    The batches, the isometries and the rate of a step depend on the seed and its number alone, so
    a resumed run ends with the weights of an uninterrupted one.

    Parameters
    ----------
    config : TrainConfig
        What to do.
    shapes : Shapes
        The dataset, encoded for this network.
    protocol : str
        ``grouped`` or ``paper``.
    seed : int
        Of the first weights, the order and the isometries.
    out : Path
        Directory of the files.
    device : torch.device
        Where to compute.
    dtype : torch.dtype
        Of the blocks: float32 or bfloat16.
    threads : int
        Meshes at a time on a CPU.
    rank, world : int
        Of this process, and how many there are.
    """

    def __init__(
        self,
        config: TrainConfig,
        shapes: data.Shapes,
        *,
        protocol: str,
        seed: int,
        out: Path,
        device: torch.device,
        dtype: torch.dtype = torch.float32,
        threads: int = 1,
        rank: int = 0,
        world: int = 1,
    ) -> None:
        self.config, self.shapes, self.protocol, self.seed = config, shapes, protocol, seed
        self.out, self.device, self.dtype = out, device, dtype
        self.threads, self.rank, self.world = threads, rank, world
        torch.manual_seed(seed)
        self.model = GCN(config.model).to(device)
        self.averaged = copy.deepcopy(self.model) if config.average else self.model
        objective = Objective(self.model, config.loss, dtype, threads)
        self.objective: nn.Module = DistributedDataParallel(objective) if world > 1 else objective
        self.optimiser = optimiser(config, self.model)
        if config.batch_size < world:
            raise TrainingError(f"a batch of {config.batch_size} cannot be shared by {world}")
        self.instances = shapes.instances("train", protocol)
        if config.isometries != "stored":
            self.instances = torch.unique(self.instances[:, 0])[:, None]
        trained = torch.unique(self.instances[:, 0]).tolist()
        areas = torch.cat([shapes.graphs[i].areas for i in trained])
        with torch.no_grad():
            self.model.head[-1].bias.copy_(mean_outputs(shapes.y[trained], areas, config.model))
        self.averaged.load_state_dict(self.model.state_dict())
        validation = torch.unique(shapes.instances("validation", protocol)[:, 0])
        chosen = torch.randperm(len(validation), generator=generator(0))[:VALIDATED]
        self.validation = validation[chosen].tolist()
        self.shares = self.shares_of(self.instances)
        self.per_epoch = int(self.shares.sum() / config.batch_size)  # the rest is left out
        if not self.per_epoch:
            raise TrainingError(
                f"{len(self.instances)} instances are no batch of {config.batch_size}: "
                "choose a larger version or a smaller batch"
            )
        self.total = self.per_epoch * config.epochs
        self.every = min(self.per_epoch, EVERY)
        self.progressed = Progressed()
        self.since = time.monotonic()

    def shares_of(self, instances: Tensor) -> Tensor:
        """Return how often each instance is drawn in an epoch, float64, (I,): 1 or less."""
        sizes = [len(self.shapes.graphs[i].features) for i in instances[:, 0].tolist()]
        cost = torch.tensor(sizes, dtype=torch.float64)
        return (self.config.vertices / cost).clamp(max=1) if self.config.vertices else cost / cost

    def rate(self, step: int) -> float:
        """Return the learning rate of a step."""
        if self.config.schedule == "constant":
            return self.config.learning_rate
        if self.config.schedule == "trapezoid":
            plateau, fall, floor = self.config.plateau, self.config.fall, self.config.floor
            fallen = 1 - (1 - floor) * (step - plateau) / (fall - plateau)
            return self.config.learning_rate * min((step + 1) / RISE, 1, max(fallen, floor))
        rise = max(1, round(WARM * self.total))
        if step < rise:
            return self.config.learning_rate * (step + 1) / rise
        return (
            self.config.learning_rate
            * (1 + math.cos(math.pi * (step - rise) / (self.total - rise)))
            / 2
        )

    def batch(self, step: int) -> tuple[list[int], Tensor]:
        """Return the shapes of a step's batch, and their isometries, (b, 3, 3)."""
        size = self.config.batch_size
        if self.config.vertices:
            drawn = torch.multinomial(self.shares, size, generator=generator(self.seed, 0, step))
        else:
            epoch, at = divmod(step, self.per_epoch)
            order = torch.randperm(len(self.instances), generator=generator(self.seed, 0, epoch))
            drawn = order[at * size : (at + 1) * size]
        chosen = self.instances[drawn]
        shapes = chosen[:, 0].tolist()
        if self.config.isometries == "stored":
            return shapes, self.shapes.isometries[chosen[:, 0], chosen[:, 1]]
        draw = random_isometries if self.config.isometries == "random" else random_signs
        return shapes, draw(size, generator(self.seed, 1, step))

    def step(self) -> None:
        """Take a step of the optimiser; now and then, validate and add a row to the log."""
        number = self.progressed.steps
        shapes, isometries = self.batch(number)
        mine = slice(self.rank, None, self.world)
        graphs = [self.shapes.graphs[i] for i in shapes[mine]]
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate(number)
        self.optimiser.zero_grad()
        loss = self.objective(graphs, isometries[mine].to(self.device), self.shapes.y[shapes[mine]])
        if not torch.isfinite(loss):
            raise TrainingError(
                f"the loss is {loss.item()} at step {number}: the last checkpoint in {self.out} "
                "is kept; take a lower rate"
            )
        # DistributedDataParallel takes the mean over processes, whatever their shares.
        (loss * (len(graphs) * self.world / len(shapes))).backward()
        if self.config.clip:
            nn.utils.clip_grad_norm_(self.model.parameters(), self.config.clip)
        self.optimiser.step()
        self.progressed.steps += 1
        self.take_into_average()
        self.progressed.losses.append(loss.item())
        steps = self.progressed.steps
        validated = steps % self.every == 0 or steps == self.total
        if validated or steps % LOGGED == 0:
            self.add_to_log(validated)

    def take_into_average(self) -> None:
        """Move the averaged weights a little towards those of the last step."""
        if self.averaged is self.model:
            return
        share = (RECENT + 1) / (RECENT + self.progressed.steps)
        with torch.no_grad():
            now = self.model.state_dict()
            for name, mean in self.averaged.state_dict().items():
                mean.lerp_(now[name], share)

    def converged(self) -> bool:
        """Return whether the last quarter of the steps has gained too little in validation RPD."""
        rows = [row for row in self.progressed.log if "validation_rpd" in row]
        if not self.config.converged or not rows:
            return False
        quarter = QUARTER * rows[-1]["steps"]
        if quarter < self.config.fall:  # while the rate falls every run improves
            return False
        before = [row["validation_rpd"] for row in rows if row["steps"] <= quarter]
        least = min(row["validation_rpd"] for row in rows)
        return bool(before) and least > (1 - self.config.converged) * min(before)

    def add_to_log(self, validated: bool) -> None:
        """Add a row to the log, with scores on the validation split or without."""
        losses, self.progressed.losses = self.progressed.losses, []
        mean = torch.tensor(sum(losses) / len(losses), device=self.device)
        if self.world > 1:  # each process has seen a share of every batch
            distributed.all_reduce(mean, distributed.ReduceOp.SUM)
            mean /= self.world
        if self.rank:
            return
        row = {
            "epoch": round(self.progressed.steps / self.per_epoch, 3),
            "steps": self.progressed.steps,
            "minutes": round(self.minutes(), 3),
            "loss": mean.item(),
            **(self.validate() if validated else {}),
        }
        self.progressed.log.append(row)
        if sum("validation_rpd" not in row for row in self.progressed.log) > ROWS:
            self.progressed.log = thinned(self.progressed.log)

    def validated(self) -> dict[str, float] | None:
        """Return the last row of the log that has scores."""
        scored = (row for row in reversed(self.progressed.log) if "validation_rpd" in row)
        return next(scored, None)

    def validate(self) -> dict[str, float]:
        """Return PSNR>20 and RPD over some shapes of the validation split."""
        found = predict(
            self.averaged, [self.shapes.graphs[i] for i in self.validation], self.threads
        )
        p, g = found.double().numpy(), self.shapes.y[self.validation].cpu().double().numpy()
        return {
            f"validation_{key}": float(METRICS[key].function(p, g).mean())
            for key in ("psnr20", "rpd")
        }

    def minutes(self) -> float:
        """Return the minutes trained, those before an interruption included."""
        return self.progressed.minutes + (time.monotonic() - self.since) / 60

    def record(self) -> dict[str, Any]:
        """Return what is to be known of the weights."""
        return {
            "config": weights.describe(self.config),
            "version": self.shapes.version,
            "recipe": self.shapes.digest,
            "protocol": self.protocol,
            "seed": self.seed,
            "steps": self.progressed.steps,
            "of": self.total,
            "epochs": round(self.progressed.steps / self.per_epoch, 2),
            "converged": self.converged(),
            "minutes": round(self.minutes(), 2),
            "dtype": str(self.dtype).removeprefix("torch."),
            "sessions": [*self.progressed.sessions, self.session()],
            "losses": self.progressed.losses,
            "log": self.progressed.log,
        }

    def session(self) -> dict[str, Any]:
        """Return what this process computes on, and for how long it has."""
        return {
            "device": device_name(self.device),
            "processes": self.world,
            "threads": self.threads,
            "minutes": round((time.monotonic() - self.since) / 60, 2),
        }

    def save(self) -> None:
        """Write the checkpoint and the log."""
        if self.rank:
            return
        tensors = {f"model.{name}": tensor for name, tensor in self.model.state_dict().items()}
        if self.averaged is not self.model:
            tensors |= {f"mean.{name}": t for name, t in self.averaged.state_dict().items()}
        for number, state in self.optimiser.state_dict()["state"].items():
            for name, tensor in state.items():
                tensors[f"optimiser.{number}.{name}"] = tensor
        weights.write(self.out / CHECKPOINT, tensors, self.record())
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.progressed.log)
        write_text(self.out / LOG, text.getvalue())

    def resume(self) -> None:
        """Go on from the checkpoint.

        Raises
        ------
        TrainingError
            If it is of another configuration, dataset, protocol, seed or dtype.
        WeightsError
            If it is missing or damaged.
        """
        path = self.out / CHECKPOINT
        tensors, record = weights.read(path)
        own = self.record()
        for key in ("config", "version", "recipe", "protocol", "seed", "dtype"):
            if record.get(key) != own[key]:
                apart = difference(record.get(key), own[key])
                raise TrainingError(
                    f"{path} is of another run: its {key} is {apart}; "
                    "choose another --out, or the same options"
                )
        networks = {"model.": self.model}
        if self.averaged is not self.model:
            networks["mean."] = self.averaged
        for prefix, network in networks.items():
            mine = {n.removeprefix(prefix): t for n, t in tensors.items() if n.startswith(prefix)}
            weights.fill(network, mine, path)
        state: dict[int, dict[str, Tensor]] = {}
        for name, tensor in tensors.items():
            kind, number, *rest = name.split(".")
            if kind == "optimiser":
                state.setdefault(int(number), {})[".".join(rest)] = tensor
        try:
            done = [record[key] for key in ("steps", "minutes", "losses", "log", "sessions")]
        except KeyError as error:
            raise weights.WeightsError(f"{path} is damaged: it lacks {error}") from error
        parameters = list(self.model.parameters())
        if done[0] and set(state) != set(range(len(parameters))):
            raise weights.WeightsError(f"{path} is damaged: it lacks a part of the optimiser")
        groups = self.optimiser.state_dict()["param_groups"]
        self.optimiser.load_state_dict({"state": state, "param_groups": groups})
        self.progressed = Progressed(*done)
        self.since = time.monotonic()

    def finish(self) -> None:
        """Write the weights of a row."""
        if not self.rank:
            weights.save_model(self.out / WEIGHTS, self.averaged, self.record())


def thinned(log: list[dict[str, float]]) -> list[dict[str, float]]:
    """Return every row with scores, and every second without; the last one is kept."""
    others = [row["steps"] for row in log if "validation_rpd" not in row]
    kept = set(others[::-2])
    return [row for row in log if "validation_rpd" in row or row["steps"] in kept]


def optimiser(config: TrainConfig, model: nn.Module) -> torch.optim.Optimizer:
    """Return the optimiser of a configuration."""
    rate, decay = config.learning_rate, config.weight_decay
    if config.optimiser == "adamw":
        return torch.optim.AdamW(model.parameters(), rate, weight_decay=decay)
    return torch.optim.SGD(model.parameters(), rate, momentum=config.momentum, weight_decay=decay)


def generator(*numbers: int) -> torch.Generator:
    """Return a generator that depends on these numbers alone."""
    seed = 0
    for number in numbers:
        seed = (seed * 1_000_003 + number + 1) % 2**63
    return torch.Generator().manual_seed(seed)


def random_isometries(count: int, random: torch.Generator) -> Tensor:
    """Draw matrices uniformly from O(3), (count, 3, 3), float32."""
    q, r = torch.linalg.qr(torch.randn(count, 3, 3, dtype=torch.float64, generator=random))
    return (q * torch.sign(torch.diagonal(r, dim1=1, dim2=2))[:, None, :]).float()


def random_signs(count: int, random: torch.Generator) -> Tensor:
    """Draw diagonal matrices of 1 and -1, (count, 3, 3), float32."""
    return torch.diag_embed(2.0 * torch.randint(0, 2, (count, 3), generator=random) - 1)


def difference(theirs: Any, mine: Any) -> str:
    """Say in a few words how two values differ."""
    if isinstance(theirs, dict) and isinstance(mine, dict):
        for key in mine:
            if theirs.get(key) != mine[key]:
                return f"{key} {difference(theirs.get(key), mine[key])}"
    return f"{theirs!r}, not {mine!r}"


def device_name(device: torch.device) -> str:
    """Return a device's name for the record."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    return f"CPU, {torch.backends.cpu.get_cpu_capability()}"
