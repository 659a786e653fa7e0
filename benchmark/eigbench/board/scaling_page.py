"""The section Scaling of LEADERBOARD.md, the same to the byte whatever the order of its rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from eigbench.board import scaling_figure as scaling_figure
from eigbench.board.markdown import cell as escaped
from eigbench.board.markdown import table
from eigbench.board.tables import family_title, number
from eigbench.scaling import scores as scaling_scores
from eigbench.scaling import surfaces
from eigbench.scaling.results import Scaled
from eigbench.scaling.scores import Cell, Verdict
from synthnet.store.files import sha256

FIGURE = Path("benchmark", "figures", "scaling.svg")


def section(rows: Sequence[Scaled]) -> tuple[list[str], dict[Path, str]]:
    """Return the parts of the section, and the text of its figure; both empty without rows."""
    if not rows:
        return [], {}
    sizes = scaling_scores.sizes(rows)
    by_setting = scaling_scores.settings(rows)
    parts = [
        "## Scaling\n",
        f"{introduction(sizes)}\n",
    ]
    for label, mine in by_setting.items():
        verdicts = [scaling_scores.verdict(mine, size) for size in sizes]
        parts += [
            f"### Scaling: {escaped(label)}\n",
            *told(verdicts, mine),
            _main(mine, sizes),
            "The same answers against the spectrum of the surface instead of the mesh's. In "
            "brackets: the ms that the fastest exact solver takes on a mesh just fine enough for "
            "that error, interpolated between the sizes; making such a mesh is not counted.\n",
            _distances(mine, sizes, verdicts),
        ]
    parts += [
        f"![Time and error against vertices]({FIGURE.as_posix()})\n",
        "### Scaling: peak memory\n",
        "MB of the process, its libraries included.\n",
        _memory(rows, sizes),
        "### Scaling: LaPy beside each run\n",
        "ms a mesh, timed in the run of each row on the same meshes, up to "
        f"{surfaces.TIMED_BESIDE:,} vertices: how fast the machine was then.\n",
        _beside(rows, [size for size in sizes if size <= surfaces.TIMED_BESIDE]),
        "SHA-256 of the files:\n",
        table(["model", "result"], [[r.name, sha256(r.path)] for r in _sorted(rows)], left=2),
    ]
    return parts, {FIGURE: scaling_figure.draw(by_setting)}


def introduction(sizes: Sequence[int]) -> str:
    """Return what is measured, and when a prediction wins."""
    return (
        "Where, if anywhere, does prediction beat the exact solver? The same "
        f"{len(surfaces.SURFACES)} surfaces "
        f"({', '.join(family_title(name).lower() for name in surfaces.SURFACES)}) at "
        f"{', '.join(f'{size:,}' for size in sizes)} vertices, one mesh a call "
        "([what is measured](docs/scaling.md)). Medians over the surfaces. Error: mean relative "
        "error of the ten eigenvalues against the label, the exact spectrum of the mesh. The "
        "label itself is off the surface's spectrum too: the discretisation error. A prediction "
        "wins if it is nearer to the label than that, faster than the fastest exact solver, and "
        "faster than that solver on a coarser mesh just as far from the surface's spectrum; one "
        "further off is a trade. Times are compared within one hardware, device and number of "
        "threads only."
    )


def _sorted(rows: Sequence[Scaled]) -> list[Scaled]:
    return sorted(rows, key=lambda row: row.slug)


def ordered(rows: Sequence[Scaled], size: int) -> list[Scaled]:
    """Return the rows, fastest first at a size; those without a time there last."""

    def key(row: Scaled) -> tuple[bool, float, str]:
        seconds = scaling_scores.cell(row, size).seconds
        return not seconds >= 0, seconds if seconds >= 0 else 0.0, row.slug

    return sorted(rows, key=key)


def told(verdicts: Sequence[Verdict], rows: Sequence[Scaled]) -> list[str]:
    """Return the answer in a sentence, and what it rests on for each size."""
    names = {row.slug: row.name for row in rows}
    kinds = {row.slug: row.result["model"]["kind"] for row in rows}
    won = []
    for one in verdicts:
        winners = [
            f"{names[slug]} ({kinds[slug]}, {wins} of {one.compared})"
            for slug, (_, wins) in one.faster.items()
            if wins
        ]
        if winners:
            won.append(f"at {one.size:,} vertices {', '.join(winners)}")
    elsewhere = " At no other size." if len(won) < len(verdicts) else ""
    if not any(one.compared for one in verdicts):
        answer = "no exact solver was run in this setting, so nothing can be said."
    elif won:
        answer = (
            "faster than the fastest exact solver, also on a coarser mesh that is as good, and "
            "nearer to the label than the label is to the surface's spectrum (kind, on how many "
            f"surfaces): {'; '.join(won)}.{elsewhere}"
        )
    else:
        answer = (
            "nowhere. No prediction is faster than the fastest exact solver, also on a coarser "
            "mesh that is as good, and nearer to the label than the label is to the surface's "
            "spectrum."
        )
    lines = [_line(one, names, rows) for one in verdicts]
    return [
        f"**Where prediction beats the exact solver**: {escaped(answer)}\n",
        "\n".join(lines) + "\n",
        *(f"**{escaped(row.name)}**: {escaped(row.remark)}\n" for row in rows if row.remark),
    ]


def _line(one: Verdict, names: dict[str, str], rows: Sequence[Scaled]) -> str:
    own = percent(scaling_scores.floor(one.size))
    start = f"- {one.size:,} vertices, discretisation error {own}: "
    cells = {row.slug: scaling_scores.cell(row, one.size) for row in rows}
    absent = "; ".join(names[slug] for slug, found in cells.items() if not found.total)
    not_run = f" Not run: {absent}." if absent else ""
    if one.solver is None:
        return start + escaped(f"no exact solver answered.{not_run}")
    text = f"the fastest exact solver (mostly {one.solver}) takes {ms(one.seconds)} ms"
    if one.compared < len(surfaces.SURFACES):
        text += f" ({one.compared} of {len(surfaces.SURFACES)} surfaces)"
    faster = [
        f"{names[slug]} ({ms(cells[slug].seconds)} ms, error {percent(cells[slug].error)})"
        for slug in sorted(one.faster, key=lambda slug: (cells[slug].error, slug))
    ]
    text += f". Faster, on some surface: {', '.join(faster) or 'none'}."
    return start + escaped(text + not_run)


def percent(value: float) -> str:
    """Return a share in per cent."""
    return f"{number(100 * value, 3)} %"


def ms(seconds: float) -> str:
    """Return seconds in milliseconds."""
    return number(1e3 * seconds, 2)


def with_failures(one: Cell, text: str) -> str:
    """Return a number with what it leaves out: surfaces that were not answered."""
    if not one.total:
        return "not run"
    if not one.answered:
        return ", ".join(one.failures)
    whole = one.answered == len(surfaces.SURFACES)
    return text if whole else f"{text} ({one.answered} of {len(surfaces.SURFACES)})"


def _main(rows: Sequence[Scaled], sizes: Sequence[int]) -> str:
    headers = ["model", "kind"]
    for size in sizes:
        headers += [f"{size:,}: error", "ms"]
    own = ["discretisation error of the meshes", ""]
    for size in sizes:
        own += [percent(scaling_scores.floor(size)), ""]
    lines = []
    for row in ordered(rows, sizes[0]):
        line = [row.name, row.result["model"]["kind"]]
        for size in sizes:
            one = scaling_scores.cell(row, size)
            line += [
                with_failures(one, percent(one.error)),
                with_failures(one, ms(one.seconds)),
            ]
        lines.append(line)
    return table(headers, [own, *lines], left=2)


def _by_size(
    rows: Sequence[Scaled], sizes: Sequence[int], text: Callable[[Cell], str]
) -> list[list[str]]:
    found = []
    for row in _sorted(rows):
        cells = [scaling_scores.cell(row, size) for size in sizes]
        found.append([row.name, *(with_failures(one, text(one)) for one in cells)])
    return found


def _distances(rows: Sequence[Scaled], sizes: Sequence[int], verdicts: Sequence[Verdict]) -> str:
    own = ["the labels", *(with_coarse(verdicts, scaling_scores.floor(size)) for size in sizes)]
    lines = _by_size(rows, sizes, lambda one: with_coarse(verdicts, one.distance))
    return table(["model", *(f"{size:,}" for size in sizes)], [own, *lines])


def with_coarse(verdicts: Sequence[Verdict], distance: float) -> str:
    """Return an error, and the ms of an exact solver on a mesh just fine enough for it."""
    side, seconds = scaling_scores.coarse_seconds(verdicts, distance)
    return percent(distance) + (f" ({side}{ms(seconds)})" if seconds > 0 else "")


def _memory(rows: Sequence[Scaled], sizes: Sequence[int]) -> str:
    lines = _by_size(rows, sizes, lambda one: f"{one.peak_memory_mb:,.0f}")
    return table(["model", *(f"{size:,}" for size in sizes)], lines)


def _beside(rows: Sequence[Scaled], sizes: Sequence[int]) -> str:
    lines = []
    for row in _sorted(rows):
        found = [lapys_seconds(row, size) for size in sizes]
        lines.append([row.name, *("not run" if one is None else ms(one) for one in found)])
    return table(["model", *(f"{size:,}" for size in sizes)], lines)


def lapys_seconds(row: Scaled, size: int) -> float | None:
    """Return the median time of LaPy in a row's run at a size, in seconds."""
    found = [
        one["reference_seconds"]
        for (_, at), one in row.meshes.items()
        if at == size and one["reference_seconds"] is not None
    ]
    return float(np.median(found)) if found else None
