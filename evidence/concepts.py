"""The pictures of docs/concepts.md: Weyl's law, two isospectral drums, and the error of a mesh.

The surfaces of Weyl's law are scaled to the area 4π, so that the law is the line λₙ = n. The drums
are those of Gordon, Webb and Wolpert, held at the boundary, by quadratic elements; their two meshes
are irregular and not related. The errors are those of the unit sphere, whose eigenvalues are
l(l + 1), by linear elements with each of the three masses. They are of λ₅ and λ₁₀: those of λ₁
nearly vanish with lumped mass, where two errors of order h² cancel.

References
----------
T. A. Driscoll, "Eigenmodes of isospectral drums", SIAM Review 39 (1997): the drums' eigenvalues to
twelve digits, for triangles with two sides of length 2, as here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from evidence import DOCS
from evidence.figures import as_svg, figure_on_nothing
from synthnet import spectrum
from synthnet.families import FAMILIES, drum
from synthnet.mesh.geometry import area, corner_edges
from synthnet.pictures.palette import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION
from synthnet.spectrum import Operator
from synthnet.spectrum.operators import SHARES
from synthnet.store.files import write_text
from synthnet.types import Mesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COUNT = 100  # eigenvalues of each surface of Weyl's law


class Surface(NamedTuple):
    """A surface of Weyl's law: its family, its parameters and how it is drawn."""

    family: str
    parameters: dict[str, float]
    colour: str
    line: str


SURFACES = {
    "sphere": Surface("ellipsoid", {"a": 1, "b": 1, "c": 1}, BLUE, "-"),
    "torus": Surface(
        "twisted_torus", {"tube_radius": 0.5, "flatness": 1, "half_turns": 0}, GREEN, "--"
    ),
    "long cylinder with lids": Surface(
        "capped_cylinder", {"radius": 1, "height": 20}, PURPLE, "-."
    ),
    "disc": Surface("elliptic_disc", {"flatness": 1}, VERMILION, ":"),
}
NAMED = (1, 10, 100)  # indices that the caption names

# Driscoll (1997), table 1: both drums, held at the boundary.
PUBLISHED = np.array(
    [2.53794399980, 3.65550971352, 5.17555935622, 6.53755744376, 7.24807786256, 9.20929499840]
)
HELD = Operator(boundary="dirichlet", elements="quadratic")
SIZE = 2.0  # of the drums: two sides of each of the seven triangles
SHOWN = len(PUBLISHED)  # eigenvalues below each drum
COLOURED = 3  # the eigenfunction that colours it
DIGITS = 4  # of the drums' eigenvalues
BANDS = 15  # of colour

MASSES = {"consistent": (BLUE, "o"), "lumped": (VERMILION, "s"), "mean": (GREEN, "^")}
INDICES = (5, 10)  # a panel each
SPHERE = np.repeat([l * (l + 1.0) for l in (1, 2, 3)], [3, 5, 7])  # noqa: E741 - its name
SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")


