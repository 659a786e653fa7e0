"""The tables of a board as JSON for the page: the same columns that LEADERBOARD.md has."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from eigbench.board.columns import Cell, Column, Group, Row


def heads(groups: Sequence[Group[Row]], fixed: Sequence[Column[Row]] = ()) -> dict[str, Any]:
    """Return all columns by key, and the groups by the keys of their columns."""
    return {
        "columns": {
            column.key: {
                "title": column.title,
                "help": column.note,
                "numeric": column.numeric,
                "higher": column.higher,
            }
            for column in _columns(groups, fixed)
        },
        "groups": [
            {"key": g.key, "title": g.title, "columns": [c.key for c in g.columns]} for g in groups
        ],
    }


def cells(
    row: Row, groups: Sequence[Group[Row]], fixed: Sequence[Column[Row]] = ()
) -> dict[str, Cell]:
    """Return a row's cells by the keys of their columns."""
    return {column.key: column.cell(row) for column in _columns(groups, fixed)}


def _columns(groups: Sequence[Group[Row]], fixed: Sequence[Column[Row]]) -> Sequence[Column[Row]]:
    """Return each column once, though several groups may have it."""
    every = [*fixed, *(column for group in groups for column in group.columns)]
    return list({column.key: column for column in every}.values())
