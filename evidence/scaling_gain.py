"""How much longer the exact solver takes for the errors of rows that win on the scaling track."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from eigbench.board.scaling_columns import ms, percent
from eigbench.scaling import results, scores, surfaces
from eigbench.scaling.results import Scaled
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
    exact = {surface: scores.exact_seconds(rows, surface) for surface in surfaces.SURFACES}
    found = []
    for size in scores.sizes(rows):
        wins = scores.verdict(rows, size).wins
        winners = [r for r in rows if wins.get(r.slug, 0) > len(surfaces.SURFACES) / 2]
        for without in (True, False):
            some = [r for r in winners if untrained(r.result["model"]) == without]
            gains = sorted((_gain(row, size, exact) for row in some), reverse=True)
            found += [cells for _, cells in gains[:1]]
    return found


def _gain(
    row: Scaled, size: int, exact: Mapping[str, Mapping[int, float]]
) -> tuple[float, list[str]]:
    """Return how many times as long the solver takes as a row, and the row's cells.

    ``exact`` has the solver's seconds by surface and size.
    """
    medians = scores.medians(row, size)
    solver, times, beyond = [], [], []
    for surface, known in exact.items():
        mesh = row.meshes[surface, size]
        if known and mesh["outcome"] == results.ANSWERED:
            distance = scores.distance(mesh)
            solver.append(scores.equal_seconds(surface, known, distance))
            times.append(solver[-1] / scores.seconds(mesh))
            beyond.append(distance < surfaces.pinned(surface, max(known)).discretisation_error)
    gain = float(np.median(times))
    # A solver's time for an error below that on the finest mesh is not known, but that it is longer
    side = "> " if np.mean(beyond) >= 0.5 else ""
    cells = [percent(medians.distance), ms(medians.seconds)]
    cells += [f"{side}{ms(float(np.median(solver)))}", f"{side}{gain:,.1f}"]
    return gain, [f"{size:,}", row.name, *cells]
