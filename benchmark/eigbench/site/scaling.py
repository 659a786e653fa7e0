"""The scaling track on the page: its board, what a row opens to, and its charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from eigbench.board import scaling_columns, scaling_page
from eigbench.board.columns import Group, six_digits
from eigbench.board.scaling_columns import HARDWARE, TRAINING, ms, percent
from eigbench.board.scaling_figure import FASTEST
from eigbench.board.tables import family_title
from eigbench.scaling import panels, scores, surfaces
from eigbench.scaling.panels import Panel
from eigbench.scaling.results import ANSWERED, Scaled
from eigbench.scaling.scores import Verdict
from eigbench.site import columns, origin
from synthnet.store.files import sha256

KEY, TITLE = "scaling", "scaling track"


def content(rows: Sequence[Scaled]) -> dict[str, Any]:
    """Return what the page shows of the scaling track."""
    sizes = scores.sizes(rows)
    notes, shown, charts = [scaling_page.introduction(sizes)], [], []
    for label, mine in scores.settings(rows).items():
        verdicts = [scores.verdict(mine, size) for size in sizes]
        groups = _groups(sizes, mine)
        every = columns.of(groups)
        notes += [f"**{label}**", *(part.strip() for part in scaling_page.answers(verdicts, mine))]
        shown += [
            columns.entry(row, row.slug, row.result, every)
            for row in scaling_page.ordered(mine, sizes[0])
        ]
        charts += [
            _panel(label, mine, panels.panel(mine, verdicts, verdict.size), verdict)
            for verdict in verdicts
        ]
    return {
        "key": KEY,
        "kind": "scaling",
        "title": "Scaling: error and speed at each number of vertices",
        "notes": notes,
        "fastest": FASTEST,
        "panels": charts,
        "columns": columns.heads(every),
        "groups": columns.views(groups),
        "rows": shown,
    }


def _panel(label: str, rows: Sequence[Scaled], panel: Panel, verdict: Verdict) -> dict[str, Any]:
    """Return a chart of one size: the models, the exact solver, and where a prediction can win."""
    points = [
        {
            "slug": row.slug,
            "speed": six_digits(panel.lapy_seconds / middle.seconds),
            "error": six_digits(middle.distance),
            "shown": percent(middle.distance),
            "answered": middle.answered,
            "wins": verdict.wins.get(row.slug, 0),
        }
        for row in rows
        if (middle := scores.medians(row, panel.size)).answered
    ]
    return {
        "setting": label,
        "size": panel.size,
        "surfaces": len(surfaces.SURFACES),
        "points": points,
        "solver": [[six_digits(x), six_digits(y)] for x, y in panel.solver],
        "border": [[six_digits(x), six_digits(y)] for x, y in panel.border],
    }


def _groups(sizes: Sequence[int], rows: Sequence[Scaled]) -> list[Group[Scaled]]:
    """Return the views of the page's table; the first and the last have what the run declared."""
    overview, *others, last = scaling_columns.groups(sizes, rows).values()
    first = replace(overview, columns=[*overview.columns, TRAINING])
    return [first, *others, replace(last, columns=[*last.columns, HARDWARE])]


def opened(row: Scaled, code: str) -> dict[str, Any]:
    """Return what the page shows of a row of the scaling track when it is opened."""
    sizes = scores.sizes([row])
    headers = [
        "surface",
        *(f"{size:,}: {what}" for size in sizes for what in ("error to the surface", "ms")),
    ]
    lines = [
        [family_title(surface), *(text for size in sizes for text in _of_mesh(row, surface, size))]
        for surface in surfaces.SURFACES
    ]
    files = [["result, SHA-256", sha256(row.path)], *map(list, row.result["environment"].items())]
    return {
        "facts": origin.facts(row.result, row.path, code),
        "verified": False,  # no row of the track can be
        "bibtex": origin.bibtex(row.result, row.path, row.slug, TITLE),
        "tables": [
            {"title": "By surface", "headers": headers, "rows": lines},
            {"title": "Files and versions", "headers": ["", ""], "rows": files},
        ],
        "shapes": [],
    }


def _of_mesh(row: Scaled, surface: str, size: int) -> tuple[str, str]:
    """Return the error to the surface and the ms of a mesh, or why there is none."""
    mesh = row.meshes.get((surface, size))
    if mesh is None:
        return "not run", "not run"
    if mesh["outcome"] != ANSWERED:
        return mesh["outcome"], mesh["outcome"]
    return percent(scores.distance(mesh)), ms(scores.seconds(mesh))
