"""Spectra of many meshes, on several cores."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from functools import partial
from itertools import count, islice
from typing import Any

from synthnet.processes import worker_pool
from synthnet.spectrum.inputs import as_mesh, check_count
from synthnet.spectrum.operators import PLAIN, Operator
from synthnet.spectrum.solve import compile_solver, compute
from synthnet.types import Spectrum


def spectra(
    meshes: Iterable[Any],
    k: int = 10,
    *,
    operator: Operator = PLAIN,
    repair: bool = False,
    workers: int = 1,
) -> Iterator[Spectrum]:
    """Yield the spectrum of each mesh, in order, as :func:`synthnet.spectrum.compute` does.

    Parameters
    ----------
    meshes : iterable of Mesh or other
        As of :func:`synthnet.spectrum.compute`.
    k : int
        Number of eigenvalues of each.
    operator : synthnet.spectrum.Operator
        Which operator of each.
    repair : bool
        Repair each first, see :func:`synthnet.spectrum.compute`.
    workers : int
        Processes; with one, all is done in this. Each takes a core: set OMP_NUM_THREADS=1. Two
        meshes for each are read ahead.

    Raises
    ------
    ValueError, Refused, SpectrumError, CertificateError
        At the first mesh that has no spectrum; a note of the error says which it is.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> spheres = [FAMILIES["sphere"].generate({"radius": r, "resolution": 9}) for r in (1.0, 2.0)]
    >>> [round(float(found.eigenvalues[0]), 1) for found in spectra(spheres, k=3)]
    [2.1, 0.5]
    """
    check_count(k)
    if workers < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    solve = partial(compute, k=k, operator=operator, repair=repair)
    if workers == 1:
        for number, mesh in enumerate(meshes):
            with _numbered(number):
                found = solve(mesh)
            yield found
        return
    compile_solver()  # once, before all of them would
    with worker_pool(workers) as pool:
        futures = _submitted(pool, solve, meshes)
        waiting = deque(islice(futures, 2 * workers))
        for number in count():
            if not waiting:
                return
            with _numbered(number):
                found = waiting.popleft().result()
            waiting.extend(islice(futures, 1))
            yield found


@contextmanager
def _numbered(number: int) -> Iterator[None]:
    """Add to an error of this block which mesh it is of."""
    try:
        yield
    except BrokenExecutor:
        raise  # a process has died, of whichever mesh
    except Exception as error:
        error.add_note(f"of mesh {number}, counted from 0")
        raise


def _submitted(
    pool: Executor, solve: Callable[[Any], Spectrum], meshes: Iterable[Any]
) -> Iterator[Future[Spectrum]]:
    """Yield what each mesh will have; the last is an error if there is no further mesh by one."""
    try:
        for mesh in map(as_mesh, meshes):
            yield pool.submit(solve, mesh)
    except Exception as error:  # noqa: BLE001 - raised when it is its turn
        failed = Future[Spectrum]()
        failed.set_exception(error)
        yield failed
