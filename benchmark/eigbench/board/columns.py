"""Tables of a board, once for LEADERBOARD.md and the page: each is a list of columns.

A column has a key, a title, a note, and a function from a row to a cell. A cell is a text and the
value that the page sorts it by, a number or words; ``None`` goes last.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from eigbench import results
from eigbench.board.markdown import table
from eigbench.board.tables import score

Row = TypeVar("Row")  # what a table is of: a ranked submission, or a result of the scaling track
Cell = tuple[str, float | str | None]

NAME = "name"  # the key of the column of models' names
DECLARED = "The run declared it: it does not follow from the predictions."


@dataclass(frozen=True, slots=True)
class Column(Generic[Row]):
    """A column of a table."""

    key: str  # unique on its board
    title: str
    note: str  # what the page explains about it
    cell: Callable[[Row], Cell]
    numeric: bool = True  # whether it is sorted by numbers, and aligned right
    higher: bool = False  # whether more is better, so that the page sorts it downwards first
    lead: str = ""  # its text in the line above the models, in a table that has one


@dataclass(frozen=True, slots=True)
class Group(Generic[Row]):
    """Columns shown together: a table of LEADERBOARD.md, and a view of the page's table."""

    key: str  # unique on its board
    title: str
    columns: Sequence[Column[Row]]  # beside the model's name
    note: str = ""  # stands below the heading in LEADERBOARD.md
    lead: str = ""  # what the line above the models is called; empty where there is none


def as_markdown(
    group: Group[Row], rows: Sequence[Row], first: Sequence[Column[Row]], *, lead: bool = True
) -> str:
    """Return the Markdown table of a group, with the columns that name each row first."""
    columns = [*first, *group.columns]
    lines = [[column.cell(row)[0] for column in columns] for row in rows]
    if group.lead and lead:
        named = [group.lead if column.key == NAME else "" for column in first]
        lines.insert(0, [*named, *(column.lead for column in group.columns)])
    titles = [column.title for column in columns]
    return table(titles, lines, [column.numeric for column in columns])


def of_run(result: Callable[[Row], dict[str, Any]]) -> tuple[Column[Row], ...]:
    """Return the columns of a run's model, kind, hardware and training set, from its result.

    A mark on a row belongs after its name, here, for every table.
    """

    def column(key: str, title: str, note: str, text: Callable[[Row], str]) -> Column[Row]:
        return Column(key, title, note, lambda row: words(text(row)), numeric=False)

    def setting(row: Row) -> str:
        return results.setting(result(row))

    def training(row: Row) -> str:
        return results.declared(result(row), "training_data")

    return (
        column(NAME, "model", "Name of the model.", lambda row: result(row)["model"]["name"]),
        column("kind", "kind", DECLARED, lambda row: result(row)["model"]["kind"]),
        column("hardware", "hardware", f"Where it was timed. {DECLARED}", setting),
        column("training", "training set", f"What it was fitted to. {DECLARED}", training),
    )


def words(text: str) -> Cell:
    """Return a cell of words, which sort as they are."""
    return text, text


def of_score(value: float | None, key: str) -> Cell:
    """Return a cell of a metric's score."""
    return score(value, key), six_digits(value)


def six_digits(value: float | None) -> float | None:
    """Return a number with the digits that are enough to sort and draw it; no NaN or infinity.

    Examples
    --------
    >>> six_digits(0.123456789), six_digits(float("nan")), six_digits(None)
    (0.123457, None, None)
    """
    return None if value is None or not math.isfinite(value) else float(f"{value:.6g}")
