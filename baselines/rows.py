"""Run the rows of the leaderboard: list them, and make again what an earlier version has made.

    python -m baselines.rows                                 # the rows, and which are marked
    python -m baselines.rows --marked                        # run these again and submit them
    python -m baselines.rows --run                           # run and submit all of 1.0/grouped
    python -m baselines.rows --run exact ritz5 --board 2.0/family --seeds 1
    python -m baselines.rows --run exact --board scaling --sizes 1000 10000

One thread each, on a machine with nothing else to do, because times are compared. Rows of a board
are timed beside LaPy, so they may be made on several machines; those of the scaling track are
compared on one machine only. What is finished in --results is kept as long as the row's own sources
stay (remove it after an edit of synthnet) and as many seeds are asked for, and an interrupted row
goes on where it stopped. All of one dataset take one to two hours. Under a protocol of a version's
own, only what is trained is run: the rest predicts there what it predicts under `grouped`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eigbench import results
from eigbench.results.sources import outdated
from tabulate import tabulate

ROOT = Path(__file__).parent.parent
SEVERAL = ("boosted_trees", "ritz_mlp", "ritz_mlp_surface", "spectrum_mlp")  # have three seeds
NAMES = """
mean weyl boosted_trees ritz3 ritz5 ritz7 decimate300 decimate1000 lumped exact lapy_cholmod
certified multilevel two_masses quadratic richardson curved ritz_mlp kriging ritz_mlp_surface
spectrum_mlp multilevel_masses reproduction:table2_alg_virtual_long gcn_scale_free
patch_transformer
"""
SEEDS = {name: 3 if name in SEVERAL else 1 for name in NAMES.split()}  # of each row's predictor
TRAINED = (  # on the set they are asked for
    "mean",
    "boosted_trees",
    "ritz_mlp",
    "gcn_scale_free",
    "kriging",
    "ritz_mlp_surface",
    "spectrum_mlp",
    "multilevel_masses",
)
ONLY = {"gcn_scale_free": "2.0", "patch_transformer": "2.0"}  # they are trained on that alone
ELEMENTS = ("quadratic", "richardson")  # they take half an hour and more a board
SOME = {  # most meshes of 2.1 are those of 2.0: what can say something new is run on it
    "2.1": (
        *("mean", "weyl", "exact", "lapy_cholmod", "certified", "two_masses", "curved"),
        *("multilevel", "kriging", "ritz_mlp_surface", "spectrum_mlp", "multilevel_masses"),
        *ELEMENTS,
    )
}
# Meshes; those of 2.0 and 2.1 have four times as many vertices as those of 1.0
BATCH = {"1.0": 200, "2.0": 50, "2.1": 50}
IMPORTED = ("imported/real-28", "imported/pypi-246")
PROTOCOLS = {
    "1.0": ("grouped",),
    "2.0": ("grouped", "family", "resolution", "genus", "boundary", *IMPORTED),
    "2.1": ("grouped", "cad", "cortex", *IMPORTED),
}
SCALING = "scaling"
NOT_RUN = {  # a test holds this list to what lies on the boards
    # The rows of that track are compared on one machine, which has not run the network since it was
    # trained to the end.
    SCALING: (*ELEMENTS, "gcn_scale_free"),
    "2.0/family": ("gcn_scale_free",),  # 20 trainings of half an hour
    # They certify what they compute, and cannot on needles.
    "2.0/imported/pypi-246": ELEMENTS,
    "2.1/imported/pypi-246": ELEMENTS,
}
BOARDS = (
    *(f"{version}/{protocol}" for version, some in PROTOCOLS.items() for protocol in some),
    SCALING,
)


@dataclass(frozen=True, slots=True)
class Row:
    """A baseline on a board; ``result`` is what the board has of it, if anything."""

    name: str
    board: str
    result: dict[str, Any] | None

    @property
    def marked(self) -> bool:
        """Whether an earlier version of the code made it."""
        return self.result is not None and outdated(self.result, ROOT)

    @property
    def state(self) -> str:
        """What the board has."""
        if self.result is None:
            return "not run"
        return "made by an earlier version" if self.marked else "as the code is"


def code(name: str) -> str:
    """Return a baseline's file, or the name of one of several: ``reproduction.py:table1_rpd``."""
    file, colon, variant = name.partition(":")
    return f"{file}.py{colon}{variant}"


def usual(board: str) -> list[str]:
    """Return the baselines that belong on a board."""
    version, _, protocol = board.partition("/")
    trained_anew = board != SCALING and protocol != "grouped" and "imported" not in protocol
    every = list(TRAINED if trained_anew else SEEDS)
    some = [name for name in every if name in SOME.get(version, every)]
    return [name for name in some if board == SCALING or ONLY.get(name) in (None, version)]


