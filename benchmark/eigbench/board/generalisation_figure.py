"""The generalisation drop as dumbbells: one panel per protocol, one line per model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eigbench.board.figures import FLOOR, KINDS, as_svg, escaped, style
from eigbench.board.generalisation import Board, title
from eigbench.board.ranking import RANKED_BY
from eigbench.scoring.metrics import METRICS
from synthnet.pictures.palette import GREY

if TYPE_CHECKING:
    import matplotlib as mpl
    from matplotlib.figure import Figure

LINE, WIDTH = 0.2, 9.6  # inches: of a model, and of all panels with the names


def draw(board: Board) -> str:
    """Return an SVG: each model's error on what its training held out, and without holding out.

    The filled mark is the same model trained on everything, on the very same shapes; a model
    without it is not trained on the version, and has no drop.
    """
    with style() as new_figure:
        high = LINE * len(board.rows) + 1.25
        figure = new_figure(figsize=(WIDTH, high))
        panels = figure.subplots(1, len(board.protocols), sharex=True, sharey=True, squeeze=False)
        figure.subplots_adjust(0.355, 0.5 / high, 0.985, 1 - 0.7 / high, wspace=0.08)
        for axes, protocol in zip(panels[0], board.protocols, strict=True):
            for line, row in enumerate(board.rows):
                held_out = board.scored(row.submission, protocol, RANKED_BY)
                if held_out.score is not None:
                    kind = row.submission.result["model"]["kind"]
                    _dumbbell(axes, line, kind, held_out.score, held_out.before)
            axes.set_title(_two_lines(title(protocol)), fontsize=8, loc="left")
            axes.set_xscale("log")
            axes.grid(axis="x", alpha=0.25)
            axes.tick_params(labelsize=7)
        names = [escaped(row.submission.name) for row in board.rows]
        panels[0][0].set_yticks(range(len(names)), names, fontsize=7.5)
        panels[0][0].set_ylim(len(names) - 0.5, -0.5)
        figure.text(
            0.67, 0.1 / high, f"mean {METRICS[RANKED_BY].heading}; below {FLOOR:g} at the edge",
            ha="center", fontsize=8,
        )  # fmt: skip
        kinds = {row.submission.result["model"]["kind"] for row in board.rows}
        _legend(figure, panels[0][0], kinds)
        return as_svg(figure)


def _dumbbell(
    axes: mpl.axes.Axes, line: int, kind: str, score: float, before: float | None
) -> None:
    """Draw a model's score, and a line from what it would be with nothing held out."""
    colour, marker = KINDS[kind]
    x = max(score, FLOOR)
    if before is not None:
        start = max(before, FLOOR)
        axes.plot([start, x], [line, line], color=colour, lw=1.6, alpha=0.6, zorder=1)
        axes.plot(start, line, marker, color=colour, ms=5.5, zorder=2)
    axes.plot(x, line, marker, color=colour, mfc="white", ms=5, zorder=3)


def _two_lines(text: str) -> str:
    """Return a title of at most some letters a line."""
    words = text.split()
    half = max(1, (len(words) + 1) // 2)
    return f"{' '.join(words[:half])}\n{' '.join(words[half:])}".rstrip()


def _legend(figure: Figure, axes: mpl.axes.Axes, kinds: set[str]) -> None:
    marks = [(marker, colour, colour, kind) for kind, (colour, marker) in KINDS.items()]
    handles = [
        axes.plot([], [], marker, color=colour, mfc=fill, ls="", label=text)[0]
        for marker, colour, fill, text in [
            *(mark for mark in marks if mark[3] in kinds),
            ("o", GREY, GREY, "trained on everything"),
            ("o", GREY, "white", "trained without what is tested"),
        ]
    ]
    figure.legend(handles=handles, loc="upper center", frameon=False, fontsize=7.5, ncols=5)
