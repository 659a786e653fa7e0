"""The pictures of the dataset cards.

A thumbnail of each family; what each of its parameters does, at the 5th, 50th and 95th percentile
of its distribution, the others at their median; the distributions of sizes, areas and
eigenvalues by family, from the facts that were measured on the built version.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from eigbench.board.figures import as_svg, style
from matplotlib.figure import Figure
from PIL import Image

from evidence import DOCS
from evidence.shapes import MEASURES, new_families
from evidence.timing import progress
from synthnet import recipe
from synthnet.build.label import make_sample
from synthnet.families import FAMILIES
from synthnet.pictures import draw, gallery
from synthnet.pictures.palette import BLUE
from synthnet.pictures.raster import render
from synthnet.recipe.distributions import quantile
from synthnet.recipe.plan import plan_shards
from synthnet.store.files import write_bytes, write_text
from synthnet.types import Mesh, Sample

THUMBNAIL = (160, 120)  # pixels
SOLID, SOFT = 40, 24  # colours of a picture's palette: few bytes, and no difference to see
SMOOTH = 200  # as many a picture with eigenfunctions has
QUANTILES = {"low": 0.05, "middle": 0.5, "high": 0.95}
STRIP = draw.Layout(across=3, width=1.5, height=1.1)
PLAIN = {"triangulation": "uniform", "vertices": 3000, "seed": 0}  # 2.0, to see the surface
KINDS, SIZES = ("uniform", "adaptive", "irregular"), (600, 2400, 9600)
SHOWN = {"genus": 3, "hole": 0.6, "thickness": 0.5, "stretch": 0.9, "bend": 0.4}  # a pretzel
EXAMPLE = "bent_tube-00004"  # it is a medium mesh of 2.0


def draw_card(facts: dict) -> None:
    """Draw the pictures of a version into docs/pictures."""
    version = facts["version"]
    directory = DOCS / "pictures" / version
    directory.mkdir(parents=True, exist_ok=True)
    thumbnails(version, directory)
    parameters(version, directory)
    if version == "2.0":
        triangulations(directory)
        examples(directory)
    write_text(directory / "distributions.svg", distributions(facts))


def thumbnails(version: str, directory: Path) -> None:
    """Draw the shape in the middle of each family's parameters."""
    new = new_families(version)
    shown = [family for family in gallery.candidates(version) if family.family in new]
    for family in progress(shown, "thumbnails"):
        ((_, mesh),) = gallery.chosen(version, family, 1)
        png = io.BytesIO()
        pixels = render(mesh, *THUMBNAIL, edges=True, transparent=True)
        Image.fromarray(pixels).save(png, format="PNG")
        write_bytes(directory / f"{family.family}.png", in_few_colours(png.getvalue()))


def parameters(version: str, directory: Path) -> None:
    """Draw what each parameter of each family does, one row per parameter."""
    drawn = recipe.load(version)
    fixed = PLAIN if drawn.sizes is not None else {}
    for name in progress(new_families(version), "parameters"):
        family = drawn.families[name]
        middle = {key: quantile(value, 0.5) for key, value in family.parameters.items()}
        meshes: list[Mesh | None] = []
        captions: list[list[str]] = []
        for key, distribution in family.parameters.items():
            if not isinstance(distribution, dict):
                continue
            values = sorted({quantile(distribution, u) for u in QUANTILES.values()})
            for value in values:
                meshes.append(FAMILIES[name].generate({**middle, key: value, **fixed}))
                text = f"{value:,}" if isinstance(value, int) else f"{value:.3g}"
                captions.append([f"{key} {text}"])
            gaps = len(QUANTILES) - len(values)
            meshes += gaps * [None]
            captions += gaps * [[""]]
        edges = drawn.sizes is None
        png = draw.picture_of_sheet(meshes, captions, edges=edges, layout=STRIP, transparent=True)
        write_bytes(directory / f"{name}-parameters.png", in_few_colours(png))


def triangulations(directory: Path) -> None:
    """Draw a pretzel of 2.0 in each kind of triangulation and in three sizes."""
    pretzel = {**SHOWN, **PLAIN}
    meshes, captions = [], []
    for kind in KINDS:
        for size in SIZES:
            given = {**pretzel, "triangulation": kind, "vertices": size}
            meshes.append(FAMILIES["pretzel"].generate(given))
            captions.append([f"{kind}, {len(meshes[-1].vertices):,} vertices"])
    layout = draw.Layout(across=3, width=2.4, height=1.7)
    png = draw.picture_of_sheet(meshes, captions, edges=True, layout=layout, transparent=True)
    write_bytes(directory / "triangulations.png", in_few_colours(png))


def examples(directory: Path) -> None:
    """Draw what `synthnet show` and `synthnet gallery` draw of 2.0, for the page on pictures."""
    version = recipe.load("2.0")
    (family,) = gallery.candidates("2.0", "knotted_tube")
    shape = next(s for plan in plan_shards(version) for s in plan.shapes if s.spec.id == EXAMPLE)
    sample = make_sample(shape, version)
    assert isinstance(sample, Sample), sample
    shown = draw.picture_of_sample(sample, eigenfunctions=5, transparent=True)
    write_bytes(directory / "show.png", in_few_colours(shown, SMOOTH))
    shapes = sorted(gallery.chosen("2.0", family, 10), key=lambda chosen: chosen[0].id)
    title = f"synthNet 2.0, knotted_tube: 10 of {family.total}"
    sheet = gallery.sheet(shapes, family.varying, title, transparent=True)
    write_bytes(directory / "gallery.png", in_few_colours(sheet))


def in_few_colours(png: bytes, solid: int = SOLID) -> bytes:
    """Return a PNG with a palette: ``solid`` colours for what is opaque, :data:`SOFT` for edges."""
    pixels = np.array(Image.open(io.BytesIO(png)).convert("RGBA"))
    opaque = Image.fromarray(pixels[..., :3]).quantize(solid, dither=Image.Dither.NONE)
    edges = Image.fromarray(pixels).quantize(SOFT, dither=Image.Dither.NONE)
    colours, soft = (np.zeros((size, 4), dtype=np.uint8) for size in (solid, SOFT))
    for palette, image in ((colours, opaque), (soft, edges)):
        known = np.array(image.getpalette("RGBA"), dtype=np.uint8).reshape(-1, 4)
        palette[: len(known)] = known[: len(palette)]
    index = np.where(pixels[..., 3] == 255, np.array(opaque), solid + np.array(edges))
    few = Image.fromarray(index.astype(np.uint8), mode="P")
    table = np.concatenate([colours, soft])
    few.putpalette(table[:, :3].tobytes())
    written = io.BytesIO()
    few.save(written, format="PNG", optimize=True, transparency=table[:, 3].tobytes())
    return written.getvalue()


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
                axes.stairs(row - heights, edges, baseline=row, fill=True, color=BLUE)
                axes.axhline(row, color="0.75", lw=0.4)
            axes.set_xscale("log")
            axes.set_xlabel(title)
            axes.grid(axis="x", alpha=0.3, lw=0.5)
            axes.spines["left"].set_visible(False)
            axes.tick_params(axis="y", length=0)
        panels[0].set_ylim(len(families) - 0.7, -1.1)
        panels[0].set_yticks(range(len(families)), [FAMILIES[f["family"]].title for f in families])
        # A hundredth of a point is enough, and saves a quarter of the bytes.
        return re.sub(r"\d+\.\d{3,}", lambda digits: f"{float(digits[0]):.2f}", as_svg(figure))
