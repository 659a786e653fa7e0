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
    settings = scores.settings(results.read_board(ROOT))
    return markdown.table(HEADERS, lines(max(settings.values(), key=len)), "rlrrrr")


def lines(rows: Sequence[Scaled]) -> list[list[str]]:
    """Return for each size the untrained and the trained row whose error costs the solver most.

    Only rows count that win on more than half of the surfaces. All numbers are medians over the
    surfaces that a row answered; what its error costs the solver is a multiple of its own time.
    """
    exact = scores.exact_seconds(rows)
    found = []
    for size in scores.sizes(rows):
        wins = scores.verdict(rows, size).wins
        winners = [r for r in rows if wins.get(r.slug, 0) > len(surfaces.SURFACES) / 2]
        for without in (True, False):
            some = [r for r in winners if untrained(r.result["model"]) == without]
            gains = [(scores.equal(row, size, exact), row) for row in some]
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
