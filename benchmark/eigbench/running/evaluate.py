"""Run a predictor over a split, and keep its answers."""

import contextlib
import io
import itertools
import json
import math
import secrets
import shutil
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError, PredictorError, WorksUnasked
from eigbench.results.sources import contents
from eigbench.running import machine
from eigbench.running.box import TIME_LIMIT, Settings
from eigbench.running.meshes import Instances
from eigbench.running.process import REFERENCE_FILE, Loaded, PredictorProcess, Status
from eigbench.scoring.training import DEFAULT, untrained
from eigbench.scoring.truth import Truth
from synthnet.store import files
from synthnet.types import PROTOCOLS, Mesh

WARM_UP = 16  # meshes predicted before the clock counts; none of them is of the split
REFERENCE = 100  # of the first and of the last meshes, LaPy is timed on the same batches
LOCK = "lock"  # of the folder of answers
PARTS = "*/*.npz"  # the answers there
BUSY = "another run keeps its answers in {where}: wait for it or choose another --out"
NOTE = "run.json"  # of the folder of a process's answers: what they are of
ENDED = "ended.json"  # of a process that has answered everything: what it was, and its cost
BEGUN = "begun.json"  # the same of one that has not, as far as it is known
NOTED = 60.0  # seconds between two notes of it
SOURCES = "contents.json"  # of a run that has begun: the SHA-256 of the predictor's files


@dataclass(frozen=True, slots=True)
class Options(Settings):
    """How to run a predictor over a split; how its process is run besides."""

    batch_size: int = 200  #: meshes in one call
    seeds: int = 1  #: runs, with seeds 0, 1, ...
    resume: bool = False  #: go on from the batches that an interrupted run has left
    #: Time LaPy, on one thread, on the batches that hold the first and the last
    #: :data:`REFERENCE` meshes of the first seed and training, each right after the predictor.
    reference: bool = False


@dataclass(frozen=True, slots=True)
class Evaluation:
    """What a predictor answered, and at what cost.

    ``asked`` and all arrays except ``predictions`` have one entry per batch, of every seed.
    """

    #: Of shape (seeds, n, k), in the order of the truth's ids, in 1/length².
    predictions: NDArray[np.float64]
    seconds: NDArray[np.float64]  #: of wall time
    cpu_seconds: NDArray[np.float64]
    sizes: NDArray[np.int64]  #: numbers of meshes
    #: Whether the batch holds shapes that had not been asked before. The others hold copies of
    #: shapes; their times tell whether a predictor remembers, and do not count as its cost.
    new: NDArray[np.bool_]
    #: Wall seconds of LaPy on the same meshes; NaN where it was not asked.
    reference_seconds: NDArray[np.float64]
    asked: Sequence[tuple[int, NDArray[np.int64]]]  #: the seed and the instances
    #: Whether a batch was the first of its seed and training, at which a process may compile code.
    #: After ``resume`` it is that of the first process alone; ``verify-row`` never resumes.
    opening: NDArray[np.bool_]
    loaded: Loaded  #: META and parameters of the predictor
    status: Status  #: peak memory of its process and digests of its files

    @property
    def first(self) -> NDArray[np.bool_]:
        """Which answers, (seeds, n), are the first of their shape: those that are timed."""
        first = np.zeros(self.predictions.shape[:2], dtype=np.bool_)
        for (seed, instances), new in zip(self.asked, self.new, strict=True):
            first[seed, instances] = new
        return first


@contextlib.contextmanager
def alone(parts: Path) -> Iterator[None]:
    """Lock the directory of answers; remove it if the run finished or no batch was answered.

    Of what ends early, the answers stay: a run with ``resume`` goes on from them.

    Raises
    ------
    BuildError
        If another run keeps its answers there.
    PredictorError
        What ended the run early, and that it can be gone on from.
    """
    files.make_directory(parts)
    with files.locked(parts / LOCK, wait=False, taken=BUSY, needed=False):
        done = False
        try:
            yield
            done = True
        except PredictorError as error:
            if any(parts.glob(PARTS)):
                hint = "--resume goes on from the last good batch"
                raise PredictorError(f"{error} ({hint})") from error
            raise
        finally:
            if done or not any(parts.glob(PARTS)):  # nothing is lost
                shutil.rmtree(parts, ignore_errors=True)


