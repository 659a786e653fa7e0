"""``synthnet import``: make a dataset of mesh files."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from tabulate import tabulate

from synthnet.commands.options import add_command, workers_options
from synthnet.commands.report import summary, with_bars
from synthnet.errors import MeshImportError, counted
from synthnet.mesh.repair import COMPONENTS, KEEP, LARGEST, REPAIRS, SPLIT
from synthnet.terminal import WRONG_INPUT, Commands, print_json


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
        metavar="PATH",
        help="directory with mesh files, or one of them: OBJ, OFF, PLY, STL, GIfTI, FreeSurfer, "
        "also with .gz",
    )
    sub.add_argument("--name", required=True, metavar="NAME", help="name of the dataset")
    sub.add_argument(
        "--packages",
        action="store_true",
        help="PATH is a folder with packages from PyPI; import the meshes of the project's list "
        "from them, and nothing else (docs/import.md says which)",
    )
    sub.add_argument(
        "--download", action="store_true", help="with --packages: let pip bring what is missing"
    )
    sub.add_argument("--unit-area", action="store_true", help="scale every surface to area 1")
    pieces = sub.add_mutually_exclusive_group()
    pieces.add_argument(
        "--components",
        choices=COMPONENTS,
        default=KEEP,
        help="of several components keep all as one shape, keep the largest by area alone, or "
        "split: a shape of each (default: %(default)s)",
    )
    pieces.add_argument(
        "--keep-largest",
        dest="components",
        action="store_const",
        const=LARGEST,
        help="the same as --components largest",
    )
    sub.add_argument(
        "--without",
        nargs="+",
        choices=REPAIRS,
        default=[],
        metavar="REPAIR",
        help="leave out repairs, and refuse what needs them: "
        + "; ".join(f"{name} ({what})" for name, what in REPAIRS.items())
        + " (default: none)",
    )
    sub.add_argument(
        "--cut-fins",
        action="store_true",
        help="also cut edges of more than two faces that are not in pairs, as a fin on a plate; "
        "nothing connects these any more",
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
    from synthnet.build.importing import file_outcomes, import_meshes, small_parts
    from synthnet.build.sources import not_meshes
    from synthnet.build.surfaces import Settings

    settings = Settings(
        unit_area=options.unit_area,
        components=options.components,
        split=options.split,
        without=tuple(options.without),
        cut_fins=options.cut_fins,
    )
    inputs = _inputs(options)
    report = with_bars(partial(import_meshes, inputs, options.name, settings), options)
    rows = file_outcomes(report.dataset)
    others = Counter[str]() if options.packages else not_meshes(options.directory)
    if options.json:
        more = {"files": rows, "not_meshes": others}
        print_json({**summary(report.dataset.manifest, report), **more})
    else:
        print(tabulate(rows, headers="keys", maxcolwidths=[None, None, None, 60], intfmt=","))
        counts = Counter(row["outcome"] for row in rows)
        totals = ", ".join(f"{count:,} {outcome}" for outcome, count in counts.items())
        print(f"\n{counted(len(rows), 'file')}: {totals}: {report.dataset.directory}")
        if others:
            kinds = ", ".join(f"{count:,} {suffix}" for suffix, count in sorted(others.items()))
            print(f"{counted(others.total(), 'other file')}, not read as meshes: {kinds}")
        if report.nothing_to_do:
            print("(imported already: nothing to do)")
    if options.components != SPLIT and (parts := small_parts(report.dataset)):
        print(_warned(parts, options.components), file=sys.stderr)
    if not report.dataset.manifest.rows:
        print("synthnet: no file became a shape: the table says why", file=sys.stderr)
        return WRONG_INPUT
    return 0


def _inputs(options: argparse.Namespace) -> Sequence[Path] | Mapping[Path, Sequence[Path]]:
    """Return the directories and files that are meant, or those of packages."""
    from synthnet.build import packages

    given: list[Path] = options.directory
    if not options.packages:
        if options.download:
            raise MeshImportError("--download is for --packages: nothing else is downloaded")
        return given
    if len(given) > 1:
        raise MeshImportError(f"--packages takes one PATH, a folder for packages, got {len(given)}")
    if options.download:
        packages.download(given[0])
    return packages.find(given[0])


def _warned(files: list[str], components: str) -> str:
    """Return the line that warns of files whose largest component is less than half of them."""
    some = ", ".join(files[:3]) + (", ..." if len(files) > 3 else "")
    of = "all their components together" if components == KEEP else "the largest alone"
    return (
        f"synthnet: warning: in {len(files):,} of the files ({some}) the largest component has "
        f"less than half of the area; labels are of {of}: see --components"
    )
