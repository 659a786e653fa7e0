"""How far labels are from the smooth surface's spectrum, by pinned error estimates.

The quantiles are those of the pinned estimates of all shapes; the effectivity (estimate over
true error) is over at most ``SAMPLE`` of a family, evenly spaced, which are estimated anew and
must agree with the pins. Where the limit is not known, the estimate after another refinement
stands for the true error. Needs a built version.
"""

from __future__ import annotations

import numpy as np
import threadpoolctl

from evidence import markdown
from evidence.timing import progress
from synthnet import spectrum, store
from synthnet.build import estimates
from synthnet.build.discretisation import Estimate, estimate, extrapolate
from synthnet.families import FAMILIES
from synthnet.store import pins
from synthnet.types import ShapeSpec

SAMPLE = {"known": 100, "finer": 20}
QUANTILES = (5, 50, 95)
AGREEMENT = 1e-5  # of the label: pins are of single precision, and made on another machine


def measure(*, version: str) -> dict:
    """Return a row a family.

    Raises
    ------
    ValueError
        If the version has no pinned estimates, or they are not those made here.
    """
    dataset = store.open_dataset(version)
    errors = pins.read_errors(version)
    if errors is None:
        raise ValueError(
            f"no estimates of {version} are pinned: python -m evidence pin errors {version}"
        )
    rows = []
    with threadpoolctl.threadpool_limits(1):
        for name in dataset.manifest.drawn:
            files = [shard.file for shard in dataset.manifest.shards if shard.family == name]
            shapes = [row for file in files for row in estimates.labels(dataset.directory / file)]
            rows.append(family(name, shapes, [errors[spec.id] for spec, _ in shapes]))
    return {"version": version, "rows": rows}


def family(
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
        for i in progress(chosen, name):
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
    anew = estimate(spec, label)
    if np.max(np.abs(anew.error / label - pinned)) > AGREEMENT:
        raise ValueError(f"{spec.id}: the estimate is not the pinned one: {anew.error / label}")
    return anew


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


def table(data: dict) -> str:
    """Return a row a family."""
    cells = [
        [
            FAMILIES[row["family"]].title,
            f"{row['shapes']:,}",
            *(f"{value:.2f} %" for value in (*row["first"], *row["last"])),
            *compared(row),
        ]
        for row in data["rows"]
    ]
    headers = ["family", "shapes", "λ1 median", "λ1 95 %", "λ10 median", "λ10 95 %"]
    headers += ["refined", "limit", "compared", "estimate / true, median (5 to 95 %)"]
    text = markdown.table(headers, cells, "l")
    return f"Estimated error as a share of the label, synthNet {data['version']}:\n\n{text}"
