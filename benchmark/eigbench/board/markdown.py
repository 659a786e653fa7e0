"""Markdown of generated pages: tables, text that is no markup, and parts between marks."""

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


def marked(text: str, name: str, part: str) -> str:
    """Return a page's text with ``part`` between the marks of ``name``.

    The marks are ``<!-- begin NAME -->`` and ``<!-- end NAME -->``.

    Raises
    ------
    ValueError
        If it has no such marks, or several.

    Examples
    --------
    >>> marked("<!-- begin a-b -->old<!-- end a-b -->", "a-b", "new")
    '<!-- begin a-b -->new<!-- end a-b -->'
    """
    pattern = re.compile(f"(<!-- begin {name} -->).*?(<!-- end {name} -->)", re.DOTALL)
    text, count = pattern.subn(lambda match: f"{match[1]}{part}{match[2]}", text)
    if count != 1:
        raise ValueError(f"the marks of {name} {count} times, not once")
    return text
