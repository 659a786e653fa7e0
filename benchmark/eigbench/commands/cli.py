"""The command line: what each command takes, and the exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eigbench.board.ranking import RANKED_BY
from eigbench.commands import board, predictor
from eigbench.commands import scaling as scaling_commands
from eigbench.errors import EigbenchError
from eigbench.scoring.metrics import METRICS
from eigbench.site.write import DOCS
from synthnet.errors import SynthNetError
from synthnet.processes import EXIT_CODE
from synthnet.terminal import WRONG_INPUT, Parser
from synthnet.types import PROTOCOLS, SPLITS
from synthnet.version import __version__


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    0: done. 1: ``check`` or ``leaderboard --check`` found something. 2: the input or the
    predictor would not do; one line says what and what to do. 130: interrupted, by Ctrl-C or
    SIGTERM.
    """
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of a pipe has gone: nothing is left to say
        return 0
    except (EigbenchError, SynthNetError, ValueError) as error:
        print(f"eigbench: {error}", file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        kept = (
            "; what was finished is kept, --resume goes on from it" if "resume" in options else ""
        )
        print(f"eigbench: interrupted{kept}", file=sys.stderr)
        return EXIT_CODE
    return code


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="eigbench",
        description="Score predictors of the first ten Laplace-Beltrami eigenvalues of meshes.",
        epilog="example: eigbench check my_model.py",
    )
    parser.add_argument("--version", action="version", version=f"eigbench {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Any, text: str, example: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name, help=text, description=text, epilog=f"example: eigbench {name} {example}"
        )
        sub.set_defaults(run=run)
        sub.add_argument("--json", action="store_true", help="print JSON for a program")
        return sub

    def split_options(sub: argparse.ArgumentParser) -> None:
        which = sub.add_mutually_exclusive_group()
        which.add_argument(
            "--dataset",
            default="1.0",
            metavar="V",
            help="a version, an import, or a directory that synthnet made (default: 1.0)",
        )
        which.add_argument(
            "--sealed",
            type=Path,
            metavar="SEAL.json",
            help="the sealed set of this seal, where it is built (see docs/sealed.md)",
        )
        sub.add_argument("--split", default="test", choices=SPLITS)
        sub.add_argument(
            "--protocol",
            default="grouped",
            metavar="P",
            help=f"{', '.join(PROTOCOLS)}, or one of the version's own: of 2.0 family, "
            "resolution, genus, boundary, imported/NAME (default: grouped)",
        )

    sub = command(
        "check",
        predictor.check,
        "try a predictor on a few dozen meshes; this runs the file's code",
        "my_model.py",
    )
    sub.add_argument("predictor", type=Path, metavar="FILE", help="the predictor's Python file")
    sub.add_argument("--time-limit", type=float, default=600.0, metavar="S")

    sub = command(
        "evaluate",
        predictor.run_evaluate,
        "run a predictor over a split and score it; this runs the file's code",
        "my_model.py --dataset 1.0 --out results.json",
    )
    sub.add_argument("predictor", type=Path, metavar="FILE", help="the predictor's Python file")
    split_options(sub)
    sub.add_argument("--root", type=Path, metavar="DIR", help="directory that holds the versions")
    sub.add_argument("--out", type=Path, default=Path("results.json"), metavar="FILE")
    sub.add_argument(
        "--predictions", type=Path, metavar="FILE", help="default: beside --out, .parquet"
    )
    sub.add_argument("--device", default="cpu", help="handed to the predictor (default: cpu)")
    sub.add_argument("--batch-size", type=_positive, default=200, metavar="B")
    sub.add_argument("--seeds", type=_positive, default=1, metavar="N", help="runs (default: 1)")
    sub.add_argument("--threads", type=_positive, default=1, metavar="N", help="default: 1")
    sub.add_argument("--time-limit", type=float, default=3600.0, metavar="S", help="for a batch")
    sub.add_argument(
        "--limit", type=_positive, metavar="N", help="only N instances: a partial result"
    )
    sub.add_argument("--resume", action="store_true", help="go on with an interrupted run")
    sub.add_argument(
        "--no-reference",
        dest="reference",
        action="store_false",
        help="do not time LaPy on some of the same meshes; a board wants it timed",
    )

    sub = command(
        "score",
        predictor.score,
        "score a file of predictions; no code is run",
        "preds.parquet",
    )
    sub.add_argument("file", type=Path, metavar="FILE", help=".parquet, .npz or .csv")
    split_options(sub)
    sub.add_argument(
        "--root", type=Path, metavar="DIR", help="directory that holds a sealed set or import"
    )

    def directory_option(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--dataset",
            type=Path,
            metavar="DIR",
            help="what was predicted, if it is no pinned version",
        )

    def board_option(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--board",
            type=Path,
            default=Path(),
            metavar="DIR",
            help="a checkout of the project, or any directory of its layout (default: here)",
        )

    sub = command(
        "compare",
        board.compare,
        "compare two results, mesh by mesh; their predictions are looked for beside them",
        "a.json b.json",
    )
    sub.add_argument("a", type=Path, metavar="A.json")
    sub.add_argument("b", type=Path, metavar="B.json")
    sub.add_argument(
        "--predictions",
        type=Path,
        nargs=2,
        metavar=("A", "B"),
        default=(None, None),
        help="if they are elsewhere",
    )
    directory_option(sub)

    sub = command(
        "submit",
        board.submit,
        "check a result and its predictions, and put both in their place on the board",
        "results.json",
    )
    sub.add_argument("result", type=Path, metavar="RESULT.json")
    sub.add_argument("--predictions", type=Path, metavar="FILE", help="default: beside the result")
    sub.add_argument("--replace", action="store_true", help="replace the model's earlier result")
    board_option(sub)

    sub = command(
        "leaderboard",
        board.regenerate,
        "generate LEADERBOARD.md from the results on the board; no predictor is run",
        "--check",
    )
    sub.add_argument(
        "--check", action="store_true", help="write nothing; exit 1 if a file is not up to date"
    )
    board_option(sub)

    sub = command(
        "site",
        board.site,
        "write the leaderboard as a page to sort, filter and open, which needs no server",
        "--out page",
    )
    sub.add_argument("--out", type=Path, default=Path("page"), metavar="DIR")
    sub.add_argument(
        "--docs",
        metavar="URL",
        help=f"where the pages of docs are, seen from DIR; {{}} is a page's name, as in {DOCS} "
        "(default: those of the checkout)",
    )
    board_option(sub)

    sub = command(
        "plot",
        board.plot,
        "draw spectra, errors by family and index, their histogram, and error against time",
        "a.json b.json --out figures",
    )
    sub.add_argument("results", type=Path, nargs="+", metavar="RESULT.json")
    sub.add_argument("--out", type=Path, default=Path("figures"), metavar="DIR")
    sub.add_argument("--metric", default=RANKED_BY, choices=METRICS)
    directory_option(sub)

    scaling_commands.add(command, _positive)
    return parser


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {value}")
    return value
