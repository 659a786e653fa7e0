"""``synthnet croissant`` and ``synthnet export``: describe a built version for other tools."""

import argparse

from synthnet import store
from synthnet.commands.options import add_command
from synthnet.terminal import Commands, print_answer


def add(commands: Commands) -> None:
    """Add the commands."""
    add_command(
        commands,
        "croissant",
        run_croissant,
        "describe a built version for other tools: Croissant 1.1 metadata beside its manifest",
        "1.0-mini",
    )
    add_command(
        commands,
        "export",
        run_export,
        "describe a built version for Zenodo and the Hugging Face Hub, with Croissant metadata and "
        "the digests of all files; nothing is sent",
        "1.0-mini",
    )


def run_croissant(options: argparse.Namespace) -> int:
    """Write the Croissant metadata of a built version."""
    from synthnet.loaders import croissant

    path = str(croissant.write(store.open_dataset(options.version, options.out)))
    print_answer(options, {"croissant": path}, path)
    return 0


def run_export(options: argparse.Namespace) -> int:
    """Write what is to be published with a built version."""
    from synthnet.loaders import publishing

    paths = list(map(str, publishing.write(store.open_dataset(options.version, options.out))))
    print_answer(options, {"files": paths}, "\n".join(paths))
    return 0
