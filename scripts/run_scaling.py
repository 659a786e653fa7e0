"""Run every row of the leaderboard on the surfaces of the scaling track, one after the other.

    python scripts/run_scaling.py DIR

    python scripts/run_scaling.py DIR ritz5 exact --sizes 1000 10000

One thread each, on a machine with nothing else to do, all of them on the same one: times of
different machines are not compared. What is finished in DIR is kept, mesh by mesh, and sizes
that an earlier run left out are added. `eigbench submit` puts the results in their place.
"""

import argparse
import sys
from pathlib import Path

from run_baselines import BASELINES, ROWS, run


def main() -> int:
    """Run what is not there yet; return the first exit code that is not 0."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("place", type=Path, metavar="DIR", help="of the results")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(ROWS)}")
    parser.add_argument("--sizes", nargs="+", metavar="N", help="as of `eigbench scale`")
    parser.add_argument("--time-limit", default="600", metavar="S", help="as of `eigbench scale`")
    parser.add_argument(
        "--memory-limit", default="16", metavar="GIB", help="as of `eigbench scale`"
    )
    options = parser.parse_args()
    if unknown := set(options.names) - set(ROWS):
        parser.error(f"there is no row {min(unknown)!r}: choose of {', '.join(ROWS)}")
    options.place.mkdir(parents=True, exist_ok=True)
    for name in options.names or ROWS:
        out = options.place / f"{Path(name).name}.json"
        command = ["scale", str(BASELINES / f"{name}.py"), "--resume", "--out", str(out)]
        command += ["--time-limit", options.time_limit, "--memory-limit", options.memory_limit]
        command += ["--sizes", *options.sizes] if options.sizes else []
        if code := run(name, command):
            return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
