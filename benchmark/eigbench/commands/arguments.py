"""Options that several commands take."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable
from pathlib import Path

from eigbench.board import leaderboard
from eigbench.errors import EigbenchError
from eigbench.results.sources import is_output
from eigbench.results.submission import Submission
from eigbench.scaling import results as scaling_results
from eigbench.scoring.names import SURFACE, TARGETS
from eigbench.scoring.truth import Truth
from synthnet import recipe, store
from synthnet.errors import RecipeError
from synthnet.terminal import above_zero, at_least, complete_with

# PyTorch's, and JAX's gpu and tpu
DEVICES = ("cpu", "cuda", "gpu", "hip", "hpu", "meta", "mps", "mtia", "npu", "tpu", "xla", "xpu")

# It takes a name, a function, a text and an example
Command = Callable[..., argparse.ArgumentParser]


def predictor(sub: argparse.ArgumentParser) -> None:
    """Add the predictor's file."""
    sub.add_argument("predictor", type=Path, metavar="FILE", help="the predictor's Python file")


def path(sub: argparse._ActionsContainer, option: str, metavar: str, text: str) -> None:
    """Add an option that takes a path; its text says what it is by default."""
    sub.add_argument(option, type=Path, metavar=metavar, help=text)


def out(sub: argparse.ArgumentParser, default: str, text: str, metavar: str = "FILE") -> None:
    """Add the file, or the directory, that is written."""
    text = f"{text} (default: %(default)s)"
    sub.add_argument("--out", type=Path, default=Path(default), metavar=metavar, help=text)


def check_out(option: str, path: Path, suffix: str) -> None:
    """Check that a file may be written: over nothing but what eigbench has written.

    What a predictor reads may have the very name, weights beside its file among it.

    Raises
    ------
    EigbenchError
        If its name does not end in the suffix, or something else is there.
    """
    if path.suffix != suffix:
        raise EigbenchError(f"{option} must end in {suffix}, got {path}")
    if path.exists() and not is_output(path):
        raise EigbenchError(
            f"{path} is there, and no output of eigbench: give another {option}, or move it away"
        )


def process(sub: argparse.ArgumentParser) -> None:
    """Add what the predictor's process computes with: device and threads."""
    compute_device(sub)
    count(sub, "--threads", "N", "threads that the predictor may use", 1)


def compute_device(sub: argparse.ArgumentParser) -> None:
    """Add the device that the predictor computes on."""
    text = "PyTorch device passed to the predictor (default: %(default)s)"
    sub.add_argument("--device", type=device, default="cpu", help=text)


def count(
    sub: argparse.ArgumentParser, option: str, metavar: str, text: str, default: int, least: int = 1
) -> None:
    """Add an option that takes a whole number from ``least`` up."""
    text = f"{text} (default: %(default)s)"
    kind = at_least(least)
    sub.add_argument(option, type=kind, default=default, metavar=metavar, help=text)


def time_limit(sub: argparse.ArgumentParser, default: float, of: str = "a batch") -> None:
    """Add the time after which a predictor is given up."""
    text = f"seconds allowed for {of} (default: %(default)g)"
    sub.add_argument("--time-limit", type=above_zero, default=default, metavar="S", help=text)


def target(sub: argparse.ArgumentParser, default: str) -> None:
    """Add what predictions are compared with; ``default`` says it for where none is given."""
    text = "the surface's spectrum, or the label of the mesh"
    where = f"(default: {default}, where the surface is known)"
    sub.add_argument("--target", choices=TARGETS, help=f"{text} {where}")


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


def dataset(sub: argparse._ActionsContainer, default: str | None, what: str) -> None:
    """Add what names a dataset; :func:`unpinned` reads it."""
    shown = "the pinned labels of the version in the results" if default is None else default
    text = f"{what} (default: {shown})"
    option = sub.add_argument("--dataset", default=default, metavar="NAME", help=text)
    complete_with(option, lambda options: store.known_names(getattr(options, "root", None)))


def root(sub: argparse.ArgumentParser) -> None:
    """Add the directory of the datasets that have no directory in their name."""
    where = "(default: $SYNTHNET_HOME, else the user's cache directory)"
    path(sub, "--root", "DIR", f"directory that holds the datasets {where}")


def unpinned(name: str | None, root: Path | None) -> store.StoredDataset | None:
    """Return the dataset of a directory, an import, a sealed set or an own recipe, else None.

    Raises
    ------
    EigbenchError
        If it is a directory without a dataset.
    SynthNetError
        If there is nothing of that name.
    """
    if name is None or name in recipe.available():
        return None  # a version, even where a directory has its name
    manifest = store.read_manifest(Path(name))
    if manifest is not None:
        return store.StoredDataset(Path(name), manifest)
    if os.sep in name:
        raise EigbenchError(f"{name} holds no dataset (no manifest)")
    stored = store.open_unversioned(name, root)
    if stored is None:
        try:
            recipe.load(name, known=store.known_names(root))
        except RecipeError as error:
            if name[:1].isdigit():  # no import has such a name
                raise
            message = f"{error}; no import {name} is in {store.home(root)}: --root names another"
            raise EigbenchError(f"{message} directory") from error
    return stored


def board(sub: argparse.ArgumentParser) -> None:
    """Add the directory of the board."""
    text = "a checkout of the project, or any directory of its layout (default: here)"
    sub.add_argument("--board", type=Path, default=Path(), metavar="DIR", help=text)


def board_root(options: argparse.Namespace, *, make: bool = False) -> Path:
    """Return the directory of the board; with ``make`` one that is named need not be there.

    Raises
    ------
    EigbenchError
        If there is no board.
    """
    root: Path = options.board
    folders = (leaderboard.RESULTS, scaling_results.FOLDER)
    exists = any((root / folder).is_dir() for folder in folders)
    if not exists and not (make and root != Path()):
        raise EigbenchError(
            f"{root.resolve()} has no {leaderboard.RESULTS}: run this in a checkout of the "
            "project, or give one with --board DIR"
        )
    return root


def board_argument(options: argparse.Namespace) -> str:
    """Return the option that names the board again, for the next command."""
    return "" if options.board == Path() else f" --board {options.board}"


def device(text: str) -> str:
    """Return the name of a device: PyTorch's, or what another framework calls it."""
    kind, colon, number = text.partition(":")
    if kind not in DEVICES or (colon and not re.fullmatch("[0-9]+", number)):
        raise argparse.ArgumentTypeError(
            f"must be one of {', '.join(DEVICES)}, with a number if need be (cuda:1), got {text!r}"
        )
    return text
