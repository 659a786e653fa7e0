"""docs/pictures/surfaces.png, the picture of the README: surfaces of 2.0; no build is needed.

Beside it docs/data/surfaces.json says which eigenfunctions are shown, for the caption.
"""

from __future__ import annotations

import numpy as np
from PIL import Image

from evidence import DATA, DOCS, numbers
from synthnet import recipe, spectrum
from synthnet.families import CHARTED
from synthnet.pictures.draw import signed
from synthnet.pictures.raster import View, render
from synthnet.recipe.plan import plan_shards
from synthnet.store.files import make_directory, write_atomically
from synthnet.types import Mesh

SHOWN = {  # family: which eigenfunction, 1 being the first after the constant; from where
    "pretzel": (5, View(50, -60)),
    "knotted_tube": (4, View(55, -60)),
    "bent_tube": (5, View(20, -60)),
    "blob": (6, View(20, -60)),
    "mobius_band": (5, View(40, -60)),
    "extruded_star": (6, View(40, -60)),
    "superquadric": (8, View(20, -40)),
}
LEAST, MOST = 4_000, 40_000  # vertices: fine enough to look smooth
SIDE = 240  # pixels
COLOURS_KEPT = 256  # for few bytes


def draw_readme() -> None:
    """Draw a surface of each family in a row, and write which eigenvalues are shown."""
    pixels, rows = [], []
    for family, (number, view) in SHOWN.items():
        mesh = surface(family)
        found = spectrum.compute(mesh, number + 1)
        pixels.append(
            render(mesh, SIDE, SIDE, view=view, values=signed(found.eigenvectors)[:, number - 1])
        )
        rows.append(
            {"family": family, "number": number, "eigenvalue": found.eigenvalues[number - 1]}
        )
    small = Image.fromarray(np.hstack(pixels)).quantize(COLOURS_KEPT)
    target = DOCS / "pictures" / "surfaces.png"
    make_directory(target.parent)
    write_atomically(target, lambda partial: small.save(partial, format="png", optimize=True))
    numbers.write(DATA / "surfaces.json", {"rows": rows})


def surface(family: str) -> Mesh:
    """Return the first surface of 2.0-mini of a family that has a size to be drawn."""
    for plan in plan_shards(recipe.load("2.0-mini")):
        for shape in plan.shapes if plan.family == family else ():
            mesh = CHARTED[family].generate(shape.spec.parameters)
            if LEAST <= len(mesh.vertices) <= MOST:
                return mesh
    raise ValueError(f"{family} has no mesh of {LEAST} to {MOST} vertices in 2.0-mini")
