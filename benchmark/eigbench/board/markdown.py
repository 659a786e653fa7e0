"""Markdown of generated pages: tables, and text that is no markup."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def table(headers: Sequence[str], rows: Iterable[Sequence[str]], numeric: Sequence[bool]) -> str:
    """Return a Markdown table, its ``numeric`` columns aligned right; cells are not padded."""
    rule = ["--:" if right else "---" for right in numeric]
    lines = [headers, rule, *rows]
    return "\n".join("| " + " | ".join(map(cell, line)) + " |" for line in lines) + "\n"


def cell(text: str) -> str:
    r"""Return text that Markdown and HTML take as it is: no markup, link, formula or entity.

    Examples
    --------
    >>> cell("a_b <i> &lt; $x$"), cell("www.example.org")
    ('a\\_b &lt;i> &amp;lt; \\$x\\$', 'www&#46;example.org')
    """
    plain = " ".join(text.split()).replace("&", "&amp;").replace("<", "&lt;")
    escaped = re.sub(r"([\\|`*\[\]!_~$])", r"\\\1", plain)
    escaped = re.sub(r"(?i)\b(www)\.", r"\1&#46;", escaped).replace("://", "&#58;//")
    return re.sub(r"^([#>])", r"\\\1", escaped)
