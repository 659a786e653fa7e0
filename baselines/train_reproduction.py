"""Train every row of the paper's Tables 1 to 3 under one budget, and score it.

    train="python -m baselines.train_reproduction --minutes 2 --runs runs"
    $train --protocols grouped --epochs 3=5 4=3 5=2
    $train --protocols paper --epochs 3=4 4=2 5=1
    $train --protocols grouped --configs modern

Each protocol and configuration is trained for so many minutes, otherwise as the configuration says.
The weights go to baselines/reproduction, where baselines/reproduction.py loads them; the result and
the predictions on the version's test split go to benchmark/reproduction. What is finished is left
as it is, an interrupted run goes on. Nothing else should run on the machine: the budget is of time.
A one-cycle rate must come to its end within the minutes: --epochs says, for networks of so many
blocks, how many epochs that is. Then `make tables`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from pathlib import Path

from baselines.gcn import weights
from baselines.gcn.configs import CONFIGS, PAPER
from baselines.gcn.run import CHECKPOINT, WEIGHTS
from synthnet.store.files import make_directory, write_bytes
from synthnet.types import PROTOCOLS

ROOT = Path(__file__).parent.parent
LOADER = ROOT / "baselines" / "reproduction.py"
RESULTS = ROOT / "benchmark" / "reproduction"


def pair(text: str) -> tuple[int, int]:
    """Return blocks and epochs of ``3=5``."""
    blocks, _, epochs = text.partition("=")
    if not (blocks.isdigit() and epochs.isdigit() and int(epochs)):
        raise argparse.ArgumentTypeError(f"must be like 3=5, got {text!r}")
    return int(blocks), int(epochs)


def weights_of(config: str, protocol: str) -> Path:
    """Return the file of a row's weights; its stem is the row's name for the loader."""
    name = config.replace("-", "_")
    name = name if protocol == "grouped" else f"{name}_{protocol}"
    return LOADER.with_suffix("") / f"{name}.safetensors"


def trained(config: str, protocol: str, out: Path, options: argparse.Namespace) -> bool:
    """Train for what is left of the budget; return whether that went well."""
    left, resume = options.minutes, []
    if (out / CHECKPOINT).exists():
        _, record = weights.read(out / CHECKPOINT)
        if record["steps"] >= record["of"] or record["minutes"] >= 0.99 * options.minutes:
            return (out / WEIGHTS).exists()
        left, resume = left - record["minutes"], ["--resume"]
    command = ["baselines.gcn.train", "--config", config, "--protocol", protocol]
    command += ["--version", options.version, "--device", options.device, "--out", str(out)]
    command += ["--max-minutes", f"{left:.3f}", *resume]
    if CONFIGS[config].schedule == "one-cycle":
        epochs = options.epochs.get(CONFIGS[config].model.blocks)
        command += ["--epochs", str(epochs)] if epochs else []
    return subprocess.run([sys.executable, "-m", *command], cwd=ROOT, check=False).returncode == 0


def scored(name: str, protocol: str, result: Path, options: argparse.Namespace) -> bool:
    """Evaluate a row on the test split; return whether there is a result.

    Exit code 2 may mean that predictions are not positive, which are scored all the same: the
    paper's networks may answer anything.
    """
    command = ["eigbench", "evaluate", f"{LOADER}:{name}", "--dataset", options.version]
    command += ["--protocol", protocol, "--device", options.device, "--out", str(result)]
    command += ["--threads", str(os.cpu_count()), "--no-reference"]
    subprocess.run([sys.executable, "-m", *command], cwd=ROOT, check=False)
    return result.exists()


def main(arguments: list[str] | None = None) -> int:
    """Do what is not done yet; return 1 if something went wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--minutes", type=float, required=True, help="of training, for every row")
    parser.add_argument("--runs", type=Path, required=True, help="directory of the checkpoints")
    parser.add_argument(
        "--epochs",
        nargs="*",
        type=pair,
        default=[],
        metavar="BLOCKS=EPOCHS",
        help="of one-cycle schedules, by blocks of the network (default: the configuration's)",
    )
    parser.add_argument("--version", default="1.0-small")
    parser.add_argument("--protocols", nargs="+", default=PROTOCOLS, choices=PROTOCOLS)
    parser.add_argument("--configs", nargs="+", default=list(PAPER), choices=list(CONFIGS))
    parser.add_argument("--device", default="cpu")
    options = parser.parse_args(arguments)
    options.epochs = dict(options.epochs)
    chosen = {CONFIGS[config].model.blocks for config in options.configs}
    if unknown := set(options.epochs) - chosen:
        parser.error(f"--epochs: no chosen configuration has {min(unknown)} blocks")
    make_directory(LOADER.with_suffix(""))
    failed = []
    for protocol in options.protocols:
        for config in options.configs:
            out, row = options.runs / protocol / config, weights_of(config, protocol)
            result = RESULTS / protocol / f"{config}.json"
            if result.exists():
                continue
            print(f"{config}, {protocol}", flush=True)
            if not trained(config, protocol, out, options):
                failed.append(f"{config}, {protocol}: training")
                continue
            write_bytes(row, (out / WEIGHTS).read_bytes())
            make_directory(result.parent)
            if not scored(row.stem, protocol, result, options):
                failed.append(f"{config}, {protocol}: scoring")
    for row_and_step in failed:
        print(f"failed: {row_and_step}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
