"""The command predict: it runs a predictor over a split, and writes its answers."""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from eigbench.board import foreseen
from eigbench.commands import arguments, score
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError
from eigbench.results import predictions
from eigbench.running import box, meshes, record
from eigbench.running.evaluate import Evaluation, Options, alone, evaluate
from eigbench.running.predictor import check_file
from eigbench.running.process import Loaded
from eigbench.scoring import truth
from eigbench.scoring.training import IMPORTED
from synthnet import store, terminal
from synthnet.errors import counted
from synthnet.store.files import make_parent
from synthnet.terminal import at_least, print_answer

Settings = TypeVar("Settings", bound=box.Settings)
CORRECTED = 1.5  # by how much an estimate of time is off when it is told anew
CHANGED = "code, settings, machine or packages have changed"  # since an interrupted run
UNHELD = (
    "warning: no sandbox works here, so the file's code runs with your rights: install bubblewrap "
    "(--no-sandbox leaves this line out)"
)


def add_commands(command: Command) -> None:
    """Add predict to the command line."""
    text = "run a predictor over a split and write its answers; this runs the file's code"
    sub = command("predict", predict, text, "my_model.py --dataset 1.0 --out predictions.parquet")
    add_run(sub)
    arguments.out(sub, "predictions.parquet", "the predictions")


def add_run(sub: argparse.ArgumentParser) -> None:
    """Add the predictor, what it is asked, and how it is run."""
    arguments.predictor(sub)
    score.add_split(sub)
    arguments.root(sub)
    arguments.process(sub)
    arguments.count(sub, "--batch-size", "B", "meshes a call", 200)
    text = f"runs, with seeds 0 to N - 1; {predictions.SEEDS} at most (default: %(default)s)"
    sub.add_argument("--seeds", type=seeds, default=1, metavar="N", help=text)
    arguments.time_limit(sub, 3600.0)
    sub.add_argument("--resume", action="store_true", help="go on with an interrupted run")
    add_sandbox(sub)


def seeds(text: str) -> int:
    """Return a number of runs that a file of predictions can hold."""
    value = at_least(1)(text)
    if value > predictions.SEEDS:
        raise argparse.ArgumentTypeError(f"there can be {predictions.SEEDS} at most, got {value}")
    return value


def add_sandbox(sub: argparse.ArgumentParser) -> None:
    """Add what the predictor's process is held by; :func:`settings_of` reads it."""
    how = sub.add_mutually_exclusive_group()
    text = "run the file's code with your rights (default: in a sandbox, where one works)"
    how.add_argument(
        "--no-sandbox", dest="sandbox", action="store_const", const=box.NONE, help=text
    )
    text = "refuse to run the file's code where no sandbox works"
    how.add_argument(
        "--require-sandbox", dest="sandbox", action="store_const", const="required", help=text
    )
    sub.set_defaults(sandbox="auto")
    add_readable(sub)


def add_readable(sub: argparse.ArgumentParser) -> None:
    """Add what the sandbox shows besides the predictor's own files."""
    text = (
        "a file or directory that the sandbox shows besides the predictor's own, such as weights; "
        "may be repeated (default: none)"
    )
    sub.add_argument(
        "--readable", type=Path, action="append", default=[], metavar="PATH", help=text
    )


def settings_of(options: argparse.Namespace, settings: type[Settings]) -> Settings:
    """Return how a predictor is to be run, as a class of settings; say so where no sandbox works.

    Raises
    ------
    EigbenchError
        If a sandbox is required and none works, or something to be shown is not there.
    """
    for path in options.readable:
        if not path.exists():
            raise EigbenchError(f"--readable: there is nothing at {path}")
    kind = box.chosen(options.sandbox)
    if kind == box.NONE and options.sandbox != box.NONE:
        print(UNHELD, file=sys.stderr)
    given = {f.name: getattr(options, f.name) for f in fields(settings) if f.name in options}
    return settings(**{**given, "sandbox": kind, "readable": tuple(options.readable)})


