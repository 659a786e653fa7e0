"""The picture of the scaling track: error to the surface against speed, one panel per size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eigbench.board import figures
from eigbench.board.figures import KINDS, SPEED, Point
from eigbench.scaling import panels, scores, surfaces
from eigbench.scaling.panels import Panel
from eigbench.scaling.results import Scaled
from synthnet.pictures.palette import GREEN, PALE

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

FASTEST = 1000.0  # times LaPy; faster models are drawn at the right edge
WIDTH, HEIGHT = 9.0, 3.1  # inches: of the figure, and of a row of panels
ACROSS, COLUMNS = 2, 3  # panels in a row, and columns of the key
ENTRY, LETTERS = 0.19, 46  # inches of a line of the key, and letters that it has room for
SIGNS: dict[str, dict[str, Any]] = {
    **{
        kind: {"color": colour, "marker": marker, "markevery": [1], "ls": "", "ms": 5}
        for kind, (colour, marker) in KINDS.items()
    },
    "not every surface was answered": {
        "color": "0.4", "marker": "o", "mfc": "white", "markevery": [1], "ls": "", "ms": 5,
    },
    "fastest exact solver, coarser and finer meshes": {"color": PALE, "lw": 1.4},
    "where a prediction can win": {"color": GREEN, "lw": 7, "alpha": 0.25},
}  # fmt: skip


def draw(by_setting: Mapping[str, Sequence[Scaled]]) -> str:
    """Return an SVG with a panel for each hardware label and size, all with the same axes.

    The line is the fastest exact solver on the meshes of all sizes; right of it, down from twice
    the discretisation error of the panel's meshes, a prediction can win.
    """
    charts = [chart for label, mine in by_setting.items() for chart in _charts(label, mine)]
    rows = sorted((row for mine in by_setting.values() for row in mine), key=_key)
    numbers = {_key(row): number for number, row in enumerate(rows, start=1)}
    down, lines = -(-len(charts) // ACROSS), -(-(len(rows) + len(SIGNS)) // COLUMNS)
    below = ENTRY * lines + 0.55
    high = HEIGHT * down + below
    with figures.style() as new_figure:
        # Positions are fixed, as in figures.py
        figure = new_figure(figsize=(WIDTH, high))
        grid = np.ravel(figure.subplots(down, ACROSS, sharex=True, sharey=True, squeeze=False))
        figure.subplots_adjust(0.08, below / high, 0.985, 1 - 0.25 / high, wspace=0.06, hspace=0.14)
        drawn = []
        for axes, (label, mine, panel) in zip(grid, charts, strict=False):
            drawn.append(_models(axes, panel, [(numbers[_key(row)], row) for row in mine]))
            hardware = f"; {label}" if len(by_setting) > 1 else ""
            title = figures.escaped(f"{panel.size:,} vertices{hardware}")
            axes.set_title(title, fontsize=9, loc="left", pad=3)
        # Which hold the models of all panels
        (left, _), (low, _) = grid[0].get_xlim(), grid[0].get_ylim()
        for axes, (_, _, panel) in zip(grid, charts, strict=False):
            _solver(axes, panel, low)
        for axes in grid[len(charts) :]:
            axes.set_axis_off()
        grid[0].set_xlim(left, FASTEST * 1.6)
        grid[0].set_ylim(low, 1.0)
        for axes, points in zip(grid, drawn, strict=False):
            figures.number_marks(axes, points, floor=0.0, fastest=FASTEST)
        figure.text(0.53, (below - 0.42) / high, SPEED, ha="center", fontsize=9)
        text = "mean relative error to the surface's spectrum"
        figure.text(0.012, 0.5 + below / high / 2, text, rotation=90, va="center", fontsize=9)
        _name_key(figure, rows, lines, high)
        return figures.as_svg(figure)


def _charts(label: str, rows: Sequence[Scaled]) -> list[tuple[str, Sequence[Scaled], Panel]]:
    """Return the panels of a setting, one a size."""
    verdicts = [scores.verdict(rows, size) for size in scores.sizes(rows)]
    return [(label, rows, panels.panel(rows, verdicts, verdict.size)) for verdict in verdicts]


def _models(axes: mpl.axes.Axes, panel: Panel, rows: Sequence[tuple[int, Scaled]]) -> list[Point]:
    """Draw the models of a size that were answered and can be compared with LaPy; return them."""
    points = []
    for number, row in rows:
        cell = scores.medians(row, panel.size)
        if cell.answered and np.isfinite(panel.lapy_seconds):
            kind, speed = row.result["model"]["kind"], panel.lapy_seconds / cell.seconds
            whole = cell.answered == len(surfaces.SURFACES)
            points.append(Point(number, row.name, kind, speed, cell.distance, None, whole))
    figures.scatter(axes, points, floor=0.0, fastest=FASTEST)
    axes.set_xlabel("")
    return points


def _solver(axes: mpl.axes.Axes, panel: Panel, low: float) -> None:
    """Draw the line of the exact solver, and where a prediction can win, down to the lower edge."""
    if panel.solver:
        axes.plot(*zip(*panel.solver, strict=True), "-", color=PALE, lw=1.4, zorder=1.5)
    if panel.border:
        x, y = zip(*panel.border, strict=True)
        far = 2 * FASTEST
        axes.fill([x[0], *x, far, far], [low, *y, y[-1], low], color=GREEN, alpha=0.14, lw=0)


def _name_key(figure: Figure, rows: Sequence[Scaled], lines: int, high: float) -> None:
    """Write the key by hand: where a legend puts it depends on measured text."""
    from matplotlib.lines import Line2D

    entries: list[tuple[str, str | dict[str, Any]]] = list(SIGNS.items())
    names = [(row.name, str(number)) for number, row in enumerate(rows, start=1)]
    colours = [KINDS[row.result["model"]["kind"]][0] for row in rows]
    for i, (text, sign) in enumerate([*names, *entries]):
        column, line = divmod(i, lines)
        x, y = 0.03 + column / COLUMNS, ENTRY * (lines - line - 0.4) / high
        if isinstance(sign, str):
            figure.text(
                x, y, sign, color=colours[i], weight="bold", fontsize=7.5, ha="right",
                va="center_baseline",
            )  # fmt: skip
        else:
            figure.add_artist(Line2D([x - 0.018, x], [y, y], **sign))
        short = text if len(text) <= LETTERS else f"{text[: LETTERS - 1]}…"
        figure.text(x + 0.008, y, figures.escaped(short), fontsize=7.5, va="center_baseline")


def _key(row: Scaled) -> tuple[str, str]:
    return row.slug, str(row.path)
