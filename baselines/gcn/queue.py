"""Train and score the networks of docs/reproduction.md, one after the other: a queue.

    python -m baselines.gcn.queue                    # what is done, and what is left
    python -m baselines.gcn.queue --run              # go on, until all is done
    python -m baselines.gcn.queue --run --minutes 60 --only table1-rpd-scale-free

A network in the scale-free form is trained until it has converged, by the rule of its
configuration; one under the paper's own schedule for three hours. What is finished stays as it is;
what was scored before it had converged is trained anew.
An interrupted training goes on where it stopped: a kill loses a minute at most. Checkpoints lie in
--runs, which is best kept from one machine to the next. Where it cannot be, --keep leaves the
checkpoint of what has begun in baselines/reproduction/unfinished when --minutes are over, and the
queue on another machine goes on from there. The weights go to baselines/reproduction, where
baselines/reproduction.py loads them; results and predictions on the test split go to
benchmark/reproduction. Then `make tables`. Exit code 1: a training or a scoring has failed.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import filelock
from eigbench import results
from eigbench.errors import EigbenchError
from tabulate import tabulate

from synthnet.errors import SynthNetError
from synthnet.processes import EXIT_CODE, notice_interrupts
from synthnet.store.datasets import home
from synthnet.store.files import make_directory, write_bytes
from synthnet.terminal import above_zero

from . import weights
from .configs import CONFIGS, LONG, PAPER, SCALE_FREE
from .run import CHECKPOINT, WEIGHTS

ROOT = Path(__file__).parents[2]
LOADER = ROOT / "baselines" / "reproduction.py"
RESULTS = ROOT / "benchmark" / "reproduction"
VERSION = "1.0"
LONGEST = 180.0  # minutes of a training without a rule that ends it
BEST = "table2-alg-virtual"  # the paper's best row
TABLE_1 = tuple(name for name in PAPER if name.startswith("table1"))


class QueueError(SynthNetError):
    """A training or a scoring has ended without what it should leave."""


@dataclass(frozen=True, slots=True)
class Training:
    """One training of a row."""

    config: str
    protocol: str = "grouped"
    seed: int = 0

    def __str__(self) -> str:
        return f"{self.config}, {self.protocol}, seed {self.seed}"

    @property
    def row(self) -> str:
        """The row's name for the loader."""
        name = self.config.replace("-", "_")
        return name if self.protocol == "grouped" else f"{name}_{self.protocol}"

    def weights(self) -> Path:
        """Return the file of the weights that are kept."""
        seed = f".{self.seed}" if self.seed else ""
        return LOADER.with_suffix("") / f"{self.row}{seed}.safetensors"

    def unfinished(self) -> Path:
        """Return the file of the checkpoint that --keep leaves for another machine."""
        return self.weights().parent / "unfinished" / self.weights().name

    def result(self) -> Path:
        """Return the file of the row's result, which all its seeds share."""
        return RESULTS / self.protocol / f"{self.config}.json"

    def scored(self) -> bool:
        """Return whether the row's result holds this seed."""
        path = self.result()
        return path.exists() and results.load(path)["predictions"]["seeds"] > self.seed

    def finished(self) -> bool:
        """Return whether it is scored, and its weights are those of an ended training."""
        if not (self.scored() and self.weights().exists()):
            return False
        record = weights.read(self.weights())[1]
        return ended(record) or unspent(self, record) == 0


def trainings() -> list[Training]:
    """Return everything there is to train, in order."""
    rows = sorted(SCALE_FREE, key=lambda name: not name.startswith(BEST))
    anew = [name for name in (*LONG, *rows) if name.startswith((BEST, "table1"))]
    return [
        *(Training(name) for name in (*LONG, *rows)),
        *(Training(name, "paper") for name in anew),
        *(Training(name) for name in TABLE_1),
        *(Training(name, seed=1) for name in rows),
        *(Training(name, "paper", seed=1) for name in anew),
    ]


def folder(training: Training, runs: Path) -> Path:
    """Return the directory of a training's checkpoint and weights."""
    return runs / training.protocol / f"{training.config}-{training.seed}"


def left(training: Training, out: Path) -> float:
    """Return the minutes that a training has left; 0 when it has ended and its weights are there.

    Raises
    ------
    WeightsError
        If a file is damaged.
    """
    if not (out / CHECKPOINT).exists():
        return longest(training)
    record = weights.read(out / CHECKPOINT)[1]
    remaining = unspent(training, record)
    if not (ended(record) or remaining == 0):
        return remaining
    kept = weights.read(out / WEIGHTS)[1]["steps"] if (out / WEIGHTS).exists() else None
    return 0.0 if kept == record["steps"] else 0.01  # it was killed before it wrote them


def longest(training: Training) -> float:
    """Return the minutes after which a training ends, whatever it has reached."""
    return float("inf") if CONFIGS[training.config].converged else LONGEST


def dtype(training: Training) -> str:
    """Return what the blocks compute in: as the paper, or as fast as some processors can."""
    return "float32" if training.config in PAPER else "bfloat16"


def unspent(training: Training, record: dict[str, Any]) -> float:
    """Return the minutes up to the longest; 0 below the hundredth that records are rounded to."""
    remaining = longest(training) - float(record["minutes"])
    return remaining if remaining >= 0.01 else 0.0


def ended(record: dict[str, Any]) -> bool:
    """Return whether a training has taken all its steps, or has converged."""
    return bool(record["converged"]) or record["steps"] >= record["of"]


