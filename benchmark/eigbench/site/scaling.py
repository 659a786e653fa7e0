"""The scaling track on the page: its board, what a row opens to, and the lines of its charts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from eigbench import results
from eigbench.board import scaling_page as scaling_page
from eigbench.board.scaling_page import ms, percent, with_failures
from eigbench.board.tables import family_title
from eigbench.scaling import scores as scaling_scores
from eigbench.scaling import surfaces
from eigbench.scaling.results import ANSWERED, Scaled
from eigbench.scaling.scores import Verdict
from eigbench.site.columns import SEEN, number_of
from synthnet.store.files import sha256

KEY = "scaling"
HELP = {
    "error": "Mean relative error of the ten eigenvalues against the label, the exact spectrum of "
    "the mesh; median over the surfaces.",
    "ms": "Milliseconds a mesh, one mesh a call; median over the surfaces. To be compared within "
    "one hardware, device and number of threads only.",
    "distance": "Mean relative error against the spectrum of the surface instead of the mesh's; "
    "median over the surfaces. In brackets: the ms that the fastest exact solver takes on a mesh "
    "just fine enough for that error.",
    "memory": "Peak memory in MB of the process, its libraries included; median over the surfaces.",
    "lapy": "LaPy's ms a mesh in the same run, on the same meshes: how fast the machine was then.",
}
TITLES = {"error": "error", "ms": "ms", "distance": "distance", "memory": "MB", "lapy": "ms"}
GROUPS = {
    "overview": ("Error and time", ("error", "ms")),
    "distance": ("Against the surface", ("distance",)),
    "memory": ("Peak memory", ("memory",)),
    "lapy": ("LaPy beside each run", ("lapy",)),
}


def told(rows: Sequence[Scaled]) -> dict[str, Any]:
    """Return what the page shows of the scaling track."""
    sizes = scaling_scores.sizes(rows)
    by_setting = scaling_scores.settings(rows)
    every = {f"{name}-{size}": _column(name, size) for name in TITLES for size in sizes}
    declared = {
        "hardware": _words("hardware", f"Where it was timed. {SEEN}"),
        "training": _words("training set", f"What it was fitted to. {SEEN}"),
    }
    groups = [
        {
            "key": key,
            "title": title,
            "columns": [
                *(f"{name}-{size}" for size in sizes for name in names),
                *(declared if key == "overview" else ()),
            ],
        }
        for key, (title, names) in GROUPS.items()
    ]
    notes, shown = [scaling_page.introduction(sizes)], []
    for label, mine in by_setting.items():
        verdicts = [scaling_scores.verdict(mine, size) for size in sizes]
        notes += [f"**{label}**", *(part.strip() for part in scaling_page.told(verdicts, mine))]
        shown += [_row(row, sizes, verdicts) for row in scaling_page.ordered(mine, sizes[0])]
    return {
        "key": KEY,
        "kind": "scaling",
        "title": "Scaling: error and time against vertices",
        "notes": notes,
        "floors": {},
        "own": [[size, number_of(scaling_scores.floor(size))] for size in sizes],
        "columns": {**every, **declared},
        "groups": groups,
        "rows": shown,
    }


def _column(name: str, size: int) -> dict[str, Any]:
    return {
        "title": f"{size:,}: {TITLES[name]}",
        "help": f"At {size:,} vertices. {HELP[name]}",
        "numeric": True,
        "higher": False,
    }


def _words(title: str, told: str) -> dict[str, Any]:
    return {"title": title, "help": told, "numeric": False, "higher": False}


def _row(row: Scaled, sizes: Sequence[int], verdicts: Sequence[Verdict]) -> dict[str, Any]:
    model = row.result["model"]
    training, setting = results.declared(row.result, "training_data"), results.setting(row.result)
    cells: dict[str, tuple[str, float | str | None]] = {
        "hardware": (setting, setting),
        "training": (training, training),
    }
    points = []
    for size in sizes:
        cell = scaling_scores.cell(row, size)
        for name, shown in _cells(row, size, verdicts).items():
            cells[f"{name}-{size}"] = shown
        points.append(
            {
                "size": size,
                "error": _finite(cell.error),
                "ms": _finite(1e3 * cell.seconds),
                "whole": cell.answered == len(surfaces.SURFACES),
            }
        )
    return {
        "slug": row.slug,
        "name": row.name,
        "kind": model["kind"],
        "training": training,
        "setting": setting,
        "cells": cells,
        "points": points,
    }


def _cells(
    row: Scaled, size: int, verdicts: Sequence[Verdict]
) -> dict[str, tuple[str, float | None]]:
    """Return a row's cells at a size, by the key of :data:`TITLES`."""
    cell = scaling_scores.cell(row, size)
    beside = scaling_page.lapys_seconds(row, size)
    lapys = ("not run", None) if beside is None else (ms(beside), number_of(1e3 * beside))
    if not cell.answered:
        failed = with_failures(cell, ""), None
        return {**dict.fromkeys(TITLES, failed), "lapy": lapys}
    found = {
        "error": (percent(cell.error), cell.error),
        "ms": (ms(cell.seconds), 1e3 * cell.seconds),
        "distance": (scaling_page.with_coarse(verdicts, cell.distance), cell.distance),
        "memory": (f"{cell.peak_memory_mb:,.0f}", cell.peak_memory_mb),
    }
    told = {key: (with_failures(cell, text), _finite(x)) for key, (text, x) in found.items()}
    return {**told, "lapy": lapys}


def _finite(value: float) -> float | None:
    return number_of(value) if np.isfinite(value) else None


def opened(row: Scaled) -> dict[str, Any]:
    """Return what the page shows of a row of the scaling track when it is opened."""
    sizes = scaling_scores.sizes([row])
    model = row.result["model"]
    facts = [
        ["kind", model["kind"]],
        ["training set", results.declared(row.result, "training_data")],
    ]
    headers = ["surface", *(f"{size:,}: {what}" for size in sizes for what in ("error", "ms"))]
    lines = [
        [family_title(surface), *(text for size in sizes for text in _of_mesh(row, surface, size))]
        for surface in surfaces.SURFACES
    ]
    return {
        "facts": facts,
        "tables": [
            {"title": "By surface", "headers": headers, "rows": lines},
            {
                "title": "Files and versions",
                "headers": ["", ""],
                "rows": [
                    ["result, SHA-256", sha256(row.path)],
                    *([name, text] for name, text in row.result["environment"].items()),
                ],
            },
        ],
        "shapes": [],
    }


def _of_mesh(row: Scaled, surface: str, size: int) -> tuple[str, str]:
    one = row.meshes.get((surface, size))
    if one is None:
        return "not run", "not run"
    if one["outcome"] != ANSWERED:
        return one["outcome"], one["outcome"]
    return (
        percent(scaling_scores.error(one)),
        ms(scaling_scores.seconds(one)),
    )
