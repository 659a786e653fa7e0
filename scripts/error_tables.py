"""Measure the error estimates of a built version: docs/data and a table of docs.

    synthnet build --version 1.0 --error-estimates
    python scripts/error_tables.py 1.0

The quantiles are over all shapes; the effectivity (estimate over true error) over at most
SAMPLE of a family, evenly spaced. Where the limit is not known, the estimate after one
more refinement stands for the true error.
"""

import json
import sys
from pathlib import Path

import numpy as np
import threadpoolctl
from rich.progress import track
from tabulate import tabulate

from synthnet import estimates, spectrum, store
from synthnet.discretisation import Estimate, extrapolate
from synthnet.families import FAMILIES
from synthnet.files import write_marked
from synthnet.types import ShapeSpec

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = {
    "1.0": (DOCS / "labels.md", DOCS / "data" / "errors.json"),
    "2.0": (DOCS / "dataset-card-2.0.md", DOCS / "data" / "errors-2.0.json"),
}
SAMPLE = {"known": 100, "finer": 20}
QUANTILES = (5, 50, 95)


def true_error(spec: ShapeSpec, label: np.ndarray, row: Estimate) -> np.ndarray:
    """Return the label minus the limit, or minus a better extrapolation."""
    family = FAMILIES[spec.family]
    limit = family.limit_eigenvalues(spec.parameters, len(label))
    if limit is None:
        finer = family.refine(spec.parameters, len(row.refined) + 1)
        limit = extrapolate(row.refined[-1], spectrum.compute(finer).eigenvalues)
    return label - limit


def measured(name: str, labelled: list[tuple[ShapeSpec, np.ndarray]], rows: list[Estimate]) -> dict:
    """Return the numbers of one family; what is exact needs no comparison."""
    relative = 100 * np.array(
        [row.error / label for (_, label), row in zip(labelled, rows, strict=True)]
    )
    reference = "finer" if FAMILIES[name].limit is None else "known"
    effectivity, chosen = None, []
    if not FAMILIES[name].exact:
        count = min(SAMPLE[reference], len(rows))
        chosen = np.linspace(0, len(rows) - 1, count).round().astype(int).tolist()
        true = [true_error(*labelled[i], rows[i]) for i in track(chosen, name)]
        ratios = np.array([rows[i].error for i in chosen]) / true
        effectivity = np.percentile(ratios, QUANTILES).round(2).tolist()
    first, last = (np.percentile(relative[:, i], (50, 95)).round(2).tolist() for i in (0, -1))
    return {
        "family": name,
        "shapes": len(rows),
        "first": first,
        "last": last,
        "refinements": sorted({len(row.refined) for row in rows}),
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
    found = {row.id: row for row in estimates.read(dataset)}
    rows = []
    with threadpoolctl.threadpool_limits(1):
        for name in dataset.manifest.drawn:
            files = [shard.file for shard in dataset.manifest.shards if shard.family == name]
            mine = [row for file in files for row in estimates.labels(dataset.directory / file)]
            rows.append(measured(name, mine, [found[spec.id] for spec, _ in mine]))
    report = {"version": sys.argv[1], "rows": rows}
    data.write_text(json.dumps(report, indent=1) + "\n")
    write_marked(page, errors=f"\n{table(report)}\n")
    print(f"{data} and {page} written")


if __name__ == "__main__":
    main()
