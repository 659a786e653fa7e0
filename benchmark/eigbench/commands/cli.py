"""The command line: its commands, and the exit code."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from eigbench.commands import (
    board,
    check,
    compare,
    evaluate,
    predict,
    scaling,
    score,
    submit,
    timing,
    verify_row,
)
from eigbench.errors import EigbenchError
from synthnet import terminal
from synthnet.errors import SynthNetError
from synthnet.processes import EXIT_CODE
from synthnet.terminal import Parser, add_command
from synthnet.version import __version__


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    0: done. 1: ``check``, ``leaderboard --check``, ``scaling --verify`` or ``verify-row`` has
    findings. 2: the input or the predictor is wrong; one line says what is wrong and what to do.
    130: interrupted, by Ctrl-C or SIGTERM.
    """
    options = terminal.parse(_parser(), arguments)
    try:
        return terminal.run("eigbench", options, EigbenchError, SynthNetError)
    except KeyboardInterrupt:
        kept = "; finished work is kept, --resume continues from it" if "resume" in options else ""
        print(f"eigbench: interrupted{kept}", file=sys.stderr)
        return EXIT_CODE


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="eigbench",
        description="Score predictors of the first ten Laplace-Beltrami eigenvalues of meshes.",
        epilog="example: eigbench check my_model.py",
    )
    parser.add_argument("--version", action="version", version=f"eigbench {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    groups = (check, evaluate, predict, score, compare, timing, submit, board, scaling, verify_row)
    for group in groups:
        group.add_commands(partial(add_command, commands))
    return parser
