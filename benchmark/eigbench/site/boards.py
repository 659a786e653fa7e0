"""Boards of the page: every dataset under every protocol, ranked, with its columns and cells."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from eigbench import results
from eigbench.board import generalisation, leaderboard, page, ranking
from eigbench.board.generalisation import Board
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.board.tables import score
from eigbench.results.submission import Submission
from eigbench.scoring import noise, scores
from eigbench.scoring.metrics import MAIN
from eigbench.scoring.training import untrained
from eigbench.scoring.truth import Truth
from eigbench.site import columns
from eigbench.site.columns import number_of

OF_ALL = {
    "grouped": "grouped: no copy of a test shape in training",
    "paper": "paper: copies of a shape on both sides",
}


@dataclass(frozen=True, slots=True)
class Shown:
    """A board as it is shown.

    Parameters
    ----------
    rows : sequence of Ranked
        Best first. Under a protocol that asks for generalisation, what is not trained is among
        them: its predictions of the whole split hold for a part of it.
    protocols : Board or None
        All protocols of the version, if it has its own.
    own : str or None
        The one of these that the rows are of.
    """

    rows: Sequence[Ranked]
    protocols: Board | None
    own: str | None

    @property
    def truth(self) -> Truth:
        """What is predicted."""
        return self.rows[0].submission.truth

    @property
    def key(self) -> str:
        """Name in files and fragments: ``1.0-test-grouped``."""
        return self.rows[0].submission.board

    @property
    def title(self) -> str:
        """Name of the protocol for readers."""
        protocol = self.truth.protocol
        return OF_ALL.get(protocol) or generalisation.title(protocol)


def shown(submissions: Sequence[Submission]) -> list[Shown]:
    """Return the boards, in order of version and protocol."""
    found = []
    for rows, board in leaderboard.boards(submissions):
        found.append(Shown(rows, board, None))
        if board is not None:
            under = {protocol: list(_under(board, protocol)) for protocol in board.protocols}
            found += [Shown(ranking.ranked(mine), board, p) for p, mine in under.items() if mine]
    return found


def _under(board: Board, protocol: str) -> Iterator[Submission]:
    """Yield who is scored under a protocol, with the times of the protocol ``grouped``."""
    ran = {one.slug: one for one in board.held_out.get(protocol, ())}
    for row in board.rows:
        model = row.submission
        if own := ran.get(model.slug):
            result = {**own.result, "cost": model.result["cost"]}
            yield dataclasses.replace(own, result=result)
        elif untrained(model.result["model"]) and _is_known(board, model, protocol):
            yield restricted(model, generalisation.tested(board.version, protocol))


def _is_known(board: Board, model: Submission, protocol: str) -> bool:
    return board.cell(model, protocol, RANKED_BY).score is not None


def restricted(model: Submission, wanted: Truth) -> Submission:
    """Return a submission as if it had been asked about some of its instances only."""
    found = generalisation.predicted(model, wanted)
    result = {
        **model.result,
        "dataset": results.dataset_facts(wanted),
        "scores": scores.score(wanted, found),
    }
    return dataclasses.replace(model, result=result, truth=wanted, predictions=found)


def told(board: Shown) -> dict[str, Any]:
    """Return what the page shows of a board."""
    groups = columns.groups(board.rows, board.protocols, board.own)
    fixed = columns.fixed()
    known = {column.key: column for group in groups for column in group.columns}
    every = [*fixed, *known.values()]
    return {
        "key": board.key,
        "kind": "board",
        "title": results.title(board.rows[0].submission.result),
        "notes": _notes(board),
        "floors": _floors(board.truth),
        "columns": {column.key: column.told() for column in every},
        "groups": [
            {"key": g.key, "title": g.title, "columns": [c.key for c in g.columns]} for g in groups
        ],
        "rows": [
            {
                "slug": row.submission.slug,
                "name": row.submission.name,
                "kind": row.submission.result["model"]["kind"],
                "training": results.declared(row.submission.result, "training_data"),
                "setting": results.setting(row.submission.result),
                "ms": number_of(row.submission.result["cost"]["ms_per_mesh"]),
                "cells": {column.key: column.cell(row) for column in every},
            }
            for row in board.rows
        ],
    }


def _notes(board: Shown) -> list[str]:
    notes = [note.strip() for note in (*page.introduction(board.rows), *page.remarks(board.rows))]
    if board.own is None:
        return notes
    return [*notes, f"**Generalisation**: {generalisation.EXPLAINED}"]


def _floors(truth: Truth) -> dict[str, Any]:
    """Return the noise floor of each metric, as number and text."""
    found = {key: noise.floor(truth, key) for key in MAIN}
    return {
        key: [number_of(value), score(value, key)]
        for key, value in found.items()
        if value is not None
    }
