"""Figures that can be read on light and on dark pages, as SVG."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from evidence import DOCS
from synthnet.store.files import write_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def as_svg(figure: Figure) -> str:
    """Return a figure as SVG, its paths with two digits after the point: finer than any screen."""
    from eigbench.board import figures

    def shortened(path: re.Match) -> str:
        return re.sub(r"(\.\d\d)\d+", r"\1", path[0])

    return re.sub(r' d="[^"]+"', shortened, figures.as_svg(figure))


@contextmanager
def figure_on_nothing(height: float) -> Iterator[Figure]:
    """Give a figure without ground, whose text can be read on light and on dark pages."""
    import matplotlib as mpl
    from eigbench.board.figures import style

    from synthnet.pictures.draw import ON_NOTHING

    with style() as new_figure:
        mpl.rcParams.update(ON_NOTHING)
        yield new_figure(figsize=(8, height))


@contextmanager
def drawn(name: str) -> Iterator[Figure]:
    """Give a figure, and write it to docs/ at the end."""
    with figure_on_nothing(3.8) as figure:
        figure.set_layout_engine("constrained")
        yield figure
        write_text(DOCS / name, as_svg(figure))


def label_axes(axes: Axes, x: str, y: str) -> None:
    """Name logarithmic axes, with a grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(True, which="both", alpha=0.2)
