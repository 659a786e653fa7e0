"""``synthnet export``: what a repository of datasets asks for beside the files."""

from __future__ import annotations

import argparse

from synthnet import store
from synthnet.commands.options import add_command
from synthnet.terminal import Commands, print_answer


def add(commands: Commands) -> None:
    """Add the command."""
    add_command(
        commands,
        "export",
        run,
        "describe a built version for Zenodo and the Hugging Face Hub, with Croissant metadata and "
        "the digests of all files; nothing is sent",
        "1.0-mini",
    )


def run(options: argparse.Namespace) -> int:
    """Write what is to be published with a built version."""
    from synthnet.loaders import publishing

    paths = list(map(str, publishing.write(store.open_dataset(options.version, options.out))))
    print_answer(options, {"files": paths}, "\n".join(paths))
    return 0
