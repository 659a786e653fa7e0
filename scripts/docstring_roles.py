r"""Docstrings on the site: roles such as ``:func:`name``` become links, ``:math:`x``` formulas.

An extension of griffe, which mkdocs.yml names. Formulas are drawn by matplotlib when the site is
built, so that no page needs a script for them.
"""

from __future__ import annotations

import base64
import html
import io
import re
from typing import Any

import griffe
import matplotlib as mpl
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser

DISPLAY = re.compile(r"^( *)\.\. math::\n((?:\1 +\S.*\n?)+)", re.MULTILINE)
ROLE = re.compile(r":(func|class|meth|mod|data|attr|exc|math):`(~?)([^`]+)`")
LITERAL = re.compile(r"(\S)?::$", re.MULTILINE)
SIZE = 10.0  # points; pictures are placed in units of it, so that they follow the text
DISPLAYED = 1.3  # times as large: what stands alone has fractions
OURS = ("synthnet", "eigbench")


class Roles(griffe.Extension):
    """Rewrite the roles in every docstring."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Rewrite one docstring."""
        if obj.docstring is not None:
            obj.docstring.value = rewrite(obj.docstring.value, obj)


def rewrite(text: str, obj: griffe.Object | None = None) -> str:
    r"""Return a docstring in Markdown: links, formulas and blocks of code.

    Examples
    --------
    >>> rewrite("see :data:`numpy.pi` and :func:`~synthnet.recipe.splits.by_hash`::")
    'see `numpy.pi` and [`by_hash`][synthnet.recipe.splits.by_hash]:'
    >>> rewrite(":math:`e_i`")[:32]
    '<img class="math" alt="e_i" src='
    """
    text = DISPLAY.sub(lambda m: f"{m[1]}{formula(m[2], DISPLAYED)}\n", text)
    return LITERAL.sub(lambda m: f"{m[1]}:" if m[1] else "", ROLE.sub(_role(obj), text))


def _role(obj: griffe.Object | None) -> Any:
    def replaced(match: re.Match[str]) -> str:
        role, short, target = match.groups()
        if role == "math":
            return formula(target)
        place = _place(role, target, obj)
        title = target.rpartition(".")[2] if short else target
        return f"`{title}`" if place is None else f"[`{title}`][{place}]"

    return replaced


def formula(tex: str, scale: float = 1.0) -> str:
    """Return the picture of a formula, in line with the text, with its TeX for who cannot see."""
    tex = " ".join(tex.split())
    drawn = f"${tex}$"
    font = FontProperties(size=SIZE, math_fontfamily="cm")
    width, height, depth, *_ = MathTextParser("path").parse(drawn, dpi=72, prop=font)
    figure = Figure(figsize=(width / 72, height / 72))
    figure.text(0, depth / height, drawn, fontproperties=font)
    written = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "synthnet", "svg.fonttype": "path"}):
        figure.savefig(written, format="svg", transparent=True, metadata={"Date": None})
    picture = base64.b64encode(written.getvalue()).decode()
    high, deep = scale * height / SIZE, scale * depth / SIZE
    style = f"height:{high:.3f}em;vertical-align:-{deep:.3f}em"
    source = f"data:image/svg+xml;base64,{picture}"
    return f'<img class="math" alt="{html.escape(tex)}" src="{source}" style="{style}">'


def _place(role: str, target: str, obj: griffe.Object | None) -> str | None:
    """Return the full path of what a role names as its docstring sees it, if it is ours."""
    if not target.startswith(tuple(f"{name}." for name in OURS)):
        try:
            target = obj.resolve(target) if obj is not None else ""
        except griffe.NameResolutionError:
            return None
    if target.partition(".")[0] not in OURS:
        return None
    # The pages have functions and classes; a constant or attribute is told where it belongs.
    return target.rpartition(".")[0] if role in ("data", "attr") else target
