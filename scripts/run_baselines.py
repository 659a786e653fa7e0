"""Evaluate every row of the leaderboard on the full test split, one after the other.

    python scripts/run_baselines.py DIR

    python scripts/run_baselines.py DIR ritz5 exact
    python scripts/run_baselines.py DIR exact --dataset 2.0
    python scripts/run_baselines.py DIR/family --dataset 2.0 --protocol family --seeds 1

One thread each, on a machine with nothing else to do, because times are compared; each is timed
beside LaPy, so rows may be made on several machines. What is finished in DIR is kept, and an
interrupted row goes on where it stopped. All of them take one to two hours. `eigbench submit` puts
the results in their place. Under a protocol of a version's own, only what is trained is run: the
rest predicts there what it predicts under `grouped`.
"""

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

BASELINES = Path(__file__).parent.parent / "baselines"
ROWS = {  # file: seeds
    "mean": 1,
    "weyl": 1,
    "boosted_trees": 3,
    "ritz3": 1,
    "ritz5": 1,
    "ritz7": 1,
    "decimate300": 1,
    "decimate1000": 1,
    "lumped": 1,
    "exact": 1,
    "certified": 1,
    "multilevel": 1,
    "ritz_mlp": 3,
    "reproduction/modern": 1,
    "gcn_scale_free": 1,
}
TRAINED = ("mean", "boosted_trees", "ritz_mlp", "gcn_scale_free")  # on the set they are asked for
ONLY = {"gcn_scale_free": "2.0"}  # trained on that alone
BATCH = {"1.0": 200, "2.0": 50}  # meshes: 2.0's are six times as large


def run(name: str, command: Sequence[str]) -> int:
    """Run a command of eigbench for a row; return its exit code."""
    print(f"{name}:", flush=True)
    return subprocess.run([sys.executable, "-m", "eigbench", *command], check=False).returncode


def main() -> int:
    """Run what is not there yet; return the first exit code that is not 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("place", type=Path, metavar="DIR", help="of the results")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ROWS)}")
    parser.add_argument("--dataset", default="1.0", choices=BATCH)
    parser.add_argument("--protocol", default="grouped")
    parser.add_argument("--seeds", type=int, help="at most so many (default: those of the row)")
    options = parser.parse_args()
    place = options.place
    if unknown := set(options.names) - set(ROWS):
        parser.error(f"there is no row {min(unknown)!r}: choose of {', '.join(ROWS)}")
    if options.protocol == "paper":
        parser.error("the trained baselines keep no numbers of the test shapes' copies")
    place.mkdir(parents=True, exist_ok=True)
    trained = options.protocol != "grouped"
    rows = TRAINED if trained and "imported" not in options.protocol else ROWS
    default = [name for name in rows if ONLY.get(name) in (None, options.dataset)]
    for name in options.names or default:
        out = place / f"{Path(name).name}.json"
        if out.exists():
            continue
        command = ["evaluate", str(BASELINES / f"{name}.py"), "--resume"]
        command += ["--dataset", options.dataset, "--protocol", options.protocol]
        command += ["--batch-size", str(BATCH[options.dataset])]
        command += ["--no-reference"] if trained else []  # times are shown for grouped only
        command += ["--seeds", str(min(ROWS[name], options.seeds or ROWS[name]))]
        command += ["--out", str(out)]
        if code := run(name, command):
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
