"""The command line: ``synthnet versions | build | import | info | verify | spectrum | ...``."""

import argparse
import sys
from collections.abc import Sequence

from synthnet import terminal
from synthnet.commands import (
    build,
    export,
    gallery,
    imports,
    info,
    seal,
    show,
    spectra,
    verify,
    versions,
)
from synthnet.errors import SynthNetError
from synthnet.processes import EXIT_CODE
from synthnet.terminal import Parser
from synthnet.version import __version__

COMMANDS = (versions, build, imports, seal, info, verify, show, gallery, spectra, export)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    0: done. 1: ``verify`` found a difference. 2: the input, the directory or the machine
    is at fault; one line says what is wrong and what to do. 130: interrupted, by Ctrl-C or SIGTERM.
    """
    options = terminal.parse(_parser(), arguments)
    try:
        return terminal.run("synthnet", options, SynthNetError)
    except KeyboardInterrupt:
        makes_shards = getattr(options, "makes_shards", False)
        kept = "; finished shards are kept, run the same command to go on" if makes_shards else ""
        print(f"synthnet: interrupted{kept}", file=sys.stderr)
        return EXIT_CODE


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="synthnet",
        description="Build and inspect synthNet: triangle meshes labelled with the first "
        "ten eigenvalues of their Laplace-Beltrami operator; and compute those of your own.",
        epilog="example: synthnet build 1.0-mini",
    )
    parser.add_argument("--version", action="version", version=f"synthnet {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for command in COMMANDS:
        command.add(commands)
    return parser
