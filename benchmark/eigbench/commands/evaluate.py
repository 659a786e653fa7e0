"""The command evaluate: it runs a predictor over a split and scores it."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eigbench import results
from eigbench.board import tables
from eigbench.commands import arguments, score
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError, PredictorError
from eigbench.results import predictions
from eigbench.running import meshes, record
from eigbench.running.evaluate import Evaluation, Options, evaluate, predict_meshes
from eigbench.running.predictor import check_file
from eigbench.scoring import physics, truth
from eigbench.scoring.training import IMPORTED
from synthnet import store
from synthnet.store.files import make_parent
from synthnet.terminal import Rate
from synthnet.types import PROTOCOLS

UNTIMED = (
    "warning: LaPy is not timed (--no-reference): the speed column stays empty, and a board does "
    "not take the result"
)


def add_commands(command: Command) -> None:
    """Add evaluate to the command line."""
    sub = command(
        "evaluate",
        run_evaluate,
        "run a predictor over a split and score it; this runs the file's code",
        "my_model.py --dataset 1.0 --out results.json",
    )
    arguments.predictor(sub)
    score.add_split(sub)
    arguments.root(sub)
    arguments.out(sub, "results.json")
    sub.add_argument(
        "--predictions",
        type=Path,
        metavar="FILE",
        help="the predictions (default: beside --out, ending in .parquet)",
    )
    arguments.process(sub)
    arguments.count(sub, "--batch-size", "B", "meshes a call", 200)
    arguments.count(sub, "--seeds", "N", "runs, with seeds 0 to N - 1", 1)
    arguments.time_limit(sub, 3600.0)
    sub.add_argument(
        "--limit",
        type=arguments.positive,
        metavar="N",
        help="predict only N meshes, and mark the result as partial (default: all)",
    )
    sub.add_argument("--resume", action="store_true", help="go on with an interrupted run")
    sub.add_argument(
        "--no-reference",
        dest="reference",
        action="store_false",
        help="do not time LaPy on some of the same meshes; a leaderboard requires that time",
    )


def _meshes_of(
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


def run_evaluate(options: argparse.Namespace) -> int:
    """Run a predictor over a split, write the result and print its tables."""
    out: Path = options.out
    kept: Path = options.predictions or out.with_suffix(".parquet")
    for name, path, suffix in (("--out", out, ".json"), ("--predictions", kept, ".parquet")):
        if path.suffix != suffix:
            raise EigbenchError(f"{name} must end in {suffix}, got {path}")
    check_file(options.predictor)
    directory = score.dataset_of(options)
    labels = score.labels_of(options, directory)
    partial = options.limit is not None and options.limit < len(labels.ids)
    _check_out(out, options.predictor, partial)
    if not (options.reference or partial) and labels.protocol in PROTOCOLS:
        print(UNTIMED, file=sys.stderr)
    if partial:
        labels = labels.head(options.limit)
    dataset = _meshes_of(labels, directory, options.root)
    settings = Options(**{f.name: getattr(options, f.name) for f in fields(Options)})
    settings = replace(settings, reference=settings.reference and not partial)
    for path in (out, kept):
        make_parent(path)
    parts = out.with_name(f".{out.name}.parts")
    evaluation, answers = _predict(options, labels, dataset, settings, parts)
    predictions.write(kept, labels, evaluation.predictions)
    result = record.make(
        labels,
        evaluation,
        settings,
        code=options.predictor,
        predictions=kept,
        contract=physics.contract(answers),
        partial=partial,
    )
    results.write(out, result)
    shutil.rmtree(parts, ignore_errors=True)
    if options.json:
        print(json.dumps(result, indent=1))
    else:
        print(f"{result['model']['name']} on {score.described(result)}\n")
        score.print_scores(result["scores"])
        print(f"{tables.cost(result)}\n")
        print(tables.physics(result["physics"]))
        print(f"\nresult {out}, predictions {kept}; {score.EXPLAINED}")
    for finding in record.findings(result["cost"]):
        print(f"warning: {finding}", file=sys.stderr)
    return score.exit_code(predictions.unphysical(labels, evaluation.predictions))


def _check_out(out: Path, predictor: Path, partial: bool) -> None:
    """Check that a result may be written: over none but an earlier one of the same file."""
    if not out.exists():
        return
    earlier = results.read(out)
    code = earlier["model"]["code"]
    if code != predictor.name:
        raise EigbenchError(f"{out} is the result of {code}: give {predictor.name} another --out")
    if partial and not earlier["partial"]:
        raise EigbenchError(f"{out} is a whole result: give --limit another --out")


def _check_name(out: Path, name: str) -> None:
    """Check that a result may be written: over none of a model of another name."""
    if out.exists() and (there := results.read(out)["model"]["name"]) != name:
        raise EigbenchError(f"{out} is the result of the model {there}: give {name} another --out")


def _predict(
    options: argparse.Namespace,
    labels: truth.Truth,
    dataset: store.StoredDataset,
    settings: Options,
    parts: Path,
) -> tuple[Evaluation, NDArray[np.float64]]:
    """Return the evaluation and the answers to the questions of physics, with progress."""
    console = Console(stderr=True, highlight=False)
    with console.status("reading the meshes"):
        instances = meshes.read(dataset, labels.ids)
    loading = console.status("loading the predictor")
    progress = Progress(
        TextColumn("predicting"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(),
        TimeRemainingColumn(),
        console=console,
    )
    meshes_in_all = len(labels.ids) * settings.seeds
    task = progress.add_task("predicting", total=meshes_in_all)

    def on_batch(count: int, seconds: float) -> None:
        loading.stop()
        first = not progress.tasks[task].completed
        progress.start()
        progress.advance(task, count)
        if first and options.limit is None and count < meshes_in_all:
            rest = seconds * (meshes_in_all - count) / count
            console.print(f"predicting {meshes_in_all:,} meshes: {_about(rest)} more")

    try:
        loading.start()
        evaluation = evaluate(
            options.predictor,
            labels,
            instances,
            settings,
            parts,
            on_batch=on_batch,
            on_restart=lambda: console.print("code or settings have changed: starting anew"),
            on_loaded=lambda loaded: _check_name(options.out, loaded.meta["name"]),
        )
    except PredictorError as error:
        if any(parts.glob("*/*.npz")):
            raise PredictorError(f"{error} (--resume goes on from the last good batch)") from error
        raise
    finally:
        loading.stop()
        progress.stop()
    k = labels.eigenvalues.shape[1]
    with console.status("predicting for the physics contract"):
        asked = physics.questions()
        trained = str(labels.trainings[0])
        answers = predict_meshes(options.predictor, *asked, k, settings, trained)
    return evaluation, answers


def _about(seconds: float) -> str:
    """Return a duration as a rough number of minutes.

    Examples
    --------
    >>> _about(20), _about(700)
    ('less than a minute', 'about 12 min')
    """
    return "less than a minute" if seconds < 60 else f"about {seconds / 60:.0f} min"
