"""What the commands that show a dataset do: ``synthnet show | gallery | croissant``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track
from tabulate import tabulate

from synthnet import recipe, store
from synthnet.build import estimates
from synthnet.mesh.geometry import MeshFacts
from synthnet.store.files import write_bytes
from synthnet.types import Mesh, ShapeSpec

Thing = TypeVar("Thing")

EIGENFUNCTIONS, SHAPES = 5, 15  # drawn if not told how many


def show_options(sub: argparse.ArgumentParser) -> None:
    """Add the options of ``synthnet show`` but those of every command."""
    sub.add_argument("id", metavar="ID", help="for example cone-00042")
    sub.add_argument(
        "--png", type=Path, metavar="FILE", help="also draw it, with spectrum and eigenfunctions"
    )
    sub.add_argument(
        "--eigenfunctions",
        type=at_least_zero,
        default=EIGENFUNCTIONS,
        metavar="N",
        help="how many eigenfunctions to draw (default: %(default)s)",
    )
    sub.add_argument("--edges", action="store_true", help="draw the edges of the triangles")


def gallery_options(sub: argparse.ArgumentParser) -> None:
    """Add the options of ``synthnet gallery`` but those of every command."""
    sub.add_argument(
        "family",
        nargs="?",
        metavar="FAMILY",
        help="for example torus (default: one shape of each family)",
    )
    sub.add_argument(
        "--png",
        type=Path,
        metavar="FILE",
        help="where to write it (default: gallery-V.png or gallery-V-FAMILY.png, here)",
    )
    sub.add_argument(
        "--count",
        type=_at_least_one,
        metavar="N",
        help=f"how many shapes of the family (default: {SHAPES})",
    )
    sub.add_argument("--edges", action="store_true", help="draw the edges of the triangles")


def show(options: argparse.Namespace) -> int:
    """Say what one shape is, and draw it if asked to."""
    dataset = store.open_dataset(options.version, options.out)
    sample = dataset.find(options.id)
    estimate = estimates.find(dataset, options.id)
    facts = MeshFacts(sample.mesh)
    if options.png is not None:
        from synthnet.pictures.draw import draw_sample

        draw_sample(sample, options.png, eigenfunctions=options.eigenfunctions, edges=options.edges)
    described: dict[str, Any] = {
        "id": sample.spec.id,
        "family": sample.spec.family,
        "parameters": dict(sample.spec.parameters),
        "split": sample.split,
        "vertices": facts.n_vertices,
        "faces": facts.n_faces,
        "area": facts.area,
        "volume": facts.volume,
        "euler_characteristic": facts.euler_characteristic,
        "closed": facts.is_closed,
        "least_relative_altitude": float(facts.relative_altitudes.min()),
        "eigenvalues": sample.eigenvalues.tolist(),
        "trivial": sample.trivial,
        "certificate": asdict(sample.certificate),
        "error_estimate": None if estimate is None else estimate.error.tolist(),
    }
    if options.json:
        print(json.dumps(described, indent=1))
        return 0
    eigenvalues, errors = described.pop("eigenvalues"), described.pop("error_estimate")
    proof = sample.certificate
    described["certificate"] = (
        f"{proof.count} eigenvalues below {proof.shift:.6g}, zero included, as many as were "
        f"found; each within a relative {proof.residual:.1g} of an exact one"
    )
    parameters = described.pop("parameters")
    described["parameters"] = ", ".join(f"{k} {v}" for k, v in parameters.items())
    print(
        tabulate([(k.replace("_", " "), _short(v)) for k, v in described.items()], tablefmt="plain")
    )
    print("eigenvalues (1/length²)")
    print("  " + "  ".join(f"{value:.6g}" for value in eigenvalues))
    if errors is not None:
        print("their estimated errors, label − limit (1/length²)")
        print("  " + "  ".join(f"{value:.2g}" for value in errors))
    if options.png is not None:
        print(f"picture: {options.png}")
    return 0


def gallery(options: argparse.Namespace) -> int:
    """Draw a contact sheet of a family, or of one shape of each."""
    from synthnet.pictures import draw
    from synthnet.pictures import gallery as galleries

    name = "-".join(filter(None, ("gallery", options.version, options.family)))
    path: Path = options.png or Path(f"{name}.png")
    draw.check_name(path)
    found = galleries.candidates(options.version, options.family, options.out)
    one_each = options.family is None and len(found) != 1
    if one_each and options.count is not None:
        raise ValueError("--count is for the shapes of one family: name the family")
    shapes: list[tuple[ShapeSpec, Mesh]] = []
    varying: tuple[str, ...] = ()
    if one_each:
        for one in _followed(found, len(found)):
            shapes += galleries.chosen(options.version, one, 1, options.out)
        title = f"{recipe.title(options.version)}: {len(shapes)} families"
    else:
        (one,) = found
        count = min(options.count or SHAPES, len(one.specs))
        made = galleries.chosen(options.version, one, count, options.out)
        shapes = sorted(_followed(made, count), key=lambda shape: shape[0].id)
        title = f"{recipe.title(options.version)}, {one.family}: {len(shapes)} of {one.total:,}"
        varying = one.varying
    if not shapes:
        family = "" if options.family is None else f" of family {options.family}"
        raise ValueError(
            f"{options.version} has no shape{family} to draw, every one was rejected: "
            f"`synthnet info --version {options.version}` says why"
        )
    write_bytes(path, galleries.sheet(shapes, varying, title, edges=options.edges))
    if options.json:
        ids = [spec.id for spec, _ in shapes]
        print(json.dumps({"picture": str(path), "ids": ids}, indent=1))
    else:
        print(f"picture: {path}")
    return 0


def croissant(options: argparse.Namespace) -> int:
    """Write the Croissant metadata of a built version."""
    from synthnet.loaders.croissant import write

    path = write(store.open_dataset(options.version, options.out))
    print(json.dumps({"croissant": str(path)}, indent=1) if options.json else path)
    return 0


def _followed(things: Iterable[Thing], count: int) -> Iterable[Thing]:
    """Show how far a loop is, to who sits before a terminal."""
    console = Console(stderr=True)
    return track(
        things,
        "drawing",
        count,
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def at_least_zero(text: str) -> int:
    """Return a number of the command line that may not be negative."""
    return _at_least(0, text)


def _at_least_one(text: str) -> int:
    return _at_least(1, text)


def _at_least(least: int, text: str) -> int:
    value = int(text)
    if value < least:
        raise argparse.ArgumentTypeError(f"must be at least {least}, got {value}")
    return value


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:,}" if isinstance(value, int) else str(value)
