"""Train and score the networks of docs/reproduction.md, one after the other: a queue.

    python -m baselines.gcn.queue                    # what is done, and what is left
    python -m baselines.gcn.queue --run              # go on, until all is done
    python -m baselines.gcn.queue --run --minutes 60 --only table1-rpd-scale-free

A network in the scale-free form is trained until it has converged, by the rule of its
configuration; one under the paper's own schedule for three hours. What is finished stays as it is.
An interrupted training goes on where it stopped: a kill loses a minute at most. Checkpoints lie in
--runs, which is best kept from one machine to the next. The weights go to baselines/reproduction,
where baselines/reproduction.py loads them; results and predictions on the test split go to
benchmark/reproduction. Then `make tables`.
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

from tabulate import tabulate

from synthnet.store.datasets import home
from synthnet.store.files import make_directory, write_bytes

from . import weights
from .configs import CONFIGS, PAPER, SCALE_FREE
from .run import CHECKPOINT, WEIGHTS

ROOT = Path(__file__).parents[2]
LOADER = ROOT / "baselines" / "reproduction.py"
RESULTS = ROOT / "benchmark" / "reproduction"
VERSION = "1.0"
LONGEST = 180.0  # minutes of a training without a rule that ends it
BEST = "table2-alg-virtual"  # the paper's best row
TABLE_1 = tuple(name for name in PAPER if name.startswith("table1"))


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

    def result(self) -> Path:
        """Return the file of the row's result."""
        return RESULTS / self.protocol / f"{self.config}.json"


def trainings() -> list[Training]:
    """Return everything there is to train, in order."""
    rows = sorted(SCALE_FREE, key=lambda name: not name.startswith(BEST))
    anew = [name for name in rows if name.startswith((BEST, "table1"))]
    return [
        *(Training(name) for name in rows),
        *(Training(name, "paper") for name in anew),
        *(Training(name) for name in TABLE_1),
        *(Training(name, seed=1) for name in rows),
        *(Training(name, "paper", seed=1) for name in anew),
    ]


def left(record: dict[str, Any]) -> float | None:
    """Return the minutes that a training has left, 0 when it has ended, ``None`` for no limit."""
    if record["converged"] or record["steps"] >= record["of"]:
        return 0.0
    if weights.config_of(record).converged:
        return None
    remaining = LONGEST - record["minutes"]
    return remaining if remaining > 0.01 * LONGEST else 0.0


def train(one: Training, runs: Path, options: argparse.Namespace, minutes: float) -> bool:
    """Train for at most so many minutes; return whether the training has ended."""
    out = folder(one, runs)
    remaining: float | None = None if CONFIGS[one.config].converged else LONGEST
    begun = (out / CHECKPOINT).exists()
    if begun:
        remaining = left(weights.read(out / CHECKPOINT)[1])
    if remaining != 0:
        limit = minutes if remaining is None else min(minutes, remaining)
        command = ["baselines.gcn.train", "--config", one.config, "--protocol", one.protocol]
        command += ["--seed", str(one.seed), "--version", options.version, "--out", str(out)]
        command += ["--threads", str(options.threads)]
        command += ["--max-minutes", f"{limit:.3f}"] if limit < float("inf") else []
        run([*command, "--resume"] if begun else command)
    return left(weights.read(out / CHECKPOINT)[1]) == 0


def score(one: Training, options: argparse.Namespace) -> None:
    """Evaluate a row on the test split, by all seeds that are trained.

    Exit code 2 may mean that predictions are not positive, which are scored all the same: the
    paper's networks may answer anything.
    """
    make_directory(one.result().parent)
    seeds = 1
    while Training(one.config, one.protocol, seeds).weights().exists():
        seeds += 1
    command = ["eigbench", "evaluate", f"{LOADER}:{one.row}", "--dataset", options.version]
    command += ["--protocol", one.protocol, "--seeds", str(seeds), "--out", str(one.result())]
    run([*command, "--threads", str(options.threads), "--no-reference"], (0, 2))


def run(command: Sequence[str], expected: Sequence[int] = (0,)) -> None:
    """Run a Python module at low priority.

    Raises
    ------
    subprocess.CalledProcessError
        If it ends with another exit code than expected.
    """
    python = ["nice", "-n", "19", sys.executable]
    done = subprocess.run([*python, "-m", *command], cwd=ROOT, check=False)
    if done.returncode not in expected:
        raise subprocess.CalledProcessError(done.returncode, command)


def folder(one: Training, runs: Path) -> Path:
    """Return the directory of a training's checkpoint."""
    return runs / one.protocol / f"{one.config}-{one.seed}"


def table(chosen: Sequence[Training], runs: Path) -> str:
    """Return what is done and what is left."""
    rows = []
    for one in chosen:
        checkpoint = folder(one, runs) / CHECKPOINT
        source = checkpoint if checkpoint.exists() else one.weights()
        cells = ["waits", "", "", "", ""]
        if source.exists():
            record = weights.read(source)[1]
            scored = [row for row in record["log"] if "validation_rpd" in row]
            state = "is trained" if one.weights().exists() else "has begun"
            cells = [state, f"{record['steps']:,}", f"{record['minutes']:.0f}"]
            shares = [f"{r['validation_rpd']:.3f} {r['validation_psnr20']:.1%}" for r in scored]
            cells += shares[-1].split() if shares else ["", ""]
        rows.append([one.config, one.protocol, one.seed, *cells])
    headers = ["configuration", "protocol", "seed", "state", "steps", "minutes"]
    return tabulate(rows, [*headers, "validation RPD", "PSNR>20"], disable_numparse=True)


def say(what: object) -> None:
    """Write a line."""
    sys.stdout.write(f"{what}\n")
    sys.stdout.flush()


def go_on(chosen: Sequence[Training], runs: Path, options: argparse.Namespace) -> int:
    """Do what is not done yet; return the exit code."""
    ends = time.monotonic() + 60 * options.minutes
    make_directory(LOADER.with_suffix(""))
    for one in chosen:
        if one.weights().exists():
            continue
        say(one)
        try:
            if not train(one, runs, options, (ends - time.monotonic()) / 60):
                say("the time is up; --run goes on")
                return 0
            write_bytes(one.weights(), (folder(one, runs) / WEIGHTS).read_bytes())
            score(one, options)
        except subprocess.CalledProcessError as error:
            sys.stderr.write(f"gcn.queue: {one}: {error.cmd[0]} ended with {error.returncode}\n")
            return error.returncode
        except KeyboardInterrupt:
            return 130
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Show the queue, or go on with it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--run", action="store_true", help="go on (default: show the queue)")
    parser.add_argument("--only", nargs="+", metavar="CONFIG", choices=[*PAPER, *SCALE_FREE])
    parser.add_argument("--minutes", type=float, default=float("inf"), help="stop after so many")
    parser.add_argument("--threads", type=int, default=1, help="(default: %(default)s)")
    parser.add_argument("--version", default=VERSION, help="of synthNet (default: %(default)s)")
    parser.add_argument("--runs", type=Path, help="checkpoints (default: beside the datasets)")
    options = parser.parse_args(arguments)
    runs = options.runs or Path(str(home())) / "trainings" / options.version
    chosen = [one for one in trainings() if not options.only or one.config in options.only]
    if options.run:
        return go_on(chosen, runs, options)
    sys.stdout.write(f"{table(chosen, runs)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
