"""The command evaluate: it runs a predictor over a split and scores it."""

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from eigbench import results
from eigbench.board import foreseen, tables
from eigbench.board.leaderboard import RESULTS
from eigbench.commands import arguments, predict, queries, score
from eigbench.commands.arguments import Command
from eigbench.errors import EigbenchError
from eigbench.results import predictions
from eigbench.running import record
from eigbench.running.evaluate import Evaluation, Options, alone, predict_meshes
from eigbench.running.predictor import check_file, code_name
from eigbench.scoring import physics, targets, truth
from eigbench.scoring.scores import is_sealed
from eigbench.site.bundle import CHECKOUT
from synthnet.recipe import Kind
from synthnet.store.files import make_parent
from synthnet.terminal import at_least, print_json
from synthnet.types import PROTOCOLS

UNTIMED = (
    "warning: LaPy is not timed (--no-reference): the speed column stays empty, and a board does "
    "not take the result"
)


def add_commands(command: Command) -> None:
    """Add evaluate to the command line."""
    text = "run a predictor over a split and score it; this runs the file's code"
    sub = command("evaluate", run_evaluate, text, "my_model.py --dataset 1.0 --out results.json")
    predict.add_run(sub)
    arguments.out(sub, "results.json", "the result")
    text = "the predictions (default: beside --out, ending in .parquet)"
    arguments.path(sub, "--predictions", "FILE", text)
    text = "predict only N meshes, and mark the result as partial (default: all)"
    sub.add_argument("--limit", type=at_least(1), metavar="N", help=text)
    text = "do not time LaPy on some of the same meshes; a leaderboard requires that time"
    sub.add_argument("--no-reference", dest="reference", action="store_false", help=text)


def run_evaluate(options: argparse.Namespace) -> int:
    """Run a predictor over a split, write the result and print its tables."""
    out: Path = options.out
    arguments.check_out("--out", out, ".json")
    kept: Path = options.predictions or out.with_suffix(".parquet")
    arguments.check_out("--predictions", kept, ".parquet")
    check_file(options.predictor)
    directory = score.dataset_of(options)
    labels = score.labels_of(options, directory)
    partial = options.limit is not None and options.limit < len(labels.ids)
    _check_out(out, options.predictor, partial, labels)
    if not (options.reference or partial) and labels.protocol in PROTOCOLS:
        print(UNTIMED, file=sys.stderr)
    if partial:
        labels = labels.head(options.limit)
    dataset = predict.meshes_of(labels, directory, options.root)
    if dataset.kind is Kind.SEALED:  # nor need the predictor's process know where it is
        os.environ.pop("SYNTHNET_HOME", None)
    settings = predict.settings_of(options, Options)
    settings = replace(settings, reference=settings.reference and not partial)
    for path in (out, kept):
        make_parent(path)
    parts = out.with_name(f".{out.name}.parts")
    board = Path() if RESULTS.is_dir() else CHECKOUT
    print(foreseen.line(board, labels, options.predictor, settings.seeds), file=sys.stderr)
    with alone(parts):
        evaluation = predict.answers(
            options.predictor,
            labels,
            predict.read_meshes(dataset, labels),
            settings,
            parts,
            on_loaded=lambda loaded: _check_name(out, loaded.meta["name"]),
            estimated=options.limit is None,
        )
        contract = _contract(options.predictor, labels, settings)
        predictions.write(kept, labels, evaluation.predictions)
        result = record.make(
            labels,
            evaluation,
            settings,
            code=options.predictor,
            predictions=kept,
            contract=contract,
            partial=partial,
        )
        queries.note(
            directory, "evaluate", result["model"]["name"], result["predictions"]["sha256"]
        )
        results.write(out, result)
    _report(options, kept, labels, evaluation, result)
    return score.exit_code(predictions.unphysical(labels, evaluation.predictions))


def _report(
    options: argparse.Namespace,
    kept: Path,
    labels: truth.Truth,
    evaluation: Evaluation,
    result: dict[str, Any],
) -> None:
    """Print scores, cost and physics, and warn of what speaks against the row."""
    if options.json:
        print_json(result)
    else:
        print(f"{result['model']['name']} on {score.described(result)}\n")
        score.print_scores(result["scores"])
        print(f"{tables.cost(result)}\n")
        print(tables.physics(result["physics"]))
        print(f"\nresult {options.out}, predictions {kept}; {score.EXPLAINED}")
    for finding in record.findings(result["cost"], evaluation.status.refused):
        print(f"warning: {finding}", file=sys.stderr)
    if not is_sealed(labels.version):
        for finding in record.copies_answered_otherwise(targets.every(labels), evaluation):
            print(f"warning: {finding}; verify-row refuses such a row", file=sys.stderr)
    score.warn_of_answers(result["model"]["kind"], labels, evaluation.predictions)


def _check_out(out: Path, predictor: Path, partial: bool, labels: truth.Truth) -> None:
    """Check that a result may be written: over none but one of the same file and dataset."""
    if not out.exists():
        return
    earlier = _earlier(out)
    if earlier.code != code_name(predictor):
        raise EigbenchError(
            f"{out} is the result of {earlier.code}: give {predictor.name} another --out"
        )
    if (earlier.version, earlier.protocol) != (labels.version, labels.protocol):
        raise EigbenchError(
            f"{out} is a result on {earlier.version}, protocol {earlier.protocol}: give another "
            "--out"
        )
    if partial and not earlier.partial:
        raise EigbenchError(f"{out} is a whole result: give --limit another --out")


def _check_name(out: Path, name: str) -> None:
    """Check that a result may be written: over none of a model of another name."""
    if out.exists() and (there := _earlier(out).name) != name:
        raise EigbenchError(f"{out} is the result of the model {there}: give {name} another --out")


class _Earlier(NamedTuple):
    """What a result is of; an earlier eigbench may have made it."""

    code: str
    name: str
    version: str
    protocol: str
    partial: bool


def _earlier(out: Path) -> _Earlier:
    """Return what a result is of; its numbers may be of other metrics, so they are not read."""
    result = results.load(out)
    try:
        model, dataset = result["model"], result["dataset"]
        facts = model["code"], model["name"], dataset["version"], dataset["protocol"]
        return _Earlier(*facts, result["partial"])
    except (KeyError, TypeError) as error:
        raise EigbenchError(
            f"{out} is no result of `eigbench evaluate`: give another --out"
        ) from error


def _contract(predictor: Path, labels: truth.Truth, settings: Options) -> dict[str, float | None]:
    """Return how far a predictor obeys the laws of physics."""
    k = labels.eigenvalues.shape[1]
    with Console(stderr=True, highlight=False).status("predicting for the physics contract"):
        trained = str(labels.trainings[0])
        return physics.contract(
            predict_meshes(predictor, *physics.questions(), k, settings, trained)
        )
