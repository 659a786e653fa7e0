"""The columns of time, memory and training: what a prediction costs."""

from collections.abc import Callable, Sequence
from typing import Any

from eigbench import results
from eigbench.board.columns import DECLARED, Cell, Column, Group, six_digits, words
from eigbench.board.ranking import Ranked
from eigbench.board.tables import SPEED, number, times_faster


def table(rows: Sequence[Ranked]) -> Group[Ranked]:
    """Return the table of times and memory, which are compared within one hardware only."""

    def quartiles(facts: dict[str, Any]) -> Cell:
        low, high = facts["ms_per_mesh_quartiles"]
        return f"{number(low, 2)} to {number(high, 2)}", six_digits(low)

    def lapys_own(facts: dict[str, Any]) -> Cell:
        return _number("ms_per_mesh")(facts.get("reference") or {})

    def counted(facts: dict[str, Any]) -> Cell:
        by = facts.get("counted_by", {})
        return ", ".join(dict.fromkeys(by.values())) or "not recorded", None

    def training(row: Ranked) -> Cell:
        return words(results.declared(row.submission.result, "training_cost"))

    mean = "Total time divided by the number of meshes."
    memory = "Peak memory of the predictor's process, its libraries included, a GPU's not."
    by = "What counted processor time and memory: a control group, or samples of the process tree."
    loaded = "Seconds until the predictor was loaded, once, before the clock of its answers."
    trained = f"What the training took. {DECLARED}"
    ms, *ratios = speed(rows)
    columns = [
        ms,
        _fact("quartiles", "quartiles", "Quartiles of ms per mesh over the batches.", quartiles),
        _fact("ms-mean", "mean", mean, _number("ms_per_mesh_mean")),
        _fact("lapy-ms", "LaPy's ms", "LaPy's ms per mesh in the same run.", lapys_own),
        *ratios,
        _fact("batch", "batch", "Number of meshes in a call.", _number("batch_size", 0)),
        _fact("loading", "loading s", loaded, _number("loading_seconds")),
        _fact("cores", "cores used", "CPU time divided by wall time.", _number("cores_used")),
        _fact("memory", "peak MB", memory, _number("peak_memory_mb", 0)),
        _fact("counted", "counted by", by, counted, numeric=False),
        parameters(),
        Column("training-cost", "training cost", trained, training, numeric=False),
    ]
    note = "ms per mesh is the median over batches. The training cost is declared, not measured."
    return Group("cost", "Cost", columns, note)


def speed(rows: Sequence[Ranked], protocol: str | None = None) -> list[Column[Ranked]]:
    """Return the columns of time and of :func:`ratios`.

    Rows of a version's own protocol show the times of ``grouped``.
    """
    elsewhere = _elsewhere(protocol)
    ms_note = (
        "Milliseconds per mesh from raw vertices and faces to eigenvalues, median over batches. "
        f"Compare them within one hardware, device and number of threads only.{elsewhere}"
    )
    ms = _fact("ms", "ms per mesh", ms_note, _number("ms_per_mesh"))
    return [ms, *ratios(rows, protocol)]


def ratios(rows: Sequence[Ranked], protocol: str | None = None) -> list[Column[Ranked]]:
    """Return a column of speed against LaPy, and one for each other peer of the rows' times."""

    def ratio(facts: dict[str, Any]) -> Cell:
        return _speed(facts.get("reference"))

    elsewhere = _elsewhere(protocol)
    note = (
        "How many times as fast as LaPy on one thread, timed in the same run on some of the same "
        f"batches. It may be compared between machines for equal device and threads.{elsewhere}"
    )
    names = dict.fromkeys(
        name for row in rows for name in row.submission.result["cost"].get("peers", {})
    )

    def column(name: str) -> Column[Ranked]:
        def ratio(facts: dict[str, Any]) -> Cell:
            return _speed(facts.get("peers", {}).get(name))

        note = f"How many times as fast as {name}, on one thread, in the same run.{elsewhere}"
        return _fact(f"against-{name}", f"against {name}", note, ratio, higher=True)

    return [_fact("lapy", SPEED, note, ratio, higher=True), *map(column, names)]


def _elsewhere(protocol: str | None) -> str:
    return "" if protocol is None else " Timed under the protocol grouped."


def _fact(
    key: str,
    title: str,
    note: str,
    cell: Callable[[dict[str, Any]], Cell],
    *,
    higher: bool = False,
    numeric: bool = True,
) -> Column[Ranked]:
    """Return a column of what a run cost; on a board with verified rows no others' is shown."""

    def shown(row: Ranked) -> Cell:
        return ("not verified", None) if row.cost is None else cell(row.cost)

    return Column(key, title, note, shown, higher=higher, numeric=numeric)


def _speed(beside: dict[str, Any] | None) -> Cell:
    """Return how many times as fast as a peer a run was."""
    return times_faster(beside), None if beside is None else six_digits(beside["ratio"])


def _number(name: str, decimals: int = 2) -> Callable[[dict[str, Any]], Cell]:
    """Return the cell of a number; results before 2026-11 do not have the seconds of loading."""

    def cell(facts: dict[str, Any]) -> Cell:
        if name not in facts:
            return "not timed", None
        return number(facts[name], decimals), six_digits(facts[name])

    return cell


def parameters() -> Column[Ranked]:
    """Return the column of the number of trained parameters."""

    def cell(row: Ranked) -> Cell:
        count = row.submission.result["model"]["parameters"]
        return ("", None) if count is None else (f"{count:,}", count)

    return Column("parameters", "parameters", "Number of trained parameters, counted.", cell)
