"""What the results of the scaling track say: errors, times, and whether prediction wins.

An exact solver is recognised by its answers: on a mesh, every model within :data:`EXACT` of the
label in every eigenvalue is one. Every other answer is a prediction, that of other elements too. It
wins on a mesh if its error to the surface's spectrum is at most :data:`WINNING_ERROR` times that
of the label, and the fastest exact solver on the same machine takes longer to reach this error, on
the mesh of that surface that it takes for it, be that coarser or finer than this one.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench import results
from eigbench.scaling import surfaces
from eigbench.scaling.results import ANSWERED, Scaled

EXACT = 1e-9  # relative, of every eigenvalue: solvers are within 1e-11, a good fit is not
# Times the discretisation error; a larger error is a trade against time, not a win
WINNING_ERROR = 2.0
SAME = 1e-6  # relative: distances from a surface that differ by less are equal


@dataclass(frozen=True, slots=True)
class Medians:
    """One model at one size: medians over the surfaces that it answered."""

    answered: int  #: surfaces
    total: int  #: surfaces tried, 0 where it was not run
    error: float  #: mean relative error against the mesh's label
    distance: float  #: mean relative error against the surface's spectrum
    seconds: float  #: wall time of a mesh, itself the median of repeats
    peak_memory_mb: float  #: of the process
    failures: tuple[str, ...]  #: why the others were not answered, as ``over 600 s``


@dataclass(frozen=True, slots=True)
class Verdict:
    """Where predictions beat the exact solver at one size."""

    size: int  #: nominal number of vertices
    #: The model that is exact and fastest on most surfaces; ``None`` if none answered exactly.
    solver: str | None
    seconds: float  #: median over the surfaces of the fastest exact time; NaN if there is none
    compared: int  #: surfaces on which there is an exact time
    wins: Mapping[str, int]  #: by slug of each model that wins somewhere, on how many surfaces


@dataclass(frozen=True, slots=True)
class Median:
    """A median of numbers of which some are known by bounds alone."""

    side: str  #: ``"< "`` or ``"> "`` where this bound of the median alone is known; else empty
    value: float  #: NaN where nothing is known


@dataclass(frozen=True, slots=True)
class Equal:
    """What a model's error to the surface costs an exact solver, on whichever mesh it takes.

    Medians over the surfaces that the model answered. An error that is larger than on the coarsest
    mesh that a solver answered bounds the time from above, one that is smaller than on the finest
    from below.
    """

    seconds: Median
    gain: Median  #: times as long as the model


def settings(rows: Sequence[Scaled]) -> dict[str, list[Scaled]]:
    """Return the results by hardware, device and threads: times are compared within one only."""
    by_setting: dict[str, list[Scaled]] = {}
    for row in sorted(rows, key=lambda row: row.slug):
        by_setting.setdefault(results.setting(row.result), []).append(row)
    return dict(sorted(by_setting.items()))


def seconds(mesh: Mapping[str, Any]) -> float:
    """Return the time of a mesh: the median of its repeats."""
    return float(np.median(mesh["seconds"]))


def error(mesh: Mapping[str, Any]) -> float:
    """Return the mean relative error of an answer against the mesh's label."""
    return surfaces.relative_error(np.array(mesh["eigenvalues"]), _pinned(mesh).label)


def distance(mesh: Mapping[str, Any]) -> float:
    """Return the mean relative error of an answer against the surface's spectrum."""
    return surfaces.relative_error(np.array(mesh["eigenvalues"]), _pinned(mesh).limit)


def is_exact(mesh: Mapping[str, Any]) -> bool:
    """Return whether an answer is the label, but for rounding."""
    return bool(np.max(np.abs(np.array(mesh["eigenvalues"]) / _pinned(mesh).label - 1)) <= EXACT)


def _pinned(mesh: Mapping[str, Any]) -> surfaces.Pinned:
    return surfaces.pinned(mesh["surface"], mesh["size"])


