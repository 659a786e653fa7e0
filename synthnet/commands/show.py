"""``synthnet show``: say what one shape is, and draw it."""

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tabulate import tabulate

from synthnet import store
from synthnet.commands.options import add_command
from synthnet.mesh.geometry import MeshFacts
from synthnet.store import limits
from synthnet.store.files import make_parent
from synthnet.store.limits import StoredLimit
from synthnet.terminal import Commands, at_least, complete_with, print_json

EIGENFUNCTIONS = 5  # that are drawn by default


def add(commands: Commands) -> None:
    """Add the command."""
    example = "torus-00012 --png torus.png"
    sub = add_command(commands, "show", run, "show one shape", example, positional=False)
    shape = sub.add_argument(
        "id",
        metavar="ID",
        help="id of the shape, for example cone-00042; of an import, or its file",
    )
    complete_with(shape, _names)
    sub.add_argument(
        "--png",
        type=Path,
        metavar="FILE",
        help="also draw it into this file, with spectrum and eigenfunctions (default: no picture)",
    )
    sub.add_argument(
        "--eigenfunctions",
        type=at_least(0),
        default=EIGENFUNCTIONS,
        metavar="N",
        help="how many eigenfunctions to draw (default: %(default)s)",
    )
    sub.add_argument("--edges", action="store_true", help="draw the edges of the triangles")


def _names(options: argparse.Namespace) -> list[str]:
    """Return the ids of a dataset's shapes, and their files if it was imported."""
    dataset = store.open_dataset(options.version, options.out)
    ids, files = dataset.ids(), dataset.files()
    return ids + [files[id] for id in ids if id in files]


def run(options: argparse.Namespace) -> int:
    """Say what one shape is, and draw it if asked to."""
    dataset = store.open_dataset(options.version, options.out)
    sample = dataset.find(options.id)
    limit = limits.find(dataset, sample.spec.id)
    facts = MeshFacts(sample.mesh)
    if options.png is not None:
        from synthnet.pictures.draw import check_name, draw_sample

        check_name(options.png)
        make_parent(options.png)
        draw_sample(sample, options.png, eigenfunctions=options.eigenfunctions, edges=options.edges)
    described: dict[str, Any] = {
        "id": sample.spec.id,
        "family": sample.spec.family,
        "parameters": dict(sample.spec.parameters),
        "split": sample.split,
        "vertices": facts.n_vertices,
        "faces": facts.n_faces,
        "area": facts.area,
        "volume": facts.volume if facts.is_closed else None,
        "euler_characteristic": facts.euler_characteristic,
        "closed": facts.is_closed,
        "least_relative_altitude": float(facts.relative_altitudes.min()),
        "eigenvalues": sample.eigenvalues.tolist(),
        "trivial": sample.trivial,
        "certificate": asdict(sample.certificate),
        "limit": None if limit is None else _of_limit(limit),
    }
    if options.json:
        print_json(described)
        return 0
    del described["eigenvalues"], described["limit"]
    if described["volume"] is None:
        del described["volume"]
    proof = sample.certificate
    parameters = described.pop("parameters")
    bound = parameters.get("error_bound")
    described["certificate"] = (
        f"{proof.count} eigenvalues below {proof.shift:.6g}, zero included, as many as were found; "
        + (
            f"the largest relative residual is {proof.residual:.1g}, without rounding of matrices"
            if bound is None
            else f"each within a relative {bound:.1g} of the mesh's, rounding included"
        )
    )
    described["parameters"] = ", ".join(f"{k} {v}" for k, v in parameters.items())
    print(
        tabulate([(k.replace("_", " "), _short(v)) for k, v in described.items()], tablefmt="plain")
    )
    print("eigenvalues (1/length²)")
    print("  " + "  ".join(f"{value:.6g}" for value in sample.eigenvalues))
    if limit is not None:
        print("limits, the eigenvalues of the surface (1/length²)")
        print("  " + "  ".join(f"{value:.6g}" for value in limit.eigenvalues))
        print("bars: how far each limit may be from the truth (1/length²)")
        print("  " + "  ".join(f"{value:.1g}" for value in limit.bar))
        verdict = "above 20 dB" if limit.above_20_db else "20 dB or less"
        print(f"errors, eigenvalue / limit - 1 (PSNR {verdict})")
        print("  " + "  ".join(f"{value:.2%}" for value in limit.error))
    if options.png is not None:
        print(f"picture: {options.png}")
    return 0


def _of_limit(limit: StoredLimit) -> dict[str, Any]:
    numbers = {name: getattr(limit, name).tolist() for name in limits.NUMBERS}
    return {**numbers, "above_20_db": limit.above_20_db}


def _short(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    return f"{value:,}" if isinstance(value, int) else str(value)
