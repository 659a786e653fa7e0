"""The picture of the scaling track: time and error against vertices, both logarithmic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from eigbench.board.figures import as_svg, style
from eigbench.scaling import scores as scaling_scores
from eigbench.scaling import surfaces
from eigbench.scaling.results import Scaled
from eigbench.scaling.scores import Medians

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

# Okabe and Ito without yellow; the next seven models have other lines and marks
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666")
LINES, MARKS = ("-", "--", ":"), ("o", "^", "s")
LEAST = 1e-6  # errors below are drawn at the lower edge: an exact solver's
HEIGHT, ENTRY = 3.4, 0.19  # inches of a pair of panels, and of a line of the legend
COLUMNS = 2
OWN = "discretisation error of the meshes"


def draw(by_setting: Mapping[str, Sequence[Scaled]]) -> str:
    """Return an SVG with a pair of panels for each hardware label: time, and error.

    The grey line is the discretisation error of the meshes; an empty mark says that not every
    surface was answered.
    """
    rows = sorted((row for mine in by_setting.values() for row in mine), key=_key)
    looks = {_key(row): _look(number) for number, row in enumerate(rows)}
    entries = -(-(len(rows) + 1) // COLUMNS)
    legend = ENTRY * entries + 0.2
    height = HEIGHT * len(by_setting) + legend
    with style() as new_figure:
        # Positions are fixed, as in figures.py
        figure = new_figure(figsize=(7.2, height))
        panels = figure.subplots(len(by_setting), 2, squeeze=False)
        figure.subplots_adjust(
            0.09, (legend + 0.5) / height, 0.98, 1 - 0.3 / height, wspace=0.25, hspace=0.45
        )
        for (time, error), (label, mine) in zip(panels, by_setting.items(), strict=True):
            sizes = scaling_scores.sizes(mine)
            for row in mine:
                cells = [scaling_scores.medians(row, size) for size in sizes]
                look = looks[_key(row)]
                _line(time, sizes, cells, [cell.seconds for cell in cells], look)
                errors = [np.nan if np.isnan(c.error) else max(c.error, LEAST) for c in cells]
                _line(error, sizes, cells, errors, look)
            floors = [scaling_scores.floor(size) for size in sizes]
            error.plot(sizes, floors, color="#999999", lw=4, alpha=0.5)
            time.set_title(label.replace("$", "\\$"), fontsize=8, loc="left")
            time.set_ylabel("seconds a mesh")
            error.set_ylabel(f"mean relative error, from {LEAST:.0e} up")
            for axes in (time, error):
                axes.set_xscale("log")
                axes.set_yscale("log")
                axes.set_xlabel("vertices")
                axes.set_xlim(sizes[0] / 2, sizes[-1] * 2)
                axes.grid(alpha=0.25)
        names = [row.name.replace("$", "\\$") for row in rows]
        own = ("#999999", "-", "")
        for number, (name, look) in enumerate(
            zip([*names, OWN], [*looks.values(), own], strict=True)
        ):
            column, line = divmod(number, entries)
            _entry(
                figure, 0.03 + column / COLUMNS, (legend - ENTRY * (line + 1)) / height, name, look
            )
        return as_svg(figure)


def _entry(figure: Figure, x: float, y: float, name: str, look: tuple[str, str, str]) -> None:
    """Write a line of the legend by hand: where a legend puts it depends on measured text."""
    from matplotlib.lines import Line2D

    colour, line, mark = look
    width, alpha = (4.0, 0.5) if name == OWN else (1.2, 1.0)
    figure.add_artist(Line2D([x, x + 0.04], [y, y], color=colour, ls=line, lw=width, alpha=alpha))
    if mark:
        figure.add_artist(Line2D([x + 0.02], [y], color=colour, marker=mark, ms=4))
    figure.text(x + 0.05, y, name, fontsize=7.5, va="center_baseline")


def _key(row: Scaled) -> tuple[str, str]:
    return row.slug, str(row.path)


def _look(number: int) -> tuple[str, str, str]:
    turn, colour = divmod(number, len(COLOURS))
    return COLOURS[colour], LINES[turn % len(LINES)], MARKS[turn % len(MARKS)]


def _line(
    axes: mpl.axes.Axes,
    sizes: Sequence[int],
    cells: Sequence[Medians],
    values: Sequence[float],
    look: tuple[str, str, str],
) -> None:
    """Draw a model; sizes at which not every surface was answered have an empty mark."""
    colour, line, mark = look
    axes.plot(sizes, values, ls=line, color=colour, lw=1.2)
    for size, cell, value in zip(sizes, cells, values, strict=True):
        if cell.answered:
            fill = "full" if cell.answered == len(surfaces.SURFACES) else "none"
            axes.plot([size], [value], mark, color=colour, ms=4, fillstyle=fill)
