"""The commands of the scaling track: scale, which runs a predictor, and scaling."""

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console
from tabulate import tabulate

from eigbench.board.tables import family_title
from eigbench.commands import arguments, predict
from eigbench.commands.arguments import Command
from eigbench.running.predictor import check_file
from eigbench.scaling import run as scaling_run
from eigbench.scaling import scores as scaling_scores
from eigbench.scaling import surfaces
from eigbench.scaling.results import ANSWERED, Scaled
from eigbench.scaling.run import Settings
from synthnet.store.files import make_parent
from synthnet.terminal import above_zero, print_json


def add_commands(command: Command) -> None:
    """Add scale and scaling to the command line."""

    def sizes_option(sub: argparse.ArgumentParser) -> None:
        sizes = surfaces.SIZES
        text = f"numbers of vertices: {', '.join(map(str, sizes))} (default: all that are pinned)"
        sub.add_argument("--sizes", type=int, nargs="+", choices=sizes, metavar="N", help=text)

    text = "run a predictor on the surfaces of the scaling track; this runs the file's code"
    sub = command("scale", scale, text, "my_model.py --sizes 1000 10000 --out surfaces.json")
    arguments.predictor(sub)
    sizes_option(sub)
    arguments.out(sub, "scaling.json", "the result")
    arguments.process(sub)
    arguments.time_limit(sub, 600.0, "a mesh")
    text = (
        "memory that the predictor's process may use, checked on Linux only (default: %(default)g)"
    )
    sub.add_argument("--memory-limit", type=above_zero, default=16.0, metavar="GIB", help=text)
    sub.add_argument("--resume", action="store_true", help="add what the result at --out lacks")
    predict.add_sandbox(sub)

    text = "list the meshes of the scaling track; --verify makes them and their labels anew"
    sub = command("scaling", show, text, "--verify --sizes 1000 10000")
    sizes_option(sub)
    sub.add_argument("--verify", action="store_true", help="exit 1 if anything differs")


def scale(options: argparse.Namespace) -> int:
    """Run a predictor over the meshes, write the result and print its table."""
    out: Path = options.out
    arguments.check_out("--out", out, ".json")
    check_file(options.predictor)
    settings = predict.settings_of(options, Settings)
    make_parent(out)
    with Console(stderr=True).status("loading the predictor") as status:
        result = scaling_run.run(
            options.predictor,
            _sizes(options),
            settings,
            out,
            on_mesh=lambda name: status.update(f"predicting {name}"),
        )
    if options.json:
        print_json(result)
        return 0
    rows = []
    for (surface, size), mesh in Scaled(result, out).meshes.items():
        own = surfaces.pinned(surface, size).discretisation_error
        row = [f"{size:,}", family_title(surface), f"{100 * own:.2g} %"]
        if mesh["outcome"] == ANSWERED:
            seconds, memory = scaling_scores.seconds(mesh), mesh["peak_memory_mb"]
            of_both = scaling_scores.distance(mesh), scaling_scores.error(mesh)
            row += [f"{100 * error:.2g} %" for error in of_both]
            row += [f"{1e3 * seconds:,.2f}", f"{memory:,.0f}", ""]
        else:
            row += ["", "", "", "", f"{mesh['outcome']}: {mesh['detail']}"]
        rows.append(row)
    errors = ["discretisation error", "error to the surface", "to the mesh"]
    headers = ["vertices", "surface", *errors, "ms", "peak MB", ""]
    print(f"{result['model']['name']}, one mesh a call\n")
    print(tabulate(rows, headers=headers, disable_numparse=True))
    print(f"\nresult {out}")
    return 0


def show(options: argparse.Namespace) -> int:
    """List the meshes, or make them anew and say what differs."""
    chosen = [surfaces.pinned(s, size) for size in _sizes(options) for s in surfaces.SURFACES]
    rows: list[dict[str, Any]] = []
    findings = []
    with Console(stderr=True).status("reading") as status:
        for pinned in chosen:
            if options.verify:
                status.update(f"solving {pinned.pin.id}")
                findings += [f"{pinned.pin.id}: {d}" for d in surfaces.differences(pinned)]
            rows.append(
                {
                    "mesh": pinned.pin.id,
                    "vertices": pinned.vertices,
                    "triangulation": surfaces.SURFACES[pinned.surface]["triangulation"],
                    "discretisation_error": pinned.discretisation_error,
                    "limit_error": float((pinned.limit_error / pinned.limit).max()),
                }
            )
    if options.json:
        print_json({"meshes": rows, "verified": options.verify, "findings": findings})
        return 1 if findings else 0
    cells = [
        [
            row["mesh"],
            f"{row['vertices']:,}",
            row["triangulation"],
            f"{100 * row['discretisation_error']:.2g} %",
            f"{100 * row['limit_error']:.1g} %",
        ]
        for row in rows
    ]
    headers = ["mesh", "vertices", "triangulation", "discretisation error", "of the limit"]
    print(tabulate(cells, headers=headers, disable_numparse=True))
    for finding in findings:
        print(finding)
    if options.verify and not findings:
        print(f"\n{len(rows)} meshes and their labels are the pinned ones")
    return 1 if findings else 0


def _sizes(options: argparse.Namespace) -> list[int]:
    if options.sizes is not None:
        return sorted(set(options.sizes))
    pinned = surfaces.read()
    return [n for n in surfaces.SIZES if all((s, n) in pinned for s in surfaces.SURFACES)]
