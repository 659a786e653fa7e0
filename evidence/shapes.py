"""Facts of a version's shapes: splits, rejections, and distributions of sizes and eigenvalues.

Needs a built version.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict

import numpy as np

from evidence import markdown
from evidence.timing import progress
from synthnet import recipe, store
from synthnet.families import FAMILIES
from synthnet.mesh.geometry import area
from synthnet.types import SPLITS

BINS = 40  # a histogram has so many, equal in the logarithm
MEASURES = {
    "vertices": "vertices",
    "area": "area (length²)",
    "first": "λ₁ (1/length²)",
    "last": "λ₁₀ (1/length²)",
}
PERCENTILES = (0, 5, 50, 95, 100)


def measure(*, version: str) -> dict:
    """Return splits, rejections, percentiles and histograms by family."""
    dataset = store.open_dataset(version)
    values: dict[str, dict[str, list[float]]] = {}
    splits: dict[str, Counter] = {}
    for shard in progress(dataset.manifest.shards, version):
        family = values.setdefault(shard.family, {name: [] for name in MEASURES})
        for sample in store.read_samples(dataset.directory / shard.file):
            family["vertices"].append(len(sample.mesh.vertices))
            family["area"].append(area(sample.mesh))
            family["first"].append(float(sample.eigenvalues[0]))
            family["last"].append(float(sample.eigenvalues[-1]))
            splits.setdefault(shard.family, Counter())[sample.split] += 1
    bins = {
        name: np.geomspace(
            min(min(family[name]) for family in values.values()) * 0.999,
            max(max(family[name]) for family in values.values()) * 1.001,
            BINS + 1,
        )
        for name in MEASURES
    }
    return {
        "version": version,
        "recipe_digest": dataset.manifest.recipe_digest,
        "rejections": [asdict(rejection) for rejection in dataset.manifest.rejections],
        "bins": {name: [float(f"{edge:.4g}") for edge in edges] for name, edges in bins.items()},
        "families": [
            {
                "family": name,
                "splits": {split: splits[name][split] for split in SPLITS},
                "percentiles": {
                    key: [
                        float(f"{value:.4g}") for value in np.percentile(family[key], PERCENTILES)
                    ]
                    for key in MEASURES
                },
                "counts": {
                    key: np.histogram(family[key], bins[key])[0].tolist() for key in MEASURES
                },
            }
            for name, family in values.items()
        ],
    }


def parameter_table(facts: dict) -> str:
    """Return the table of what each parameter does."""
    version, rows = facts["version"], []
    for name, family in recipe.load(version).families.items():
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