def evaluate(
    path: Path,
    truth: Truth,
    instances: Instances,
    options: Options,
    parts: Path,
    on_batch: Callable[[int, float], None] = lambda count, seconds: None,
    on_restart: Callable[[], None] = lambda: None,
    on_loaded: Callable[[Loaded], None] = lambda loaded: None,
    *,
    sets: NDArray[np.int64] | None = None,
) -> Evaluation:
    """Run a predictor over the instances of a split, in an order that is drawn anew.

    One instance of each shape comes first, and the other copies after all of these.

    Parameters
    ----------
    path : Path
        The predictor's file; its code is run.
    truth : Truth
        What to predict.
    instances : Instances
        The meshes.
    options : Options
        How.
    parts : Path
        Directory that keeps each batch's answer until the whole is done; see :func:`alone`.
    on_batch : callable, optional
        Called with the number of meshes of each batch that is done, and the seconds it took,
        LaPy's aside; once with those of an interrupted run.
    on_restart : callable, optional
        Called if answers were left to go on from, but not by this code and these options.
    on_loaded : callable, optional
        Called when the predictor is loaded, before it predicts; what it raises ends the run.
    sets : ndarray of shape (n,), int64, optional
        The set that each instance is of: a batch holds those of one, so that it has a time.

    Raises
    ------
    PredictorError
        If the predictor fails, answers with the wrong shape or type, changes its input,
        hangs or dies. The batches before, if any, are kept in ``parts``; not those of a process
        that works while it is not asked.
    EigbenchError
        If what an interrupted run has left was answered on another accelerator.
    """
    everything = np.arange(len(truth.ids))
    sets = np.zeros_like(everything) if sets is None else sets
    runs: list[tuple[list[_Part], Loaded, Status]] = []
    asked = []
    predictions = np.empty((options.seeds, *truth.eigenvalues.shape))

    def task_of(seed: int, number: int, trainings: Sequence[str]) -> _Task:
        several = len(trainings) > 1
        training = trainings[number]
        chosen = np.flatnonzero(truth.trainings == training) if several else everything
        mine = replace(options, reference=options.reference and seed == number == 0)
        folder = parts / (f"seed-{seed}-{number}" if several else f"seed-{seed}")
        return _Task(path, chosen, truth.take(chosen), sets[chosen], mine, seed, training, folder)

    trainings, started = list(dict.fromkeys(truth.trainings.tolist())), None
    with contextlib.ExitStack() as stack:
        if not _is_answered(task_of(0, 0, trainings)):
            trainings, started = _trainings(path, truth, trainings, options, stack)
        for seed, number in itertools.product(range(options.seeds), range(len(trainings))):
            task = task_of(seed, number, trainings)
            left = options.resume and any(task.folder.glob("*.npz"))
            same = _open_parts(task)
            if left and not same:
                on_restart()
            first = runs[0][1] if runs else None
            try:
                run = _run(task, instances, on_batch, on_loaded, started, first)
            except WorksUnasked:
                shutil.rmtree(task.folder)  # else --resume would find nothing left to ask of it
                raise
            for part in run[0]:
                predictions[seed, task.chosen[part.instances]] = part.values
                asked.append((seed, task.chosen[part.instances]))
            runs.append(run)
            stack.close()
            started = None
    every, loaded, statuses = zip(*runs, strict=True)
    saved = [part for mine in every for part in mine]
    return Evaluation(
        predictions=predictions,
        seconds=np.array([part.seconds for part in saved]),
        cpu_seconds=np.array([part.cpu_seconds for part in saved]),
        sizes=np.array([len(part.instances) for part in saved]),
        new=np.array([part.new for part in saved]),
        reference_seconds=np.array([part.reference_seconds for part in saved]),
        asked=asked,
        opening=np.array([i == 0 for mine in every for i in range(len(mine))], dtype=np.bool_),
        loaded=loaded[0],
        status=_together(statuses),
    )


