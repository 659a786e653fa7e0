"""The page of a model: where it stands on every board, by how much, and how to run it again."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from eigbench.board import page
from eigbench.board.columns import Cell, of_score, six_digits
from eigbench.board.cost_columns import ratios
from eigbench.board.ranked_columns import KIND
from eigbench.board.ranking import RANKED_BY, PairedDifference, Ranked, count_ranked
from eigbench.board.tables import deviation, family_title, in_order, with_uncertainty
from eigbench.results import sources
from eigbench.results.submission import Submission
from eigbench.scaling.results import Scaled
from eigbench.scoring.physics import SHARES, TITLES
from eigbench.scoring.training import on_imports
from eigbench.site import scaling
from eigbench.site.boards import Shown
from synthnet import recipe

SMALLEST = 1e-6  # a deviation from a law that fills its ray of the radar; 1 leaves it empty


def contents(shown: Sequence[Shown], scaled: Sequence[Scaled]) -> dict[str, dict[str, Any]]:
    """Return what the page of each model shows, by its slug."""
    rows: dict[str, list[tuple[Shown, Ranked]]] = {}
    for board in shown:
        for row in board.rows:
            rows.setdefault(row.submission.slug, []).append((board, row))
    names = {slug: mine[0][1].submission.name for slug, mine in rows.items()}
    models = {slug: _ranked(mine, names) for slug, mine in rows.items()}
    for entry in scaled:
        if entry.slug not in models:
            models[entry.slug] = _only_scaled(entry)
        where = {"board": scaling.KEY, "dataset": "Scaling track", "title": "one mesh a call"}
        models[entry.slug]["standings"].append({**where, "rank": "", "cells": ["", "", ""]})
        again = f"eigbench scale {sources.CODE}/{entry.result['model']['code']}"
        models[entry.slug]["command"][scaling.KEY] = again
    return models


def _ranked(mine: Sequence[tuple[Shown, Ranked]], names: Mapping[str, str]) -> dict[str, Any]:
    """Return what is known of a model that stands on boards."""
    # Not under a version's own protocol, which has no physics of its own
    first = next((row for board, row in mine if board.own is None), mine[0][1])
    return {
        "name": first.submission.name,
        "kind": KIND.cell(first)[0],
        "standings": [_standing(board, row) for board, row in mine],
        "families": list(_families(mine)),
        "physics": _physics(first.submission),
        "command": {board.key: command(row.submission) for board, row in mine},
        "apart": {
            board.key: [_apart(other, names[other.slug]) for other in row.apart]
            for board, row in mine
        },
    }


def _apart(other: PairedDifference, name: str) -> list[object]:
    """Return how far another row is from the model."""
    ends = map(six_digits, (other.mean, other.low, other.high))
    return [other.slug, name, *ends, other.sure]


def _only_scaled(row: Scaled) -> dict[str, Any]:
    """Return what is known of a model that only the scaling track has."""
    named = {"name": row.name, "kind": row.result["model"]["kind"]}
    return {**named, "standings": [], "families": [], "physics": [], "command": {}, "apart": {}}


def _standing(board: Shown, row: Ranked) -> dict[str, Any]:
    """Return a line of the card: a board, and the model's numbers there."""
    overall = row.scores["overall"]
    ratio, *_ = ratios([row])
    shown = [with_uncertainty(overall[key], key) for key in (RANKED_BY, "psnr20")]
    return {
        "board": board.key,
        "dataset": recipe.title(board.truth.version),
        "title": board.short,
        "rank": row.shown_rank,
        "of": count_ranked(board.rows),
        "cells": [*shown, ratio.cell(row)[0]],
    }


def _families(mine: Sequence[tuple[Shown, Ranked]]) -> Iterator[dict[str, Any]]:
    """Yield the heat strips: means of families, one line per protocol, by version and target."""
    strips: dict[tuple[str, str], list[tuple[Shown, Ranked]]] = {}
    for board, row in mine:
        if on_imports(board.truth.protocol):
            continue  # its shapes are of no family
        strips.setdefault((board.truth.version, board.truth.target), []).append((board, row))
    for (version, target), lines in strips.items():
        families = in_order({name for _, row in lines for name in row.scores["families"]})
        yield {
            "title": f"{recipe.title(version)}, {page.NAMES[target]}",
            "families": [family_title(name) for name in families],
            "lines": [
                {
                    "board": board.key,
                    "title": board.protocol,
                    "cells": [_family(row, name) for name in families],
                }
                for board, row in lines
            ],
        }


def _family(row: Ranked, name: str) -> Cell:
    """Return the mean of a family; one that a protocol does not test is empty."""
    if name not in row.scores["families"]:
        return "", None
    return of_score(row.scores["families"][name][RANKED_BY]["mean"], RANKED_BY)


def _physics(submission: Submission) -> list[dict[str, Any]]:
    """Return how well the model keeps to each law: as text, and from 0 to 1."""
    measured = submission.result["physics"]
    return [
        {"title": title, "text": deviation(key, measured[key]), "kept": _kept(key, measured[key])}
        for key, title in TITLES.items()
    ]


def _kept(key: str, value: float | None) -> float:
    """Return how well a law is kept: a share, or a deviation on a logarithmic scale.

    Examples
    --------
    >>> _kept("rotation", 1e-3), _kept("rotation", 0.0), _kept("positive", 0.25)
    (0.5, 1.0, 0.25)
    """
    if value is None:
        return 0.0
    if key in SHARES:
        return value
    kept = math.log(max(value, SMALLEST)) / math.log(SMALLEST)
    return round(max(0.0, kept), 6)


def command(submission: Submission) -> str:
    """Return the command that makes a row again."""
    result = submission.result
    facts = result["dataset"]
    named = f"--dataset {facts['version']} --protocol {facts['protocol']}"
    seeds = result["predictions"]["seeds"]
    counts = f"--batch-size {submission.batch_size}" + (f" --seeds {seeds}" if seeds > 1 else "")
    return f"eigbench evaluate {sources.CODE}/{result['model']['code']} {named} {counts}"
