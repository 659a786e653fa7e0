"""Surfaces of 2.0, each coloured by an eigenfunction: the row of the README, and a poster.

No build is needed.
"""

from __future__ import annotations

from evidence import DATA, DOCS, numbers
from evidence.card_pictures import SMOOTH, in_few_colours
from evidence.timing import progress
from synthnet import recipe, spectrum
from synthnet.families import CHARTED
from synthnet.pictures import draw
from synthnet.pictures.raster import View
from synthnet.recipe.plan import plan_shards
from synthnet.store.files import make_directory, write_bytes
from synthnet.types import Mesh, Topology

README = {  # family: which eigenfunction after the constant, from where
    "pretzel": (5, View(50, -60)),
    "knotted_tube": (4, View(55, -60)),
    "bent_tube": (5, View(20, -60)),
    "blob": (6, View(20, -60)),
    "mobius_band": (5, View(40, -60)),
    "extruded_star": (6, View(40, -60)),
    "superquadric": (8, View(20, -40)),
}
POSTER = (5, None)  # of the families that the README does not have
LEAST, MOST = 4_000, 40_000  # vertices: fine enough to look smooth
# Small, so that captions can still be read on a page that is narrower than the picture.
ROW = draw.Layout(across=len(README), width=1.15, height=1.1)
SHEET = draw.Layout(across=5, width=1.5, height=1.25)


def draw_readme() -> None:
    """Draw a surface of some families in a row: docs/pictures/surfaces.png.

    Beside it docs/data/surfaces.json says which eigenvalues are shown, for the caption.
    """
    _draw("surfaces.png", list(README), ROW)
    rows = []
    for family, (number, _) in README.items():
        values = spectrum.compute(surface(family)[0], number).eigenvalues
        rows.append({"family": family, "number": number, "eigenvalue": values[number - 1]})
    numbers.write(DATA / "surfaces.json", {"rows": rows})


def draw_poster() -> None:
    """Draw a surface of every family, with its topology: docs/pictures/poster.png."""
    _draw("poster.png", list(recipe.load("2.0").families), SHEET)


def _draw(name: str, families: list[str], layout: draw.Layout) -> None:
    meshes, captions, colourings = [], [], []
    for family in progress(families, name):
        mesh, topology = surface(family)
        index, view = README.get(family, POSTER)
        meshes.append(mesh)
        captions.append([CHARTED[family].title, kind(topology)])
        colourings.append(draw.coloured_by(mesh, index, view))
    png = draw.picture_of_sheet(
        meshes, captions, layout=layout, colourings=colourings, transparent=True
    )
    target = DOCS / "pictures" / name
    make_directory(target.parent)
    write_bytes(target, in_few_colours(png, SMOOTH))


def surface(family: str) -> tuple[Mesh, Topology]:
    """Return the first surface of 2.0-mini of a family that has a size to be drawn."""
    for plan in plan_shards(recipe.load("2.0-mini")):
        for shape in plan.shapes if plan.family == family else ():
            parameters = shape.spec.parameters
            mesh = CHARTED[family].generate(parameters)
            if LEAST <= len(mesh.vertices) <= MOST:
                return mesh, CHARTED[family].topology(parameters)
    raise ValueError(f"{family} has no mesh of {LEAST} to {MOST} vertices in 2.0-mini")


def kind(topology: Topology) -> str:
    """Return the class of a surface in words.

    Examples
    --------
    >>> kind(Topology(2)), kind(Topology(-4)), kind(Topology(0, 2)), kind(Topology(0, 1, False))
    ('closed, genus 0', 'closed, genus 3', '2 boundaries', '1 boundary, one side')
    """
    if not topology.boundaries:
        return f"closed, genus {(2 - topology.euler_characteristic) // 2}"
    count = topology.boundaries
    side = "" if topology.orientable else ", one side"
    return f"{count} {'boundary' if count == 1 else 'boundaries'}{side}"
