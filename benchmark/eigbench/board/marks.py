"""Generated text between the marks of a page: ``<!-- begin NAME -->`` and ``<!-- end NAME -->``."""

from __future__ import annotations

import re


def marked(text: str, name: str, part: str) -> str:
    """Return a page's text with ``part`` between the marks of ``name``.

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
