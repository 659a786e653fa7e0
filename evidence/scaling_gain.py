"""How much longer the exact solver takes for the errors of rows that win on the scaling track."""

from __future__ import annotations

from collections.abc import Sequence

from eigbench.board.scaling_columns import ms, percent
from eigbench.scaling import results, scores, surfaces
from eigbench.scaling.results import Scaled
from eigbench.scaling.scores import Equal
from eigbench.scoring.training import untrained

from evidence import ROOT, markdown

HEADERS = ["vertices", "row", "error to the surface", "ms", "the solver's ms", "times as long"]


def table() -> str:
    """Return the table, of the machine that most rows of the board were run on."""
    return markdown.table(HEADERS, lines(_rows()), "rlrrrr")


def answer() -> str:
    """Return at which sizes rows win on most surfaces, of the same machine."""
    return sentence(_rows())


def sentence(rows: Sequence[Scaled]) -> str:
    """Return at which sizes trained and other rows win on more than half of the surfaces."""
    sizes = scores.sizes(rows)
    winners = [_winners(rows, size) for size in sizes]
    won = {
        kind: [size for size, some in zip(sizes, winners, strict=True) if some[kind]]
        for kind in ("untrained", "trained")
    }
    if won["untrained"] == won["trained"]:
        won = {"untrained and trained": won["trained"]}
    parts = [f"{kind} rows do so {_at(some, sizes)}" for kind, some in won.items()]
    return f"on most of the surfaces, {', '.join(parts)}."


def _at(some: Sequence[int], sizes: Sequence[int]) -> str:
    if not some:
        return "at no size"
    if len(some) == len(sizes):
        return "at every size"
    *first, last = [f"{size:,}" for size in some]
    return f"at {', '.join(first)} and {last} vertices" if first else f"at {last} vertices"


def _rows() -> Sequence[Scaled]:
    settings = scores.settings(results.read_board(ROOT))
    return max(settings.values(), key=len)


def _winners(rows: Sequence[Scaled], size: int) -> dict[str, list[Scaled]]:
    """Return the untrained and the trained rows that win on more than half of the surfaces."""
    wins = scores.verdict(rows, size).wins
    winners: dict[str, list[Scaled]] = {"untrained": [], "trained": []}
    for row in rows:
        if wins.get(row.slug, 0) > len(surfaces.SURFACES) / 2:
            winners["untrained" if untrained(row.result["model"]) else "trained"].append(row)
    return winners


def lines(rows: Sequence[Scaled]) -> list[list[str]]:
    """Return for each size the untrained and the trained row whose error costs the solver most.

    Only rows count that win on more than half of the surfaces. All numbers are medians over the
    surfaces that a row answered; what its error costs the solver is a multiple of its own time.
    """
    exact = scores.exact_seconds(rows)
    found = []
    for size in scores.sizes(rows):
        for winners in _winners(rows, size).values():
            gains = [(scores.equal(row, size, exact), row) for row in winners]
            found += [
                _cells(row, size, equal)
                for equal, row in sorted(gains, key=lambda of: -of[0].gain.value)[:1]
            ]
    return found


def _cells(row: Scaled, size: int, equal: Equal) -> list[str]:
    medians = scores.medians(row, size)
    times = (
        equal.seconds.side + ms(equal.seconds.value),
        equal.gain.side + f"{equal.gain.value:,.1f}",
    )
    return [f"{size:,}", row.name, percent(medians.distance), ms(medians.seconds), *times]