def predict(options: argparse.Namespace) -> int:
    """Run a predictor over a split and write its predictions."""
    out: Path = options.out
    arguments.check_out("--out", out, ".parquet")
    check_file(options.predictor)
    directory = score.dataset_of(options)
    labels = score.labels_of(options, directory)
    dataset = meshes_of(labels, directory, options.root)
    settings = settings_of(options, Options)
    make_parent(out)
    parts = out.with_name(f".{out.name}.parts")
    with alone(parts):
        instances = read_meshes(dataset, labels)
        evaluation = answers(options.predictor, labels, instances, settings, parts)
        predictions.write(out, labels, evaluation.predictions)
    cost = record.cost(evaluation, settings)
    facts = {
        "predictions": str(out),
        "model": evaluation.loaded.meta["name"],
        "instances": len(labels.ids),
        "ms_per_mesh": cost["ms_per_mesh"],
        "sandbox": settings.sandbox,
    }
    text = (
        f"{facts['model']}: {len(labels.ids):,} instances, "
        f"{cost['ms_per_mesh']:.3g} ms per mesh, sandbox {settings.sandbox}\n"
        f"predictions {out}; now: eigbench score {out}{_split(options)}"
    )
    print_answer(options, facts, text)
    for finding in record.findings(cost, evaluation.status.refused):
        print(f"warning: {finding}", file=sys.stderr)
    return score.exit_code(predictions.unphysical(labels, evaluation.predictions))


def _split(options: argparse.Namespace) -> str:
    """Return the options that name the split again, for the next command."""
    given = {name: getattr(options, name) for name in ("sealed", "root", "split", "protocol")}
    given["dataset"] = None if options.sealed else options.dataset
    usual = {"split": "test", "protocol": "grouped"}
    return "".join(f" --{k} {v}" for k, v in given.items() if v not in (None, usual.get(k)))


def meshes_of(
    labels: truth.Truth, directory: store.StoredDataset | None, root: Path | None
) -> store.StoredDataset:
    """Return the dataset on disk whose meshes are predicted; it must be that of the labels."""
    kind, _, name = labels.protocol.partition("/")
    version = name if kind == IMPORTED else labels.version
    dataset = directory or store.open_dataset(version, root)
    if kind == IMPORTED:
        same = truth.of_import(dataset, labels.version).recipe_digest == labels.recipe_digest
        problem = f"does not hold the meshes whose labels are pinned as {name}"
    else:
        same = dataset.manifest.recipe_digest == labels.recipe_digest
        problem = f"was not built from the recipe of {labels.version}"
    if not same:
        raise EigbenchError(f"{dataset.directory} {problem}: check it with `synthnet verify`")
    return dataset


def read_meshes(dataset: store.StoredDataset, labels: truth.Truth) -> meshes.Instances:
    """Read the meshes of a split, and say so."""
    with Console(stderr=True).status("reading the meshes"):
        return meshes.read(dataset, labels.ids)


def answers(
    predictor: Path,
    labels: truth.Truth,
    instances: meshes.Instances,
    settings: Options,
    parts: Path,
    on_loaded: Callable[[Loaded], None] = lambda loaded: None,
    *,
    estimated: bool = True,
    sets: NDArray[np.int64] | None = None,
) -> Evaluation:
    """Run a predictor over a split, with progress and, if ``estimated``, the time it may take."""
    console = Console(stderr=True, highlight=False)
    loading = console.status("loading the predictor")
    progress = terminal.progress("predicting", console)
    meshes_in_all = len(labels.ids) * settings.seeds
    task = progress.add_task("predicting", total=meshes_in_all)
    of = f"predicting {counted(meshes_in_all, 'mesh', 'meshes')}"
    taken = starting = foretold = 0.0
    starts, every_start, since = 0, settings.seeds, time.perf_counter()

    def on_start(loaded: Loaded) -> None:
        nonlocal starts, every_start, starting
        trainings = len(set(labels.trainings.tolist())) if loaded.trained else 1
        every_start = settings.seeds * trainings
        starts, starting = starts + 1, starting + time.perf_counter() - since
        on_loaded(loaded)

    def on_batch(count: int, seconds: float) -> None:
        nonlocal taken, foretold, since
        loading.stop()
        progress.start()
        progress.advance(task, count)
        done, taken = progress.tasks[task].completed, taken + seconds
        whole = taken * meshes_in_all / done + every_start * starting / max(starts, 1)
        off = max(whole, foretold) > CORRECTED * min(whole, foretold)  # the first batch compiles
        if estimated and off and done < meshes_in_all:
            foretold = whole
            console.print(f"{of}: {foreseen.about(whole - taken - starting)} more")
        since = time.perf_counter()

    try:
        loading.start()
        return evaluate(
            predictor,
            labels,
            instances,
            settings,
            parts,
            on_batch=on_batch,
            on_restart=lambda: console.print(f"{CHANGED}: starting anew"),
            on_loaded=on_start,
            sets=sets,
        )
    finally:
        loading.stop()
        progress.stop()
