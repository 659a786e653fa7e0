"""The command: ``python -m evidence`` lists the blocks and the measurements."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from eigbench.errors import EigbenchError

from evidence import card, measurements, numbers, packages, pins, voronoi
from evidence.blocks import BLOCKS, CARDS, ELSEWHERE, PAGE, fill, rendered
from evidence.measurements import FILES, MEASUREMENTS, REPORTS, add_options
from synthnet import terminal
from synthnet.errors import SynthNetError

# Of a picture the module and the function that draw it, and the numbers that these are given.
PICTURES: dict[str, tuple[str, tuple[str, ...]]] = {
    "architecture": ("architecture.draw_architecture", ()),
    **{name: (f"{name}.draw", (name,)) for name in ("concepts", "growth", "peers")},
    **{name: ("card_pictures.draw_card", (f"shapes-{name}",)) for name in CARDS},
    "readme": ("surface_pictures.draw_readme", ()),
    "poster": ("surface_pictures.draw_poster", ()),
}
PINS = {
    "version": "the shapes of a built version",
    "limits": "the spectra of the surfaces of a version's shapes, with error bars",
    "scaling": "meshes, labels and limits of the scaling track",
    "packages": "the list of files for `synthnet import --packages`",
    "voronoi": "libigl's mass matrices for the tests (pip install libigl)",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return 1 where a check failed, and 2 after one line on what was wrong."""
    options = parser().parse_args(arguments)
    return terminal.run("evidence", options, EigbenchError, SynthNetError)


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    top = argparse.ArgumentParser(prog="python -m evidence", description=__doc__)
    top.set_defaults(run=run_list, traceback=False)
    commands = top.add_subparsers(metavar="COMMAND")
    add_measurements(commands.add_parser("measure", help="run a measurement, write its numbers"))
    filling = commands.add_parser("fill", help="write the generated blocks of the pages")
    filling.add_argument("names", nargs="*", metavar="NAME", help="default: every block")
    filling.add_argument("--check", action="store_true", help="write nothing; 1 if one is stale")
    filling.set_defaults(run=run_fill)
    drawing = commands.add_parser("draw", help=f"draw pictures: {', '.join(PICTURES)}")
    drawing.add_argument("names", nargs="+", choices=PICTURES, metavar="NAME")
    drawing.set_defaults(run=run_draw)
    cost = commands.add_parser("cost", help="what many meshes would cost, by the build of 1.0")
    cost.add_argument("--meshes", type=int, default=1_000_000)
    cost.add_argument("--cores", type=int, default=64)
    cost.set_defaults(run=run_cost)
    add_pins(commands.add_parser("pin", help="write a pinned file"))
    return top


def add_measurements(measure: argparse.ArgumentParser) -> None:
    """Add a command a measurement."""
    commands = measure.add_subparsers(metavar="NAME", required=True)
    for name, module in MEASUREMENTS.items():
        command = commands.add_parser(
            name,
            help=first_line(name),
            description=module.__doc__,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        add_options(command, module.measure)
        default = f"docs/data/{FILES.get(name, name)}.json"
        command.add_argument("--out", metavar="FILE", help=f"default: {default}; - only prints")
        command.set_defaults(run=run_measure, measurement=name)


def add_pins(pin: argparse.ArgumentParser) -> None:
    """Add a command for each pinned file."""
    commands = pin.add_subparsers(metavar="WHAT", required=True)
    for what, about in PINS.items():
        command = commands.add_parser(what, help=about)
        if what == "scaling":
            command.add_argument("sizes", nargs="+", type=int, metavar="SIZE")
        elif what == "packages":
            command.add_argument("directory", type=Path, help="where pip has installed them")
        elif what != "voronoi":
            command.add_argument("version")
            command.add_argument("--out", type=Path, metavar="FILE", help="another file to write")
        if what == "limits":
            command.add_argument("--workers", type=int, default=1, help="processes (default: 1)")
        command.set_defaults(run=run_pin, what=what)


def first_line(name: str) -> str:
    """Return what a measurement is about."""
    return str(MEASUREMENTS[name].__doc__).partition("\n")[0]


def run_list(_: argparse.Namespace) -> int:
    """Print the blocks with their data, and the measurements."""
    print("Blocks, and the files of docs/data that they are made from (fill, fill --check):\n")
    for name, block in BLOCKS.items():
        print(f"  {name:32} {', '.join(block.data)}")
    print(f"  {PAGE:32} the whole page, from benchmark/reproduction")
    for name, command in ELSEWHERE.items():
        print(f"  {name:32} by {command}")
    print("\nMeasurements (measure NAME):\n")
    for name in MEASUREMENTS:
        print(f"  {name:32} {first_line(name)}")
    print("\nNumbers that another command writes:\n")
    for name, command in REPORTS.items():
        print(f"  {name:32} {command}")
    return 0


def run_measure(options: argparse.Namespace) -> int:
    """Run a measurement."""
    return measurements.run(options.measurement, options.out, vars(options))


def run_fill(options: argparse.Namespace) -> int:
    """Fill blocks, or check them."""
    if unknown := sorted({*options.names} - {*BLOCKS, PAGE}):
        raise ValueError(f"there is no block {unknown[0]}: python -m evidence lists them")
    stale = fill(options.names or [*BLOCKS, PAGE], check=options.check)
    for name in stale:
        text = f"{name} is stale: python -m evidence fill {name}" if options.check else name
        print(text, file=sys.stderr if options.check else sys.stdout)
    return int(options.check and bool(stale))


def run_draw(options: argparse.Namespace) -> int:
    """Draw pictures from the numbers of docs/data."""
    for name in options.names:
        rendered(*PICTURES[name])
    return 0


def run_cost(options: argparse.Namespace) -> int:
    """Print the cost of many meshes."""
    print(card.many_meshes(numbers.read("build-1.0"), options.meshes, options.cores))
    return 0


def run_pin(options: argparse.Namespace) -> int:
    """Write a pinned file."""
    if options.what == "voronoi":
        voronoi.pin_voronoi()
    elif options.what == "scaling":
        pins.pin_scaling(options.sizes)
    elif options.what == "packages":
        packages.pin_packages(options.directory)
    elif options.what == "limits":
        pins.pin_limits(options.version, options.out, options.workers)
    else:
        pins.pin_version(options.version, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
