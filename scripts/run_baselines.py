"""Evaluate every row of the leaderboard on the full test split, one after the other.

    python scripts/run_baselines.py DIR

    python scripts/run_baselines.py DIR ritz5 exact

One thread each, on a machine with nothing else to do, because times are compared; each is timed
beside LaPy, so rows may be made on several machines. What is finished in DIR is kept, and an
interrupted row goes on where it stopped. All of them take one to two hours. `eigbench submit` puts
the results in their place.
"""

import argparse
import subprocess
import sys
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
}


def main() -> int:
    """Run what is not there yet; return the first exit code that is not 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("place", type=Path, metavar="DIR", help="of the results")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ROWS)}")
    options = parser.parse_args()
    place = options.place
    if unknown := set(options.names) - set(ROWS):
        parser.error(f"there is no row {min(unknown)!r}: choose of {', '.join(ROWS)}")
    place.mkdir(parents=True, exist_ok=True)
    for name in options.names or ROWS:
        out = place / f"{Path(name).name}.json"
        if out.exists():
            continue
        command = ["evaluate", str(BASELINES / f"{name}.py"), "--resume"]
        command += ["--seeds", str(ROWS[name]), "--out", str(out)]
        print(f"{name}:", flush=True)
        done = subprocess.run([sys.executable, "-m", "eigbench", *command], check=False)
        if done.returncode:
            return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
