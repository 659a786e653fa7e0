"""Boards of the page: every dataset under every protocol, ranked, with its columns and cells."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from eigbench.board import generalisation, leaderboard, page, ranked_columns
from eigbench.board.columns import Group, six_digits
from eigbench.board.generalisation import Board, NotRun
from eigbench.board.ranked_columns import RANK
from eigbench.board.ranking import Ranked
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import MAIN
from eigbench.scoring.truth import Truth
from eigbench.site import columns

FIRST_VIEWS = 2  # of a board's table that the page has from the start; their columns chart it
OF_ALL = {
    "grouped": "grouped: no copy of a test shape in training",
    "paper": "paper: copies of a shape on both sides",
}


@dataclass(frozen=True, slots=True)
class Shown:
    """A board as it is shown.

    Its rows are the best first. Under a version's own protocol, models without training are among
    them: their predictions of the whole split hold for a part of it.
    """

    rows: Sequence[Ranked]
    protocols: Board | None  # all of the version, if it has its own
    own: str | None  # the version's own protocol that the rows are of, if they are of one

    @property
    def truth(self) -> Truth:
        """What is predicted."""
        return self.rows[0].submission.truth

    @property
    def key(self) -> str:
        """Name in files and fragments: ``1.0-test-grouped-surface``."""
        submission = self.rows[0].submission
        return f"{submission.board}-{submission.target}"

    @property
    def protocol(self) -> str:
        """Name of the protocol in short: ``grouped``, or what is held out."""
        protocol = self.truth.protocol
        return protocol if protocol in OF_ALL else generalisation.title(protocol)

    @property
    def short(self) -> str:
        """Name without what it says of itself: ``against the mesh; grouped``."""
        return f"{page.NAMES[self.truth.target]}; {self.protocol}"

    @property
    def title(self) -> str:
        """Name of the protocol for readers."""
        protocol = OF_ALL.get(self.truth.protocol, self.protocol)
        return f"{page.NAMES[self.truth.target]}; {protocol}"


def shown(submissions: Sequence[Submission], not_run: Sequence[NotRun] = ()) -> list[Shown]:
    """Return the boards, in order of version, target and protocol: what is held out comes first."""
    every = []
    for rows, board in leaderboard.boards(submissions, not_run):
        if board is not None:
            every += [Shown(list(mine.values()), board, p) for p, mine in board.under.items()]
        every.append(Shown(rows, board, None))
    return every


def contents(board: Shown) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return what the page shows of a board at first, and what it asks for when that is wanted.

    The second has the columns and cells of the other views, and the drops under each protocol.
    """
    groups = _groups(board)
    first = columns.of(groups[:FIRST_VIEWS], [RANK])
    shown = {column.key for column in first}
    later = [column for column in columns.of(groups) if column.key not in shown]
    rows = [
        columns.entry(row, row.submission.slug, row.submission.result, first) for row in board.rows
    ]
    head = {"key": board.key, "kind": "board", "title": page.title(board.rows)}
    views = {"columns": columns.heads(first), "groups": columns.views(groups)}
    rest = {
        "columns": columns.heads(later),
        "cells": {row.submission.slug: columns.cells(row, later) for row in board.rows},
        "drops": _drops(board),
    }
    return {**head, "notes": _notes(board), **views, "rest": True, "rows": rows}, rest


def _drops(board: Shown) -> dict[str, list[dict[str, Any]]]:
    """Return, by metric, each protocol with the models run under it: their score, and without it.

    Empty for a board that does not compare protocols.
    """
    if board.protocols is None or board.own is not None:
        return {}
    return {
        key: [
            {
                "title": generalisation.title(protocol),
                "column": f"{key}-{protocol}",
                "scores": {
                    row.submission.slug: [six_digits(held.before), six_digits(held.score)]
                    for row in board.rows
                    if (held := board.protocols.scored(row.submission, protocol, key)).score
                    is not None
                },
            }
            for protocol in board.protocols.protocols
        ]
        for key in generalisation.SHOWN
    }


def _groups(board: Shown) -> list[Group[Ranked]]:
    """Return the views of the page's table."""
    whole = ranked_columns.main(board.rows)
    metrics = Group("metrics", "All metrics", [c for c in whole.columns if c.key in MAIN])
    overview = ranked_columns.overview(board.rows, board.protocols, board.own)
    declared = Group("run", "Speed and hardware", [c for c in whole.columns if c.key not in MAIN])
    groups = [overview, metrics, declared, *ranked_columns.groups(board.rows, board.own)]
    if board.protocols is None or board.own is not None:
        return groups
    marks = generalisation.remark_marks(board.protocols, board.rows)
    tables = (generalisation.table(board.protocols, key, marks) for key in generalisation.SHOWN)
    return [*groups, *tables]


def _notes(board: Shown) -> list[str]:
    """Return the paragraphs of "How to read this"."""
    remarks = page.remarks(row.submission for row in board.rows)
    notes = [note.strip() for note in (*page.introduction(board.rows), *remarks)]
    if board.own is not None:
        return [*notes, f"**Generalisation**: {generalisation.EXPLAINED}"]
    if board.protocols is not None:
        marks = generalisation.remark_marks(board.protocols, board.rows)
        notes += generalisation.lines(marks)
    return notes
