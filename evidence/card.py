"""Write the measured parts of the dataset cards from built versions.

The seconds come from the report of that build, which is kept in docs/data:

    synthnet build --version 1.0 --json > docs/data/build-1.0.json
    python benchmarks/build_cost.py --json > docs/data/build-cost.json
    python benchmarks/build_full.py
    python benchmarks/loading.py 1.0 --json > docs/data/loading-1.0.json
    python scripts/card_tables.py 1.0

    synthnet build --version 2.0 --json > docs/data/build-2.0.json
    python scripts/card_tables.py 2.0
"""

import json
import sys
from pathlib import Path

import numpy as np
from tabulate import tabulate

from synthnet import recipe, spectrum, store
from synthnet.families import FAMILIES
from synthnet.recipe.drawing import draw_shapes
from synthnet.store.files import write_marked

ROOT = Path(__file__).parent.parent
CARDS = {
    "1.0": ROOT / "docs" / "dataset-card.md",
    "2.0": ROOT / "docs" / "dataset-card-2.0.md",
}
DATA = ROOT / "docs" / "data"
# A cone whose spectrum a further subdivision changes by less than 1 %.
SMOOTH = {"resolution": 60, "split": 20, "subdivisions": 2}


def composition(report: dict) -> str:
    """Return the table of families of a build report."""
    pictures = f"pictures/{report['version']}"
    rows = [
        [
            f"![{FAMILIES[row['family']].title}]({pictures}/{row['family']}.png)",
            FAMILIES[row["family"]].title,
            row["drawn"],
            ", ".join(f"{n} `{reason}`" for reason, n in row["rejected"].items()) or "0",
            row["kept"],
            row["vertices"],
            row["faces"],
            round(row["core_seconds"], 1),
        ]
        for row in report["families"]
    ]
    totals = [sum(row[i] for row in rows) for i in (2, 4, 5, 6, 7)]
    rejected = totals[0] - totals[1]
    rows.append(["", "All", totals[0], str(rejected), *totals[1:4], round(totals[4], 1)])
    if report["version"] == "1.0":
        rows.append(["", "*The paper, as reported*", 16550, "189", 16361, "", "", ""])
    headers = ["", "family", "drawn", "rejected", "kept", "vertices", "faces", "core-seconds"]
    table = tabulate(rows, headers, tablefmt="github", intfmt=",", floatfmt=",.1f")
    minutes = report["wall_seconds"] / 60
    size = report["bytes"] / 1e6
    return (
        f"{table}\n\nBuilt by `synthnet build --version {report['version']}` on 2 cores in "
        f"{minutes:.1f} minutes; {size:,.0f} MB."
    )


def split_cone_flaw(dataset: store.StoredDataset, count: int = 100) -> str:
    """Return how far the labels of split cones are above a fine cone's."""
    paths = [path for path in dataset.paths() if path.name.startswith("split_cone")]
    samples = [sample for path in paths for sample in store.read_samples(path)]
    excess = []
    for sample in samples[:: len(samples) // count][:count]:
        height = sample.spec.parameters["height"]
        fine = FAMILIES["cone"].generate({"radius": 1.0, "height": height, **SMOOTH})
        excess.append(sample.eigenvalues / spectrum.compute(fine).eigenvalues - 1)
    low, median, high = np.percentile(np.mean(excess, axis=1), [5, 50, 95])
    return (
        f"Over {count} of them the mean excess of the ten eigenvalues over those of a fine mesh "
        f"of the same cone is {100 * median:.0f} % in the median, and {100 * low:.0f} to "
        f"{100 * high:.0f} % from the 5th to the 95th percentile; tall cones are the worst."
    )


def inverted_cone_flaw() -> str:
    """Return how many inverted cones are not inverted, and how many touch their base."""
    shapes = [s for s in draw_shapes(recipe.load("1.0")) if s.family == "inverted_cone"]
    rings = [(2 * s.parameters["split"], s.parameters["flip"]) for s in shapes]
    ends = [np.floor(flip * count + 0.5) / count for count, flip in rings]
    return (
        f"Of {len(shapes):,}, {ends.count(1.0)} have t rounded to 1, so nothing is reflected and "
        f"they are plain cones; {ends.count(0.5)} have t rounded to 0.5, so the tip lies on the "
        "centre of the base. The two are different vertices, and the surface is a manifold."
    )


def measured(name: str) -> dict:
    """Return the output of a committed command."""
    return json.loads((DATA / f"{name}.json").read_text())


def cost(build: dict, full: dict, loading: dict) -> str:
    """Return what a built mesh and an epoch cost."""
    whole = build["rows"][-1]
    return (
        f"Building a mesh, with checks, label, copies and storage, takes {whole['ours ms']} "
        f"core-milliseconds; a plain loop over Open3D and `lapy.Solver(...).eigs(11)`, which "
        f"checks and stores nothing, {whole['plain ms']}: {whole['ratio']} of it, over "
        f"{whole['shapes']} random shapes, in one run, on one thread (`make bench`). The whole of "
        f"{full['version']} on {full['workers']} cores, one after the other: the loop "
        f"{full['plain seconds']:.0f} s, the build {full['build seconds']:.0f} s, "
        f"{full['ratio']} of it (`python benchmarks/build_full.py`). The train split opens in "
        f"{loading['open_seconds']} s; an epoch of a `DataLoader` over its "
        f"{loading['instances']:,} instances, without a model, takes {loading['epoch_seconds']} s "
        f"and at most {loading['peak_resident_mb']} MB of resident memory "
        "(`python benchmarks/loading.py`)."
    )


def main() -> None:
    """Rewrite the marked parts of a card."""
    version = sys.argv[1]
    parts = {"composition": f"\n{composition(measured(f'build-{version}'))}\n"}
    if version == "1.0":
        parts |= {
            "cost": f"\n{cost(*map(measured, ('build-cost', 'build-full', 'loading-1.0')))}\n",
            "inverted_cones": inverted_cone_flaw(),
            "split_cones": split_cone_flaw(store.open_dataset("1.0")),
        }
    write_marked(CARDS[version], **parts)
    print(f"{CARDS[version]} written")


if __name__ == "__main__":
    main()
