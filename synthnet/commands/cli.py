"""The command line: ``synthnet versions | build | import | seal | info | verify | ...``."""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from tabulate import tabulate

from synthnet import recipe, store
from synthnet.build import estimates
from synthnet.build.versions import BuildReport, build
from synthnet.build.workers import Engine, dask_cluster, mpi_processes
from synthnet.commands import seal, show
from synthnet.commands.report import FamilyBars, family_table, summary
from synthnet.errors import StoreError, SynthNetError
from synthnet.store import storage
from synthnet.terminal import WRONG_INPUT, Parser
from synthnet.types import SPLITS
from synthnet.version import __version__

DIFFERENT = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    0: done. 1: ``verify`` found a difference. 2: the input, the directory or the machine
    would not do; one line says what and what to do. An interrupt is left to the caller.
    """
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
    except BrokenPipeError:
        sys.stderr.close()  # the reader of a pipe has gone: nothing is left to say
        return 0
    except (SynthNetError, ValueError) as error:
        print(f"synthnet: {error}", file=sys.stderr)
        return WRONG_INPUT
    except OSError as error:
        print(f"synthnet: {error.filename}: {error.strerror}", file=sys.stderr)
        return WRONG_INPUT
    return code


def _versions(options: argparse.Namespace) -> int:
    rows = []
    known = recipe.available()
    for name in known:
        wanted = recipe.load(name)
        manifest = store.read_manifest(store.dataset_directory(name, options.out))
        built = manifest is not None and manifest.recipe_digest == wanted.digest
        rows.append({"version": name, "shapes": wanted.count, "built": built})
    for name in storage.names(store.home(options.out)):  # imports, sealed sets, scaled versions
        if name in known:
            continue
        try:
            manifest = store.read_manifest(store.dataset_directory(name, options.out))
        except (StoreError, PermissionError):
            continue  # of another program, or not for us to read
        if manifest is not None and manifest.version == name:
            rows.append({"version": name, "shapes": manifest.rows, "built": True})
    if options.json:
        _print_json(rows)
        return 0
    print(tabulate([{**r, "built": "yes" if r["built"] else "no"} for r in rows], headers="keys"))
    print(f"\nin {store.home(options.out)}")
    return 0


def _wanted(options: argparse.Namespace) -> recipe.Recipe:
    wanted = recipe.load(options.version)
    return wanted if options.scale is None else recipe.scaled(wanted, options.scale)


def _engine(options: argparse.Namespace) -> Engine | None:
    if options.engine != "dask" and options.scheduler is not None:
        raise ValueError("--scheduler is for --engine dask")
    if options.engine != "local" and options.workers is not None:
        raise ValueError(f"--workers is for local processes, not for --engine {options.engine}")
    if options.engine == "mpi":
        return mpi_processes()
    if options.engine == "dask":
        if options.scheduler is None:
            raise ValueError("--engine dask needs --scheduler, for example tcp://10.0.0.1:8786")
        return dask_cluster(options.scheduler)
    return None


def _build(options: argparse.Namespace) -> int:
    bars = FamilyBars()
    with bars.progress:
        report = build(
            _wanted(options),
            root=options.out,
            workers=options.workers,
            engine=_engine(options),
            watcher=bars,
            wait_for_lock=options.wait,
        )
    estimated = _estimate(options) if options.error_estimates else None
    if options.json:
        described = summary(report.dataset.manifest, report)
        if estimated is not None:
            described["error_estimates"] = {
                "core_seconds": {k: round(v, 3) for k, v in estimated.seconds.items()},
                "wall_seconds": round(estimated.wall_seconds, 3),
                "nothing_to_do": estimated.nothing_to_do,
                "reused_shards": estimated.reused,
            }
        _print_json(described)
        return 0
    directory = report.dataset.directory
    version = report.dataset.manifest.version
    if report.nothing_to_do:
        rest = ": nothing to do" if estimated is None else ""
        print(f"{version} is built already in {directory}{rest}")
        print("(every file is as it was written; `synthnet verify` checks what is in them)")
    else:
        print(family_table(report.dataset.manifest, report.seconds))
        kept = f", {report.reused} shards kept from an earlier run" if report.reused else ""
        if kept:
            print("\n(core-seconds are those of this run: of kept shards only the reading)", end="")
        print(f"\n{version} built in {report.wall_seconds:.0f} s{kept}: {directory}")
    if estimated is not None and estimated.nothing_to_do:
        print("its error estimates are there already: nothing to do")
    elif estimated is not None:
        core = sum(estimated.seconds.values())
        kept = f", {estimated.reused} shards kept from an earlier run" if estimated.reused else ""
        place = directory / estimates.DIRECTORY
        print(f"error estimates made in {estimated.wall_seconds:.0f} s ", end="")
        print(f"({core:,.0f} core-seconds){kept}: {place}")
    return 0


def _estimate(options: argparse.Namespace) -> BuildReport:
    bars = FamilyBars("errors of ")
    with bars.progress:
        return estimates.build_estimates(
            _wanted(options),
            root=options.out,
            workers=options.workers,
            engine=_engine(options),
            watcher=bars,
            wait_for_lock=options.wait,
        )


def _import(options: argparse.Namespace) -> int:
    from synthnet.build.importing import Settings, import_meshes, what_was_met

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
    rows = what_was_met(report.dataset)
    if options.json:
        _print_json({**summary(report.dataset.manifest, report), "files": rows})
    else:
        met = [row for row in rows if row["what"]]
        if met:
            print(tabulate(met, headers="keys", maxcolwidths=[None, None, None, 60], intfmt=","))
        counts = Counter(row["outcome"] for row in rows)
        told = ", ".join(f"{count:,} {outcome}" for outcome, count in counts.items())
        print(f"\n{len(rows):,} files: {told}: {report.dataset.directory}")
        if report.nothing_to_do:
            print("(imported already: nothing to do)")
    if not report.dataset.manifest.rows:
        print("synthnet: no file became a shape: the table says why", file=sys.stderr)
        return WRONG_INPUT
    return 0


def _info(options: argparse.Namespace) -> int:
    dataset = store.open_dataset(options.version, options.out)
    manifest = dataset.manifest
    if options.ids:
        ids = [i.as_py() for p in dataset.paths() for i in store.read_table(p, ["id"])["id"]]
        if options.json:
            _print_json(ids)
        else:
            print("\n".join(ids))
        return 0
    if options.json:
        _print_json({**summary(manifest), "directory": str(dataset.directory)})
        return 0
    print(family_table(manifest))
    size = sum(shard.size for shard in manifest.shards)
    splits = Counter(
        split.as_py() for path in dataset.paths() for split in store.read_table(path, ["split"])[0]
    )
    print(f"\nversion    {manifest.version}  (recipe {manifest.recipe_digest[:12]})")
    print(f"directory  {dataset.directory}")
    print(f"size       {size / 1e6:,.1f} MB in {len(manifest.shards)} shards")
    print(f"estimates  {_estimates(dataset)}")
    print("splits     " + ", ".join(f"{name} {splits[name]:,}" for name in SPLITS))
    print("made with  " + ", ".join(f"{k} {v}" for k, v in manifest.packages.items()))
    for rejection in manifest.rejections:
        print(f"rejected   {rejection.id}: {rejection.reason}: {rejection.detail}")
    return 0


def _estimates(dataset: store.StoredDataset) -> str:
    """Return of which labels there are estimates of the error."""
    if estimates.is_complete(dataset):
        return "of every label"
    return f"{'of a part' if estimates.any_made(dataset) else 'none'} (--error-estimates)"


def _verify(options: argparse.Namespace) -> int:
    from synthnet.verify.checks import verify, verify_files
    from synthnet.verify.unseal import CHECKS

    progress = Progress(
        TextColumn("verifying"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    task = progress.add_task("shards", total=None)

    def on_shard(done: int, total: int) -> None:
        progress.start()  # not before there is something to show
        progress.update(task, completed=done, total=total)

    name = options.version
    if seal.is_wanted(options):
        name, report = seal.unseal(options, on_shard, progress)
    elif options.files:
        report = verify_files(options.version, root=options.out)
    else:
        try:
            report = verify(
                options.version,
                root=options.out,
                sample=options.sample,
                seed=options.seed,
                on_shard=on_shard,
            )
        finally:
            progress.stop()
    failed = bool(report.problems)
    if options.json:
        checks = [
            {"check": c.name, "examined": c.examined, "problems": list(c.problems)}
            for c in report.checks
        ]
        _print_json({"version": name, "ok": not failed, "checks": checks})
        return DIFFERENT if failed else 0
    rows = [
        (c.name, f"{c.examined:,}", len(c.problems) or "none", CHECKS[c.name])
        for c in report.checks
    ]
    print(tabulate(rows, headers=["check", "examined", "problems", "what"], disable_numparse=True))
    for problem in report.problems[: options.limit]:
        print(f"  {problem}")
    if len(report.problems) > options.limit:
        print(f"  … and {len(report.problems) - options.limit} more (--limit shows more)")
    print(f"\n{name} in {report.directory}: {'DIFFERENT' if failed else 'verified'}")
    if failed and not seal.is_wanted(options):
        out = f" --out {options.out}" if options.out else ""
        again = f"`synthnet build --version {options.version}{out}`"
        if recipe.is_sealed(options.version):
            again = "the `synthnet seal` that made it again"
        elif store.open_imported(options.version, options.out) is not None:
            again = f"the `synthnet import` of {options.version} again"
        print(f"run {again}: it makes damaged shards anew,")
        print("and says which other files to remove first")
    return DIFFERENT if failed else 0


BUILD_EXAMPLES = """example: synthnet build --version 1.0-small --workers 2