def measure(*, weyl: int = 20_000, drums: int = 40_000, largest: int = 64_000) -> dict:
    """Return the eigenvalues of surfaces and drums, and the errors on spheres.

    Parameters
    ----------
    weyl, drums
        Vertices of each of their meshes, about.
    largest
        Vertices of the finest of five spheres, about; each coarser one has a quarter.
    """
    return {
        "weyl": [weyl_row(name, weyl) for name in SURFACES],
        "drums": [drum_row(form, drums) for form in (0, 1)],
        "errors": [row for quarters in range(5) for row in error_rows(largest // 4**quarters)],
    }


def made(family: str, parameters: dict, vertices: int, **how: object) -> Mesh:
    """Return a mesh of about so many vertices, uniform if ``how`` does not say otherwise."""
    plain = {"triangulation": "uniform", "vertices": vertices, "seed": 0}
    return FAMILIES[family].generate({**parameters, **plain, **how})


def weyl_row(name: str, vertices: int) -> dict:
    """Return the eigenvalues of a surface, at the area 4π."""
    surface = SURFACES[name]
    mesh = made(surface.family, surface.parameters, vertices)
    values = spectrum.compute(mesh, COUNT, operator=Operator(mass="mean")).eigenvalues
    scaled = values * area(mesh) / (4 * math.pi)
    return {"surface": name, "vertices": len(mesh.vertices), "eigenvalues": scaled.tolist()}


def drum_row(form: int, vertices: int) -> dict:
    """Return the eigenvalues of a drum that is held at its boundary."""
    shape = {"form": form, "size": SIZE, "lean": 0.0}
    mesh = made("drum", shape, vertices, triangulation="irregular", seed=form)
    values = spectrum.compute(mesh, SHOWN, operator=HELD).eigenvalues
    return {"form": form, "vertices": len(mesh.vertices), "eigenvalues": values.tolist()}


def error_rows(vertices: int) -> Iterator[dict]:
    """Yield the relative errors on a mesh of the unit sphere, one row for each mass."""
    mesh = made("ellipsoid", {"a": 1, "b": 1, "c": 1}, vertices)
    edge = float(np.linalg.norm(corner_edges(mesh), axis=-1).mean())
    for mass in SHARES:
        values = spectrum.compute(mesh, 10, operator=Operator(mass=mass)).eigenvalues
        errors = (values / SPHERE[:10] - 1).tolist()
        yield {"mass": mass, "vertices": len(mesh.vertices), "edge": edge, "errors": errors}


def problems(data: dict) -> list[str]:
    """Return what contradicts the captions."""
    wrong = [
        f"drum {row['form']}: λ{i} = {value:.6g}, published {known:.6g}"
        for row in data["drums"]
        for i, (value, known) in enumerate(zip(row["eigenvalues"], PUBLISHED, strict=True), 1)
        if rounded(value) != rounded(known)
    ]
    if len({tuple(map(rounded, row["eigenvalues"])) for row in data["drums"]}) > 1:
        wrong.append(f"the drums differ in the first {DIGITS} digits")
    wrong += [
        f"{mass} mass, λ{index}: order {order(data, mass, index):.2f}, not 2"
        for mass in MASSES
        for index in INDICES
        if abs(order(data, mass, index) - 2) > 0.1
    ]
    return wrong


def rounded(value: float) -> str:
    """Return an eigenvalue of a drum as the picture has it.

    Examples
    --------
    >>> rounded(2.53794)
    '2.538'
    """
    return f"{value:#.{DIGITS}g}"


def order(data: dict, mass: str, index: int) -> float:
    """Return the slope of an eigenvalue's error against the edge length, on the finest meshes."""
    edges, errors = _errors(data, mass, index)
    return float(np.log(errors[0] / errors[1]) / np.log(edges[0] / edges[1]))


def _errors(data: dict, mass: str, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return edge lengths and relative errors, the finest mesh first."""
    rows = [row for row in data["errors"] if row["mass"] == mass]
    return (
        np.array([row["edge"] for row in rows]),
        np.array([row["errors"][index - 1] for row in rows]),
    )


# --- the numbers of the captions ------------------------------------------------------------


def weyl_caption(data: dict) -> str:
    """Return each surface's eigenvalues over Weyl's law, at three indices."""
    parts = [
        f"{row['surface']}: " + ", ".join(f"{row['eigenvalues'][n - 1] / n:.2f}" for n in NAMED)
        for row in data["weyl"]
    ]
    *first, last = (str(n) for n in NAMED)
    return f"*λₙ divided by 4πn / area, at n = {', '.join(first)} and {last}: {'; '.join(parts)}.*"


def drums_caption(data: dict) -> str:
    """Return how far the computed spectra are from each other, and from the published one."""
    first, second = (np.array(row["eigenvalues"]) for row in data["drums"])
    apart = np.abs(first / second - 1).max()
    off = max(np.abs(values / PUBLISHED - 1).max() for values in (first, second))
    sizes = " and ".join(dict.fromkeys(f"{row['vertices']:,}" for row in data["drums"]))
    return (
        f"*Both meshes are irregular, cut independently of each other, and have {sizes} vertices. "
        f"The spectra differ by at most {_exponent(apart)} relative to each other, and by at most "
        f"{_exponent(off)} from the one that Driscoll (1997) computed to twelve digits.*"
    )


def _exponent(value: float) -> str:
    return f"{value:.0e}".replace("e-0", "e-")


def errors_caption(data: dict) -> str:
    """Return the errors of each mass on one mesh, and the fitted orders."""
    sizes = sorted({row["vertices"] for row in data["errors"]})
    size = sizes[len(sizes) // 2]
    rows = {row["mass"]: row["errors"] for row in data["errors"] if row["vertices"] == size}
    parts = [
        f"{mass} mass " + " and ".join(f"{_percent(rows[mass][i - 1])}" for i in INDICES)
        for mass in MASSES
    ]
    orders = sorted(order(data, mass, index) for mass in MASSES for index in INDICES)
    slopes = " to ".join(dict.fromkeys(f"{slope:.2f}" for slope in (orders[0], orders[-1])))
    names = " and ".join(f"λ{i}".translate(SUBSCRIPTS) for i in INDICES)
    return (
        f"*On the sphere of {size:,} vertices the errors of {names} are: {'; '.join(parts)}. "
        f"Between the two finest meshes every line has the slope {slopes}.*"
    )


def _percent(share: float) -> str:
    return f"{100 * share:+.2f} %".replace("-", "−")


# --- the pictures ---------------------------------------------------------------------------


def draw(data: dict) -> None:
    """Draw the three pictures into docs/pictures."""
    for name, picture in {"weyl": weyl, "drums": drums, "mesh-error": mesh_error}.items():
        write_text(DOCS / "pictures" / f"{name}.svg", picture(data))


def weyl(data: dict) -> str:
    """Return an SVG: eigenvalues against Weyl's law, the first 20 and the first 100."""
    with figure_on_nothing(3.6) as figure:
        panels = figure.subplots(1, 2)
        figure.subplots_adjust(0.065, 0.14, 0.99, 0.97, wspace=0.17)
        for axes, most in zip(panels, (20, COUNT), strict=True):
            index = np.arange(1, most + 1)
            axes.plot([0, most], [0, most], color=GREY, lw=1, label="Weyl's law, λₙ = 4πn / area")
            for row in data["weyl"]:
                surface = SURFACES[row["surface"]]
                axes.plot(
                    index, row["eigenvalues"][:most], surface.line, marker="o",
                    ms=3.2 if most == 20 else 0, lw=1.4, color=surface.colour,
                    label=row["surface"],
                )  # fmt: skip
            axes.set_xlabel("4πn / area, which is n")
            axes.set_xticks(np.linspace(0, most, 6))
            axes.set_xlim(0, 1.01 * most)
            axes.set_ylim(0, 1.2 * most)
            axes.grid(alpha=0.25)
        panels[0].set_ylabel("λₙ at area 4π")
        panels[0].legend(frameon=False, fontsize=7.5, loc="upper left")
        return as_svg(figure)


def drums(data: dict) -> str:
    """Return an SVG: both drums with an eigenfunction, and their eigenvalues below."""
    with figure_on_nothing(4.4) as figure:
        for row, left in zip(data["drums"], (0.02, 0.52), strict=True):
            axes = figure.add_axes((left, 0.17, 0.46, 0.81))
            draw_drum(axes, row["form"])
            texts = [
                f"λ{i}".translate(SUBSCRIPTS) + f" = {rounded(value)}"
                for i, value in enumerate(row["eigenvalues"], start=1)
            ]
            for line, y in ((texts[:3], 0.105), (texts[3:], 0.045)):
                for text, x in zip(line, (0.08, 0.23, 0.38), strict=True):
                    figure.text(left + x, y, text, ha="center", fontsize=10)
        return as_svg(figure)


def draw_drum(axes: Axes, form: int) -> None:
    """Colour a drum by an eigenfunction, and outline it and its seven triangles."""
    from synthnet.pictures.raster import diverging

    mesh = made("drum", {"form": form, "size": SIZE, "lean": 0.0}, 1400)
    values = spectrum.compute(mesh, COLOURED, operator=HELD).eigenvectors[:, -1]
    values = values / np.abs(values).max()
    inside = np.flatnonzero(values)  # the others take a sign from there: no zero line at the rim
    apart = mesh.vertices[:, None] - mesh.vertices[inside]
    values += 1e-6 * np.sign(values[inside][np.linalg.norm(apart, axis=2).argmin(axis=1)])
    edges = np.linspace(-1, 1, BANDS + 1)
    colours = diverging((edges[1:] + edges[:-1]) / 2)
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    bands = axes.tricontourf(x, y, mesh.faces, values, levels=1.0001 * edges, colors=colours)
    bands.set_edgecolor("face")  # no ground shows between two bands
    axes.tricontour(x, y, mesh.faces, values, levels=[0.0], colors=GREY, linewidths=1)
    for corners in drum.patches(form, SIZE, 0.0):
        axes.fill(*corners.T, fill=False, ec=GREY, lw=0.8, ls=":", clip_on=False)
    at = drum.positions(form, SIZE, 0.0)
    outline = np.array([at[name] for name in drum.OUTLINES[form].split()])
    axes.fill(*outline.T, fill=False, ec=GREY, lw=1.5, joinstyle="round", clip_on=False)
    axes.set_aspect("equal")
    axes.set_axis_off()


def mesh_error(data: dict) -> str:
    """Return an SVG: errors on the sphere against the edge length, one panel per eigenvalue."""
    with figure_on_nothing(3.6) as figure:
        panels = figure.subplots(1, len(INDICES), sharey=True)
        figure.subplots_adjust(0.085, 0.14, 0.99, 0.92, wspace=0.06)
        for axes, index in zip(panels, INDICES, strict=True):
            for mass, (colour, marker) in MASSES.items():
                edges, errors = _errors(data, mass, index)
                inside = colour if errors[0] > 0 else "none"
                side = "too large" if errors[0] > 0 else "too small"
                axes.loglog(
                    edges, np.abs(errors), marker=marker, color=colour, mfc=inside, ms=5.5, lw=1.3,
                    label=f"{mass} mass, {side}",
                )  # fmt: skip
            draw_slope(axes, edges, np.abs(errors))
            axes.set_title(f"λ{index}".translate(SUBSCRIPTS), fontsize=10, color=GREY)
            axes.set_xticks([0.02, 0.05, 0.1, 0.2], ["0.02", "0.05", "0.1", "0.2"])
            axes.set_xticks([], minor=True)
            axes.set_xlabel("mean edge length h, on the unit sphere")
            axes.grid(alpha=0.25)
            axes.legend(frameon=False, fontsize=7.5, loc="upper left")
        panels[0].set_ylabel("relative error to the sphere")
        return as_svg(figure)


def draw_slope(axes: Axes, edges: np.ndarray, errors: np.ndarray) -> None:
    """Draw a triangle of slope 2 below a line of errors."""
    (low, high), foot = (edges[1], edges[2]), 0.3 * errors[1]
    top = foot * (high / low) ** 2
    axes.plot([low, high, high, low], [foot, foot, top, foot], color=ORANGE, lw=1)
    axes.annotate(
        "2", (high, math.sqrt(foot * top)), (4, 0), textcoords="offset points", va="center",
        fontsize=8,
    )  # fmt: skip
