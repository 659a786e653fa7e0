"""``synthnet import``: make a dataset of mesh files."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

from tabulate import tabulate

from synthnet.commands.options import add_command, print_json, workers_options
from synthnet.commands.report import FamilyBars, summary
from synthnet.terminal import WRONG_INPUT, Commands


def add(commands: Commands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "import",
        run,
        "make a dataset of your own mesh files",
        "scans --name scans --unit-area",
        version=False,
    )
    sub.add_argument(
        "directory",
        type=Path,
        nargs="+",
        metavar="DIR",
        help="directory with OBJ, OFF, PLY or STL files",
    )
    sub.add_argument("--name", required=True, metavar="NAME", help="name of the dataset")
    sub.add_argument("--unit-area", action="store_true", help="scale every surface to area 1")
    sub.add_argument(
        "--keep-largest",
        action="store_true",
        help="keep the largest of several components, instead of refusing the file",
    )
    sub.add_argument(
        "--split",
        choices=("test", "hash"),
        default="test",
        help="all files are test shapes, or 70, 20 and 10 %% by the hash of the file "
        "(default: %(default)s)",
    )
    workers_options(sub, other="import")


def run(options: argparse.Namespace) -> int:
    """Import the files, and say what became of each."""
    from synthnet.build.importing import Settings, file_outcomes, import_meshes

    bars = FamilyBars()
    with bars.progress:
        report = import_meshes(
            options.directory,
            options.name,
            Settings(options.unit_area, options.keep_largest, options.split),
            root=options.out,
            workers=options.workers,
            watcher=bars,
            wait_for_lock=options.wait,
        )
    rows = file_outcomes(report.dataset)
    if options.json:
        print_json({**summary(report.dataset.manifest, report), "files": rows})
    else:
        notable = [row for row in rows if row["what"]]
        if notable:
            widths = [None, None, None, 60]
            print(tabulate(notable, headers="keys", maxcolwidths=widths, intfmt=","))
        counts = Counter(row["outcome"] for row in rows)
        totals = ", ".join(f"{count:,} {outcome}" for outcome, count in counts.items())
        print(f"\n{len(rows):,} files: {totals}: {report.dataset.directory}")
        if report.nothing_to_do:
            print("(imported already: nothing to do)")
    if not report.dataset.manifest.rows:
        print("synthnet: no file became a shape: the table says why", file=sys.stderr)
        return WRONG_INPUT
    return 0
