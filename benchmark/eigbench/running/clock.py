"""One clock for all rows of a board: every predictor on the same batches, in turn, in one run.

Milliseconds of two runs differ with the machine and with what else it does. Here all predictors
are loaded, each in a process of its own, and each batch goes to one after the other, LaPy among
them. So whatever slows the machine down slows all of them down.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigbench.running.meshes import Instances
from eigbench.running.process import Loaded, PredictorProcess, Status
from eigbench.scoring.truth import Truth

WARM_UP = 4  # meshes that each predictor gets before the clock counts


@dataclass(frozen=True, slots=True)
class Timed:
    """What one predictor took.

    Parameters
    ----------
    path : Path
        Its file.
    loading : float
        Seconds until it was loaded.
    seconds, cpu_seconds : ndarray of shape (batches,)
        Wall and CPU seconds of each batch: medians over the repetitions.
    loaded, status
        Its META, and its peak memory and digests.
    """

    path: Path
    loading: float
    seconds: NDArray[np.float64]
    cpu_seconds: NDArray[np.float64]
    loaded: Loaded
    status: Status


def together(
    paths: Sequence[Path],
    truth: Truth,
    instances: Instances,
    *,
    batch_size: int,
    repeats: int,
    time_limit: float,
    on_step: Callable[[str], None] = lambda step: None,
) -> list[Timed]:
    """Time predictors on all instances of a truth, one thread each.

    A batch holds meshes of about one size, so that its time tells what a mesh of that size costs.
    Each goes ``repeats`` times to every predictor, and who is first changes from one time to the
    next.

    Raises
    ------
    PredictorError
        If one fails, answers with the wrong shape or type, hangs or dies.
    """
    vertices = instances.vertices(truth.ids)
    ids = [truth.ids[i] for i in np.argsort(vertices, kind="stable")]
    k = truth.eigenvalues.shape[1]
    training = str(truth.trainings[0])
    batches = [ids[first : first + batch_size] for first in range(0, len(ids), batch_size)]
    with contextlib.ExitStack() as stack:
        processes = []
        for path in paths:
            on_step(f"loading {path.name}")
            process = PredictorProcess(path, k, training=training, time_limit=time_limit)
            processes.append(stack.enter_context(process))
            process.warm_up(WARM_UP)
        wall = np.empty((repeats, len(paths), len(batches)))
        cpu = np.empty_like(wall)
        for number, batch in enumerate(batches):
            meshes = [instances.mesh(id) for id in batch]
            for repeat in range(repeats):
                for turn in range(len(paths)):
                    i = (turn + number + repeat) % len(paths)
                    on_step(f"batch {number + 1} of {len(batches)}: {paths[i].name}")
                    answered = processes[i].predict(batch, meshes)
                    wall[repeat, i, number] = answered.seconds
                    cpu[repeat, i, number] = answered.cpu_seconds
        return [
            Timed(
                path,
                processes[i].loaded.loading_seconds,
                np.median(wall[:, i], axis=0),
                np.median(cpu[:, i], axis=0),
                processes[i].loaded,
                processes[i].status(),
            )
            for i, path in enumerate(paths)
        ]
