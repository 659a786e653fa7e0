"""Options that several commands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring.targets import TARGETS
from eigbench.scoring.truth import SURFACE, Truth
from synthnet import store

Command = Callable[..., argparse.ArgumentParser]  # of a name, a function, a text and an example


def predictor(sub: argparse.ArgumentParser) -> None:
    """Add the predictor's file."""
    sub.add_argument("predictor", type=Path, metavar="FILE", help="the predictor's Python file")


def out(sub: argparse.ArgumentParser, default: str) -> None:
    """Add the file that the result is written to."""
    sub.add_argument(
        "--out",
        type=Path,
        default=Path(default),
        metavar="FILE",
        help="the result (default: %(default)s)",
    )


def out_folder(sub: argparse.ArgumentParser, default: str, receives: str) -> None:
    """Add the directory that files are written into."""
    sub.add_argument(
        "--out",
        type=Path,
        default=Path(default),
        metavar="DIR",
        help=f"directory that receives {receives} (default: %(default)s)",
    )


def process(sub: argparse.ArgumentParser) -> None:
    """Add what the predictor's process computes with: device and threads."""
    sub.add_argument(
        "--device", default="cpu", help="PyTorch device passed to the predictor (default: cpu)"
    )
    sub.add_argument(
        "--threads",
        type=positive,
        default=1,
        metavar="N",
        help="threads that the predictor may use (default: 1)",
    )


def target(sub: argparse.ArgumentParser, default: str) -> None:
    """Add what predictions are compared with; ``default`` says it for where none is given."""
    sub.add_argument(
        "--target",
        choices=TARGETS,
        help="the surface's spectrum, or the label of the mesh (default: "
        f"{default}, where the surface is known)",
    )


def beside(row: Submission, target: str | None) -> Submission:
    """Return a submission beside a target; by default the surface, where it is known.

    Raises
    ------
    EigbenchError
        If the target is not known.
    """
    there = row.at(target) if target is not None else row.at(SURFACE) or row
    if there is None:
        raise unknown_surfaces(row.truth)
    return there


def unknown_surfaces(labels: Truth) -> EigbenchError:
    """Return the error of a dataset whose surfaces' spectra are asked for and not known."""
    return EigbenchError(
        f"the surfaces' spectra of {labels.version}, {labels.protocol}, are not known: "
        "give --target mesh"
    )


def dataset_directory(sub: argparse.ArgumentParser) -> None:
    """Add the directory of a dataset whose labels are not pinned; read by :func:`dataset`."""
    sub.add_argument(
        "--dataset",
        type=Path,
        metavar="DIR",
        help="directory of the dataset that was predicted, unless it is a pinned version",
    )


def dataset(options: argparse.Namespace) -> store.StoredDataset | None:
    """Return the dataset of a directory, if one is given.

    Raises
    ------
    EigbenchError
        If there is none.
    """
    if options.dataset is None:
        return None
    manifest = store.read_manifest(options.dataset)
    if manifest is None:
        raise EigbenchError(f"{options.dataset} holds no dataset (no manifest)")
    return store.StoredDataset(options.dataset, manifest)


def positive(text: str) -> int:
    """Return a whole number from 1 up."""
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {value}")
    return value


def above_zero(text: str) -> float:
    """Return a number above zero."""
    value = float(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"must be above 0, got {value:g}")
    return value