def rows(boards: Sequence[str], names: Sequence[str] = ()) -> Iterator[Row]:
    """Yield the rows of some boards, or those of some baselines."""
    for board in boards:
        name = board if board == SCALING else f"results/{board.replace('/', '-test-', 1)}"
        folder = ROOT / "benchmark" / name.replace("imported/", "imported-")
        there = [results.load(path) for path in sorted(folder.glob("*.json"))]
        by_code = {result["model"]["code"]: result for result in there}
        for baseline in names or usual(board):
            yield Row(baseline, board, by_code.get(code(baseline)))


def command(row: Row, out: Path, options: argparse.Namespace) -> list[str]:
    """Return the command of eigbench that makes a row."""
    start = [str(ROOT / "baselines" / code(row.name)), "--resume", "--out", str(out)]
    if row.board == SCALING:
        sizes = ["--sizes", *options.sizes] if options.sizes else []
        limits = ["--time-limit", options.time_limit, "--memory-limit", options.memory_limit]
        return ["scale", *start, *limits, *sizes]
    version, _, protocol = row.board.partition("/")
    batch_size, seeds = counts(row, options)
    shown = [] if protocol == "grouped" else ["--no-reference"]  # times are shown for grouped only
    split = ["--dataset", version, "--protocol", protocol, *shown]
    return ["evaluate", *start, *split, "--batch-size", str(batch_size), "--seeds", str(seeds)]


def counts(row: Row, options: argparse.Namespace) -> tuple[int, int]:
    """Return meshes a batch, and seeds: those that a row has, if any, or fewer."""
    seeds = SEEDS[row.name] if row.result is None else row.result["predictions"]["seeds"]
    return BATCH[row.board.partition("/")[0]], min(SEEDS[row.name], options.seeds or seeds)


def eigbench(*arguments: str) -> int:
    """Run a command of eigbench; return its exit code."""
    return subprocess.run([sys.executable, "-m", "eigbench", *arguments], check=False).returncode


def make(row: Row, options: argparse.Namespace) -> int:
    """Evaluate and submit a row; return the first exit code that is not 0."""
    print(f"{row.name}, {row.board}:", flush=True)
    folder = options.results / row.board.replace("/", "-")
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / f"{row.name.replace(':', '-')}.json"
    made = results.load(out) if out.exists() else None
    if made is not None and outdated(made, ROOT):
        out.unlink()
        made = None
    finished = False  # on the scaling track --resume adds sizes
    if made is not None and row.board != SCALING:
        has = made["cost"]["batch_size"], made["predictions"]["seeds"]
        finished = has == counts(row, options)
    status = 0 if finished else eigbench(*command(row, out, options))
    if status:
        return status
    return eigbench("submit", str(out), "--replace", "--board", str(ROOT))


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--marked", action="store_true", help="run what an earlier version made")
    what.add_argument(
        "--run", nargs="*", metavar="NAME", help=f"run these (default: all) of {', '.join(SEEDS)}"
    )
    parser.add_argument(
        "--board", nargs="+", metavar="B", help=f"of {', '.join(BOARDS)} (--run: 1.0/grouped)"
    )
    parser.add_argument(
        "--results", type=Path, default=ROOT / "runs" / "rows", metavar="DIR", help="of this run"
    )
    parser.add_argument("--seeds", type=int, help="at most so many (default: those of the row)")
    parser.add_argument("--sizes", nargs="+", metavar="N", help="as of `eigbench scale`")
    parser.add_argument("--time-limit", default="600", metavar="S", help="as of `eigbench scale`")
    parser.add_argument(
        "--memory-limit", default="16", metavar="GIB", help="as of `eigbench scale`"
    )
    options = parser.parse_args(arguments)
    options.board = options.board or (BOARDS if options.run is None else BOARDS[:1])
    for board in options.board:
        version, _, protocol = board.partition("/")
        if protocol == "paper":
            parser.error("the trained baselines keep no numbers of the test shapes' copies")
        if board != SCALING and not (version in BATCH and protocol):
            parser.error(f"there is no board {board!r}: choose one of {', '.join(BOARDS)}")
    if unknown := set(options.run or ()) - set(SEEDS):
        parser.error(f"there is no row {min(unknown)!r}: choose one of {', '.join(SEEDS)}")
    return options


def main(arguments: Sequence[str] | None = None) -> int:
    """List the rows, and run those that are asked for; return the first exit code that is not 0."""
    options = parse(arguments)
    every = list(rows(options.board, options.run or ()))
    if options.run is not None:
        chosen = every
    else:
        chosen = [row for row in every if options.marked and row.marked]
        print(tabulate([(row.board, row.name, row.state) for row in every], tablefmt="plain"))
        print(f"{sum(row.marked for row in every)} of {len(every)} rows are marked")
    for row in chosen:
        if status := make(row, options):
            return status
    return eigbench("leaderboard", "--board", str(ROOT)) if chosen else 0


if __name__ == "__main__":
    sys.exit(main())
