"""Tables of a page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

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
