"""Write the pictures of a dataset card, and the facts of its shapes beside them.

    synthnet build --version 1.0
    python scripts/card_pictures.py 1.0

A thumbnail of each family; what each of its parameters does, at the 5th, 50th and 95th percentile
of its distribution, the others at their median; the distributions of sizes, areas and
eigenvalues by family. They are measured on the built version and kept in docs/data.
`python scripts/card_pictures.py 1.0 --draw` draws from what is kept there.
"""

import io
import json
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

import numpy as np
from eigbench.board.figures import as_svg, style
from matplotlib.figure import Figure
from PIL import Image
from rich.progress import track
from tabulate import tabulate

from synthnet import recipe, store
from synthnet.build.versions import make_sample
from synthnet.families import FAMILIES
from synthnet.mesh.geometry import area
from synthnet.pictures import draw, gallery
from synthnet.pictures.raster import render
from synthnet.recipe.distributions import DISTRIBUTIONS
from synthnet.recipe.plan import plan_shards
from synthnet.store.files import write_bytes, write_marked, write_text
from synthnet.types import SPLITS, Mesh, Sample

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
CARDS = {"1.0": DOCS / "dataset-card.md", "2.0": DOCS / "dataset-card-2.0.md"}
THUMBNAIL = (160, 120)  # pixels
COLOURS = 48  # of a picture's palette: a quarter of the bytes, and no difference to see
QUANTILES = {"low": 0.05, "middle": 0.5, "high": 0.95}
STRIP = draw.Layout(across=3, width=1.5, height=1.1)
PLAIN = {"triangulation": "uniform", "vertices": 3000, "seed": 0}  # 2.0, to see the surface
KINDS, SIZES = ("uniform", "adaptive", "irregular"), (600, 2400, 9600)
SHOWN = {"genus": 3, "hole": 0.6, "thickness": 0.5, "stretch": 0.9, "bend": 0.4}  # a pretzel
EXAMPLE = "bent_tube-00004"  # of 2.0, a medium mesh
BINS = 40  # of a histogram, equal in the logarithm
MEASURES = {
    "vertices": "vertices",
    "area": "area (length²)",
    "first": "λ₁ (1/length²)",
    "last": "λ₁₀ (1/length²)",
}
PERCENTILES = (0, 5, 50, 95, 100)


def measured(version: str) -> dict:
    """Return the facts of a built version: splits, rejections, percentiles and histograms."""
    dataset = store.open_dataset(version)
    values: dict[str, dict[str, list[float]]] = {}
    splits: dict[str, Counter] = {}
    for shard in track(dataset.manifest.shards, version):
        mine = values.setdefault(shard.family, {name: [] for name in MEASURES})
        for sample in store.read_samples(dataset.directory / shard.file):
            mine["vertices"].append(len(sample.mesh.vertices))
            mine["area"].append(area(sample.mesh))
            mine["first"].append(float(sample.eigenvalues[0]))
            mine["last"].append(float(sample.eigenvalues[-1]))
            splits.setdefault(shard.family, Counter())[sample.split] += 1
    bins = {
        name: np.geomspace(
            min(min(mine[name]) for mine in values.values()) * 0.999,
            max(max(mine[name]) for mine in values.values()) * 1.001,
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
                "family": family,
                "splits": {split: splits[family][split] for split in SPLITS},
                "percentiles": {
                    name: [float(f"{value:.4g}") for value in np.percentile(found, PERCENTILES)]
                    for name, found in mine.items()
                },
                "counts": {
                    name: np.histogram(found, bins[name])[0].tolist()
                    for name, found in mine.items()
                },
            }
            for family, mine in values.items()
        ],
    }