def predict_meshes(
    path: Path,
    ids: Sequence[str],
    given: Sequence[Mesh],
    k: int,
    options: Options,
    training: str = DEFAULT,
) -> NDArray[np.float64]:
    """Return the answers, (n, k), for given meshes; as :func:`evaluate`, without keeping them."""
    with PredictorProcess(path, k, options, training=training) as process:
        answers = [
            process.predict(ids[first:last], given[first:last]).values
            for first, last in _batches(len(ids), options.batch_size)
        ]
    return np.concatenate(answers)


def _trainings(
    path: Path, truth: Truth, trainings: list[str], options: Options, stack: contextlib.ExitStack
) -> tuple[list[str], PredictorProcess | None]:
    """Return the sets to train the predictor on, in turn; a single one if it is not trained.

    If it had to be loaded to see that, its process is returned as well, since loading may train for
    hours: it has the first set and seed 0. Closing the stack ends it.
    """
    if all(training.partition("/")[2] in PROTOCOLS for training in trainings):
        return trainings, None
    k = truth.eigenvalues.shape[1]
    process = stack.enter_context(PredictorProcess(path, k, options, training=trainings[0]))
    loaded = process.loaded
    if loaded.trained:
        return trainings, process
    if not untrained(loaded.meta):
        trained = loaded.meta.get("training_data", "an unknown set")
        raise PredictorError(
            f"the protocol {truth.protocol} asks for a training of its own, {trainings[0]}, and by "
            f"its META {path} is {loaded.meta['kind']}, trained on {trained}: define load(device, "
            'seed, training), or say "kind": "classical" and "training_data": "none" if nothing '
            "in it was fitted to labels"
        )
    return trainings[:1], process


@dataclass(frozen=True, slots=True)
class _Task:
    """What one process of a predictor is asked: instances, how, and what it was trained on."""

    path: Path
    chosen: NDArray[np.int64]  #: the instances, as indices of the whole truth
    truth: Truth  #: theirs
    sets: NDArray[np.int64]
    options: Options
    seed: int
    training: str
    folder: Path  #: of its parts


@dataclass(frozen=True, slots=True)
class _Part:
    """A batch: indices of its instances, whether their shapes were new, and what came of it."""

    instances: NDArray[np.int64]
    new: bool
    values: NDArray[np.float64]
    seconds: float
    cpu_seconds: float
    reference_seconds: float = math.nan


