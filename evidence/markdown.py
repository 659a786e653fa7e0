"""Tables of a page."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from tabulate import tabulate


def table(headers: Sequence[str], rows: Iterable[Sequence[object]], align: str = "") -> str:
    """Return a Markdown table.

    Parameters
    ----------
    headers, rows
        The cells, as they are to be shown.
    align
        A letter a column, ``l`` or ``r``; the last one stands for those that follow.

    Examples
    --------
    >>> print(table(["mesh", "ms"], [["torus", "3.6"]], "lr"))
    | mesh   |   ms |
    |--------|------|
    | torus  |  3.6 |
    """
    sides = {"l": "left", "r": "right"}
    letters = align + align[-1:] * (len(headers) - len(align))
    return tabulate(
        list(rows),
        headers,
        tablefmt="github",
        disable_numparse=True,
        colalign=[sides[letter] for letter in letters] or None,
    )


def columns(rows: Iterable[Mapping], formats: Mapping[str, str], align: str = "") -> str:
    """Return a Markdown table of rows of numbers.

    Parameters
    ----------
    rows
        Values by name.
    formats
        How a column is written, by its header: ``{name:.1f}``.
    align
        As of :func:`table`.

    Examples
    --------
    >>> print(columns([{"mesh": "torus", "ms": 3.6}], {"ms per mesh": "{ms:.2f}"}, "r"))
    |   ms per mesh |
    |---------------|
    |          3.60 |
    """
    cells = [[text.format_map(row) for text in formats.values()] for row in rows]
    return table(list(formats), cells, align)


def folded(summary: str, text: str) -> str:
    """Return Markdown that a click unfolds, on GitHub and on the site.

    Examples
    --------
    >>> print(folded("The numbers", "| a |"))
    <details>
    <summary>The numbers</summary>
    <BLANKLINE>
    | a |
    <BLANKLINE>
    </details>
    """
    return f"<details>\n<summary>{summary}</summary>\n\n{text}\n\n</details>"
