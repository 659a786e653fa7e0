"""The columns of a board, for LEADERBOARD.md and for the page."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from eigbench.board import cost_columns, generalisation, tables
from eigbench.board.columns import (
    DECLARED,
    Cell,
    Column,
    Group,
    of_run,
    of_score,
    six_digits,
    words,
)
from eigbench.board.generalisation import Board
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.scoring.metrics import MAIN, METRICS
from eigbench.scoring.names import MESH
from eigbench.scoring.physics import SHARES, TITLES

PHYSICS_NOTES = {
    "scale_2": "A mesh twice as large must have a quarter of the eigenvalues.",
    "scale_half": "A mesh half as large must have four times the eigenvalues.",
    "rotation": "A rotated mesh must have the same eigenvalues.",
    "reflection": "A mirrored mesh must have the same eigenvalues.",
    "permutation": "The numbering of vertices and faces must not matter.",
    "triangulation": "Each triangle is split into four: the surface stays the same, though the "
    "eigenvalues of an exact solver change a little.",
    "positive": "Share of probe shapes whose predicted eigenvalues are all positive.",
    "ascending": "Share of probe shapes whose predicted eigenvalues ascend.",
}
FAMILIES_BY = ("invlap", "rpd", "psnr20")


def _result(row: Ranked) -> dict[str, Any]:
    return row.submission.result


def _order(row: Ranked) -> int | None:
    """Return what rows are sorted by, by rank: exact ones are first, declared ones last."""
    if row.declared:
        return None
    return row.ranks[0] if row.ranks else 0


RANK: Column[Ranked] = Column(
    "rank",
    "rank",
    f"By mean {METRICS[RANKED_BY].title}: the ranks that the row may have, at 95 %, from paired "
    "differences to every other ranked row. Exact rows stand above the ranking: nothing but "
    "rounding sets them apart from the target.",
    lambda row: (row.shown_rank, _order(row)),
    numeric=False,
)
MODEL, KIND, HARDWARE, TRAINING = of_run(_result)


def main(rows: Sequence[Ranked]) -> Group[Ranked]:
    """Return all metrics, for a board's own page."""
    cost = [cost_columns.parameters(), *cost_columns.speed(rows)]
    return Group("main", "Scores", [*map(_mean, MAIN), *cost, HARDWARE, TRAINING, _seeds()])


def short(rows: Sequence[Ranked]) -> Group[Ranked]:
    """Return the table of LEADERBOARD.md: what decides, on one screen."""
    scored = [_mean(RANKED_BY), _by_family(), _mean("psnr20")]
    return Group("short", "Board", [*scored, *cost_columns.ratios(rows), TRAINING, _seeds()])


def top(rows: Sequence[Ranked]) -> Group[Ranked]:
    """Return the table of the README."""
    return Group("top", "Top", [_mean(RANKED_BY), _mean("psnr20"), *cost_columns.ratios(rows)])


def overview(rows: Sequence[Ranked], board: Board | None, protocol: str | None) -> Group[Ranked]:
    """Return what the page shows first: fewer columns, and the drop where something is held out."""
    drops = [] if board is None or protocol is None else generalisation.drops(board, protocol)
    metrics = [_mean(RANKED_BY), _by_family(), *drops, _mean("invlap"), _mean("psnr20")]
    cost = [*cost_columns.speed(rows, protocol), cost_columns.parameters()]
    return Group("overview", "Overview", [*metrics, *cost, TRAINING, _seeds()])


def held_out(board: Board, protocol: str) -> Group[Ranked]:
    """Return the table of a version's own protocol: its scores, and the drop."""
    drops = generalisation.drops(board, protocol)
    columns = [_mean(RANKED_BY), *drops, _mean("psnr20"), _seeds()]
    return Group(f"protocol-{protocol}", generalisation.title(protocol), columns)


def groups(rows: Sequence[Ranked], protocol: str | None = None) -> list[Group[Ranked]]:
    """Return the tables below the main one.

    ``protocol`` is the version's own that the rows are of, which has no times and physics of its
    own; ``None`` for a protocol that all versions have.
    """
    median_note = (
        "The median over instances. InvLap has no upper bound, so one bad prediction can dominate "
        "its mean; PSNR is in dB, and infinite where a prediction is exact."
    )
    interval_note = (
        "95 % percentile-bootstrap intervals of the means; where an interval is not symmetric, ± "
        "gives only half its width."
    )
    medians = [_median(key) for key in METRICS if key != "psnr20"]
    scored = [
        Group("medians", "Medians", medians, median_note),
        Group("intervals", "Intervals", [_interval(key) for key in MAIN], interval_note),
        *(_families(rows, key) for key in FAMILIES_BY),
        Group("indices", "Relative error by eigenvalue", _indices(rows), "Mean of |p − g| / g."),
    ]
    if protocol is not None:
        return scored
    again = [_verified()] if rows[0].submission.target == MESH and any(map(_said, rows)) else []
    return [*scored, *again, cost_columns.table(rows), _physics()]


def _of_metric(
    key: str, suffix: str, note: str, cell: Callable[[dict[str, float | None]], Cell]
) -> Column[Ranked]:
    """Return a column of a metric's scores over all instances."""
    metric = METRICS[key]
    return Column(
        key + suffix,
        metric.heading,
        note,
        lambda row: cell(row.scores["overall"][key]),
        higher=metric.higher_is_better,
    )


