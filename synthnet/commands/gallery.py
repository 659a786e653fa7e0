"""``synthnet gallery``: draw a contact sheet."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import track

from synthnet import recipe
from synthnet.commands.options import add_command
from synthnet.store.files import make_parent, write_bytes
from synthnet.terminal import Commands, at_least, complete_with, print_answer
from synthnet.types import Mesh, ShapeSpec

Thing = TypeVar("Thing")

SHAPES = 15  # of a family that are drawn by default


def add(commands: Commands) -> None:
    """Add the command."""
    sub = add_command(
        commands,
        "gallery",
        run,
        "draw a contact sheet of a family, or one shape of each; no build is needed",
        "torus --dataset 1.0",
        positional=False,
    )
    family = sub.add_argument(
        "family",
        nargs="?",
        metavar="FAMILY",
        help="family to draw, for example torus (default: one shape of each family)",
    )
    complete_with(family, lambda options: recipe.load(options.version).families)
    sub.add_argument(
        "--png",
        type=Path,
        metavar="FILE",
        help="picture to write (default: gallery-V.png or gallery-V-FAMILY.png, here)",
    )
    sub.add_argument(
        "--count",
        type=at_least(1),
        metavar="N",
        help=f"how many shapes of the family (default: {SHAPES})",
    )
    sub.add_argument("--edges", action="store_true", help="draw the edges of the triangles")


def run(options: argparse.Namespace) -> int:
    """Draw a contact sheet of a family, or of one shape of each."""
    from synthnet.pictures import draw
    from synthnet.pictures import gallery as galleries

    name = "-".join(filter(None, ("gallery", options.version, options.family)))
    path: Path = options.png or Path(f"{name.replace('/', '-')}.png")  # it may be a file's path
    draw.check_name(path)
    families = galleries.candidates(options.version, options.family, options.out)
    one_each = options.family is None and len(families) != 1
    if one_each and options.count is not None:
        raise ValueError("--count is for the shapes of one family: name the family")
    make_parent(path)
    shapes: list[tuple[ShapeSpec, Mesh]] = []
    varying: tuple[str, ...] = ()
    if one_each:
        for candidates in _followed(families, len(families)):
            shapes += galleries.chosen(options.version, candidates, 1, options.out)
        title = f"{recipe.title(options.version)}: {len(shapes)} families"
    else:
        (candidates,) = families
        count = min(options.count or SHAPES, len(candidates.specs))
        made = galleries.chosen(options.version, candidates, count, options.out)
        shapes = sorted(_followed(made, count), key=lambda shape: shape[0].id)
        title = f"{recipe.title(options.version)}, {candidates.family}: "
        title += f"{len(shapes)} of {candidates.total:,}"
        varying = candidates.varying
    if not shapes:
        family = "" if options.family is None else f" of family {options.family}"
        raise ValueError(
            f"{options.version} has no shape{family} to draw, every one was rejected: "
            f"`synthnet info {options.version}` says why"
        )
    write_bytes(path, galleries.sheet(shapes, varying, title, edges=options.edges))
    ids = [spec.id for spec, _ in shapes]
    print_answer(options, {"picture": str(path), "ids": ids}, f"picture: {path}")
    return 0


def _followed(things: Iterable[Thing], count: int) -> Iterable[Thing]:
    """Show the progress of a loop on a terminal."""
    console = Console(stderr=True)
    return track(
        things,
        "drawing",
        count,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
