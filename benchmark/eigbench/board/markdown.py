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
    """Return text that Markdown takes as it is."""
    return re.sub(r"([\\|`*\[\]!])", r"\\\1", " ".join(text.split())).replace("<", "&lt;")
