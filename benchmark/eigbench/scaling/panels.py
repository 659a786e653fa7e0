"""Charts of the scaling track: error to the surface against speed beside LaPy, one a size."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eigbench.scaling import scores
from eigbench.scaling.results import Scaled
from eigbench.scaling.scores import Verdict


@dataclass(frozen=True, slots=True)
class Panel:
    """What a chart of one size has beside the models: error to the surface against speed."""

    size: int  # nominal number of vertices
    # Of a mesh, median over the surfaces: speeds are multiples of its; NaN where it was not timed
    lapy_seconds: float
    # Speed and error of the fastest exact solver on the meshes of each size, coarse to fine
    solver: Sequence[tuple[float, float]]
    # Speed and error along the left border of where a prediction can win, upwards: the solver's
    # line. It reaches right and down from there. Empty where no exact solver answered every surface
    border: Sequence[tuple[float, float]]


def panel(rows: Sequence[Scaled], verdicts: Sequence[Verdict], size: int) -> Panel:
    """Return what a chart of one size has beside the models.

    To win, a prediction must be faster than the exact solver is for the same error, and that error
    is at most :data:`scores.WINNING_ERROR` times the discretisation error of these meshes.

    The rows are of one setting, the verdicts of these rows, one a size.
    """
    lapy = lapy_seconds(rows, size)
    times = scores.whole_seconds(verdicts) if np.isfinite(lapy) else {}
    errors = {size: scores.floor(size) for size in times}
    solver = [(lapy / times[n], errors[n]) for n in times]
    border: list[tuple[float, float]] = []
    if size in times:
        top = scores.WINNING_ERROR * errors[size]
        below = sorted((errors[n], lapy / times[n]) for n in times if errors[n] < top)
        border = [(speed, error) for error, speed in below]
        border.append((lapy / scores.interpolated_seconds(errors, times, top), top))
    return Panel(size, lapy, solver, border)


def lapy_seconds(rows: Sequence[Scaled], size: int) -> float:
    """Return LaPy's time of a mesh, median over the surfaces; NaN where it was not timed.

    It is that of LaPy's own row, as for every other row. Where the rows of a setting have none, it
    is that which was timed beside them.
    """
    for row in rows:
        if row.slug == "lapy" and scores.medians(row, size).answered:
            return scores.medians(row, size).seconds
    beside = [time for row in rows if (time := scores.beside_seconds(row, size)) is not None]
    return float(np.median(beside)) if beside else np.nan
