"""Columns of a board: what each is called, how it explains itself, and each row's cell in it.

A cell is its text, as in LEADERBOARD.md, and the number that it is sorted by: ``None`` goes last.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from eigbench import results
from eigbench.board import generalisation
from eigbench.board.generalisation import Board
from eigbench.board.page import lapys_own
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.board.tables import (
    SPEED,
    beside_lapy,
    deviation,
    family_title,
    in_order,
    number,
    score,
    with_uncertainty,
)
from eigbench.scoring.metrics import MAIN, METRICS
from eigbench.scoring.physics import SHARES, TITLES

Cell = tuple[str, float | str | None]
SEEN = "The run declared it: it does not follow from the predictions."
METRIC_HELP = {
    "invlap": "Inverse Laplacian: √ Σ (g/p − 1)² of prediction p and label g. No upper bound: one "
    "prediction that is too small can make the mean.",
    "rpd": "Relative percent difference: Σ |p − g| / (|p| + |g|), from 0 to 10. Ranks go by it.",
    "polar": "1 − cosine of the angle between the spectra + ‖p − g‖ / (‖p‖ + ‖g‖), from 0 to 3. It "
    "sees mostly the largest eigenvalues.",
    "psnr": "Peak signal-to-noise ratio of a spectrum in dB, infinite for an exact one.",
    "psnr20": "Share of meshes whose spectrum is predicted with a PSNR above 20 dB.",
    "l1": "Σ |p − g| in 1/length²: the smallest shapes make it.",
    "l2": "√ Σ (p − g)² in 1/length²: the smallest shapes make it.",
}
PHYSICS_HELP = {
    "scale_2": "A mesh twice as large must have a quarter of the eigenvalues.",
    "scale_half": "A mesh half as large must have four times the eigenvalues.",
    "rotation": "A rotated mesh must have the same eigenvalues.",
    "reflection": "A mirrored mesh must have the same eigenvalues.",
    "permutation": "The numbering of vertices and faces must not matter.",
    "triangulation": "Each triangle split into four: the same surface, though an exact solver's "
    "eigenvalues differ a little too.",
    "positive": "Share of probe shapes whose predicted eigenvalues are all positive.",
    "ascending": "Share of probe shapes whose predicted eigenvalues ascend.",
}
FAMILIES_BY = ("rpd", "invlap", "psnr20")


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a board.

    Parameters
    ----------
    key : str
        Unique on the board.
    title, help : str
        Its head, and what it says.
    cell : callable
        From a row to its cell.
    numeric : bool
        Whether it is sorted by numbers, and aligned right.
    higher : bool
        Whether more is better, so that it is sorted downwards first.
    """

    key: str
    title: str
    help: str
    cell: Callable[[Ranked], Cell]
    numeric: bool = True
    higher: bool = False

    def told(self) -> dict[str, Any]:
        """Return what the page wants to know of it."""
        return {
            "title": self.title,
            "help": self.help,
            "numeric": self.numeric,
            "higher": self.higher,
        }


@dataclass(frozen=True, slots=True)
class Group:
    """Columns that are shown together, beside rank and model."""

    key: str
    title: str
    columns: Sequence[Column]


def number_of(value: float | None) -> float | None:
    """Return a number with the six digits that are enough to sort and draw it."""
    return None if value is None else float(f"{value:.6g}")


def groups(rows: Sequence[Ranked], board: Board | None, protocol: str | None) -> list[Group]:
    """Return the columns of a board.

    Parameters
    ----------
    rows : sequence of Ranked
        Of the board.
    board : Board or None
        All protocols of the version, if it has its own.
    protocol : str or None
        The one of these that the rows are of; ``None`` for one that all versions have.
    """
    main = {key: _main(key) for key in MAIN}
    drops = [] if board is None or protocol is None else _drops(board, protocol)
    timed = [_milliseconds(protocol), _ratio(protocol)]
    overview = [main[RANKED_BY], *drops, main["invlap"], main["psnr20"], *timed]
    found = [
        Group("overview", "Overview", [*overview, _parameters(), *_declared()]),
        Group("metrics", "All metrics", list(main.values())),
        Group("medians", "Medians", [_median(key) for key in METRICS if key != "psnr20"]),
        Group("intervals", "Intervals", [_interval(key) for key in MAIN]),
        *(_families(rows, key) for key in FAMILIES_BY),
        Group("indices", "Error by eigenvalue", _indices(rows)),
    ]
    if protocol is None:
        found.append(Group("cost", "Cost", [*timed, *_cost(), _parameters()]))
        found.append(Group("physics", "Physics", [_physics(key) for key in TITLES]))
        if board is not None:
            found += [_protocols(board, key) for key in generalisation.SHOWN]
    return found