def _mean(key: str) -> Column[Ranked]:
    note = (
        f"{METRICS[key].note} Mean over instances ± half the 95 % interval over shapes and seeds; "
        "in brackets the standard deviation over seeds."
    )
    return _of_metric(
        key, "", note, lambda cell: (tables.with_uncertainty(cell, key), six_digits(cell["mean"]))
    )


def _number(key: str, number: str, suffix: str, note: str) -> Column[Ranked]:
    """Return a column of one number of a metric: ``mean``, ``median`` or ``by_family``."""
    return _of_metric(key, suffix, note, lambda cell: of_score(cell[number], key))


def _by_family() -> Column[Ranked]:
    """Return the mean over families of the metric that ranks go by."""
    note = f"{METRICS[RANKED_BY].note} Mean over families of their means: all weigh the same."
    column = _number(RANKED_BY, "by_family", "-by-family", note)
    return replace(column, title=f"{column.title}, macro average")


def _median(key: str) -> Column[Ranked]:
    return _number(key, "median", "-median", f"Median over instances. {METRICS[key].note}")


def _interval(key: str) -> Column[Ranked]:
    note = f"95 % percentile-bootstrap interval of the mean over shapes. {METRICS[key].note}"
    return _of_metric(
        key,
        "-interval",
        note,
        lambda cell: (tables.interval(cell["low"], cell["high"], key), six_digits(cell["low"])),
    )


def _families(rows: Sequence[Ranked], key: str) -> Group[Ranked]:
    metric = METRICS[key]
    counts = rows[0].scores["families"]

    def column(name: str) -> Column[Ranked]:
        count = f"{counts[name]['count']:,}"
        return Column(
            f"{key}-{name}",
            tables.family_title(name),
            f"Mean {metric.title} over the {count} instances of this family. {METRICS[key].note}",
            lambda row: of_score(row.scores["families"][name][key]["mean"], key),
            higher=metric.higher_is_better,
            lead=count,
        )

    columns = [column(name) for name in tables.in_order(counts)]
    return Group(f"families-{key}", f"{metric.heading} by family", columns, lead="instances")


def _indices(rows: Sequence[Ranked]) -> list[Column[Ranked]]:
    def column(i: int) -> Column[Ranked]:
        def cell(row: Ranked) -> Cell:
            value = row.scores["per_index"][i]["mean"]
            return tables.error(value), six_digits(value)

        note = f"Mean relative error |p − g| / g of the non-zero eigenvalue number {i + 1}."
        return Column(f"index-{i + 1}", f"λ{i + 1}", note, cell)

    return [column(i) for i in range(len(rows[0].scores["per_index"]))]


def _seeds() -> Column[Ranked]:
    def seeds(row: Ranked) -> Cell:
        count = row.submission.result["predictions"]["seeds"]
        return str(count), count

    return Column("seeds", "seeds", "Runs with other random numbers; their mean is shown.", seeds)


def _said(row: Ranked) -> dict[str, Any] | None:
    """Return what a row says of its verification, if it is verified."""
    return _result(row).get("verified")


def _verified() -> Group[Ranked]:
    """Return what came of it when the code of the rows was run again, against the mesh."""

    def column(
        key: str, title: str, note: str, cell: Callable[[dict[str, Any]], Cell]
    ) -> Column[Ranked]:
        def of_row(row: Ranked) -> Cell:
            said = _said(row)
            return ("not verified", None) if said is None else cell(said)

        return Column(f"verified-{key}", title, note, of_row, numeric=key != "date")

    def scored(scores: dict[str, Any]) -> Cell:
        shown = tables.with_uncertainty({**scores, "seed_std": None}, RANKED_BY)
        return shown, six_digits(scores["mean"])

    def drawn(said: dict[str, Any]) -> Cell:
        count = said["sealed"]["instances"]
        return f"{count:,}", count

    heading, about = METRICS[RANKED_BY].heading, METRICS[RANKED_BY].note
    same = f"{about} On the same split, by the same code."
    fresh = f"{about} On surfaces that were drawn for this run and removed after it."
    columns = [
        column("again", f"{heading} run again", same, lambda said: scored(said["scores"][MESH])),
        column("fresh", f"{heading} on a fresh draw", fresh, lambda said: scored(said["sealed"])),
        column("drawn", "meshes of the draw", "Instances of the fresh draw.", drawn),
        column("date", "date", "When it was verified.", lambda said: words(said["date"])),
    ]
    note = (
        "`eigbench verify-row` has run the code again, on the test split and on a fresh draw: "
        "surfaces of the same recipe, from a seed that nobody knows. A model that knew the public "
        "test shapes would do worse there. A draw has fewer shapes than the split, and each "
        "command draws its own, so compare a row with itself."
    )
    return Group("verified", "Verified", columns, note)


def _physics() -> Group[Ranked]:
    def column(key: str) -> Column[Ranked]:
        def cell(row: Ranked) -> Cell:
            value = row.submission.result["physics"][key]
            return tables.deviation(key, value), six_digits(value)

        measured = "" if key in SHARES else " Median relative deviation on probe shapes."
        note = f"{PHYSICS_NOTES[key]}{measured} {DECLARED}"
        return Column(f"physics-{key}", TITLES[key], note, cell, higher=key in SHARES)

    note = (
        "Median relative deviation on probe shapes from the laws that every spectrum obeys, and "
        "the share of spectra that are positive and ascending."
    )
    return Group("physics", "Physics", [column(key) for key in TITLES], note)
