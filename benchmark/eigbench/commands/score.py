"""The command score, which runs no code; and the options of a split, which evaluate has too."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from eigbench import results
from eigbench.board import tables
from eigbench.commands import arguments, queries
from eigbench.commands.arguments import Command
from eigbench.results import predictions
from eigbench.scoring import scores, targets, truth
from eigbench.scoring.training import on_imports
from synthnet import recipe, store
from synthnet.errors import counted
from synthnet.store import pins
from synthnet.store.files import sha256
from synthnet.terminal import WRONG_INPUT, complete_with, print_json
from synthnet.types import PROTOCOLS, SPLITS
from synthnet.verify import seal

EXPLAINED = "docs/metrics.md says what the columns mean"


def add_commands(command: Command) -> None:
    """Add score to the command line."""
    text = "score a file of predictions; no code is run"
    sub = command("score", score, text, "preds.parquet")
    sub.add_argument("file", type=Path, metavar="FILE", help="predictions: .parquet, .npz or .csv")
    add_split(sub)
    arguments.target(sub, "both")
    arguments.root(sub)


def add_split(sub: argparse.ArgumentParser) -> None:
    """Add the options that choose the labels."""
    which = sub.add_mutually_exclusive_group()
    arguments.dataset(which, "1.0", "a version, an import, or a directory that synthnet made")
    text = "the sealed set of this seal, where it is built, in place of --dataset; see "
    arguments.path(which, "--sealed", "SEAL.json", f"{text}docs/sealed.md (default: none)")
    text = "split to predict (default: %(default)s)"
    sub.add_argument("--split", default="test", choices=SPLITS, help=text)
    protocol = sub.add_argument(
        "--protocol",
        default="grouped",
        metavar="P",
        help=f"{', '.join(PROTOCOLS)}, imported/NAME, or a protocol of the version: family, "
        "resolution, genus, boundary (2.0); cad, cortex (2.1) (default: %(default)s)",
    )
    complete_with(
        protocol, lambda options: [*PROTOCOLS, *(recipe.load(options.dataset).protocols or ())]
    )


def dataset_of(options: argparse.Namespace) -> store.StoredDataset | None:
    """Return the dataset that the options name; None for a version, whose labels are pinned."""
    if options.sealed is not None:
        return seal.open_checked(seal.read(options.sealed), options.root)
    return arguments.unpinned(options.dataset, options.root)


def labels_of(options: argparse.Namespace, directory: store.StoredDataset | None) -> truth.Truth:
    """Return the labels of the split that the options choose."""
    if directory is not None:
        return truth.of_dataset(directory, options.split, options.protocol)
    name = ""
    if on_imports(options.protocol):
        resolved = recipe.load(options.dataset)
        name = truth.imported_name(resolved, options.split, options.protocol)
    if name and pins.read(name) is None:  # for a board it must be pinned; to try, on disk will do
        dataset = store.open_unversioned(name, options.root)
        if dataset is not None and dataset.kind is recipe.Kind.IMPORTED:
            return truth.of_import(dataset, options.dataset)
    return truth.load(options.dataset, options.split, options.protocol)


def exit_code(problem: str) -> int:
    """Return the exit code of scored predictions, and print what is wrong with them."""
    if problem:
        print(f"eigbench: {problem}", file=sys.stderr)
        return WRONG_INPUT
    return 0


def warn_of_answers(kind: str, labels: truth.Truth, answers: NDArray[np.float64]) -> None:
    """Print how many spectra do not ascend, and which are a target to the bit, at each target."""
    if finding := predictions.unordered(answers):
        print(f"warning: {finding}", file=sys.stderr)
    for known in targets.every(labels):
        if finding := predictions.looked_up(kind, known, answers):
            print(f"warning: {finding}", file=sys.stderr)


def score(options: argparse.Namespace) -> int:
    """Score a file of predictions."""
    dataset = dataset_of(options)
    with Console(stderr=True).status("scoring"):
        labels = labels_of(options, dataset)
        values = predictions.read(options.file, labels)
        scored = scores.of_targets(labels, values)
    queries.note(dataset, "score", options.file.name, sha256(options.file))
    if options.target is not None:
        if scored[options.target] is None:
            raise arguments.unknown_surfaces(labels)
        scored = {options.target: scored[options.target]}
    result = {"dataset": results.dataset_facts(labels), "scores": scored}
    if options.json:
        print_json(result)
    else:
        print(f"{options.file} on {described(result)}\n")
        print_scores(scored)
        print(EXPLAINED)
    warn_of_answers("", labels, values)
    return exit_code(predictions.unphysical(labels, values))


def print_scores(scored: Mapping[str, dict[str, Any] | None]) -> None:
    """Print the tables of each target that is known."""
    for target, numbers in scored.items():
        if numbers is None:
            print(f"Against the {target}: not known for this dataset\n")
            continue
        exact = f", {100 * numbers['exact']:.4g} % of the spectra exact" if numbers["exact"] else ""
        print(f"Against the {target}{exact}\n")
        for table in (tables.overall, tables.families, tables.per_index):
            print(f"{table(numbers)}\n")


def described(result: dict[str, Any]) -> str:
    """Return what a result is of, and how many shapes and instances that are."""
    facts = result["dataset"]
    part = "a part of " if result.get("partial") else ""
    return (
        f"{part}{results.title(result)}: "
        f"{counted(facts['shapes'], 'shape')}, {counted(facts['instances'], 'instance')}"
    )
