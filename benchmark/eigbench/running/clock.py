"""One clock for all rows of a board: every predictor on the same batches, in turn, in one run.

Milliseconds of two runs differ with the machine and with what else it does. Here all predictors
are loaded, each in a process of its own, and each batch goes to one after the other, LaPy among
them. So whatever slows the machine down slows all of them down.
"""

import contextlib
import secrets
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import PredictorError
from eigbench.running.box import NONE, Settings
from eigbench.running.evaluate import WARM_UP
from eigbench.running.meshes import Instances
from eigbench.running.process import REFERENCE_FILE, Loaded, PredictorProcess, Status
from eigbench.running.unseen import ENOUGH, longer
from eigbench.scoring.truth import Truth

Meshes = TypeVar("Meshes", list[str], NDArray[np.int64])  # what each has: ids, numbers of vertices
OF_FRESH = -1  # in place of the number of a size


@dataclass(frozen=True, slots=True)
class Timed:
    """What one predictor took.

    Wall and CPU seconds, of shape (batches,), are those of a batch of each size: medians over those
    of that size.
    """

    path: Path  #: its file
    seconds: NDArray[np.float64]
    cpu_seconds: NDArray[np.float64]
    #: What it answered meanwhile, in the order of the truth's ids, of shape (1, n, k), float64.
    predictions: NDArray[np.float64]
    #: How many times as long fresh meshes took as public ones; ``None`` of too few of either.
    longer: float | None
    loaded: Loaded  #: its META and the seconds of loading it
    status: Status  #: its peak memory and digests


def together(
    paths: Sequence[Path],
    truth: Truth,
    instances: Instances,
    *,
    fresh: int = 0,
    batch_size: int,
    repeats: int,
    settings: Settings,
    on_step: Callable[[str], None] = lambda step: None,
) -> list[Timed]:
    """Time predictors on one instance of each shape of a truth, one thread each.

    No shape is asked twice, so nothing is gained by remembering one. Sorted by size, the shapes go
    into batches of about one size, ``repeats`` of each size: its time, their median, tells what a
    mesh of that size costs. Batches come in an order that is drawn anew, every one goes to every
    predictor, and who is first changes from one to the next.

    The last ``fresh`` instances of the truth are those that nobody has seen. Their batches come
    among the others and have no part in the times, but tell whether a predictor knows the others.

    Raises
    ------
    PredictorError
        If one, which is named, fails, answers with the wrong shape or type or with what is not
        finite, hangs or dies.
    """
    k = truth.eigenvalues.shape[1]
    training = str(truth.trainings[0])
    public = len(truth.ids) - fresh
    groups = by_size(truth.ids[:public], instances, batch_size, repeats)
    asked = [(number, batch) for number, group in enumerate(groups) for batch in group]
    small = max(1, min(batch_size, fresh // ENOUGH))
    asked += [(OF_FRESH, batch) for (batch,) in by_size(truth.ids[public:], instances, small, 1)]
    secrets.SystemRandom().shuffle(asked)
    with contextlib.ExitStack() as stack:
        processes = []
        for path in paths:
            on_step(f"loading {path.name}")
            held = replace(settings, sandbox=NONE) if path == REFERENCE_FILE else settings
            with _named(path):
                process = PredictorProcess(path, k, held, training=training)
                processes.append(stack.enter_context(process))
                process.warm_up(min(WARM_UP, batch_size))
        wall = np.empty((len(paths), len(asked)))
        cpu = np.empty_like(wall)
        values = np.empty((len(paths), 1, *truth.eigenvalues.shape))
        index = {id: i for i, id in enumerate(truth.ids)}
        for step, (_, batch) in enumerate(asked):
            meshes = [instances.mesh(id) for id in batch]
            for turn in range(len(paths)):
                i = (turn + step) % len(paths)
                on_step(f"batch {step + 1} of {len(asked)}: {paths[i].name}")
                with _named(paths[i]):
                    answered = processes[i].predict(batch, meshes)
                    if not np.isfinite(answered.values).all():
                        raise PredictorError("the answer has numbers that are not finite")
                wall[i, step] = answered.seconds
                cpu[i, step] = answered.cpu_seconds
                values[i, 0, [index[id] for id in batch]] = answered.values
        numbers = np.array([number for number, _ in asked])
        vertices = np.array([instances.vertices(batch).sum() for _, batch in asked])
        timed = []
        for i, path in enumerate(paths):
            with _named(path):
                status = processes[i].status()
            seconds, cpu_seconds = (
                np.array([np.median(took[i, numbers == number]) for number in range(len(groups))])
                for took in (wall, cpu)
            )
            ratio = longer(wall[i], vertices, numbers == OF_FRESH)
            loaded = processes[i].loaded
            timed.append(Timed(path, seconds, cpu_seconds, values[i], ratio, loaded, status))
        return timed


@contextlib.contextmanager
def _named(path: Path) -> Iterator[None]:
    """Say of what goes wrong whose predictor's it is."""
    name = "LaPy" if path == REFERENCE_FILE else path.name
    try:
        yield
    except PredictorError as error:
        if str(error).startswith(name):
            raise
        raise PredictorError(f"{name}: {error}") from error


def by_size(
    ids: Sequence[str], instances: Instances, batch_size: int, repeats: int
) -> list[list[list[str]]]:
    """Return ids, ascending by size: for each size ``repeats`` batches of meshes near it."""
    ids = [ids[i] for i in np.argsort(instances.vertices(ids), kind="stable")]
    groups = in_sizes(ids, batch_size, repeats)
    return [[group[repeat::repeats] for repeat in range(repeats)] for group in groups]


def in_sizes(ascending: Meshes, batch_size: int, repeats: int) -> list[Meshes]:
    """Return what meshes have, ascending by size, in parts: ``repeats`` batches of each size."""
    step = batch_size * repeats
    return [ascending[first : first + step] for first in range(0, len(ascending), step)]
