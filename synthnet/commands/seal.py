"""What the command line does with seals: ``synthnet seal`` and ``synthnet verify --sealed``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from rich.progress import Progress

from synthnet import recipe
from synthnet.commands.report import FamilyBars, family_table
from synthnet.verify import seal as seals
from synthnet.verify.checks import VerifyReport


def seal_options(sub: argparse.ArgumentParser) -> None:
    """Add the options of ``synthnet seal`` but those of every command."""
    salt_option(sub)
    sub.add_argument(
        "--new-salt", action="store_true", help="make that file first, of 256 random bits"
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
        "it goes into the seed and into the seal",
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
    sub.add_argument("--workers", type=int, metavar="N", help="local processes")
    sub.add_argument(
        "--wait", action="store_true", help="wait while another build is at work in the place"
    )


def salt_option(sub: argparse.ArgumentParser, *, required: bool = True) -> None:
    """Add the option that names the salt."""
    sub.add_argument(
        "--salt-file",
        type=Path,
        required=required,
        metavar="FILE",
        help="the salt: at least 32 random bytes as hexadecimal digits",
    )


def unseal_options(sub: argparse.ArgumentParser, which: argparse._ActionsContainer) -> None:
    """Add the options of ``synthnet verify`` that a sealed set wants."""
    which.add_argument(
        "--sealed",
        type=Path,
        metavar="SEAL.json",
        help="check a sealed set by its revealed salt; it is built first if it is not there",
    )
    salt_option(sub, required=False)
    sub.add_argument("--workers", type=int, metavar="N", help="local processes, for --sealed")


def seal(options: argparse.Namespace) -> int:
    """Draw a sealed set, and write what is to be published."""
    seals.check_terms(recipe.load(options.version), options.share, options.beacon)
    if options.new_salt:
        seals.make_salt(options.salt_file)
    salt = seals.read_salt(options.salt_file)
    wanted = seals.sealed_recipe(options.version, salt, share=options.share, beacon=options.beacon)
    assert wanted.sealed is not None
    if options.commitment:
        found = {"dataset": wanted.version, "commitment": wanted.sealed.commitment}
        print(json.dumps(found, indent=1) if options.json else found["commitment"])
        return 0
    place = options.publish or Path(f"{wanted.version}.json")
    seals.check_free(place, wanted)
    bars = FamilyBars()
    with bars.progress:
        found_seal, report = seals.make(
            wanted,
            root=options.out,
            workers=options.workers,
            watcher=bars,
            wait_for_lock=options.wait,
        )
    seals.write(place, found_seal)
    directory = report.dataset.directory
    if options.json:
        where = {"seal": str(place), "directory": str(directory)}
        print(json.dumps({**asdict(found_seal), **where}, indent=1))
        return 0
    if not report.nothing_to_do:
        print(family_table(report.dataset.manifest, report.seconds) + "\n")
    passed = sum(found_seal.left_out.values())
    print(f"{wanted.version}: {sum(found_seal.kept.values()):,} shapes", end="")
    print(f"; {passed:,} surfaces of {options.version} were drawn and left out" if passed else "")
    print(f"publish     {place}")
    print(f"keep secret {options.salt_file} and {directory}")
    return 0


def is_wanted(options: argparse.Namespace) -> bool:
    """Return whether ``synthnet verify`` is asked to check a seal.

    Raises
    ------
    ValueError
        If it is asked so in part, or for something else as well.
    """
    if (options.sealed is None) != (options.salt_file is None):
        raise ValueError("--sealed and --salt-file go together: the seal, and its revealed salt")
    if options.sealed is None and options.workers is not None:
        raise ValueError("--workers is for --sealed, which builds")
    if options.sealed is not None and options.files:
        raise ValueError("--files is for a built version: --sealed computes everything anew")
    return options.sealed is not None


def unseal(
    options: argparse.Namespace, on_shard: Callable[[int, int], None], progress: Progress
) -> tuple[str, VerifyReport]:
    """Check a seal by its salt; return the name of the set and what was found."""
    from synthnet.verify.unseal import verify_sealed

    published = seals.read(options.sealed)
    salt = seals.read_salt(options.salt_file)
    bars = FamilyBars()

    def on_checked(done: int, total: int) -> None:
        bars.progress.stop()
        on_shard(done, total)

    try:
        with bars.progress:
            report = verify_sealed(
                published,
                salt,
                root=options.out,
                workers=options.workers,
                sample=options.sample,
                seed=options.seed,
                watcher=bars,
                on_shard=on_checked,
            )
    finally:
        progress.stop()
    return published.dataset, report
