"""What the parsers of the commands share."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from synthnet import recipe, store, terminal
from synthnet.terminal import Commands, DatasetName, at_least, complete_with


def add_command(
    commands: Commands,
    name: str,
    run: Callable[[argparse.Namespace], int],
    text: str,
    example: str = "",
    *,
    version: bool = True,
    positional: bool = True,
) -> argparse.ArgumentParser:
    """Add a command with the options that every command has, and its dataset by default."""
    command = terminal.add_command(commands, name, run, text, example)
    command.add_argument(
        "--out",
        "--root",
        metavar="DIR",
        help="directory or URL (s3://bucket/data) that holds the versions "
        "(default: $SYNTHNET_HOME, else the user's cache directory, here "
        + str(store.home()).replace("%", "%%")
        + ")",
    )
    if version:
        dataset_argument(command, positional=positional)
    return command


def dataset_argument(command: argparse._ActionsContainer, *, positional: bool = True) -> None:
    """Add what names a dataset: a word of its own, or an option where that means another thing."""
    known = f"one of {', '.join(recipe.available())}, or one of these scaled, as 1.0-x100"
    if positional:
        word = command.add_argument(
            "version",
            nargs="?",
            action=DatasetName,
            default=argparse.SUPPRESS,
            metavar="DATASET",
            help=f"{known} (default: 1.0)",
        )
        complete_with(word, _names)
        known = "the same as DATASET"
    option = command.add_argument(
        "--dataset",
        "--version",
        dest="version",
        action=DatasetName,
        default="1.0",
        metavar="NAME",
        help=f"{known} (default: %(default)s); --version is its old name",
    )
    complete_with(option, _names)


def _names(options: argparse.Namespace) -> list[str]:
    return store.known_names(getattr(options, "out", None))


def workers_options(command: argparse.ArgumentParser, *, other: str) -> None:
    """Add the options of a command that makes shards; it may wait for an ``other`` command."""
    command.set_defaults(makes_shards=True)
    workers_option(command, "local processes of one thread each; the data do not depend on it")
    command.add_argument(
        "--wait",
        action="store_true",
        help=f"wait while another {other} is at work in the directory",
    )


def workers_option(command: argparse.ArgumentParser, text: str) -> None:
    """Add the number of local processes."""
    command.add_argument(
        "--workers",
        type=at_least(1),
        metavar="N",
        help=f"{text} (default: the cores there are)",
    )