def fixed() -> list[Column]:
    """Return the columns that every group begins with, but for the model's name."""
    return [
        Column(
            "rank",
            "rank",
            f"By mean {METRICS[RANKED_BY].title}. Rows that share a rank (=) cannot be told apart "
            "from the first of their group: too few shapes, or labels too coarse.",
            lambda row: (row.place, row.rank),
        )
    ]


def _main(key: str) -> Column:
    def cell(row: Ranked) -> Cell:
        scores = row.submission.result["scores"]["overall"][key]
        return with_uncertainty(scores, key), number_of(scores["mean"])

    metric = METRICS[key]
    told = (
        f"{METRIC_HELP[key]} Mean over instances ± half the 95 % interval over shapes; in brackets "
        "the standard deviation over seeds."
    )
    return Column(key, metric.heading, told, cell, higher=metric.higher_is_better)


def _median(key: str) -> Column:
    def cell(row: Ranked) -> Cell:
        value = row.submission.result["scores"]["overall"][key]["median"]
        return score(value, key), number_of(value)

    metric = METRICS[key]
    told = f"Median over instances. {METRIC_HELP[key]}"
    return Column(f"{key}-median", metric.heading, told, cell, higher=metric.higher_is_better)


def _interval(key: str) -> Column:
    def cell(row: Ranked) -> Cell:
        scores = row.submission.result["scores"]["overall"][key]
        return f"{score(scores['low'], key)} to {score(scores['high'], key)}", number_of(
            scores["low"]
        )

    metric = METRICS[key]
    told = f"95 % percentile-bootstrap interval of the mean over shapes. {METRIC_HELP[key]}"
    return Column(f"{key}-interval", metric.heading, told, cell, higher=metric.higher_is_better)


def _families(rows: Sequence[Ranked], key: str) -> Group:
    metric = METRICS[key]
    counts = rows[0].submission.result["scores"]["families"]

    def column(name: str) -> Column:
        def cell(row: Ranked) -> Cell:
            value = row.submission.result["scores"]["families"][name][key]["mean"]
            return score(value, key), number_of(value)

        told = (
            f"Mean {metric.title} over the {counts[name]['count']:,} instances of this family. "
            f"{METRIC_HELP[key]}"
        )
        title = family_title(name)
        return Column(f"{key}-{name}", title, told, cell, higher=metric.higher_is_better)

    columns = [column(name) for name in in_order(counts)]
    return Group(f"families-{key}", f"{metric.heading} by family", columns)


def _indices(rows: Sequence[Ranked]) -> list[Column]:
    def column(i: int) -> Column:
        def cell(row: Ranked) -> Cell:
            value = row.submission.result["scores"]["per_index"][i]["mean"]
            return number(value), number_of(value)

        told = f"Mean relative error |p − g| / g of eigenvalue {i + 1} after zero."
        return Column(f"index-{i + 1}", f"λ{i + 1}", told, cell)

    count = len(rows[0].submission.result["scores"]["per_index"])
    return [column(i) for i in range(count)]


def _fact(row: Ranked, key: str) -> Any:
    return row.submission.result["cost"][key]


def _elsewhere(protocol: str | None) -> str:
    return "" if protocol is None else " Timed under the protocol grouped."


def _milliseconds(protocol: str | None) -> Column:
    def cell(row: Ranked) -> Cell:
        value = _fact(row, "ms_per_mesh")
        return number(value, 2), number_of(value)

    told = (
        "Milliseconds a mesh from raw vertices and faces to eigenvalues, median over batches. To "
        f"be compared within one hardware, device and number of threads only.{_elsewhere(protocol)}"
    )
    return Column("ms", "ms a mesh", told, cell)


def _ratio(protocol: str | None) -> Column:
    def cell(row: Ranked) -> Cell:
        facts = row.submission.result["cost"]
        beside = facts.get("reference")
        return beside_lapy(facts), None if beside is None else number_of(beside["ratio"])

    told = (
        "How many times faster than LaPy on one thread, timed in the same run on some of the same "
        "batches; for equal device and threads this may be compared between machines."
        f"{_elsewhere(protocol)}"
    )
    return Column("lapy", SPEED, told, cell, higher=True)


def _parameters() -> Column:
    def cell(row: Ranked) -> Cell:
        value = row.submission.result["model"]["parameters"]
        return ("", None) if value is None else (f"{value:,}", value)

    return Column("parameters", "parameters", "Number of trained parameters, counted.", cell)


