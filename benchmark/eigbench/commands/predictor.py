"""What the commands on predictors do: check, evaluate, score. Only score runs no code of theirs."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from eigbench import results
from eigbench.board import tables
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
from synthnet.verify import seal

AGREE = 1e-5  # relative, between batch sizes and orders of one predictor


def check(options: argparse.Namespace) -> int:
    """Try a predictor on the probes, one at a time, shuffled and changed."""
    ids, probes = physics.questions()
    base = len(ids) // (1 + len(physics.CHANGES))
    order = np.random.default_rng(0).permutation(len(ids))

    def ask(chosen: Sequence[int], batch_size: int) -> NDArray[np.float64]:
        settings = Options(batch_size=batch_size, time_limit=options.time_limit)
        asked = [ids[i] for i in chosen], [probes[i] for i in chosen]
        return predict_meshes(options.predictor, *asked, 10, settings)

    console = Console(stderr=True)
    with console.status("asking about all at once"):
        answers = ask(range(len(ids)), len(ids))
    with console.status("asking one at a time"):
        singly = ask(range(base), 1)
    with console.status("asking in shuffled order"):
        shuffled = ask(order.tolist(), len(ids))
    contract = physics.contract(answers)
    findings = [
        *_differences("one mesh at a time", ids, answers[:base], singly),
        *_differences("shuffled order", [ids[i] for i in order], answers[order], shuffled),
    ]
    if not np.isfinite(answers).all():
        bad = [ids[i] for i in np.flatnonzero(~np.isfinite(answers).all(axis=1))[:3]]
        findings.append(f"answers that are not finite, first for {', '.join(bad)}")
    elif not (answers > 0).all():
        bad = [ids[i] for i in np.flatnonzero(~(answers > 0).all(axis=1))[:3]]
        findings.append(f"answers that are not positive, first for {', '.join(bad)}")
    if contract["ascending"] != 1:
        findings.append("answers that do not ascend: sort each spectrum")
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
    """Return the dataset that is named as a directory, an import or a seal, if one is."""
    if options.sealed is not None:
        return seal.open_checked(seal.read(options.sealed), options.root)
    if options.dataset in recipe.available():
        return None  # a version, even where a directory has its name
    place = Path(options.dataset)
    manifest = store.read_manifest(place)
    if manifest is not None:
        return store.StoredDataset(place, manifest)
    return store.open_unversioned(options.dataset, options.root)


def _truth(options: argparse.Namespace, directory: store.StoredDataset | None) -> truth.Truth:
    if directory is not None:
        return truth.of_dataset(directory, options.split, options.protocol)
    name = ""
    if options.protocol.startswith(IMPORTED):
        wanted = recipe.load(options.dataset)
        name = truth.imported_name(wanted, options.split, options.protocol)
    if name and pins.read(name) is None:  # for a board it must be pinned; to try, on disk will do
        there = store.open_imported(name, options.root)
        if there is not None:
            return truth.of_import(there, options.dataset)
    return truth.load(options.dataset, options.split, options.protocol)


def _meshes_of(
    wanted: truth.Truth, directory: store.StoredDataset | None, root: Path | None
) -> store.StoredDataset:
    """Return the dataset on disk whose meshes are predicted; it must be that of the labels."""
    kind, _, name = wanted.protocol.partition("/")
    place = name if kind == IMPORTED else wanted.version
    dataset = directory or store.open_imported(place, root) or store.open_dataset(place, root)
    if kind == IMPORTED:
        same = truth.of_import(dataset, wanted.version).recipe_digest == wanted.recipe_digest
        problem = f"does not hold the meshes whose labels are pinned as {name}"
    else:
        same = dataset.manifest.recipe_digest == wanted.recipe_digest
        problem = f"was not built from the recipe of {wanted.version}"
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
    wanted = _truth(options, directory)
    partial = options.limit is not None and options.limit < len(wanted.ids)
    if partial:
        wanted = wanted.head(options.limit)
        if out.exists() and not results.read(out)["partial"]:
            raise EigbenchError(f"{out} is a whole result: give --limit another --out")
    dataset = _meshes_of(wanted, directory, options.root)
    settings = Options(**{f.name: getattr(options, f.name) for f in fields(Options)})
    settings = replace(settings, reference=settings.reference and not partial)
    parts = out.with_name(f".{out.name}.parts")
    evaluation, answers = _predict(options, wanted, dataset, settings, parts)
    predictions.write(kept, wanted, evaluation.predictions)
    result = record.make(
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
    else:
        print(f"{result['model']['name']} on {_described(result)}\n")
        for table in (tables.overall, tables.families, tables.per_index, tables.cost):
            print(f"{table(result)}\n")
        print(tables.physics(result["physics"]))
        print(f"\nresult {out}, predictions {kept}")
    return _told(predictions.unphysical(wanted, evaluation.predictions))


def _predict(
    options: argparse.Namespace,
    wanted: truth.Truth,
    dataset: store.StoredDataset,
    settings: Options,
    parts: Path,
) -> tuple[Evaluation, NDArray[np.float64]]:
    """Return the evaluation and the answers to the questions of physics, with progress."""
    console = Console(stderr=True)
    with console.status("reading the meshes"):
        instances = meshes.read(dataset, wanted.ids)
    loading = console.status("loading the predictor")
    progress = Progress(
        TextColumn("predicting"),
        BarColumn(),
        MofNCompleteColumn(),
        Rate(),
        TimeRemainingColumn(),
        console=console,
    )
    task = progress.add_task("predicting", total=len(wanted.ids) * settings.seeds)

    def on_batch(count: int) -> None:
        loading.stop()
        progress.start()
        progress.advance(task, count)

    try:
        loading.start()
        evaluation = evaluate(
            options.predictor,
            wanted,
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
    k = wanted.eigenvalues.shape[1]
    with console.status("asking about physics"):
        asked = physics.questions()
        trained = str(wanted.trainings[0])
        answers = predict_meshes(options.predictor, *asked, k, settings, trained)
    return evaluation, answers


def _told(problem: str) -> int:
    """Say what is wrong with predictions that were scored as they are."""
    if problem:
        print(f"eigbench: {problem}", file=sys.stderr)
        return WRONG_INPUT
    return 0


def score(options: argparse.Namespace) -> int:
    """Score a file of predictions."""
    wanted = _truth(options, _directory(options))
    found = predictions.read(options.file, wanted)
    result = {"dataset": results.dataset_facts(wanted), "scores": scores.score(wanted, found)}
    if options.json:
        print(json.dumps(result, indent=1))
    else:
        print(f"{options.file} on {_described(result)}\n")
        for table in (tables.overall, tables.families, tables.per_index):
            print(f"{table(result)}\n")
    return _told(predictions.unphysical(wanted, found))


def _described(result: dict[str, Any]) -> str:
    facts = result["dataset"]
    part = "a part of " if result.get("partial") else ""
    return (
        f"{part}{results.title(result)}: "
        f"{facts['shapes']:,} shapes, {facts['instances']:,} instances"
    )