many machines:
  synthnet build --engine dask --scheduler tcp://10.0.0.1:8786 --out /shared/synthnet
  mpiexec -n 5 python -m mpi4py.futures -m synthnet build --engine mpi --out /shared/synthnet
  synthnet build --scale 100 --out s3://bucket/synthnet
"""


def _print_json(value: Any) -> None:
    print(json.dumps(value, indent=1))


# Arguments


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="synthnet",
        description="Build and inspect synthNet: triangle meshes labelled with the first "
        "ten eigenvalues of their Laplace-Beltrami operator.",
        epilog="example: synthnet build --version 1.0-mini",
    )
    parser.add_argument("--version", action="version", version=f"synthnet {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Any, text: str, example: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name, help=text, description=text, epilog=f"example: synthnet {name}{example}"
        )
        sub.set_defaults(run=run)
        sub.add_argument(
            "--out",
            "--root",
            metavar="DIR",
            help="directory or URL (s3://bucket/data) that holds the versions "
            "(default: $SYNTHNET_HOME, else the user's cache directory, here "
            + str(store.home()).replace("%", "%%")
            + ")",
        )
        sub.add_argument("--json", action="store_true", help="print JSON for a program")
        return sub

    def version_option(sub: argparse._ActionsContainer) -> None:
        sub.add_argument(
            "--version",
            default="1.0",
            metavar="V",
            help=f"one of {', '.join(recipe.available())}, or one of these scaled, as 1.0-x100 "
            "(default: %(default)s)",
        )

    command("versions", _versions, "list what can be built", "")

    sub = command("build", _build, "build a version", " --version 1.0-small --workers 2")
    sub.formatter_class = argparse.RawDescriptionHelpFormatter
    sub.epilog = BUILD_EXAMPLES
    version_option(sub)
    sub.add_argument(
        "--scale",
        type=int,
        metavar="N",
        help="draw N times as many shapes, all new, by the same distributions; "
        "the version's name is then V-xN",
    )
    sub.add_argument(
        "--engine",
        choices=("local", "dask", "mpi"),
        default="local",
        help="who does the work: processes of this machine (default), a Dask cluster, "
        "or the other processes of an MPI job; the data do not depend on it",
    )
    sub.add_argument("--scheduler", metavar="ADDRESS", help="of the Dask cluster")
    sub.add_argument(
        "--workers",
        type=int,
        metavar="N",
        help="local processes of one thread each (default: the cores there are); "
        "the data do not depend on it",
    )
    sub.add_argument(
        "--wait", action="store_true", help="wait while another build is at work in the place"
    )
    sub.add_argument(
        "--error-estimates",
        action="store_true",
        help="then estimate how far each label is from the smooth surface's spectrum "
        "(several times the work of the build)",
    )

    sub = command(
        "import",
        _import,
        "make a dataset of your own mesh files",
        " scans --name scans --unit-area",
    )
    sub.add_argument(
        "directory", type=Path, nargs="+", metavar="DIR", help="with OBJ, OFF, PLY or STL files"
    )
    sub.add_argument("--name", required=True, metavar="NAME", help="of the dataset")
    sub.add_argument("--unit-area", action="store_true", help="scale every surface to area 1")
    sub.add_argument(
        "--keep-largest",
        action="store_true",
        help="of several components keep the largest, instead of refusing the file",
    )
    sub.add_argument(
        "--split",
        choices=("test", "hash"),
        default="test",
        help="all files are test shapes (default), or 70, 20 and 10 %% by the hash of the file",
    )
    sub.add_argument("--workers", type=int, metavar="N", help="local processes")
    sub.add_argument(
        "--wait", action="store_true", help="wait while another import is at work in the place"
    )

    sub = command(
        "seal",
        seal.seal,
        "draw a test set from a secret salt, and write the file that commits to it",
        " --version 1.0-mini --salt-file salt.txt --new-salt",
    )
    version_option(sub)
    seal.seal_options(sub)

    sub = command("info", _info, "say what a built version holds", " --version 1.0-small")
    version_option(sub)
    sub.add_argument("--ids", action="store_true", help="list the ids of its shapes")

    sub = command("verify", _verify, "check a built version", " --version 1.0 --sample 200")
    which = sub.add_mutually_exclusive_group()
    version_option(which)
    seal.unseal_options(sub, which)
    sub.add_argument(
        "--files",
        action="store_true",
        help="only see whether any byte has changed since the build: seconds, not minutes",
    )
    sub.add_argument(
        "--sample",
        type=show.at_least_zero,
        default=100,
        metavar="N",
        help="labels to derive anew with LaPy (default: %(default)s)",
    )
    sub.add_argument(
        "--seed",
        type=show.at_least_zero,
        default=0,
        metavar="N",
        help="of that sample (default: 0)",
    )
    sub.add_argument(
        "--limit",
        type=show.at_least_zero,
        default=20,
        metavar="N",
        help="problems to print (default: 20)",
    )

    sub = command("show", show.show, "show one shape", " torus-00012 --png torus.png")
    version_option(sub)
    show.show_options(sub)

    sub = command(
        "gallery",
        show.gallery,
        "draw a contact sheet of a family, or one shape of each; no build is needed",
        " torus --version 1.0",
    )
    version_option(sub)
    show.gallery_options(sub)

    sub = command(
        "croissant",
        show.croissant,
        "describe a built version for other tools: Croissant 1.1 metadata beside its manifest",
        " --version 1.0-mini",
    )
    version_option(sub)
    return parser
