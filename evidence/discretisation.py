"""Measure the error estimates of a version: docs/data and a table of docs.

    synthnet build --version 1.0
    python scripts/error_tables.py 1.0

The quantiles are those of the pinned estimates of all shapes; the effectivity (estimate over
true error) is over at most SAMPLE of a family, evenly spaced, which are estimated anew and
must agree with the pins. Where the limit is not known, the estimate after one more refinement
stands for the true error.
"""

import json
import sys
from pathlib import Path

import numpy as np
import threadpoolctl
from rich.progress import track
from tabulate import tabulate

from synthnet import spectrum, store
from synthnet.build import estimates
from synthnet.build.discretisation import Estimate, estimate, extrapolate
from synthnet.families import FAMILIES
from synthnet.store import pins
from synthnet.store.files import write_marked, write_text
from synthnet.types import ShapeSpec

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = {
    "1.0": (DOCS / "labels.md", DOCS / "data" / "errors.json"),
    "2.0": (DOCS / "dataset-card-2.0.md", DOCS / "data" / "errors-2.0.json"),
}
SAMPLE = {"known": 100, "finer": 20}
QUANTILES = (5, 50, 95)
AGREEMENT = 1e-5  # of the label: pins are of single precision, and made on another machine


def true_error(spec: ShapeSpec, label: np.ndarray, row: Estimate) -> np.ndarray:
    """Return the label minus the limit, or minus a better extrapolation."""
    family = FAMILIES[spec.family]
    limit = family.limit_eigenvalues(spec.parameters, len(label))
    if limit is None:
        finer = family.refine(spec.parameters, len(row.refined) + 1)
        limit = extrapolate(row.refined[-1], spectrum.compute(finer).eigenvalues)
    return label - limit


def estimated(spec: ShapeSpec, label: np.ndarray, pinned: np.ndarray) -> Estimate:
    """Return the estimate of a shape, made anew; the pinned one is a share of the label."""
    found = estimate(spec, label)
    if np.max(np.abs(found.error / label - pinned)) > AGREEMENT:
        raise ValueError(f"{spec.id}: the estimate is not the pinned one: {found.error / label}")
    return found


def measured(
    name: str, labelled: list[tuple[ShapeSpec, np.ndarray]], errors: list[np.ndarray]
) -> dict:
    """Return the numbers of one family; what is exact needs no comparison."""
    relative = 100 * np.array(errors, dtype=np.float64)
    reference = "finer" if FAMILIES[name].limit is None else "known"
    effectivity, chosen, refinements = None, [], set()
    if not FAMILIES[name].exact:
        count = min(SAMPLE[reference], len(labelled))
        chosen = np.linspace(0, len(labelled) - 1, count).round().astype(int).tolist()
        ratios = []
        for i in track(chosen, name):
            row = estimated(*labelled[i], errors[i])
            ratios.append(row.error / true_error(*labelled[i], row))
            refinements.add(len(row.refined))
        effectivity = np.percentile(np.array(ratios), QUANTILES).round(2).tolist()
    first, last = (np.percentile(relative[:, i], (50, 95)).round(2).tolist() for i in (0, -1))
    return {
        "family": name,
        "shapes": len(labelled),
        "first": first,
        "last": last,
        "refinements": sorted(refinements),
        "reference": reference,
        "compared": len(chosen),
        "effectivity": effectivity,
    }


def compared(row: dict) -> list[str | int]:
    """Return the cells that say what an estimate rests on, and how good it is."""
    if row["effectivity"] is None:
        return ["", "known", "", "exact"]
    low, middle, high = row["effectivity"]
    return [
        ", ".join(map(str, row["refinements"])),
        "known" if row["reference"] == "known" else "one more refinement",
        row["compared"],
        f"{middle:.2f} ({low:.2f} to {high:.2f})",
    ]


def table(report: dict) -> str:
    """Return the table of the page."""
    cells = [
        [
            FAMILIES[row["family"]].title,
            f"{row['shapes']:,}",
            *(f"{value:.2f} %" for value in (*row["first"], *row["last"])),
            *compared(row),
        ]
        for row in report["rows"]
    ]
    headers = ["family", "shapes", "λ1 median", "λ1 95 %", "λ10 median", "λ10 95 %"]
    headers += ["refined", "limit", "compared", "estimate / true, median (5 to 95 %)"]
    text = tabulate(cells, headers, tablefmt="github", disable_numparse=True)
    return f"Estimated error as a share of the label, synthNet {report['version']}:\n\n{text}"


def main() -> None:
    """Measure, and rewrite the marked part of the page."""
    page, data = PAGES[sys.argv[1]]
    dataset = store.open_dataset(sys.argv[1])
    found = pins.read_errors(sys.argv[1])
    if found is None:
        raise ValueError(f"no estimates of {sys.argv[1]} are pinned: see scripts/pin_errors.py")
    rows = []
    with threadpoolctl.threadpool_limits(1):
        for name in dataset.manifest.drawn:
            files = [shard.file for shard in dataset.manifest.shards if shard.family == name]
            mine = [row for file in files for row in estimates.labels(dataset.directory / file)]
            rows.append(measured(name, mine, [found[spec.id] for spec, _ in mine]))
    report = {"version": sys.argv[1], "rows": rows}
    write_text(data, json.dumps(report, indent=1) + "\n")
    write_marked(page, errors=f"\n{table(report)}\n")
    print(f"{data} and {page} written")


if __name__ == "__main__":
    main()
