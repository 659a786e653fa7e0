"""Draw docs/pictures/surfaces.png, the picture of the README: surfaces of 2.0, no build needed.

Usage: python scripts/readme_picture.py
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import matplotlib.figure
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LightSource
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from synthnet import recipe, spectrum
from synthnet.families import CHARTED
from synthnet.files import write_atomically
from synthnet.plan import plan_shards
from synthnet.types import Mesh

OUT = Path(__file__).parent.parent / "docs" / "pictures" / "surfaces.png"
SHOWN = {  # family: which eigenfunction, from where
    "pretzel": (4, 50, -60),
    "knotted_tube": (3, 55, -60),
    "bent_tube": (4, 40, -60),
    "blob": (5, 20, -60),
    "twisted_torus": (6, 45, -60),
    "dented_cone": (4, 25, -60),
    "superquadric": (7, 20, -40),
}
LEAST, MOST = 4_000, 20_000  # vertices: fine enough to look smooth, few enough to draw
SIDE, DPI = 1.5, 320  # inches, and dots an inch before the picture is halved
COLOURS_KEPT = 256
COLOURS = "RdBu_r"  # diverging, told apart by colour-blind readers


def main() -> None:
    """Draw one surface of each family in a row."""
    figure = matplotlib.figure.Figure(figsize=(SIDE * len(SHOWN), SIDE), dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    for place, (family, (number, elevation, azimuth)) in enumerate(SHOWN.items()):
        box = (place / len(SHOWN), 0, 1 / len(SHOWN), 1)
        axes = figure.add_axes(box, projection="3d")
        draw(axes, surface(family), number, (elevation, azimuth))
    canvas.draw()
    drawn = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    # Drawn at twice the size, so that no seam of two triangles is left; few colours, for few bytes.
    small = drawn.reduce(2).quantize(COLOURS_KEPT)
    OUT.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(OUT, lambda partial: small.save(partial, format="png", optimize=True))
    print(OUT)


def surface(family: str) -> Mesh:
    """Return the first surface of 2.0 of a family that is of a size to be drawn."""
    for plan in plan_shards(recipe.load("2.0-mini")):
        for shape in plan.shapes if plan.family == family else ():
            mesh = CHARTED[family].generate(shape.spec.parameters)
            if LEAST <= len(mesh.vertices) <= MOST:
                return mesh
    raise ValueError(f"{family} has no mesh of {LEAST} to {MOST} vertices in 2.0-mini")


def draw(axes: object, mesh: Mesh, number: int, view: tuple[float, float]) -> None:
    """Draw a mesh, coloured by an eigenfunction and shaded."""
    vertices = mesh.vertices.astype(np.float64)
    values = spectrum.compute(mesh).eigenvectors[:, number]
    values *= np.sign(values[np.abs(values).argmax()])  # an eigenfunction's sign is nobody's
    corners = vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    light = LightSource(azdeg=view[1] + 30, altdeg=50).direction
    brightness = 0.55 + 0.45 * np.abs(normals @ light)
    level = values[mesh.faces].mean(axis=1) / np.abs(values).max()
    colours = mpl.colormaps[COLOURS](0.5 + 0.42 * level)
    colours[:, :3] *= brightness[:, None]
    drawn = Poly3DCollection(corners, facecolors=colours, edgecolors=colours, linewidths=0.2)
    drawn.set_clip_on(False)
    axes.add_collection3d(drawn)  # type: ignore[attr-defined]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    for axis, a, b in zip("xyz", low, high, strict=True):
        getattr(axes, f"set_{axis}lim")(a, b)
    axes.set_box_aspect(np.maximum(high - low, 0.05 * (high - low).max()), zoom=1.2)  # type: ignore[attr-defined]
    axes.view_init(*view)  # type: ignore[attr-defined]
    axes.set_axis_off()  # type: ignore[attr-defined]
    axes.patch.set_alpha(0)  # type: ignore[attr-defined]


if __name__ == "__main__":
    main()
