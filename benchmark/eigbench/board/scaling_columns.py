"""The columns of the scaling track, for LEADERBOARD.md and for the page."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from eigbench.board.columns import Cell, Column, Group, of_run, six_digits
from eigbench.board.tables import error, number
from eigbench.scaling import scores, surfaces
from eigbench.scaling.results import Scaled
from eigbench.scaling.scores import Medians


def _result(row: Scaled) -> dict[str, Any]:
    return row.result


MODEL, KIND, HARDWARE, TRAINING = of_run(_result)


def groups(sizes: Sequence[int], rows: Sequence[Scaled]) -> dict[str, Group[Scaled]]:
    """Return the tables of one hardware setting by key; ``rows`` are all of that setting."""
    exact = scores.exact_seconds(rows)
    overview = [column(size) for size in sizes for column in (_distance, _time)]
    solver = (
        "The ms that the fastest exact solver takes on a mesh just fine enough for the row's error "
        "to the surface, interpolated between the sizes on each surface; making such a mesh is not "
        "counted."
    )
    mesh = (
        "The same answers against the label, the exact spectrum of the mesh, instead of the "
        "surface's."
    )
    memory = "MB of the process, its libraries included."
    timed = [_lapy(size) for size in sizes if size <= surfaces.TIMED_BESIDE]
    lapy = (
        "LaPy's ms per mesh in the run of each row, on the same meshes up to "
        f"{surfaces.TIMED_BESIDE:,} vertices: how fast the machine was then."
    )
    tables = (
        Group("overview", "Error and time", overview, lead="discretisation error of the meshes"),
        Group("solver", "Solver at the same error", [_solver(n, exact) for n in sizes], solver),
        Group("mesh", "Against the mesh", [_error(size) for size in sizes], mesh),
        Group("memory", "Peak memory", [_memory(size) for size in sizes], memory),
        Group("lapy", "LaPy beside each run", timed, lapy),
    )
    return {group.key: group for group in tables}


def _error(size: int) -> Column[Scaled]:
    note = (
        "Mean relative error of the ten eigenvalues against the label, the exact spectrum of the "
        "mesh; median over the surfaces."
    )
    return _median(
        "error", size, "error to the mesh", note, lambda _, m: (percent(m.error), m.error)
    )


def _time(size: int) -> Column[Scaled]:
    note = (
        "Milliseconds per mesh, one mesh a call; median over the surfaces. Compare them within one "
        "hardware, device and number of threads only."
    )
    return _median("ms", size, "ms", note, lambda _, m: (ms(m.seconds), 1e3 * m.seconds))


def _distance(size: int) -> Column[Scaled]:
    note = (
        "Mean relative error of the ten eigenvalues against the spectrum of the surface; median "
        "over the surfaces."
    )
    own, title = percent(scores.floor(size)), "error to the surface"
    return _median(
        "distance", size, title, note, lambda _, m: (percent(m.distance), m.distance), own
    )


def _solver(size: int, exact: Mapping[str, Mapping[int, float]]) -> Column[Scaled]:
    note = (
        "Milliseconds that the fastest exact solver takes on a mesh just fine enough for the "
        "row's error to the surface; median over the surfaces."
    )

    def cell(row: Scaled, _: Medians) -> tuple[str, float]:
        takes = scores.equal(row, size, exact).seconds
        known = np.isfinite(takes.value)
        return f"{takes.side}{ms(takes.value)}" if known else "–", 1e3 * takes.value

    return _median("solver", size, "the solver's ms", note, cell)


def _memory(size: int) -> Column[Scaled]:
    note = "Peak memory in MB of the process, its libraries included; median over the surfaces."
    return _median(
        "memory", size, "MB", note, lambda _, m: (f"{m.peak_memory_mb:,.0f}", m.peak_memory_mb)
    )


def _lapy(size: int) -> Column[Scaled]:
    def cell(row: Scaled) -> Cell:
        seconds = scores.beside_seconds(row, size)
        return ("not run", None) if seconds is None else (ms(seconds), six_digits(1e3 * seconds))

    note = "LaPy's ms per mesh in the same run, on the same meshes: how fast the machine was then."
    return Column(f"lapy-{size}", f"{size:,}: ms", f"At {size:,} vertices. {note}", cell)


def _median(
    key: str,
    size: int,
    title: str,
    note: str,
    cell: Callable[[Scaled, Medians], tuple[str, float]],
    own: str = "",
) -> Column[Scaled]:
    """Return a column of medians at a size, which says what they leave out."""

    def with_failures(row: Scaled) -> Cell:
        medians = scores.medians(row, size)
        if not medians.total:
            return "not run", None
        if not medians.answered:
            return ", ".join(medians.failures), None
        text, value = cell(row, medians)
        if medians.answered < len(surfaces.SURFACES):
            text = f"{text} ({medians.answered} of {len(surfaces.SURFACES)})"
        return text, six_digits(value)

    note = f"At {size:,} vertices. {note}"
    return Column(f"{key}-{size}", f"{size:,}: {title}", note, with_failures, lead=own)


def percent(share: float) -> str:
    """Return a share in per cent; one that only rounding can make is exact.

    Examples
    --------
    >>> percent(0.0123), percent(9947.9018), percent(4e-13)
    ('1.230 %', '994,790.180 %', 'exact')
    """
    if share <= scores.EXACT:
        return "exact"
    return f"{100 * share:,.3f} %" if share > 1 else f"{error(100 * share, 3)} %"


def ms(seconds: float) -> str:
    """Return seconds in milliseconds, with no more digits than they are known to.

    Examples
    --------
    >>> ms(0.01234), ms(122.724)
    ('12.34', '122,724')
    """
    return f"{1e3 * seconds:,.0f}" if seconds >= 1 else number(1e3 * seconds, 2)
