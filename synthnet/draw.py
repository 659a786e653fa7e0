"""Pictures of a mesh and its spectrum, drawn off-screen."""

from __future__ import annotations

from pathlib import Path

import matplotlib.figure
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LightSource
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from synthnet.files import write_atomically
from synthnet.geometry import MeshFacts
from synthnet.types import Mesh, Sample

BLUE, GREY = "#0072b2", "#666666"  # Okabe and Ito: told apart by colour-blind readers
VIEW = {"elev": 22.0, "azim": -60.0}
EDGES_UP_TO = 4000  # faces; beyond it the edges hide the surface


def draw_sample(sample: Sample, path: Path) -> None:
    """Draw a shape beside its ten eigenvalues and write a PNG.

    Raises
    ------
    ValueError
        If the path does not end in ``.png``.
    BuildError
        If the file cannot be written.
    """
    if path.suffix.lower() != ".png":
        raise ValueError(f"the picture's name must end in .png, got {path}")
    figure = matplotlib.figure.Figure(figsize=(9, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(1, 2, width_ratios=[1.1, 1])
    space = figure.add_subplot(grid[0], projection="3d")
    _draw_mesh(space, sample.mesh)
    space.set_title(f"{sample.spec.id}\n{len(sample.mesh.faces):,} triangles", fontsize=10)

    plane = figure.add_subplot(grid[1])
    numbers = np.arange(1, len(sample.eigenvalues) + 1)
    plane.bar(numbers, sample.eigenvalues, color=BLUE, width=0.6)
    plane.set_xticks(numbers)
    plane.set_xlabel("index")
    plane.set_ylabel("eigenvalue (1/length²)")
    plane.set_title("Laplace-Beltrami eigenvalues after zero", fontsize=10)
    plane.spines[["top", "right"]].set_visible(False)
    write_atomically(path, lambda partial: figure.savefig(partial, dpi=150, format="png"))


def _draw_mesh(axes: object, mesh: Mesh) -> None:
    vertices = mesh.vertices.astype(np.float64)
    faces = _facing(mesh) if MeshFacts(mesh).is_closed else mesh.faces  # else both sides are seen
    shades = LightSource(azdeg=200, altdeg=35)
    surface = Poly3DCollection(
        vertices[faces],
        facecolors="#9ecae9",
        edgecolors=(0, 0, 0, 0.35),
        linewidths=0.25 if len(mesh.faces) <= EDGES_UP_TO else 0,
        shade=True,
        lightsource=shades,
    )
    surface.set_clip_on(False)  # a long shape may reach past its half of the picture
    axes.add_collection3d(surface)  # type: ignore[attr-defined]
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    extent = np.maximum(high - low, 0.02 * (high - low).max())
    middle = (low + high) / 2
    for axis, m, e in zip("xyz", middle, extent, strict=True):
        getattr(axes, f"set_{axis}lim")(m - e / 2, m + e / 2)
    axes.set_box_aspect(extent, zoom=0.95)  # type: ignore[attr-defined]
    axes.view_init(**VIEW)  # type: ignore[attr-defined]
    axes.set_axis_off()  # type: ignore[attr-defined]


def _facing(mesh: Mesh) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return the faces turned to the viewer: half the work, and nothing shines through."""
    elevation, azimuth = np.radians(VIEW["elev"]), np.radians(VIEW["azim"])
    eye = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    corners = mesh.vertices.astype(np.float64)[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.asarray(mesh.faces[normals @ eye > 0], dtype=np.int64)
