"""The command line: ``eigbench check | evaluate | score``."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eigbench import physics, predictions, results, scores, tables, truth
from eigbench.errors import EigbenchError, PredictorError
from eigbench.evaluate import Options, evaluate, predict_meshes
from synthnet import store
from synthnet.cli import WRONG_INPUT, Parser
from synthnet.errors import SynthNetError
from synthnet.interrupts import EXIT_CODE
from synthnet.report import Rate
from synthnet.types import PROTOCOLS, SPLITS
from synthnet.version import __version__

AGREE = 1e-5  # relative, between batch sizes and orders of one predictor


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code.

    0: done. 1: ``check`` found something. 2: the input or the predictor would not do; one
    line says what and what to do. 130: interrupted by Ctrl-C.
    """
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
    except (EigbenchError, SynthNetError, ValueError) as error:
        print(f"eigbench: {error}", file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        print("eigbench: interrupted; --resume goes on from the last batch", file=sys.stderr)
        return EXIT_CODE
    return code


def _check(options: argparse.Namespace) -> int:
    ids, meshes = physics.questions()
    settings = Options(batch_size=len(ids), time_limit=options.time_limit)
    k = 10
    answers = predict_meshes(options.predictor, ids, meshes, k, settings)
    base = len(physics.probes())
    one = Options(batch_size=1, time_limit=options.time_limit)
    singly = predict_meshes(options.predictor, ids[:base], meshes[:base], k, one)
    order = np.random.default_rng(0).permutation(base)
    shuffled = predict_meshes(
        options.predictor,
        tuple(ids[i] for i in order),
        tuple(meshes[i] for i in order),
        k,
        Options(batch_size=base, time_limit=options.time_limit),
    )
    contract = physics.contract(answers)
    findings = [
        *_differences("one mesh at a time", ids, answers[:base], singly),
        *_differences("shuffled order", [ids[i] for i in order], answers[order], shuffled),
    ]
    if not np.isfinite(answers).all():
        bad = [ids[i] for i in np.flatnonzero(~np.isfinite(answers).all(axis=1))[:3]]
        findings.append(f"answers that are not finite, first for {', '.join(bad)}")
    if options.json:
        print(json.dumps({"physics": contract, "findings": findings}, indent=1))
    else:
        print(tables.physics(contract))
        print(f"\n{base} shapes and {len(ids) - base} changed copies of them")
        for finding in findings:
            print(f"  {finding}")
        verdict = "it can be evaluated" if not findings else "look at the findings above"
        print(f"{options.predictor}: loads and answers in shape; {verdict}")
    return 1 if findings else 0


def _differences(
    how: str, ids: Sequence[str], a: np.ndarray[Any, Any], b: np.ndarray[Any, Any]
) -> list[str]:
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = np.where(a == b, 0.0, np.abs(a / b - 1)).max(axis=1)
    bad = np.flatnonzero(~(apart <= AGREE) & np.isfinite(a).all(axis=1))
    if not len(bad):
        return []
    first = ", ".join(ids[i] for i in bad[:3])
    return [f"other answers for {how}: up to {apart[bad].max():.2g} relative, first for {first}"]


def _directory(options: argparse.Namespace) -> store.StoredDataset | None:
    """Return the dataset that ``--dataset`` names as a directory, if it does."""
    place = Path(options.dataset)
    manifest = store.read_manifest(place)
    return None if manifest is None else store.StoredDataset(place, manifest)


def _truth(options: argparse.Namespace, directory: store.StoredDataset | None) -> truth.Truth:
    if directory is not None:
        return truth.of_dataset(directory, options.split, options.protocol)
    return truth.load(options.dataset, options.split, options.protocol)


def _evaluate(options: argparse.Namespace) -> int:
    out: Path = options.out
    kept: Path = options.predictions or out.with_suffix(".parquet")
    for name, path, suffix in (("--out", out, ".json"), ("--predictions", kept, ".parquet")):
        if path.suffix != suffix:
            raise EigbenchError(f"{name} must end in {suffix}, got {path}")
    directory = _directory(options)
    wanted = _truth(options, directory)
    partial = options.limit is not None and options.limit < len(wanted.ids)
    if partial:
        wanted = wanted.head(options.limit)
    dataset = directory or store.open_dataset(options.dataset, options.root)
    settings = Options(**{f.name: getattr(options, f.name) for f in fields(Options)})
    parts = out.with_name(f".{out.name}.parts")
    progress = Progress(
        TextColumn("predicting"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
    )
    task = progress.add_task("predicting", total=len(wanted.ids) * settings.seeds)

    def on_batch(count: int) -> None:
        progress.start()  # not before there is something to show
        progress.advance(task, count)

    try:
        evaluation = evaluate(
            options.predictor,
            wanted,
            dataset,
            settings,
            parts,
            on_batch=on_batch,
        )
    except PredictorError as error:
        if any(parts.glob("*/*.npz")):
            raise PredictorError(f"{error} (--resume goes on from the last good batch)") from error
        raise
    finally:
        progress.stop()
    ids, meshes = physics.questions()
    answers = predict_meshes(options.predictor, ids, meshes, wanted.eigenvalues.shape[1], settings)
    predictions.write(kept, wanted, evaluation.predictions)
    result = results.make(
        wanted,
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
        return 0
    print(f"{result['model']['name']} on {_described(result)}\n")
    for table in (tables.overall, tables.families, tables.per_index, tables.cost):
        print(table(result) + "\n")
    print(tables.physics(result["physics"]))
    print(f"\nresult {out}, predictions {kept}")
    return 0


def _score(options: argparse.Namespace) -> int:
    wanted = _truth(options, _directory(options))
    found = predictions.read(options.file, wanted)
    result = {"dataset": results.dataset_facts(wanted), "scores": scores.score(wanted, found)}
    if options.json:
        print(json.dumps(result, indent=1))
        return 0
    print(f"{options.file} on {_described(result)}\n")
    for table in (tables.overall, tables.families, tables.per_index):
        print(table(result) + "\n")
    return 0


def _described(result: dict[str, Any]) -> str:
    facts = result["dataset"]
    part = "a part of " if result.get("partial") else ""
    return (
        f"{part}synthNet {facts['version']}, {facts['split']} split, protocol {facts['protocol']}: "
        f"{facts['shapes']:,} shapes, {facts['instances']:,} instances"
    )


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="eigbench",
        description="Score predictors of the first ten Laplace-Beltrami eigenvalues of meshes.",
        epilog="example: eigbench check my_model.py",
    )
    parser.add_argument("--version", action="version", version=f"eigbench {__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    def command(name: str, run: Any, text: str, example: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(
            name, help=text, description=text, epilog=f"example: eigbench {name} {example}"
        )
        sub.set_defaults(run=run)
        sub.add_argument("--json", action="store_true", help="print JSON for a program")
        return sub

    def split_options(sub: argparse.ArgumentParser) -> None:
        sub.add_argument(
            "--dataset",
            default="1.0",
            metavar="V",
            help="a version, or a directory that synthnet built (default: 1.0)",
        )
        sub.add_argument("--split", default="test", choices=SPLITS)
        sub.add_argument("--protocol", default="grouped", choices=PROTOCOLS)

    sub = command(
        "check",
        _check,
        "try a predictor on a few dozen meshes; this runs the file's code",
        "my_model.py",
    )
    sub.add_argument("predictor", type=Path, metavar="FILE", help="the predictor's Python file")
    sub.add_argument("--time-limit", type=float, default=600.0, metavar="S")

    sub = command(
        "evaluate",
        _evaluate,
        "run a predictor over a split and score it; this runs the file's code",
        "my_model.py --dataset 1.0 --out results.json",
    )
    sub.add_argument("predictor", type=Path, metavar="FILE", help="the predictor's Python file")
    split_options(sub)
    sub.add_argument("--root", type=Path, metavar="DIR", help="directory that holds the versions")
    sub.add_argument("--out", type=Path, default=Path("results.json"), metavar="FILE")
    sub.add_argument(
        "--predictions", type=Path, metavar="FILE", help="default: beside --out, .parquet"
    )
    sub.add_argument("--device", default="cpu", help="handed to the predictor (default: cpu)")
    sub.add_argument("--batch-size", type=_positive, default=200, metavar="B")
    sub.add_argument("--seeds", type=_positive, default=1, metavar="N", help="runs (default: 1)")
    sub.add_argument("--threads", type=_positive, default=1, metavar="N", help="default: 1")
    sub.add_argument("--time-limit", type=float, default=3600.0, metavar="S", help="for a batch")
    sub.add_argument(
        "--limit", type=_positive, metavar="N", help="only N instances: a partial result"
    )
    sub.add_argument("--resume", action="store_true", help="go on with an interrupted run")

    sub = command("score", _score, "score a file of predictions; no code is run", "preds.parquet")
    sub.add_argument("file", type=Path, metavar="FILE", help=".parquet, .npz or .csv")
    split_options(sub)
    return parser


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {value}")
    return value
