"""The commands evaluate, which runs a predictor, and score, which runs no code."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eigbench import results
from eigbench.board import tables
from eigbench.commands import arguments
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError, PredictorError
from eigbench.results import predictions
from eigbench.running import meshes, record
from eigbench.running.evaluate import Evaluation, Options, evaluate, predict_meshes
from eigbench.running.predictor import check_file
from eigbench.scoring import physics, scores, truth
from eigbench.scoring.training import IMPORTED
from synthnet import recipe, store
from synthnet.store import pins
from synthnet.terminal import WRONG_INPUT, Rate
from synthnet.types import PROTOCOLS, SPLITS
from synthnet.verify import seal


def add_commands(command: Command) -> None:
    """Add evaluate and score to the command line."""
    _add_evaluate(command)
    sub = command(
        "score",
        score,
        "score a file of predictions; no code is run",
        "preds.parquet",
    )
    sub.add_argument("file", type=Path, metavar="FILE", help="predictions: .parquet, .npz or .csv")
    _add_split(sub)
    arguments.target(sub, "both")
    sub.add_argument(
        "--root", type=Path, metavar="DIR", help="directory that holds a sealed set or import"
    )


def _add_evaluate(command: Command) -> None:
    sub = command(
        "evaluate",
        run_evaluate,
        "run a predictor over a split and score it; this runs the file's code",
        "my_model.py --dataset 1.0 --out results.json",
    )
    arguments.predictor(sub)
    _add_split(sub)
    sub.add_argument("--root", type=Path, metavar="DIR", help="directory that holds the versions")
    arguments.out(sub, "results.json")
    sub.add_argument(
        "--predictions",
        type=Path,
        metavar="FILE",
        help="the predictions (default: beside --out, ending in .parquet)",
    )
    arguments.process(sub)
    sub.add_argument(
        "--batch-size",
        type=arguments.positive,
        default=200,
        metavar="B",
        help="meshes a call (default: %(default)s)",
    )
    sub.add_argument(
        "--seeds",
        type=arguments.positive,
        default=1,
        metavar="N",
        help="runs, with seeds 0 to N - 1 (default: 1)",
    )
    sub.add_argument(
        "--time-limit",
        type=float,
        default=3600.0,
        metavar="S",
        help="seconds allowed for a batch (default: %(default)g)",
    )
    sub.add_argument(
        "--limit",
        type=arguments.positive,
        metavar="N",
        help="predict only N meshes; the result is marked as partial",
    )
    sub.add_argument("--resume", action="store_true", help="go on with an interrupted run")
    sub.add_argument(
        "--no-reference",
        dest="reference",
        action="store_false",
        help="do not time LaPy on some of the same meshes; a leaderboard requires that time",
    )


def _add_split(sub: argparse.ArgumentParser) -> None:
    """Add the options that choose the labels."""
    which = sub.add_mutually_exclusive_group()
    which.add_argument(
        "--dataset",
        default="1.0",
        metavar="V",
        help="a version, an import, or a directory that synthnet made (default: 1.0)",
    )
    which.add_argument(
        "--sealed",
        type=Path,
        metavar="SEAL.json",
        help="the sealed set of this seal, where it is built (see docs/sealed.md)",
    )
    sub.add_argument(
        "--split", default="test", choices=SPLITS, help="split to predict (default: %(default)s)"
    )
    sub.add_argument(
        "--protocol",
        default="grouped",
        metavar="P",
        help=f"{', '.join(PROTOCOLS)}, or one that the version defines, in 2.0 family, "
        "resolution, genus, boundary, imported/NAME (default: grouped)",
    )


def _directory(options: argparse.Namespace) -> store.StoredDataset | None:
    """Return the dataset if a directory, an import or a sealed set is named, not a version."""
    if options.sealed is not None:
        return seal.open_checked(seal.read(options.sealed), options.root)
    if options.dataset in recipe.available():
        return None  # a version, even where a directory has its name
    path = Path(options.dataset)
    manifest = store.read_manifest(path)
    if manifest is not None:
        return store.StoredDataset(path, manifest)
    return store.open_unversioned(options.dataset, options.root)


def _truth(options: argparse.Namespace, directory: store.StoredDataset | None) -> truth.Truth:
    if directory is not None:
        return truth.of_dataset(directory, options.split, options.protocol)
    name = ""
    if options.protocol.startswith(IMPORTED):
        resolved = recipe.load(options.dataset)
        name = truth.imported_name(resolved, options.split, options.protocol)
    if name and pins.read(name) is None:  # for a board it must be pinned; to try, on disk will do
        dataset = store.open_unversioned(name, options.root)
        if dataset is not None and dataset.kind is recipe.Kind.IMPORTED:
            return truth.of_import(dataset, options.dataset)
    return truth.load(options.dataset, options.split, options.protocol)


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
    directory = _directory(options)
    labels = _truth(options, directory)
    partial = options.limit is not None and options.limit < len(labels.ids)
    _check_out(out, options.predictor, partial)
    if partial:
        labels = labels.head(options.limit)
    dataset = _meshes_of(labels, directory, options.root)
    settings = Options(**{f.name: getattr(options, f.name) for f in fields(Options)})
    settings = replace(settings, reference=settings.reference and not partial)
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
        print(f"{result['model']['name']} on {_described(result)}\n")
        _print_scores(result["scores"])
        print(f"{tables.cost(result)}\n")
        print(tables.physics(result["physics"]))
        print(f"\nresult {out}, predictions {kept}")
    return _exit_code(predictions.unphysical(labels, evaluation.predictions))


def _check_out(out: Path, predictor: Path, partial: bool) -> None:
    """Check that a result may be written: over none but an earlier one of the same predictor."""
    if not out.exists():
        return
    earlier = results.read(out)
    code = earlier["model"]["code"]
    if code != predictor.name:
        raise EigbenchError(f"{out} is the result of {code}: give {predictor.name} another --out")
    if partial and not earlier["partial"]:
        raise EigbenchError(f"{out} is a whole result: give --limit another --out")


def _predict(
    options: argparse.Namespace,
    labels: truth.Truth,
    dataset: store.StoredDataset,
    settings: Options,
    parts: Path,
) -> tuple[Evaluation, NDArray[np.float64]]:
    """Return the evaluation and the answers to the questions of physics, with progress."""
    console = Console(stderr=True)
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
    task = progress.add_task("predicting", total=len(labels.ids) * settings.seeds)

    def on_batch(count: int) -> None:
        loading.stop()
        progress.start()
        progress.advance(task, count)

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


def _exit_code(problem: str) -> int:
    """Return the exit code of scored predictions, and print what is wrong with them."""
    if problem:
        print(f"eigbench: {problem}", file=sys.stderr)
        return WRONG_INPUT
    return 0


def score(options: argparse.Namespace) -> int:
    """Score a file of predictions."""
    labels = _truth(options, _directory(options))
    values = predictions.read(options.file, labels)
    scored = scores.of_targets(labels, values)
    if options.target is not None:
        if scored[options.target] is None:
            raise arguments.unknown_surfaces(labels)
        scored = {options.target: scored[options.target]}
    result = {"dataset": results.dataset_facts(labels), "scores": scored}
    if options.json:
        print(json.dumps(result, indent=1))
    else:
        print(f"{options.file} on {_described(result)}\n")
        _print_scores(scored)
    return _exit_code(predictions.unphysical(labels, values))


def _print_scores(scored: Mapping[str, dict[str, Any] | None]) -> None:
    """Print the tables of each target that is known."""
    for target, numbers in scored.items():
        if numbers is None:
            print(f"Against the {target}: not known for this dataset\n")
            continue
        exact = f", {100 * numbers['exact']:.4g} % of the spectra exact" if numbers["exact"] else ""
        print(f"Against the {target}{exact}\n")
        for table in (tables.overall, tables.families, tables.per_index):
            print(f"{table(numbers)}\n")


def _described(result: dict[str, Any]) -> str:
    facts = result["dataset"]
    part = "a part of " if result.get("partial") else ""
    return (
        f"{part}{results.title(result)}: "
        f"{facts['shapes']:,} shapes, {facts['instances']:,} instances"
    )
