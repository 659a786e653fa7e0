"""Train every row of the paper's Tables 1 to 3 under one budget, and score it.

    export PYTHONPATH=.
    python scripts/train_gcn.py --minutes 2 --runs runs --protocols grouped --epochs 3=5 4=3 5=2
    python scripts/train_gcn.py --minutes 2 --runs runs --protocols paper --epochs 3=4 4=2 5=1
    python scripts/train_gcn.py --minutes 2 --runs runs --protocols grouped --configs modern

For each protocol and configuration: training for so many minutes, with what the configuration
says otherwise; its weights and a predictor go to baselines/reproduction, its result and
predictions on the version's test split to benchmark/reproduction. What is finished is left as it
is, an interrupted run goes on. Nothing else should run on the machine: the budget is of time.
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
from synthnet.store.files import write_bytes, write_text
from synthnet.types import PROTOCOLS

ROOT = Path(__file__).parent.parent
ROWS = ROOT / "baselines" / "reproduction"
RESULTS = ROOT / "benchmark" / "reproduction"
ROW = '''"""The GCN of the configuration {config}, trained under the protocol {protocol}.

Written by scripts/train_gcn.py.
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from gcn.predictor import Row, load_row, meta

META = meta(__file__)


def load(device: str, seed: int) -> Row:
    """Return the trained network."""
    return load_row(__file__, device, seed)
'''


def pair(text: str) -> tuple[int, int]:
    """Return blocks and epochs of ``3=5``."""
    blocks, _, epochs = text.partition("=")
    if not (blocks.isdigit() and epochs.isdigit() and int(epochs)):
        raise argparse.ArgumentTypeError(f"must be like 3=5, got {text!r}")
    return int(blocks), int(epochs)


def name_of(config: str, protocol: str) -> str:
    """Return the name of a row's files."""
    name = config.replace("-", "_")
    return name if protocol == "grouped" else f"{name}_{protocol}"


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


def scored(row: Path, protocol: str, result: Path, options: argparse.Namespace) -> bool:
    """Evaluate a row on the test split; return whether there is a result.

    Exit code 2 may mean that predictions are not positive, which are scored all the same: the
    paper's networks may answer anything.
    """
    command = ["eigbench", "evaluate", str(row), "--dataset", options.version]
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
    ROWS.mkdir(exist_ok=True)
    wrong = []
    for protocol in options.protocols:
        for config in options.configs:
            name = name_of(config, protocol)
            out, row = options.runs / protocol / config, ROWS / f"{name}.py"
            result = RESULTS / protocol / f"{config}.json"
            if result.exists():
                continue
            print(f"{config}, {protocol}", flush=True)
            if not trained(config, protocol, out, options):
                wrong.append(f"{config}, {protocol}: training")
                continue
            write_bytes(row.with_suffix(".safetensors"), (out / WEIGHTS).read_bytes())
            write_text(row, ROW.format(config=config, protocol=protocol))
            result.parent.mkdir(parents=True, exist_ok=True)
            if not scored(row, protocol, result, options):
                wrong.append(f"{config}, {protocol}: scoring")
    for one in wrong:
        print(f"failed: {one}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
