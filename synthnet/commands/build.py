"""``synthnet build``: build a version, and the limits of its surfaces."""

from __future__ import annotations

import argparse
from functools import partial

from synthnet import recipe, store
from synthnet.build import limits, versions
from synthnet.build.jobs import BuildReport
from synthnet.build.workers import Engine, dask_cluster, mpi_processes
from synthnet.commands.options import add_command, workers_options
from synthnet.commands.report import family_table, of_run, summary, with_bars
from synthnet.errors import counted
from synthnet.store.limits import DIRECTORY
from synthnet.terminal import Commands, print_json

EXAMPLES = """example: synthnet build 1.0-small --workers 2

many machines:
  synthnet build --engine dask --scheduler tcp://10.0.0.1:8786 --out /shared/synthnet
  mpiexec -n 5 python -m mpi4py.futures -m synthnet build --engine mpi --out /shared/synthnet
  synthnet build --scale 100 --out s3://bucket/synthnet
"""


def add(commands: Commands) -> None:
    """Add the command."""
    sub = add_command(commands, "build", run, "build a version")
    sub.formatter_class = argparse.RawDescriptionHelpFormatter
    sub.epilog = EXAMPLES
    sub.add_argument(
        "--scale",
        type=int,
        metavar="N",
        help="draw N times as many shapes, all new, by the same distributions; "
        "the version's name is then V-xN (default: the shapes of the version)",
    )
    sub.add_argument(
        "--engine",
        choices=("local", "dask", "mpi"),
        default="local",
        help="where the work is done: by processes of this machine, by a Dask cluster, or by the "
        "other processes of an MPI job; the data do not depend on it (default: %(default)s)",
    )
    sub.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="address of the Dask cluster's scheduler (default: none; --engine dask needs it)",
    )
    workers_options(sub, other="build")
    sub.add_argument(
        "--limits",
        action="store_true",
        help="then compute the spectra of the surfaces where the repository does not pin them: of "
        "scaled versions and sealed sets (takes several times as long as the build)",
    )


def run(options: argparse.Namespace) -> int:
    """Build a version, or finish it; then its limits if asked to."""
    chosen = _recipe_of(options)
    report = with_bars(partial(versions.build, chosen, engine=_engine(options)), options)
    limited = None
    if options.limits:
        build_limits = partial(limits.build_limits, chosen, engine=_engine(options))
        limited = with_bars(build_limits, options, "limits of ")
    if options.json:
        described = summary(report.dataset.manifest, report)
        if limited is not None:
            seconds = {family: round(taken, 3) for family, taken in limited.seconds.items()}
            described["limits"] = {"core_seconds": seconds, **of_run(limited)}
        print_json(described)
        return 0
    _print_build(report, limited)
    if limited is not None:
        _print_limits(limited)
    return 0


def _recipe_of(options: argparse.Namespace) -> recipe.Recipe:
    """Return the recipe to build; of a sealed set that is there, for its limits, its own."""
    if options.limits and recipe.parse_name(options.version).kind is recipe.Kind.SEALED:
        from synthnet.verify import seal

        return seal.recipe_of(store.open_dataset(options.version, options.out))
    version = recipe.load(options.version)
    return version if options.scale is None else recipe.scaled(version, options.scale)


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


def _print_build(report: BuildReport, limited: BuildReport | None) -> None:
    directory, version = report.dataset.directory, report.dataset.manifest.version
    if report.nothing_to_do:
        rest = ": nothing to do" if limited is None else ""
        print(f"{version} is built already in {directory}{rest}")
        print("(every file is as it was written; `synthnet verify` checks what is in them)")
        return
    print(family_table(report.dataset.manifest, report.seconds))
    if report.reused:
        print("\n(core-seconds are those of this run: of kept shards only the reading)", end="")
    print(f"\n{version} built in {report.wall_seconds:.0f} s{_kept(report)}: {directory}")


def _print_limits(limited: BuildReport) -> None:
    if limited.nothing_to_do:
        print("its limits are there: nothing to compute")
        return
    core = sum(limited.seconds.values())
    directory = limited.dataset.directory / DIRECTORY
    print(f"limits computed in {limited.wall_seconds:.0f} s ", end="")
    print(f"({core:,.0f} core-seconds){_kept(limited)}: {directory}")


def _kept(report: BuildReport) -> str:
    return f", {counted(report.reused, 'shard')} kept from an earlier run" if report.reused else ""
