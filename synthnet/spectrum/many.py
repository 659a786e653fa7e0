"""Spectra of many meshes, on several cores."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from functools import partial
from itertools import islice
from typing import Any, TypeAlias

from synthnet.processes import worker_pool
from synthnet.spectrum.inputs import as_count, as_mesh
from synthnet.spectrum.operators import PLAIN, Operator
from synthnet.spectrum.solve import compile_solver, compute
from synthnet.spectrum.warned import Warned, collected
from synthnet.types import Spectrum

Result: TypeAlias = tuple[Spectrum, Warned]


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

    Warns
    -----
    RuntimeWarning, UserWarning
        As :func:`synthnet.spectrum.compute`, and of which mesh.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> spheres = [FAMILIES["sphere"].generate({"radius": r, "resolution": 9}) for r in (1.0, 2.0)]
    >>> [round(float(found.eigenvalues[0]), 1) for found in spectra(spheres, k=3)]
    [2.1, 0.5]
    """
    k = as_count(k)
    if (workers := as_count(workers, "workers")) < 1:
        raise ValueError(f"workers must be at least 1, got {workers}")
    solve = partial(_recorded, partial(compute, k=k, operator=operator, repair=repair))
    if workers == 1:
        results: Iterator[Callable[[], Result]] = (partial(solve, mesh) for mesh in meshes)
    else:
        compile_solver()  # once, before all of them would
        results = _by_workers(workers, solve, meshes)
    for number, result in enumerate(results):
        try:
            found, warned = result()
        except BrokenExecutor:
            raise  # a process has died, of whichever mesh
        except Exception as error:
            error.add_note(f"of mesh {number}, counted from 0")
            raise
        for category, message in warned:
            warnings.warn(f"{message} (of mesh {number}, counted from 0)", category, stacklevel=2)
        yield found


def _recorded(solve: Callable[[Any], Spectrum], mesh: Any) -> Result:
    """Return a mesh's spectrum, and what was warned of; an error has that as notes."""
    with collected() as warned:
        try:
            return solve(mesh), warned
        except Exception as error:
            for _, message in warned:
                error.add_note(f"after a warning: {message}")
            raise


def _by_workers(
    workers: int, solve: Callable[[Any], Result], meshes: Iterable[Any]
) -> Iterator[Callable[[], Result]]:
    """Yield what waits for each mesh's spectrum; two meshes for each process are read ahead."""
    with worker_pool(workers) as pool:
        futures = _submitted(pool, solve, meshes)
        waiting = deque(islice(futures, 2 * workers))
        while waiting:
            future = waiting.popleft()
            waiting.extend(islice(futures, 1))
            yield future.result


def _submitted(
    pool: Executor, solve: Callable[[Any], Result], meshes: Iterable[Any]
) -> Iterator[Future[Result]]:
    """Yield what each mesh will have; the last is an error if there is no further mesh by one."""
    try:
        for mesh in map(as_mesh, meshes):
            yield pool.submit(solve, mesh)
    except Exception as error:  # noqa: BLE001 - raised when it is its turn
        failed = Future[Result]()
        failed.set_exception(error)
        yield failed
