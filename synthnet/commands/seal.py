"""``synthnet seal``: draw a test set from a secret salt."""

import argparse
from dataclasses import asdict
from functools import partial
from pathlib import Path

from synthnet import recipe
from synthnet.commands.options import add_command, workers_options
from synthnet.commands.report import family_table, with_bars
from synthnet.errors import counted
from synthnet.store.files import make_parent
from synthnet.terminal import Commands, print_answer, print_json


def add(commands: Commands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "seal",
        run,
        "draw a test set from a secret salt, and write the file that commits to it",
        "1.0-mini --salt-file salt.txt --new-salt",
    )
    salt_option(sub)
    sub.add_argument(
        "--new-salt", action="store_true", help="write that file first, with 256 random bits"
    )
    sub.add_argument(
        "--share",
        type=float,
        metavar="P",
        help="surfaces of each family, as a share of the version's, at least one "
        "(default: its share of test shapes)",
    )
    sub.add_argument(
        "--beacon",
        metavar="TEXT",
        help="public text that nobody could choose, drawn after the commitment was published: "
        "it goes into the seed and into the seal (default: none)",
    )
    sub.add_argument(
        "--commitment",
        action="store_true",
        help="only print the commitment, to be published before the beacon is known",
    )
    sub.add_argument(
        "--publish",
        type=Path,
        metavar="FILE",
        help="the seal to be published (default: the set's name and .json, here)",
    )
    workers_options(sub, other="build")


def salt_option(sub: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add the option that names the salt."""
    default = "" if required else " (default: none; --sealed needs it)"
    sub.add_argument(
        "--salt-file",
        type=Path,
        required=required,
        metavar="FILE",
        help=f"the salt, as --new-salt of `synthnet seal` wrote it{default}",
    )


def run(options: argparse.Namespace) -> int:
    """Draw a sealed set, and write what is to be published."""
    from synthnet.verify import seal as seals

    seals.check_terms(recipe.load(options.version), options.share, options.beacon)
    if options.new_salt:
        make_parent(options.salt_file)
        seals.make_salt(options.salt_file)
    salt = seals.read_salt(options.salt_file)
    seals.check_secret(options.salt_file)
    resolved = seals.sealed_recipe(
        options.version, salt, share=options.share, beacon=options.beacon
    )
    assert resolved.sealed is not None
    if options.commitment:
        commitment = {"dataset": resolved.version, "commitment": resolved.sealed.commitment}
        print_answer(options, commitment, resolved.sealed.commitment)
        return 0
    path = options.publish or Path(f"{resolved.version}.json")
    seals.check_free(path, resolved)
    make_parent(path)
    published, report = with_bars(partial(seals.make, resolved), options)
    seals.write(path, published)
    directory = report.dataset.directory
    if options.json:
        print_json({**asdict(published), "seal": str(path), "directory": str(directory)})
        return 0
    if not report.nothing_to_do:
        print(family_table(report.dataset.manifest, report.seconds) + "\n")
    passed = sum(published.left_out.values())
    print(f"{resolved.version}: {counted(sum(published.kept.values()), 'shape')}", end="")
    print(f"; {passed:,} surfaces of {options.version} were drawn and left out" if passed else "")
    print(f"publish     {path}")
    print(f"keep secret {options.salt_file} and {directory}")
    return 0