def medians(row: Scaled, size: int) -> Medians:
    """Return the medians of a model at a size."""
    meshes = row.meshes
    tried = [meshes[s, size] for s in surfaces.SURFACES if (s, size) in meshes]
    good = [mesh for mesh in tried if mesh["outcome"] == ANSWERED]
    facts = [(error(m), distance(m), seconds(m), m["peak_memory_mb"]) for m in good]
    middle = np.median(np.array(facts, dtype=np.float64), axis=0) if good else np.full(4, np.nan)
    failures = tuple(sorted({_failure(mesh) for mesh in tried if mesh["outcome"] != ANSWERED}))
    error_, distance_, seconds_, memory = middle.tolist()
    return Medians(len(good), len(tried), error_, distance_, seconds_, memory, failures)


def _failure(mesh: Mapping[str, Any]) -> str:
    """Return why a mesh was not answered, with the limit that was broken."""
    if mesh["outcome"] == "over time":
        return f"over {mesh['time_limit']:g} s"
    if mesh["outcome"] == "over memory":
        return f"over {mesh['memory_limit_gib']:g} GiB"
    return str(mesh["outcome"])


def sizes(rows: Sequence[Scaled]) -> list[int]:
    """Return the sizes that any result has, ascending."""
    return sorted({size for row in rows for _, size in row.meshes})


def floor(size: int) -> float:
    """Return the median over the surfaces of the meshes' own discretisation error."""
    errors = [surfaces.pinned(s, size).discretisation_error for s in surfaces.SURFACES]
    return float(np.median(errors))


def whole_seconds(verdicts: Sequence[Verdict]) -> dict[int, float]:
    """Return the time of an exact solver by size, ascending, where one answered every surface."""
    every = len(surfaces.SURFACES)
    return at_most({v.size: v.seconds for v in verdicts if v.compared == every})


def at_most(times: Mapping[int, float]) -> dict[int, float]:
    """Return times by size, ascending: of the size or, if one is less, of a larger size.

    Examples
    --------
    >>> at_most({100: 3.0, 10: 2.0, 1000: 4.0, 1: 9.0})
    {1: 2.0, 10: 2.0, 100: 3.0, 1000: 4.0}
    """
    sizes = sorted(times, reverse=True)
    least = np.minimum.accumulate([times[size] for size in sizes]).tolist()
    return dict(zip(reversed(sizes), reversed(least), strict=True))


def exact_seconds(rows: Sequence[Scaled]) -> dict[str, dict[int, float]]:
    """Return the time of the fastest exact solver by surface and size, as :func:`at_most`."""
    found = {}
    for surface in surfaces.SURFACES:
        exact = {size: _fastest_exact(rows, surface, size) for size in sizes(rows)}
        if times := {size: best[0] for size, best in exact.items() if best}:
            found[surface] = at_most(times)
    return found


def equal(row: Scaled, size: int, exact: Mapping[str, Mapping[int, float]]) -> Equal:
    """Return what the error of a model at a size costs an exact solver; see exact_seconds."""
    bounds = []
    for surface, times in exact.items():
        mesh = row.meshes.get((surface, size))
        if mesh is None or mesh["outcome"] != ANSWERED:
            continue
        least, most = solver_bounds(surface, times, distance(mesh))
        bounds.append((least, most, least / seconds(mesh), most / seconds(mesh)))
    times_least, times_most, gains_least, gains_most = np.reshape(bounds, (-1, 4)).T
    return Equal(bounded_median(times_least, times_most), bounded_median(gains_least, gains_most))


def solver_bounds(surface: str, times: Mapping[int, float], error: float) -> tuple[float, float]:
    """Return a lower and an upper bound of the seconds that an exact solver takes for an error.

    They are equal between the errors of the coarsest and the finest mesh that a solver answered.
    """
    coarsest, finest = (
        surfaces.pinned(surface, end).discretisation_error for end in (min(times), max(times))
    )
    if error > coarsest * (1 + SAME):
        return 0.0, times[min(times)]
    takes = equal_seconds(surface, times, error)
    return takes, np.inf if error < finest * (1 - SAME) else takes


