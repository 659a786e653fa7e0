"""Train a graph convolutional network.

    python -m baselines.gcn.train --config table1-rpd --version 1.0-small --out runs/table1-rpd
    python -m baselines.gcn.train --config modern --out runs/modern --max-minutes 10
    python -m baselines.gcn.train --config modern --out runs/modern --resume
    torchrun --nproc-per-node 2 -m baselines.gcn.train --config modern --out runs/modern

The directory --out gets checkpoint.safetensors, log.csv (the mean loss of every ten steps; every
hundred, or every epoch if that is shorter, scores on the validation split) and
weights.safetensors. A run that was
interrupted, or stopped by --max-minutes, goes on with --resume.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from torch import distributed

from synthnet.build.versions import ensure_built
from synthnet.errors import SynthNetError
from synthnet.store.files import make_directory
from synthnet.types import PROTOCOLS

from . import data
from .configs import CONFIGS, TrainConfig
from .encodings import MeshError
from .run import CHECKPOINT, WEIGHTS, Run, TrainingError
from .weights import WeightsError

CHECKPOINT_SECONDS = 60.0


def main(arguments: list[str] | None = None) -> int:
    """Train, and return the exit code."""
    options = parser().parse_args(arguments)
    try:
        with group(options.device) as (rank, world):
            return train(options, rank, world)
    except KeyboardInterrupt:
        sys.stderr.write("gcn.train: interrupted before the first step\n")
        return 130
    except torch.OutOfMemoryError:
        return refuse(
            f"the GPU's memory does not hold a batch of {options.batch_size or 'this size'}: "
            "choose a smaller --batch-size or --version; the last checkpoint is kept"
        )
    except (SynthNetError, TrainingError, WeightsError, MeshError) as error:
        return refuse(str(error))


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(
        prog="python -m baselines.gcn.train",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.add_argument(
        "--config", required=True, metavar="NAME", help=f"one of {', '.join(CONFIGS)}"
    )
    made.add_argument("--version", default="1.0-small", help="of synthNet (default: %(default)s)")
    made.add_argument("--protocol", default="grouped", choices=PROTOCOLS, help="of the split")
    made.add_argument("--out", required=True, type=Path, help="directory of this run")
    made.add_argument("--seed", type=int, default=0)
    made.add_argument("--epochs", type=int, help="instead of the configuration's")
    made.add_argument("--batch-size", type=int, help="instead of the configuration's")
    made.add_argument("--max-minutes", type=float, help="stop then; --resume goes on")
    made.add_argument("--resume", action="store_true", help="go on from the checkpoint in --out")
    made.add_argument("--device", default="cpu", help="cpu or cuda (default: %(default)s)")
    made.add_argument("--dtype", default="float32", choices=("float32", "bfloat16"))
    made.add_argument("--threads", type=int, help="meshes at a time (default: one a core)")
    made.add_argument("--data", help="directory of the datasets (default: $SYNTHNET_HOME)")
    return made


def checked(options: argparse.Namespace) -> TrainConfig:
    """Return the configuration that the options name.

    Raises
    ------
    TrainingError
        If an option is out of range, or ``--out`` holds another run's files.
    """
    if options.config not in CONFIGS:
        raise TrainingError(
            f"there is no configuration {options.config!r}: choose one of {', '.join(CONFIGS)}"
        )
    for name in ("epochs", "batch_size", "max_minutes", "threads"):
        value = getattr(options, name)
        if value is not None and not 0 < value < float("inf"):
            raise TrainingError(f"--{name.replace('_', '-')} must be positive, got {value}")
    if not 0 <= options.seed < 2**63:
        raise TrainingError(f"--seed must be 0 to 2**63 - 1, got {options.seed}")
    begun = (options.out / CHECKPOINT).exists()
    if options.resume and not begun:
        raise TrainingError(f"{options.out} has no checkpoint: leave --resume out to begin")
    if begun and not options.resume:
        raise TrainingError(
            f"{options.out} has a checkpoint: add --resume to go on with it, "
            "or choose another --out"
        )
    if not begun and (options.out / WEIGHTS).exists():
        raise TrainingError(f"{options.out} has {WEIGHTS} of another run: choose another --out")
    given = {key: getattr(options, key) for key in ("epochs", "batch_size")}
    return replace(CONFIGS[options.config], **{k: v for k, v in given.items() if v is not None})


def train(options: argparse.Namespace, rank: int, world: int) -> int:
    """Run what the options say, as one of ``world`` processes."""
    config = checked(options)
    threads = options.threads or torch.get_num_threads()
    torch.set_num_threads(1)  # meshes are shared out among threads, not their operations
    device = device_of(options.device, rank)
    console = Console(stderr=True, quiet=bool(rank))
    ensure_built(options.version, options.data)  # or say why not, before anything is promised
    console.print(f"Encoding the shapes of {options.version}")
    shapes = data.load(options.version, config.model, options.data, threads).to(device)
    make_directory(options.out)
    run = Run(
        config,
        shapes,
        protocol=options.protocol,
        seed=options.seed,
        out=options.out,
        device=device,
        dtype=getattr(torch, options.dtype),
        threads=threads,
        rank=rank,
        world=world,
    )
    if options.resume:
        run.resume()
    stopped = loop(run, options.max_minutes, console)
    run.save()
    run.finish()
    if not rank:
        sys.stdout.write(f"{progress_of(run)}\n")
    return 130 if stopped == "interrupted" else 0


def loop(run: Run, minutes: float | None, console: Console) -> str:
    """Take steps until all are taken, the run has converged, the time is up or someone interrupts.

    Return which of these it was. Only the first process keeps the log, and so can tell whether the
    run has converged.
    """
    began, saved = time.monotonic(), time.monotonic()
    with interruptions() as interrupted, bar(run, console) as show:
        while run.progressed.steps < run.total:
            late = minutes is not None and time.monotonic() - began >= 60 * minutes
            reason = agreed(3 if interrupted else 2 if late else int(run.converged()), run)
            if reason:
                return ("", "converged", "time is up", "interrupted")[reason]
            run.step()
            show(began, minutes)
            if time.monotonic() - saved >= CHECKPOINT_SECONDS:
                run.save()
                saved = time.monotonic()
    return "done"


def agreed(reason: int, run: Run) -> int:
    """Return the largest reason to stop of all processes: they stop at the same step."""
    if run.world == 1:
        return reason
    everyone = torch.tensor(reason, device=run.device)
    distributed.all_reduce(everyone, distributed.ReduceOp.MAX)
    return int(everyone)


@contextlib.contextmanager
def interruptions() -> Iterator[list[int]]:
    """Collect Ctrl-C and SIGTERM instead of dying of them, so that a step is finished."""
    seen: list[int] = []
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(kind, lambda number, _: seen.append(number)) for kind in kinds]
    try:
        yield seen
    finally:
        for kind, handler in zip(kinds, before, strict=True):
            signal.signal(kind, handler)


@contextlib.contextmanager
def bar(run: Run, console: Console) -> Iterator[Any]:
    """Show a bar with the loss, the last validation and the time left."""
    columns = (BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    first = run.progressed.steps
    with Progress(*columns, console=console) as progress:
        task = progress.add_task("", total=run.total, completed=first)

        def show(began: float, minutes: float | None) -> None:
            done = run.progressed
            spent = time.monotonic() - began
            left = spent / (done.steps - first) * (run.total - done.steps)
            if minutes is not None:
                left = min(left, 60 * minutes - spent)
            text = f"step {done.steps:,} of {run.total:,}"
            if done.log:
                text += f"  loss {done.log[-1]['loss']:.4f}"
            if last := run.validated():
                text += f"  validation PSNR>20 {last['validation_psnr20']:.1%}"
            text += f"  {max(0.0, left) / 60:.1f} min left"
            progress.update(task, completed=done.steps, description=text)

        yield show


def progress_of(run: Run) -> str:
    """Return the end of a run in one line."""
    done = run.progressed
    text = f"{done.steps:,} of {run.total:,} steps, {run.minutes():.1f} min"
    if last := run.validated():
        text += f", validation PSNR>20 {last['validation_psnr20']:.1%}"
    if run.converged():
        text += "; converged"
    elif done.steps < run.total:
        text += "; --resume goes on"
    return f"{text}: {run.out}"


@contextlib.contextmanager
def group(device: str) -> Iterator[tuple[int, int]]:
    """Join the processes that ``torchrun`` has started, if it has; yield rank and number."""
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        yield 0, 1
        return
    if device == "cuda" and torch.cuda.is_available():
        torch.cuda.set_device(int(os.environ["LOCAL_RANK"]))
    distributed.init_process_group("nccl" if device == "cuda" else "gloo")
    try:
        yield distributed.get_rank(), world
    finally:
        distributed.destroy_process_group()


def device_of(name: str, rank: int) -> torch.device:
    """Return the device to compute on."""
    if name not in ("cpu", "cuda"):
        raise TrainingError(f"--device must be cpu or cuda, got {name!r}")
    if name == "cpu":
        return torch.device("cpu")
    if not torch.cuda.is_available():
        raise TrainingError("no CUDA device is available: use --device cpu")
    return torch.device("cuda", int(os.environ.get("LOCAL_RANK", rank)))


def refuse(message: str) -> int:
    """Say what is wrong in one line."""
    sys.stderr.write(f"gcn.train: {message}\n")
    return 2


if __name__ == "__main__":
    sys.exit(main())