def in_few_colours(png: bytes) -> bytes:
    """Return a PNG with a palette."""
    picture = Image.open(io.BytesIO(png)).convert("RGB")
    few = picture.quantize(COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
    written = io.BytesIO()
    few.save(written, format="PNG", optimize=True)
    return written.getvalue()


def thumbnails(version: str, place: Path) -> None:
    """Draw the shape in the middle of each family's parameters."""
    for one in track(gallery.candidates(version), "thumbnails"):
        ((_, mesh),) = gallery.chosen(version, one, 1)
        png = io.BytesIO()
        Image.fromarray(render(mesh, *THUMBNAIL, edges=True)).save(png, format="PNG")
        write_bytes(place / f"{one.family}.png", in_few_colours(png.getvalue()))


def quantile(distribution: object, u: float) -> float | int:
    """Return the value of a parameter below which a share of its draws is."""
    if not isinstance(distribution, dict):
        return distribution
    ((kind, arguments),) = distribution.items()
    return DISTRIBUTIONS[kind](u, *arguments)


def parameters(version: str, place: Path) -> None:
    """Draw what each parameter of each family does, a row a parameter."""
    wanted = recipe.load(version)
    fixed = PLAIN if wanted.sizes is not None else {}
    for name, family in track(wanted.families.items(), "parameters"):
        middle = {key: quantile(one, 0.5) for key, one in family.parameters.items()}
        meshes: list[Mesh | None] = []
        captions: list[list[str]] = []
        for key, one in family.parameters.items():
            if not isinstance(one, dict):
                continue
            values = sorted({quantile(one, u) for u in QUANTILES.values()})
            for value in values:
                meshes.append(FAMILIES[name].generate({**middle, key: value, **fixed}))
                told = f"{value:,}" if isinstance(value, int) else f"{value:.3g}"
                captions.append([f"{key} {told}"])
            gaps = len(QUANTILES) - len(values)
            meshes += gaps * [None]
            captions += gaps * [[""]]
        edges = wanted.sizes is None
        png = draw.picture_of_sheet(meshes, captions, edges=edges, layout=STRIP)
        write_bytes(place / f"{name}-parameters.png", in_few_colours(png))


def triangulations(place: Path) -> None:
    """Draw a pretzel of 2.0 in each kind of triangulation and in three sizes."""
    made = [
        (kind, size, FAMILIES["pretzel"].generate({**SHOWN, **PLAIN, **asked}))
        for kind in KINDS
        for size in SIZES
        for asked in ({"triangulation": kind, "vertices": size},)
    ]
    captions = [[f"{kind}, {len(mesh.vertices):,} vertices"] for kind, _, mesh in made]
    meshes = [mesh for _, _, mesh in made]
    layout = draw.Layout(across=3, width=2.4, height=1.7)
    png = draw.picture_of_sheet(meshes, captions, edges=True, layout=layout)
    write_bytes(place / "triangulations.png", in_few_colours(png))


def examples(place: Path) -> None:
    """Draw what `synthnet show` and `synthnet gallery` draw of 2.0, for the page on pictures."""
    wanted = recipe.load("2.0")
    (family,) = gallery.candidates("2.0", "knotted_tube")
    shape = next(s for plan in plan_shards(wanted) for s in plan.shapes if s.spec.id == EXAMPLE)
    sample = make_sample(shape, wanted)
    assert isinstance(sample, Sample), sample
    show = draw.picture_of_sample(sample, eigenfunctions=5)
    write_bytes(place / "show.png", show)
    shapes = sorted(gallery.chosen("2.0", family, 10), key=lambda one: one[0].id)
    title = f"synthNet 2.0, knotted_tube: 10 of {family.total}"
    sheet = gallery.sheet(shapes, family.varying, title)
    write_bytes(place / "gallery.png", in_few_colours(sheet))


def distributions(facts: dict) -> str:
    """Return an SVG: for each family and measure a histogram, on common logarithmic axes."""
    families = facts["families"]
    high = 0.3 * len(families) + 0.9
    with style():
        figure = Figure(figsize=(9, high))
        panels = figure.subplots(1, len(MEASURES), sharey=True)
        figure.subplots_adjust(0.19, 0.5 / high, 0.99, 1 - 0.1 / high, wspace=0.08)
        for axes, (name, title) in zip(panels, MEASURES.items(), strict=True):
            edges = np.array(facts["bins"][name])
            for row, family in enumerate(families):
                counts = np.array(family["counts"][name])
                heights = 0.85 * counts / counts.max()
                axes.stairs(row - heights, edges, baseline=row, fill=True, color="#0072B2")
                axes.axhline(row, color="0.75", lw=0.4)
            axes.set_xscale("log")
            axes.set_xlabel(title)
            axes.grid(axis="x", alpha=0.3, lw=0.5)
            axes.spines["left"].set_visible(False)
            axes.tick_params(axis="y", length=0)
        panels[0].set_ylim(len(families) - 0.7, -1.1)
        panels[0].set_yticks(range(len(families)), [FAMILIES[f["family"]].title for f in families])
        return as_svg(figure)


def picture(version: str, file: str, alt: str) -> str:
    """Return a picture in Markdown, for a page of docs."""
    return f"![{alt}](pictures/{version}/{file})"


def parameter_table(version: str) -> str:
    """Return the table of what each parameter does."""
    rows = []
    for name, family in recipe.load(version).families.items():
        varied = [key for key, one in family.parameters.items() if isinstance(one, dict)]
        alt = f"{FAMILIES[name].title}: low, middle and high {', '.join(varied)}"
        rows.append([FAMILIES[name].title, picture(version, f"{name}-parameters.png", alt)])
    headers = ["family", "each parameter low, middle and high, the others in the middle"]
    return tabulate(rows, headers, tablefmt="github", disable_numparse=True)


def split_table(facts: dict) -> str:
    """Return the numbers of meshes by family and split."""
    rows = [
        [FAMILIES[f["family"]].title, *(f"{f['splits'][s]:,}" for s in SPLITS)]
        for f in facts["families"]
    ]
    totals = [sum(f["splits"][s] for f in facts["families"]) for s in SPLITS]
    rows.append(["All", *(f"{total:,}" for total in totals)])
    return tabulate(rows, ["family", *SPLITS], tablefmt="github", disable_numparse=True)


def number(value: float) -> str:
    """Return three digits, and thousands with commas.

    Examples
    --------
    >>> number(0.0123456), number(12345.6), number(386.0)
    ('0.0123', '12,346', '386')
    """
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


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
    table = tabulate(rows, headers, tablefmt="github", disable_numparse=True)
    return f"Median, and least to largest:\n\n{table}"


def filter_counts(facts: dict) -> str:
    """Return what the filters refused."""
    found = facts["rejections"]
    kept = sum(sum(family["splits"].values()) for family in facts["families"])
    told = "; ".join(f"`{r['reason']}` {r['id']} ({r['detail']})" for r in found)
    refused = f"{len(found)} rejected: {told}. No other check refused a shape." if found else ""
    return f"Of {kept + len(found):,} shapes drawn, {refused or 'no check refused one.'}"


def main() -> None:
    """Measure, unless only drawing is wanted; draw; rewrite the marked parts of the card."""
    version = sys.argv[1]
    data = DOCS / "data" / f"shapes-{version}.json"
    if "--draw" not in sys.argv:
        write_text(data, json.dumps(measured(version)) + "\n")
    facts = json.loads(data.read_text())
    place = DOCS / "pictures" / version
    place.mkdir(parents=True, exist_ok=True)
    thumbnails(version, place)
    parameters(version, place)
    if recipe.load(version).sizes is not None:
        triangulations(place)
    if version == "2.0":
        examples(place)
    write_text(place / "distributions.svg", distributions(facts))
    write_marked(
        CARDS[version],
        parameters=f"\n{parameter_table(version)}\n",
        sizes=f"\n{size_table(facts)}\n",
        splits=f"\n{split_table(facts)}\n",
        rejections=f"\n{filter_counts(facts)}\n",
    )
    print(f"{place}, {data} and {CARDS[version]} written")


if __name__ == "__main__":
    main()
