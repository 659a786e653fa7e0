"""The table of measurements, and how one is run: measure, write the numbers, print them."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from tabulate import tabulate

from evidence import (
    DATA,
    build_cost,
    build_full,
    build_memory,
    errors,
    faults,
    flaws,
    folds,
    fuzz_import,
    gcn_speed,
    growth,
    harness_overhead,
    leakage,
    loading,
    multilevel_variants,
    numbers,
    ritz_mlp_variants,
    shapes,
    solver,
)


@dataclass(frozen=True, slots=True)
class Measurement:
    """How something is measured, and where its numbers go.

    Attributes
    ----------
    module
        Has ``options``, which adds to a parser; ``measure``, which takes the options and returns
        the numbers; and perhaps ``problems``, which returns what is wrong with them.
    data
        Name of the file of docs/data; ``{version}`` in it is the option of that name.
    """

    module: ModuleType
    data: str


MEASUREMENTS = {
    "build-cost": Measurement(build_cost, "build-cost"),
    "build-full": Measurement(build_full, "build-full"),
    "build-memory": Measurement(build_memory, "build-memory"),
    "errors": Measurement(errors, "errors-{version}"),
    "faults": Measurement(faults, "faults"),
    "flaws": Measurement(flaws, "flaws-1.0"),
    "folds": Measurement(folds, "folds-2.0"),
    "fuzz-import": Measurement(fuzz_import, "fuzz-import"),
    "gcn": Measurement(gcn_speed, "gcn"),
    "growth": Measurement(growth, "growth"),
    "harness-overhead": Measurement(harness_overhead, "harness-overhead"),
    "leakage": Measurement(leakage, "leakage"),
    "loading": Measurement(loading, "loading-{version}"),
    "multilevel": Measurement(multilevel_variants, "multilevel"),
    "ritz-mlp": Measurement(ritz_mlp_variants, "ritz-mlp"),
    "shapes": Measurement(shapes, "shapes-{version}"),
    "solver": Measurement(solver, "solver"),
}
# Reports of builds, which the command of the dataset writes itself.
REPORTS = {
    f"build-{v}": f"synthnet build --version {v} --json > docs/data/build-{v}.json"
    for v in ("1.0", "2.0")
}


def run(name: str, options: argparse.Namespace) -> int:
    """Measure, print and write; return 1 if something is wrong with the numbers."""
    measurement = MEASUREMENTS[name]
    data = measurement.module.measure(options)
    print(as_text(data))
    if options.out != "-":
        default = DATA / f"{measurement.data.format_map(vars(options))}.json"
        path = Path(options.out) if options.out else default
        numbers.write(path, data)
        print(f"{path} written; `python -m evidence fill` brings it into the pages")
    find_problems = getattr(measurement.module, "problems", None)
    problems = find_problems(data) if find_problems else []
    for problem in problems:
        print(f"WRONG: {problem}", file=sys.stderr)
    return int(bool(problems))


def as_text(data: Mapping[str, object]) -> str:
    """Return numbers for the terminal: lists of rows as tables, the rest as JSON.

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
            texts.append(tabulate(value, headers="keys"))
        else:
            texts.append(f"{name}: {json.dumps(value)}")
    return "\n".join(texts)