def _run(
    task: _Task,
    instances: Instances,
    on_batch: Callable[[int, float], None],
    on_loaded: Callable[[Loaded], None],
    started: PredictorProcess | None,
    first: Loaded | None,
) -> tuple[list[_Part], Loaded, Status]:
    """Ask what is left to ask, of the process that has been started or of a new one.

    ``first`` is what is loaded for the first seed and training, if this is another one.
    """
    truth, options, folder = task.truth, task.options, task.folder
    parts = _read_parts(folder)
    done = sum(len(part.instances) for part in parts)
    if done:
        on_batch(done, sum(part.seconds for part in parts))
    ended = _read_facts(folder / ENDED)
    if ended is not None and done == len(truth.ids):
        on_loaded(ended[0])
        return parts, *ended
    earlier = _read_facts(folder / BEGUN)
    k = truth.eigenvalues.shape[1]
    with contextlib.ExitStack() as stack:
        process = started or stack.enter_context(
            PredictorProcess(task.path, k, options, seed=task.seed, training=task.training)
        )
        on_loaded(process.loaded)
        if options.seeds > 1 and not process.loaded.seeded:
            raise PredictorError(
                f"{task.path} takes no seed: define load(device, seed), or leave --seeds out"
            )
        own = process.loaded.accelerator
        for other in filter(None, (first, earlier and earlier[0])):
            if other.accelerator != own:
                raise EigbenchError(
                    f"{folder.parent} has answers of {other.accelerator or 'no accelerator'}, here "
                    f"is {own or 'none'}: go on there, or leave --resume out"
                )
        warm_up = min(WARM_UP, options.batch_size)
        process.warm_up(warm_up)
        _, status = _note(folder / BEGUN, process, earlier)
        noted = time.monotonic()
        content = contents(status.sources, _folders(task))
        files.write_text(folder / SOURCES, json.dumps(content))
        peer: PredictorProcess | None = None
        numbers = itertools.count(1 + max((int(p.stem) for p in folder.glob("*.npz")), default=-1))
        for chosen, new, beside in _batches_of(task, parts):
            batch = [truth.ids[i] for i in chosen]
            given = [instances.mesh(id) for id in batch]
            answered = process.predict(batch, given)
            part = _Part(chosen, new, answered.values, answered.seconds, answered.cpu_seconds)
            if beside:
                try:
                    if peer is None:
                        # The user's limit may be for a fast predictor
                        lapy_settings = Settings(time_limit=max(options.time_limit, TIME_LIMIT))
                        lapy = PredictorProcess(REFERENCE_FILE, k, lapy_settings)
                        peer = stack.enter_context(lapy)
                        peer.warm_up(warm_up)
                    part = replace(part, reference_seconds=peer.predict(batch, given).seconds)
                except PredictorError as error:
                    raise PredictorError(
                        f"LaPy, timed beside the predictor, failed ({error}): "
                        "--no-reference leaves it out"
                    ) from error
            _write_part(folder, next(numbers), part)
            parts.append(part)
            on_batch(len(batch), part.seconds)
            if time.monotonic() >= noted + NOTED:
                _note(folder / BEGUN, process, earlier)
                noted = time.monotonic()
        return parts, *_note(folder / ENDED, process, earlier)


def _batches_of(task: _Task, parts: Sequence[_Part]) -> list[tuple[NDArray[np.int64], bool, bool]]:
    """Return what is left to ask: indices, whether their shapes are new, and whether LaPy is timed.

    The order is drawn anew, so it can be learned from no file and no earlier run.
    """
    truth, options = task.truth, task.options
    rng = np.random.default_rng(secrets.randbits(128))
    order = rng.permutation(len(truth.ids))
    asked = np.concatenate([np.empty(0, np.int64), *(part.instances for part in parts)])
    order = np.concatenate([asked, order[~np.isin(order, asked)]])
    first = np.zeros(len(order), dtype=bool)
    first[np.unique(truth.shapes[order], return_index=True)[1]] = True
    left = np.arange(len(order)) >= len(asked)
    batches = []
    for new, part in itertools.product((True, False), np.unique(task.sets)):
        mine = task.sets[order] == part
        chosen = order[left & mine & (first == new)]
        before = int((first & mine).sum()) - len(chosen)
        for i, j in _batches(len(chosen), options.batch_size):
            edge = before + i < REFERENCE or j > len(chosen) - REFERENCE
            batches.append((chosen[i:j], new, options.reference and new and edge))
    if task.sets.any():  # of several sets, in turn
        batches = [batches[i] for i in rng.permutation(len(batches))]
        batches.sort(key=lambda batch: not batch[1])
    return batches


def _batches(count: int, size: int) -> list[tuple[int, int]]:
    return [(first, min(first + size, count)) for first in range(0, count, size)]


# The answers of an interrupted run


