"""``synthnet croissant``: describe a built version for other tools."""

from __future__ import annotations

import argparse

from synthnet import store
from synthnet.commands.options import add_command
from synthnet.terminal import Commands, print_answer


def add(commands: Commands) -> None:
    """Add the command."""
    add_command(
        commands,
        "croissant",
        run,
        "describe a built version for other tools: Croissant 1.1 metadata beside its manifest",
        "1.0-mini",
    )


def run(options: argparse.Namespace) -> int:
    """Write the Croissant metadata of a built version."""
    from synthnet.loaders.croissant import write

    path = write(store.open_dataset(options.version, options.out))
    print_answer(options, {"croissant": str(path)}, str(path))
    return 0
