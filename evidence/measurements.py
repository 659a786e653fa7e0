"""The table of measurements, and how one is run: measure, write the numbers, print them."""

from __future__ import annotations

import argparse
import inspect
import json
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path

from tabulate import tabulate

from evidence import DATA, numbers

NAMES = """
build-cost build-full build-memory concepts faults flaws folds fuzz-import gcn growth
harness-overhead installation leakage limits loading missed multilevel operators packages parts
peers ratios ritz-mlp shapes solver start thin-meshes two-numbers
"""
# Each module has ``measure``, which returns the numbers and whose parameters are the options of the
# command, and perhaps ``problems``, which returns what is wrong with them.
MEASUREMENTS = {name: import_module(f"evidence.{name.replace('-', '_')}") for name in NAMES.split()}
# The files of docs/data of those whose numbers are of a version, fixed or their option.
FILES = {"flaws": "flaws-1.0", "folds": "folds-2.0"}
FILES |= {name: f"{name}-{{version}}" for name in ("limits", "loading", "shapes")}
# Numbers that another command writes: reports of builds, and what a picture shows.
REPORTS = {
    **{
        f"build-{v}": f"synthnet build {v} --json > docs/data/build-{v}.json"
        for v in ("1.0", "2.0")
    },
    "build-2.1": "synthnet info 2.1 --json > docs/data/build-2.1.json",
    "times-elsewhere": "eigbench time, as benchmark/timing/2.0.json, on another machine",
    "surfaces": "python -m evidence draw readme",
}


def add_options(parser: argparse.ArgumentParser, measure: Callable[..., object]) -> None:
    """Add an option for each parameter of a function; one without a default has to be given."""
    for name, parameter in inspect.signature(measure).parameters.items():
        option, default = f"--{name.replace('_', '-')}", parameter.default
        if default is inspect.Parameter.empty:
            parser.add_argument(name)
        elif isinstance(default, bool):
            parser.add_argument(option, action="store_true")
        elif isinstance(default, tuple):
            kind = type(default[0]) if default else str
            parser.add_argument(option, nargs="+", type=kind, default=default)
        else:
            parser.add_argument(option, type=type(default), default=default)


def run(name: str, out: str | None, given: Mapping[str, object]) -> int:
    """Measure, print and write; return 1 if something is wrong with the numbers.

    Parameters
    ----------
    name
        Of :data:`MEASUREMENTS`.
    out
        The file to write, ``-`` for none; by default the one of docs/data.
    given
        The parameters of the measurement; others are ignored.
    """
    module = MEASUREMENTS[name]
    options = {key: given[key] for key in inspect.signature(module.measure).parameters}
    if options.get("only") and out is None:
        raise ValueError("--only measures a part: give --out FILE, or --out - to write nothing")
    data = module.measure(**options)
    print(as_text(data))
    problems = []
    if out != "-":
        path = Path(out) if out else DATA / f"{FILES.get(name, name).format_map(options)}.json"
        if out is None and path.exists() and (parts := lost(numbers.read(path.stem), data)):
            there, path = path.name, path.with_suffix(".partial.json")
            problems += [f"{there} has more of {', '.join(parts)}: this is in {path} alone"]
        numbers.write(path, data)
        print(f"{path} written; `python -m evidence fill` brings docs/data into the pages")
    if hasattr(module, "problems"):
        problems += module.problems(data)
    for problem in problems:
        print(f"WRONG: {problem}", file=sys.stderr)
    return int(bool(problems))


def lost(old: Mapping[str, object], new: Mapping[str, object]) -> list[str]:
    """Return the parts of a measurement that another, with fewer options, lacks or has fewer of.

    Examples
    --------
    >>> lost({"rows": [1, 2], "figure2": {}, "meshes": 5}, {"rows": [1], "meshes": 4})
    ['rows', 'figure2']
    """
    return [
        name
        for name, value in old.items()
        if not (value is None or name == "machine")
        and (new.get(name) is None or (isinstance(value, list) and len(new[name]) < len(value)))  # type: ignore[arg-type]
    ]


def as_text(data: Mapping[str, object]) -> str:
    """Return numbers for the terminal: rows as tables, without lists in them; the rest as JSON.

    Examples
    --------
    >>> print(as_text({"version": "1.0", "rows": [{"mesh": "torus", "ms": 3.6}]}))
    version: "1.0"
    mesh      ms
    ------  ----
    torus    3.6
    """
    texts = []
    for name, value in data.items():
        if isinstance(value, list) and value and isinstance(value[0], dict):
            rows = [{k: v for k, v in row.items() if not isinstance(v, list)} for row in value]
            texts.append(tabulate(rows, headers="keys"))
        else:
            texts.append(f"{name}: {json.dumps(value)}")
    return "\n".join(texts)