def _declared() -> list[Column]:
    def training(row: Ranked) -> Cell:
        text = results.declared(row.submission.result, "training_data")
        return text, text

    def hardware(row: Ranked) -> Cell:
        text = results.setting(row.submission.result)
        return text, text

    def seeds(row: Ranked) -> Cell:
        value = row.submission.result["predictions"]["seeds"]
        return str(value), value

    told = "Runs with other random numbers; the row shows their mean."
    return [
        Column("training", "training set", f"What it was fitted to. {SEEN}", training, False),
        Column("hardware", "hardware", f"Where it was timed. {SEEN}", hardware, False),
        Column("seeds", "seeds", told, seeds),
    ]


def _cost() -> list[Column]:
    def quartiles(row: Ranked) -> Cell:
        low, high = _fact(row, "ms_per_mesh_quartiles")
        return f"{number(low, 2)} to {number(high, 2)}", number_of(low)

    def of(key: str, decimals: int) -> Callable[[Ranked], Cell]:
        return lambda row: (number(_fact(row, key), decimals), number_of(_fact(row, key)))

    def own(row: Ranked) -> Cell:
        facts = row.submission.result["cost"]
        beside = facts.get("reference")
        return lapys_own(facts), None if beside is None else number_of(beside["ms_per_mesh"])

    def batch(row: Ranked) -> Cell:
        return str(_fact(row, "batch_size")), _fact(row, "batch_size")

    def training(row: Ranked) -> Cell:
        text = results.declared(row.submission.result, "training_cost")
        return text, text

    return [
        Column("quartiles", "quartiles", "Quartiles of ms a mesh over the batches.", quartiles),
        Column("ms-mean", "mean", "The whole time by the meshes.", of("ms_per_mesh_mean", 2)),
        Column("lapy-ms", "LaPy's ms", "LaPy's ms a mesh in the same run.", own),
        Column("batch", "batch", "Meshes that were given at once.", batch),
        Column("cores", "cores used", "CPU time by wall time.", of("cores_used", 2)),
        Column(
            "memory",
            "peak MB",
            "Peak memory of the predictor's process, its libraries included, a GPU's not.",
            of("peak_memory_mb", 0),
        ),
        Column("training-cost", "training cost", f"Of the training. {SEEN}", training, False),
    ]


def _physics(key: str) -> Column:
    def cell(row: Ranked) -> Cell:
        value = row.submission.result["physics"][key]
        return deviation(key, value), number_of(value)

    told = PHYSICS_HELP[key]
    if key not in SHARES:
        told += " Median relative deviation on probe shapes."
    return Column(f"physics-{key}", TITLES[key], f"{told} {SEEN}", cell, higher=key in SHARES)


def _iid(board: Board, protocol: str, key: str) -> Column:
    """Return the column of the same model, trained on everything, on the same shapes."""

    def cell(row: Ranked) -> Cell:
        found = board.cell(board.model(row.submission.slug), protocol, key)
        if found.score is None or found.drop is None:
            return "none", None
        value = found.score - found.drop
        return score(value, key), number_of(value)

    told = (
        f"Mean {METRICS[key].title} of the same model, by the same code and with the same seeds, "
        "trained on everything, on the same shapes (of imported meshes: on the test split). None "
        "where nothing is trained, or on another version."
    )
    return Column("iid", f"i.i.d. {METRICS[key].title}", told, cell)


def _drops(board: Board, protocol: str) -> list[Column]:
    def cell(row: Ranked) -> Cell:
        found = board.cell(board.model(row.submission.slug), protocol, RANKED_BY)
        if found.drop is None:
            return "none", None
        return generalisation.signed(found.drop, RANKED_BY), number_of(found.drop)

    told = (
        f"Mean {METRICS[RANKED_BY].title} minus that of the same model trained on everything: what "
        "it loses on what was held out. None where nothing is trained, or on another version."
    )
    return [_iid(board, protocol, RANKED_BY), Column("drop", "drop", told, cell)]


def _protocols(board: Board, key: str) -> Group:
    metric = METRICS[key]

    def column(protocol: str) -> Column:
        def cell(row: Ranked) -> Cell:
            found = board.cell(row.submission, protocol, key)
            return generalisation.with_drop(found, key), number_of(found.score)

        told = (
            f"Mean {metric.title} on the shapes that this protocol tests, by a model whose "
            "training held them and their like out; in brackets the drop against the same model "
            "trained on everything."
        )
        title = generalisation.title(protocol)
        return Column(f"{key}-{protocol}", title, told, cell, higher=metric.higher_is_better)

    def iid(row: Ranked) -> Cell:
        value = row.submission.result["scores"]["overall"][key]["mean"]
        return score(value, key), number_of(value)

    told = f"Mean {metric.title} on the whole test split, trained on everything."
    first = Column(f"{key}-iid", "i.i.d.", told, iid, higher=metric.higher_is_better)
    columns = [first, *(column(name) for name in board.protocols)]
    return Group(f"protocols-{key}", f"Generalisation, {metric.heading}", columns)