def bounded_median(
    least: Sequence[float] | NDArray[np.float64], most: Sequence[float] | NDArray[np.float64]
) -> Median:
    """Return the median of numbers of which a lower and an upper bound are known.

    The upper bound of the median is said if there is one.

    Examples
    --------
    >>> bounded_median([1, 2, 3], [1, 2, np.inf])
    Median(side='', value=2.0)
    >>> bounded_median([1, 0, 0], [1, 4, 5]), bounded_median([1, 2, 3], [1, np.inf, np.inf])
    (Median(side='< ', value=4.0), Median(side='> ', value=2.0))
    """
    if not len(least):
        return Median("", np.nan)
    low, high = float(np.median(least)), float(np.median(most))
    if low == high:
        return Median("", low)
    return Median("< ", high) if np.isfinite(high) else Median("> ", low)


def equal_seconds(surface: str, times: Mapping[int, float], distance: float) -> float:
    """Return what an exact solver takes on a mesh of a surface just fine enough for an error.

    Between two sizes time is a power of the discretisation error. On meshes coarser than the
    coarsest it is taken as inversely proportional to that error, as for a solver whose time is
    linear in the vertices; beyond the finest mesh nothing is added. There must be one time at
    least, seconds by size; ``distance`` is the mean relative error against the surface's spectrum.
    """
    errors = {size: surfaces.pinned(surface, size).discretisation_error for size in times}
    return interpolated_seconds(errors, times, distance)


def interpolated_seconds(
    errors: Mapping[int, float], times: Mapping[int, float], distance: float
) -> float:
    """Return the time of an error, from the errors and times of each size."""
    sizes = sorted(times, reverse=True)  # errors ascending
    known = np.array([errors[size] for size in sizes])
    distance = max(distance, known[0])  # that of an answer may be zero
    log = np.interp(np.log(distance), np.log(known), np.log([times[size] for size in sizes]))
    return float(np.exp(log) * min(1.0, known[-1] / distance))


def beside_seconds(row: Scaled, size: int) -> float | None:
    """Return the median time of LaPy in a row's run at a size, in seconds."""
    times = [
        mesh["reference_seconds"]
        for (_, at), mesh in row.meshes.items()
        if at == size and mesh["reference_seconds"] is not None
    ]
    return float(np.median(times)) if times else None


def verdict(rows: Sequence[Scaled], size: int) -> Verdict:
    """Return where predictions beat the exact solver; the rows are of one setting."""
    fastest: dict[str, tuple[float, str]] = {}
    wins: Counter[str] = Counter()
    every = exact_seconds(rows)
    for surface in surfaces.SURFACES:
        exact = _fastest_exact(rows, surface, size)
        if exact is None:
            continue
        fastest[surface] = exact
        near = WINNING_ERROR * surfaces.pinned(surface, size).discretisation_error
        for row, mesh in _answers(rows, surface, size):
            predicted = distance(mesh) <= near and not is_exact(mesh)
            if predicted and seconds(mesh) < equal_seconds(surface, every[surface], distance(mesh)):
                wins[row.slug] += 1
    names = [name for _, name in fastest.values()]
    return Verdict(
        size,
        max(sorted(set(names)), key=names.count) if names else None,
        float(np.median([time for time, _ in fastest.values()])) if names else np.nan,
        len(names),
        dict(sorted(wins.items())),
    )


def _answers(
    rows: Sequence[Scaled], surface: str, size: int
) -> list[tuple[Scaled, Mapping[str, Any]]]:
    return [
        (row, row.meshes[surface, size])
        for row in sorted(rows, key=lambda row: row.slug)
        if row.meshes.get((surface, size), {}).get("outcome") == ANSWERED
    ]


def _fastest_exact(rows: Sequence[Scaled], surface: str, size: int) -> tuple[float, str] | None:
    answers = _answers(rows, surface, size)
    return min(((seconds(mesh), row.name) for row, mesh in answers if is_exact(mesh)), default=None)
