"""Facts of a version's shapes: splits, rejections, and distributions of sizes and eigenvalues.

Of the families that no version before has. Needs a built version.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pandas as pd

from evidence import markdown
from evidence.timing import progress
from synthnet import recipe, store
from synthnet.families import FAMILIES
from synthnet.mesh.geometry import area
from synthnet.recipe import splits
from synthnet.types import SPLITS

BINS = 40  # a histogram has so many, equal in the logarithm
MEASURES = {
    "vertices": "vertices",
    "area": "area (length²)",
    "first": "λ₁ (1/length²)",
    "last": "λ₁₀ (1/length²)",
}
PERCENTILES = (0, 5, 50, 95, 100)


def new_families(version: str) -> list[str]:
    """Return the families of a version that none before it has, in its order."""
    before = {
        name
        for other in recipe.available()
        if recipe.load(other).base == other < version
        for name in recipe.load(other).families
    }
    return [name for name in recipe.load(version).families if name not in before]


def measure(*, version: str) -> dict:
    """Return splits, rejections, percentiles and histograms by family."""
    dataset = store.open_dataset(version)
    new = new_families(version)
    rows = [
        [s.spec.family, s.split, len(s.mesh.vertices), area(s.mesh), *s.eigenvalues[[0, -1]]]
        for s in progress(dataset.samples(), version, dataset.manifest.rows)
        if s.spec.family in new
    ]
    shapes = pd.DataFrame(rows, columns=["family", "split", *MEASURES])
    bins = {
        name: np.geomspace(shapes[name].min() * 0.999, shapes[name].max() * 1.001, BINS + 1)
        for name in MEASURES
    }
    return {
        "version": version,
        "recipe_digest": dataset.manifest.recipe_digest,
        "rejections": [asdict(rejection) for rejection in dataset.manifest.rejections],
        "bins": {name: [float(f"{edge:.4g}") for edge in edges] for name, edges in bins.items()},
        "families": [
            family_facts(name, mine, bins) for name, mine in shapes.groupby("family", sort=False)
        ],
    }


def family_facts(name: str, shapes: pd.DataFrame, bins: dict[str, np.ndarray]) -> dict:
    """Return splits, percentiles and histograms of a family."""
    percentiles = {key: np.percentile(shapes[key], PERCENTILES) for key in MEASURES}
    return {
        "family": name,
        "splits": {split: int((shapes["split"] == split).sum()) for split in SPLITS},
        "percentiles": {k: [float(f"{v:.4g}") for v in some] for k, some in percentiles.items()},
        "counts": {key: np.histogram(shapes[key], bins[key])[0].tolist() for key in MEASURES},
    }


def parameter_table(facts: dict) -> str:
    """Return the table of what each parameter does."""
    version, rows = facts["version"], []
    for name in new_families(version):
        family = recipe.load(version).families[name]
        varied = [key for key, value in family.parameters.items() if isinstance(value, dict)]
        alt = f"{FAMILIES[name].title}: low, middle and high {', '.join(varied)}"
        picture = f"![{alt}](pictures/{version}/{name}-parameters.png)"
        rows.append([FAMILIES[name].title, picture])
    headers = ["family", "each parameter low, middle and high, the others in the middle"]
    return markdown.table(headers, rows, "l")


def split_table(facts: dict) -> str:
    """Return the numbers of meshes by family and split."""
    rows = [
        [FAMILIES[f["family"]].title, *(f"{f['splits'][s]:,}" for s in SPLITS)]
        for f in facts["families"]
    ]
    totals = [sum(f["splits"][s] for f in facts["families"]) for s in SPLITS]
    rows.append(["All", *(f"{total:,}" for total in totals)])
    return markdown.table(["family", *SPLITS], rows, "l")


def family_trainings(facts: dict) -> str:
    """Return how many meshes the trainings of the protocol `family` have, the fewest and the most.

    With a family, those that share surfaces with it are left out of training.
    """
    version = recipe.load(facts["version"])
    counts = [
        sum(
            family["splits"]["train"]
            for family in facts["families"]
            if splits.uses(fold, version, "train", family["family"], 0)
        )
        for fold in splits.folds(version, "family")
    ]
    return f"{min(counts):,} to {max(counts):,}"


def size_table(facts: dict) -> str:
    """Return medians and ranges by family."""
    rows = []
    for family in facts["families"]:
        cells = []
        for name in MEASURES:
            low, _, middle, _, high = map(number, family["percentiles"][name])
            cells.append(f"{middle} ({low} to {high})")
        rows.append([FAMILIES[family["family"]].title, *cells])
    headers = ["family", *MEASURES.values()]
    return f"Median, and least to largest:\n\n{markdown.table(headers, rows, 'l')}"


def number(value: float) -> str:
    """Return three digits, and thousands with commas.

    Examples
    --------
    >>> number(0.0123456), number(12345.6), number(386.0)
    ('0.0123', '12,346', '386')
    """
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def rejections(facts: dict) -> str:
    """Return what the filters refused."""
    refused = facts["rejections"]
    kept = sum(sum(family["splits"].values()) for family in facts["families"])
    drawn = f"Of {kept + len(refused):,} shapes drawn"
    if not refused:
        return f"{drawn}, no check refused one."
    reasons = "; ".join(f"`{r['reason']}` {r['id']} ({r['detail']})" for r in refused)
    return f"{drawn}, {len(refused)} rejected: {reasons}. No other check refused a shape."