def train(training: Training, out: Path, options: argparse.Namespace, minutes: float) -> bool:
    """Train for at most so many minutes; return whether it has ended, and its weights are kept."""
    if training.unfinished().exists() and not (out / CHECKPOINT).exists():
        make_directory(out)
        write_bytes(out / CHECKPOINT, training.unfinished().read_bytes())
    if remaining := left(training, out):
        limit = min(minutes, remaining)
        command = ["baselines.gcn.train", "--config", training.config]
        command += ["--protocol", training.protocol, "--seed", str(training.seed)]
        command += ["--version", options.version, "--out", str(out)]
        command += ["--dtype", dtype(training)]
        command += ["--threads", str(options.threads)]
        command += ["--max-minutes", f"{limit:.4f}"] if limit < float("inf") else []
        run([*command, "--resume"] if (out / CHECKPOINT).exists() else command)
    if left(training, out):
        if options.keep:
            make_directory(training.unfinished().parent)
            write_bytes(training.unfinished(), (out / CHECKPOINT).read_bytes())
        return False
    write_bytes(training.weights(), (out / WEIGHTS).read_bytes())
    training.unfinished().unlink(missing_ok=True)
    return True


def score(training: Training, options: argparse.Namespace) -> None:
    """Evaluate a row on the test split, by all seeds up to its own.

    Exit code 2 may mean that predictions are not positive, which are scored all the same: the
    paper's networks may answer anything.

    Raises
    ------
    QueueError
        If there is no result afterwards that holds this seed.
    """
    make_directory(training.result().parent)
    command = ["eigbench", "evaluate", f"{LOADER}:{training.row}", "--dataset", options.version]
    command += ["--protocol", training.protocol, "--seeds", str(training.seed + 1)]
    command += ["--threads", str(options.threads), "--no-reference"]
    command += ["--out", str(training.result())]
    run(command, (0, 2))
    if not training.scored():
        raise QueueError("eigbench has written no result of this seed")


def run(command: Sequence[str], expected: Sequence[int] = (0,)) -> None:
    """Run a Python module at low priority; an interrupt ends it, and waits until it has saved.

    Raises
    ------
    QueueError
        If it ends with another exit code than expected.
    """
    python = ["nice", "-n", "19", sys.executable, "-m"]
    with subprocess.Popen([*python, *command], cwd=ROOT) as process:
        try:
            code = process.wait()
        except KeyboardInterrupt:
            process.terminate()
            process.wait()
            raise
    if code not in expected:
        raise QueueError(f"{command[0]} has ended with exit code {code}")


def table(chosen: Sequence[Training], runs: Path) -> str:
    """Return what is done and what is left."""
    rows = []
    for training in chosen:
        files = (folder(training, runs) / CHECKPOINT, training.weights(), training.unfinished())
        source = next((path for path in files if path.exists()), None)
        cells = ["waits", "", "", "", ""]
        if source is not None:
            record = weights.read(source)[1]
            state = "is finished" if training.finished() else "has begun"
            scores = [
                (f"{row['validation_rpd']:.3f}", f"{row['validation_psnr20']:.1%}")
                for row in record["log"]
                if "validation_rpd" in row
            ]
            cells = [state, f"{record['steps']:,}", f"{record['minutes']:.0f}"]
            cells += scores[-1] if scores else ("", "")
        rows.append([training.config, training.protocol, training.seed, *cells])
    headers = ["configuration", "protocol", "seed", "state", "steps", "minutes"]
    return tabulate(rows, [*headers, "validation RPD", "PSNR>20"], disable_numparse=True)


def go_on(chosen: Sequence[Training], runs: Path, options: argparse.Namespace) -> int:
    """Do what is not done yet; return the exit code."""
    ends = time.monotonic() + 60 * options.minutes
    make_directory(LOADER.with_suffix(""))
    failed = False
    for training in chosen:
        if training.finished():
            continue
        minutes = (ends - time.monotonic()) / 60
        if minutes <= 0:
            say("the time is up; --run goes on")
            break
        say(training)
        try:
            if not train(training, folder(training, runs), options, minutes):
                say("the time is up; --run goes on")
                break
            score(training, options)
        except (SynthNetError, EigbenchError, weights.WeightsError) as error:
            sys.stderr.write(f"gcn.queue: {training}: {error}\n")
            failed = True
    return int(failed)


def say(what: object) -> None:
    """Write a line."""
    sys.stdout.write(f"{what}\n")
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Show the queue, or go on with it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    queued = dict.fromkeys(training.config for training in trainings())
    parser.add_argument("--run", action="store_true", help="go on (default: show the queue)")
    parser.add_argument("--only", nargs="+", metavar="CONFIG", choices=queued)
    parser.add_argument(
        "--minutes", type=above_zero, default=float("inf"), help="train for so many, then stop"
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help="when --minutes are over, leave the checkpoint to another machine",
    )
    parser.add_argument("--threads", type=int, default=1, help="(default: %(default)s)")
    parser.add_argument(
        "--version", default=VERSION, help="of synthNet; the page is of %(default)s, the default"
    )
    parser.add_argument("--runs", type=Path, help="checkpoints (default: beside the datasets)")
    options = parser.parse_args(arguments)
    runs = options.runs or Path(str(home())) / "trainings" / options.version
    chosen = [
        training for training in trainings() if not options.only or training.config in options.only
    ]
    if not options.run:
        say(table(chosen, runs))
        return 0
    notice_interrupts()
    make_directory(runs)
    try:
        with filelock.FileLock(runs / ".lock", timeout=0):
            return go_on(chosen, runs, options)
    except filelock.Timeout:
        sys.stderr.write(f"gcn.queue: another queue is at work in {runs}: wait for it\n")
        return 2
    except KeyboardInterrupt:
        sys.stderr.write("gcn.queue: interrupted; --run goes on\n")
        return EXIT_CODE


if __name__ == "__main__":
    sys.exit(main())
