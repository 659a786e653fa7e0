"""The section Scaling of LEADERBOARD.md, the same to the byte whatever the order of its rows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from eigbench.board import scaling_columns, scaling_figure
from eigbench.board.columns import as_markdown
from eigbench.board.markdown import cell as escaped
from eigbench.board.markdown import table
from eigbench.board.scaling_columns import KIND, MODEL, ms, percent
from eigbench.board.tables import family_title
from eigbench.scaling import scores, surfaces
from eigbench.scaling.results import Scaled
from eigbench.scaling.scores import Verdict
from synthnet.store.files import sha256

FIGURE = Path("benchmark", "figures", "scaling.svg")
BETTER = (
    "faster than the fastest exact solver, also on a coarser mesh that is as good, and nearer to "
    "the label than the label is to the surface's spectrum"
)


def section(rows: Sequence[Scaled]) -> tuple[list[str], dict[Path, str]]:
    """Return the parts of the section, and the text of its figure; both empty without rows."""
    if not rows:
        return [], {}
    sizes = scores.sizes(rows)
    by_setting = scores.settings(rows)
    by_name = sorted(rows, key=lambda row: row.slug)
    parts = ["## Scaling\n", f"{introduction(sizes)}\n"]
    for label, mine in by_setting.items():
        verdicts = [scores.verdict(mine, size) for size in sizes]
        groups = scaling_columns.groups(sizes, verdicts)
        parts += [
            f"### Scaling: {escaped(label)}\n",
            *answers(verdicts, mine),
            as_markdown(groups["overview"], ordered(mine, sizes[0]), (MODEL, KIND)),
            f"{groups['distance'].note}\n",
            as_markdown(groups["distance"], mine, [MODEL]),
        ]
    parts.append(f"![Error to the surface against speed, a panel a size]({FIGURE.as_posix()})\n")
    for key in ("memory", "lapy"):  # the same in every setting
        group = groups[key]
        parts += [
            f"### Scaling: {group.title}\n",
            f"{group.note}\n",
            as_markdown(group, by_name, [MODEL]),
        ]
    digests = [[row.name, sha256(row.path)] for row in by_name]
    parts += ["SHA-256 of the files:\n", table(["model", "result"], digests, [False, False])]
    return parts, {FIGURE: scaling_figure.draw(by_setting)}


def introduction(sizes: Sequence[int]) -> str:
    """Return what is measured, and when a prediction wins."""
    return (
        "Where, if anywhere, does prediction beat the exact solver? The same "
        f"{len(surfaces.SURFACES)} surfaces "
        f"({', '.join(family_title(name).lower() for name in surfaces.SURFACES)}) at "
        f"{', '.join(f'{size:,}' for size in sizes)} vertices, one mesh a call "
        "([what is measured](docs/scaling.md)). Numbers are medians over the surfaces. The error "
        "is the mean relative error of the ten eigenvalues against the label, the exact spectrum "
        "of the mesh. The label itself differs from the surface's spectrum: by the discretisation "
        "error. A prediction wins if it is nearer to the label than that, faster than the fastest "
        "exact solver, and faster than that solver on a coarser mesh just as far from the "
        "surface's spectrum; a faster prediction further off trades accuracy for time. Times are "
        "compared within one hardware, device and number of threads only."
    )


def ordered(rows: Sequence[Scaled], size: int) -> list[Scaled]:
    """Return the rows, fastest first at a size; those without a time there last."""

    def key(row: Scaled) -> tuple[bool, float, str]:
        seconds = scores.medians(row, size).seconds
        return not seconds >= 0, seconds if seconds >= 0 else 0.0, row.slug

    return sorted(rows, key=key)


def answers(verdicts: Sequence[Verdict], rows: Sequence[Scaled]) -> list[str]:
    """Return where prediction beats the exact solver in a sentence, then the facts by size."""
    return [
        f"**Where prediction beats the exact solver.** {escaped(_answer(verdicts, rows))}\n",
        "\n".join(_facts(verdict, rows) for verdict in verdicts) + "\n",
        *(f"**{escaped(row.name)}**: {escaped(row.remark)}\n" for row in rows if row.remark),
    ]


def _answer(verdicts: Sequence[Verdict], rows: Sequence[Scaled]) -> str:
    if not any(verdict.compared for verdict in verdicts):
        return "No exact solver was run in this setting, so nothing can be said."
    by_slug = {row.slug: row for row in rows}
    won = []
    for verdict in verdicts:
        winners = [
            f"{by_slug[slug].name} ({by_slug[slug].result['model']['kind']}, {wins} of "
            f"{verdict.compared})"
            for slug, (_, wins) in verdict.faster.items()
            if wins
        ]
        if winners:
            won.append(f"at {verdict.size:,} vertices {', '.join(winners)}")
    if not won:
        return f"Nowhere: no prediction is {BETTER}."
    elsewhere = " None at another size." if len(won) < len(verdicts) else ""
    return (
        f"The following predictions (kind, number of surfaces) are {BETTER}: "
        f"{'; '.join(won)}.{elsewhere}"
    )


def _facts(verdict: Verdict, rows: Sequence[Scaled]) -> str:
    """Return the line of a size: the exact solver's time, and which models are faster."""
    own = percent(scores.floor(verdict.size))
    start = f"- {verdict.size:,} vertices, discretisation error {own}: "
    medians = {row.slug: scores.medians(row, verdict.size) for row in rows}
    names = {row.slug: row.name for row in rows}
    absent = "; ".join(names[slug] for slug, mine in medians.items() if not mine.total)
    not_run = f" Not run: {absent}." if absent else ""
    if verdict.solver is None:
        return start + escaped(f"no exact solver answered.{not_run}")
    text = f"the fastest exact solver (mostly {verdict.solver}) takes {ms(verdict.seconds)} ms"
    if verdict.compared < len(surfaces.SURFACES):
        text += f" ({verdict.compared} of {len(surfaces.SURFACES)} surfaces)"
    faster = [
        f"{names[slug]} ({ms(medians[slug].seconds)} ms, error {percent(medians[slug].error)})"
        for slug in sorted(verdict.faster, key=lambda slug: (medians[slug].error, slug))
    ]
    text += f". Faster, on some surface: {', '.join(faster) or 'none'}."
    return start + escaped(text + not_run)