def _fingerprint(task: _Task) -> dict[str, object]:
    return {
        "parts": 2,  # raised when what a part holds changes
        "predictor": task.path.name,
        "truth": task.truth.digest,
        "batch_size": task.options.batch_size,
        "device": task.options.device,
        "threads": task.options.threads,
        "seed": task.seed,
        "training": task.training,
        "reference": task.options.reference,
        "sandbox": task.options.sandbox,
        "readable": [str(path) for path in task.options.readable],
        "hardware": machine.hardware(),
        "environment": machine.environment(),
    }


def _open_parts(task: _Task) -> bool:
    """Make the directory of parts; return whether what it holds is to be gone on from."""
    same = _goes_on(task)
    if not same:
        shutil.rmtree(task.folder, ignore_errors=True)
        files.make_directory(task.folder)
        files.write_text(task.folder / NOTE, json.dumps(_fingerprint(task)))
    return same


def _goes_on(task: _Task) -> bool:
    """Whether the directory of parts holds what is to be gone on from."""
    if not task.options.resume or _read_note(task.folder / NOTE) != _fingerprint(task):
        return False
    return _unchanged(task.folder / SOURCES, task)


def _is_answered(task: _Task) -> bool:
    """Whether an earlier run has answered all of a task, so that its process need not start."""
    return (task.folder / ENDED).exists() and _goes_on(task)


def _folders(task: _Task) -> list[Path]:
    """Return the folders that a predictor's sources are named from."""
    shown = [path.parent for path in task.options.readable]
    return [task.path.resolve().parent, *shown]


def _unchanged(note: Path, task: _Task) -> bool:
    """Whether the files of an earlier run are still what they were, to the byte."""
    earlier = _read_note(note)
    if earlier is None:
        return False  # it did not come as far as the first batch
    return bool(contents(earlier, _folders(task)) == earlier)


def _read_note(path: Path) -> Any:
    """Return what a note of an earlier run holds; ``None`` if there is none, or it is damaged."""
    try:
        return json.loads(path.read_text())
    except (FileNotFoundError, ValueError):
        return None


def _read_parts(folder: Path) -> list[_Part]:
    """Return what was answered; a part that is damaged is removed, and asked again."""
    parts = []
    for path in sorted(folder.glob("*.npz")):
        try:
            with path.open("rb") as file, np.load(file, allow_pickle=False) as part:
                # Of an array without an axis, [()] is its number
                parts.append(_Part(**{name: part[name][()] for name in part.files}))
        except (EOFError, ValueError, TypeError, RuntimeError, zipfile.BadZipFile, zlib.error):
            path.unlink()
    return parts


def _together(statuses: Sequence[Status]) -> Status:
    """Return the most memory, all files and all that was refused, of several processes."""
    return Status(
        max(status.peak_bytes for status in statuses),
        {name: digest for status in statuses for name, digest in status.sources.items()},
        statuses[0].counted_by,
        tuple(dict.fromkeys(attempt for status in statuses for attempt in status.refused)),
    )


def _note(
    path: Path, process: PredictorProcess, earlier: tuple[Loaded, Status] | None
) -> tuple[Loaded, Status]:
    """Write down what a process is and has cost, together with those that were interrupted."""
    loaded, status = process.loaded, process.status()
    if earlier is not None:
        longest = max(earlier[0].loading_seconds, loaded.loading_seconds)
        loaded = replace(loaded, loading_seconds=longest)
        status = _together([earlier[1], status])
    facts = {"loaded": asdict(loaded), "status": asdict(status)}
    files.write_text(path, json.dumps(facts))
    return loaded, status


def _read_facts(path: Path) -> tuple[Loaded, Status] | None:
    """Return what :func:`_note` has written, if it has."""
    facts = _read_note(path)
    if facts is None:
        return None
    status = Status(**facts["status"])
    return Loaded(**facts["loaded"]), replace(status, refused=tuple(status.refused))


def _write_part(folder: Path, number: int, part: _Part) -> None:
    content = io.BytesIO()
    np.savez(content, **asdict(part))
    files.write_bytes(folder / f"{number:06d}.npz", content.getvalue())
