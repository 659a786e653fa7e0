"""``synthnet verify``: check a built version, or a sealed set by its revealed salt."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from tabulate import tabulate

from synthnet import store
from synthnet.commands.options import add_command, dataset_argument, workers_option
from synthnet.commands.report import FamilyBars
from synthnet.commands.seal import salt_option
from synthnet.recipe import Kind
from synthnet.terminal import Commands, at_least, print_json, progress

if TYPE_CHECKING:
    from synthnet.verify import VerifyReport

DIFFERENT = 1  # exit code where something differs
MADE_ANEW = ("manifest", "digests", "shards")  # checks of the files that a build makes anew


def add(commands: Commands) -> None:
    """Add the command."""
    example = "1.0 --sample 200"
    sub = add_command(commands, "verify", run, "check a built version", example, version=False)
    which = sub.add_mutually_exclusive_group()
    dataset_argument(which)
    which.add_argument(
        "--sealed",
        type=Path,
        metavar="SEAL.json",
        help="check a sealed set against its revealed salt instead; it is built first if it is "
        "missing (default: none)",
    )
    salt_option(sub, required=False)
    workers_option(sub, "local processes of --sealed, which builds")
    sub.add_argument(
        "--files",
        action="store_true",
        help="only check whether any byte has changed since the build: seconds, not minutes",
    )
    for option, default, text in (
        ("--sample", 100, "number of labels to compute again with LaPy"),
        ("--seed", 0, "seed that draws this sample"),
        ("--limit", 20, "number of problems to print"),
    ):
        text += " (default: %(default)s)"
        sub.add_argument(option, type=at_least(0), default=default, metavar="N", help=text)


def run(options: argparse.Namespace) -> int:
    """Check a dataset and print what differs."""
    name, report = _checked(options)
    if options.json:
        checks = [
            {"check": c.name, "examined": c.examined, "problems": list(c.problems)}
            for c in report.checks
        ]
        print_json({"version": name, "ok": not report.problems, "checks": checks})
    else:
        _print_report(name, report, options.limit)
        rebuilt = any(c.problems for c in report.checks if c.name in MADE_ANEW)
        if rebuilt and options.sealed is None:
            print(f"run {_again(options)}: it makes damaged shards anew,")
            print("and says which other files to remove first")
    return DIFFERENT if report.problems else 0


def _checked(options: argparse.Namespace) -> tuple[str, VerifyReport]:
    """Return the name of the dataset, and the report on it."""
    from synthnet.verify import verify, verify_files

    bar = progress("verifying", of="shards")
    task = bar.add_task("shards", total=None)

    def on_shard(done: int, total: int) -> None:
        bar.start()  # not before there is something to show
        bar.update(task, completed=done, total=total)

    try:
        if _is_sealed(options):
            return _unseal(options, on_shard)
        if options.files:
            return options.version, verify_files(options.version, root=options.out)
        report = verify(
            options.version,
            root=options.out,
            sample=options.sample,
            seed=options.seed,
            on_shard=on_shard,
        )
        return options.version, report
    finally:
        bar.stop()


def _print_report(name: str, report: VerifyReport, limit: int) -> None:
    from synthnet.verify.unseal import CHECKS

    rows = [
        (c.name, f"{c.examined:,}", len(c.problems) or "none", CHECKS[c.name])
        for c in report.checks
    ]
    print(tabulate(rows, headers=["check", "examined", "problems", "what"], disable_numparse=True))
    for problem in report.problems[:limit]:
        print(f"  {problem}")
    if len(report.problems) > limit:
        print(f"  … and {len(report.problems) - limit} more (--limit shows more)")
    print(f"\n{name} in {report.directory}: {'DIFFERENT' if report.problems else 'verified'}")


def _again(options: argparse.Namespace) -> str:
    """Return the command that makes a dataset anew."""
    match store.open_dataset(options.version, options.out).kind:
        case Kind.SEALED:
            return "the `synthnet seal` that made it again"
        case Kind.IMPORTED:
            return f"the `synthnet import` of {options.version} again"
    out = f" --out {options.out}" if options.out else ""
    return f"`synthnet build {options.version}{out}`"


def _is_sealed(options: argparse.Namespace) -> bool:
    """Return whether ``synthnet verify`` is asked to check a seal.

    Raise ValueError if it is asked so in part, or for something else as well.
    """
    if (options.sealed is None) != (options.salt_file is None):
        raise ValueError("--sealed and --salt-file go together: the seal, and its revealed salt")
    if options.sealed is None and options.workers is not None:
        raise ValueError("--workers is for --sealed, which builds")
    if options.sealed is not None and options.files:
        raise ValueError("--files is for a built version: --sealed computes everything anew")
    return options.sealed is not None


def _unseal(
    options: argparse.Namespace, on_shard: Callable[[int, int], None]
) -> tuple[str, VerifyReport]:
    """Check a seal by its salt; return the name of the set, and the report."""
    from synthnet.verify import seal as seals
    from synthnet.verify.unseal import verify_sealed

    published = seals.read(options.sealed)
    salt = seals.read_salt(options.salt_file)
    bars = FamilyBars()

    def on_checked(done: int, total: int) -> None:
        bars.progress.stop()
        on_shard(done, total)

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
    return published.dataset, report
