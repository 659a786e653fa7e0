"""The tables of a board as JSON for the page: the same columns that LEADERBOARD.md has."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from eigbench import results
from eigbench.board.columns import Cell, Column, Group, Row


def heads(columns: Iterable[Column[Row]]) -> dict[str, Any]:
    """Return what the page knows of columns, by key."""
    return {
        column.key: {
            "title": column.title,
            "help": column.note,
            "numeric": column.numeric,
            "higher": column.higher,
        }
        for column in columns
    }


def views(groups: Iterable[Group[Row]]) -> list[dict[str, Any]]:
    """Return groups by the keys of their columns."""
    return [{"key": g.key, "title": g.title, "columns": [c.key for c in g.columns]} for g in groups]


def cells(row: Row, columns: Iterable[Column[Row]]) -> dict[str, Cell]:
    """Return a row's cells by the keys of their columns."""
    return {column.key: column.cell(row) for column in columns}


def entry(
    row: Row, slug: str, result: dict[str, Any], shown: Iterable[Column[Row]]
) -> dict[str, Any]:
    """Return what the page's table has of a row."""
    return {
        "slug": slug,
        "name": result["model"]["name"],
        "kind": result["model"]["kind"],
        "training": results.declared(result, "training_data"),
        "setting": results.setting(result),
        "cells": cells(row, shown),
    }


def of(groups: Iterable[Group[Row]], fixed: Sequence[Column[Row]] = ()) -> list[Column[Row]]:
    """Return the columns of groups, each once, though several may have it."""
    every = [*fixed, *(column for group in groups for column in group.columns)]
    return list({column.key: column for column in every}.values())
