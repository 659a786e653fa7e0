"""A predictor in a process of its own, and what becomes of it when it hangs or dies."""

import contextlib
import errno
import json
import os
import re
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO, NoReturn, Self

import numpy as np
import psutil
from numpy.typing import NDArray

from eigbench.errors import Died, OutsideError, OverMemory, OverTime, PredictorError, WorksUnasked
from eigbench.results.sources import digest, is_output, unnameable
from eigbench.running import frames, predictor, supervisor, tree
from eigbench.running.box import BUBBLEWRAP, NONE, Box, Settings
from eigbench.running.meshes import warming
from eigbench.running.usage import ControlGroup, Usage
from eigbench.running.worker import Job
from eigbench.scoring.training import DEFAULT
from synthnet.types import Mesh

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
SIGNALLED = 128  # what bubblewrap adds to the number of a signal, as a shell does
GLANCE = 0.25  # seconds between two looks at memory that has no limit, and at processor time
# What a predictor may compute while it is not asked: in all, or as a share of what it does when
# asked; and each time without being counted, for what it clears up and threads that still spin
UNASKED, UNASKED_SHARE = 1.0, 0.1
CLEARING, SPINNING = 0.02, 0.25  # seconds; the second of each further thread
GRACE = 5.0  # seconds in which a process ends that has closed its connection
ERRORS = (  # of what a sandbox hides, makes read-only or cuts off
    *(errno.ENOENT, errno.EPERM, errno.EACCES, errno.EROFS, errno.EXDEV),
    *(errno.ENETUNREACH, errno.ENETDOWN, errno.ECONNREFUSED, errno.EADDRNOTAVAIL),
    *(socket.EAI_AGAIN, socket.EAI_NONAME),
)
SAID = ("FileNotFoundError", "PermissionError", "is not installed")
REFUSALS = (*SAID, *(f"[Errno {number}]" for number in ERRORS))
REFUSED = (
    " (the sandbox shows the predictor's own files and no network, and lets it write below $TMPDIR "
    "alone: --readable PATH shows more, --no-sandbox runs without)"
)
REFERENCE_FILE = Path(__file__).with_name("reference.py")  # LaPy, timed beside each predictor


def refused(message: str, code: Path, shows: Callable[[Path], bool]) -> str:
    """Return what to do about an error of a predictor's ``code`` that its sandbox may have made.

    ``shows`` says whether a path can be read there.
    """
    folder = code.resolve().parent
    modules = re.findall(r"needs the package (\w+)", message)
    named = [path for module in modules for path in sorted(folder.glob(f"*/{module}.py"))]
    named += [folder / name for name in re.findall(r"'([^'\0]{1,300})'", message)]
    for path in (Path(os.path.normpath(path)) for path in named):
        try:
            hidden = path.is_relative_to(folder) and path.is_file() and not shows(path)
        except OSError:  # a name that is too long is no file's
            continue
        if not hidden:
            continue
        entry = folder / path.relative_to(folder).parts[0]  # of the folder: it, or what it is in
        for link in (path, entry):
            if link.is_symlink():
                remedy = f"put what {link} leads to in its place"
                return f" (the sandbox shows no symbolic link: {remedy})"
        name, remedy = f"{entry.name}/", f"move {path.name} into {code.stem}/"
        if entry == path:
            name, remedy = path.name, f"name it {code.stem}.{path.name}"
        elif path.suffix == ".py":
            remedy = "make a package of it by an __init__.py"
        return f" (the sandbox does not show {name}: {remedy}, or add --readable {entry})"
    return REFUSED


@dataclass(frozen=True, slots=True)
class Loaded:
    """The predictor is loaded.

    Its META, its parameters, whether it takes a seed and the name of its training set, the name
    of the accelerator, and the seconds that loading took.
    """

    meta: dict[str, str]
    parameters: int | None
    seeded: bool
    trained: bool
    accelerator: str
    loading_seconds: float = 0.0


@dataclass(frozen=True, slots=True)
class Answered:
    """A batch has been answered: (B, k) values, and the wall and CPU seconds it took."""

    values: NDArray[np.float64]
    seconds: float
    cpu_seconds: float


@dataclass(frozen=True, slots=True)
class Status:
    """Peak memory of a predictor's processes so far, in bytes, and digests of its files.

    ``counted_by`` is how memory and processor time were taken; ``refused`` is what it has tried
    and its sandbox has refused, as far as Python saw it.
    """

    peak_bytes: int
    sources: dict[str, str]
    counted_by: dict[str, str]
    refused: tuple[str, ...] = ()


class PredictorProcess:
    """A predictor that is loaded when the context is entered. This runs the file's code.

    Parameters
    ----------
    path : Path
        The predictor's file.
    k : int
        Number of eigenvalues.
    settings : Settings
        How it is run. ``time_limit`` of the process may be set to another one later.
    seed, training
        Handed to the predictor.

    Raises
    ------
    PredictorError
        At once if there is no such file. On entering and in each method: if the predictor fails,
        answers with the wrong shape or type, changes its input; :class:`OverTime`,
        :class:`OverMemory` and :class:`Died` if it hangs, takes too much or dies.
    """

    def __init__(
        self, path: Path, k: int, settings: Settings, *, seed: int = 0, training: str = DEFAULT
    ) -> None:
        predictor.check_file(path)  # a sandbox has no way to say that there is none
        self.boxed = settings.sandbox != NONE
        path = path.resolve() if self.boxed else path  # a sandbox has another working directory
        self.job = Job(str(path), settings.device, seed, training, k, watched=self.boxed)
        self.settings, self.time_limit = settings, settings.time_limit
        self.loaded: Loaded

    def __enter__(self) -> Self:
        """Start the process and wait until the predictor is loaded."""
        path, training = Path(self.job.path), self.job.training
        self._looked = time.monotonic()
        with contextlib.ExitStack() as made:
            self._box = Box(path, training, self.settings) if self.boxed else None
            if self._box is not None:
                made.callback(self._box.close)
            if (group := ControlGroup.make()) is not None:
                made.callback(group.remove)
            own, other = map(made.enter_context, socket.socketpair())
            self._channel = frames.Channel(own)
            command = [sys.executable, "-P", "-m", supervisor.__name__, str(other.fileno())]
            command = command if self._box is None else self._box.command(command)
            try:
                self._process = subprocess.Popen(
                    command if group is None else group.command(command),
                    pass_fds=[other.fileno()],
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,
                    env=self._environment(),
                )
            except OSError as error:
                raise PredictorError(f"cannot start the predictor's process: {error}") from error
            other.close()
            self._made = made.pop_all()  # closed when the process has ended
        tree.hold(self._process.pid)
        self._tree = psutil.Process(self._process.pid)
        self._since = self._tree.create_time()
        self._usage = Usage(self._tree, group)
        try:
            start = time.perf_counter()
            self._send(frames.JOB, json.dumps(asdict(self.job)).encode(), "while loading")
            facts = self._facts(frames.LOADED, "while loading")
            loading = time.perf_counter() - start
            meta = predictor.checked_meta(facts.pop("meta"), path)
            self.loaded = Loaded(meta=meta, loading_seconds=loading, **facts)
            self._counted = self._usage.cpu_seconds()  # as it was last not asked any more
            self._asked = self._unasked = 0.0  # processor time in batches, and between them
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def predict(self, ids: Sequence[str], meshes: Sequence[Mesh]) -> Answered:
        """Return the answer to a batch. The ids are for messages; they stay here.

        The clock runs here, from the moment the meshes can be seen there to that when the answer
        has come and is found to be of the right form.
        """
        first = ", ".join(ids[:3])
        return self._answer(meshes, f"on the batch of {len(ids)} that begins with {first}")

    def warm_up(self, count: int) -> None:
        """Ask for some meshes of no dataset, so that what happens once has happened."""
        self._answer(warming(count), "on meshes to warm up with")

    def _answer(self, meshes: Sequence[Mesh], at: str) -> Answered:
        size = 8 * len(meshes) * self.job.k
        body, file = frames.packed(meshes)
        with file:
            cpu, start = self._between(), time.perf_counter()
            self._send(frames.MESHES, body, at, file)
            answer = self._receive(frames.ANSWER, at, most=size)
            if len(answer) != size:
                raise self._garbled(at, f"an answer of {len(answer):,} bytes")
            values = np.frombuffer(answer, "<f8").reshape(-1, self.job.k).astype(np.float64)
            seconds = time.perf_counter() - start
        self._counted = self._usage.cpu_seconds()
        self._asked += self._counted - cpu
        return Answered(values, seconds, self._counted - cpu)

    def _between(self) -> float:
        """Return the processor time so far; what was used since an answer counts as unasked."""
        cpu = self._usage.cpu_seconds()
        spared = CLEARING + SPINNING * (self.settings.threads - 1)
        self._unasked += max(cpu - self._counted - spared, 0.0)
        self._counted = cpu
        return cpu

    def status(self) -> Status:
        """Return the peak memory and the digests of the predictor's files.

        A predictor that works while it is not asked slows those that are timed with it down, and
        is refused here.

        The names of these files come from the predictor's process: only regular files below its
        own file's folder are read, without following a symbolic link.
        """
        self._between()
        if self._unasked > max(UNASKED, UNASKED_SHARE * self._asked):
            raise WorksUnasked(
                f"{Path(self.job.path).name} works while it is not asked, {self._unasked:.1f} s of "
                f"processor time beside {self._asked:.1f} s in its batches: let it rest in between"
            )
        peak = self._usage.peak_bytes()
        at = "when all was predicted"
        self._send(frames.CLOSING, b"", at)
        folder = predictor.split(Path(self.job.path))[0].resolve().parent
        facts = self._facts(frames.SOURCES, at)
        self._counted = self._usage.cpu_seconds()  # without what the answer to this took
        names = [name for name in facts["files"] if not is_output(folder / name, folder)]
        refused, digests = [], self._named()
        if self._box is not None:
            names = [n for n in names if self._box.shows(Path(os.path.normpath(folder / n)))]
            refused = self._box.refused(facts["attempts"])
        for name in names:
            try:
                digests[name] = digest(folder / name, folder)
            except FileNotFoundError:
                continue
            except OutsideError as error:
                raise PredictorError(f"a predictor lies in one folder: {error}") from error
        if problem := unnameable(digests):
            raise PredictorError(problem)
        tried = tuple(map(printable, refused))
        return Status(peak, digests, self._usage.counted_by(), tried)

    def _named(self) -> dict[str, str]:
        """Return the digests of the files that the user shows to the predictor, by their names."""
        return {
            file.relative_to(path.parent).as_posix(): digest(file)
            for path in self.settings.readable
            for file in (sorted(path.rglob("*")) if path.is_dir() else [path])
            if file.is_file()
        }

    def _environment(self) -> dict[str, str]:
        """Return the variables of the process: modules are found as here, threads are counted."""
        path = os.pathsep.join(filter(None, sys.path))
        threads = dict.fromkeys(THREAD_VARIABLES, str(self.settings.threads))
        packages = self.settings.packages
        own = "" if packages is None else str(packages.resolve())
        variables = {**os.environ, "PYTHONPATH": path, supervisor.PACKAGES: own, **threads}
        return variables if self._box is None else self._box.environment(variables)

    def _send(self, kind: bytes, body: bytes, at: str, file: BinaryIO | None = None) -> None:
        try:
            self._channel.send(kind, body, file, self._watch(at))
        except OSError:
            raise self._died(at) from None

    def _facts(self, kind: bytes, at: str) -> Any:
        return self._checked(kind, self._receive(kind, at, most=frames.MOST), at)

    def _checked(self, kind: bytes, body: bytes, at: str) -> Any:
        try:
            return frames.facts(kind, body)
        except frames.FrameError as error:
            raise self._garbled(at, str(error)) from error

    def _receive(self, kind: bytes, at: str, most: int) -> bytes:
        """Wait for a frame, and watch the clock and the memory meanwhile."""
        try:
            came, body, _ = self._channel.receive(max(most, frames.MOST), self._watch(at))
        except (EOFError, ConnectionError):
            raise self._died(at) from None
        except frames.FrameError as error:
            raise self._garbled(at, str(error)) from error
        if came == frames.FAILED:
            self._fail(body, at)
        if came != kind or len(body) > most:
            raise self._garbled(at, f"a frame of kind {came!r} and {len(body):,} bytes")
        if self._process.poll() is not None:  # and yet its child answers
            raise self._died(at)
        return body

    def _watch(self, at: str) -> Callable[[], None]:
        """Return what looks whether the predictor takes too long, from now on, or too much."""
        end = time.monotonic() + self.time_limit

        def look() -> None:
            if time.monotonic() >= end:
                raise OverTime(
                    f"the predictor took more than {self.time_limit:g} s {at}: raise --time-limit"
                )
            limit, now = self.settings.memory_limit, time.monotonic()
            if limit is None and now < self._looked + GLANCE:
                return
            self._looked = now
            if self._usage.look() > (np.inf if limit is None else limit * 2**30):
                raise OverMemory(
                    f"the predictor took more than {limit:g} GiB {at}: raise --memory-limit"
                )

        return look

    def _fail(self, body: bytes, at: str) -> NoReturn:
        """Raise what the predictor's process says went wrong."""
        facts = self._checked(frames.FAILED, body, at)
        message = " ".join(printable(facts["message"]).split())
        if self._box is not None and any(sign in message for sign in REFUSALS):
            code, _ = predictor.split(Path(self.job.path))
            message += refused(message, code, self._box.shows)
        failure = PredictorError(f"{message}, {at}" if at.startswith("on ") else message)
        trace = "\n".join(map(printable, facts["traceback"].splitlines()))
        failure.add_note(f"In the predictor's process:\n{trace}")
        raise failure

    def _garbled(self, at: str, what: str) -> PredictorError:
        return PredictorError(
            f"the predictor's process sent {what} {at}: its code must not write to the files and "
            "sockets that it has not opened"
        )

    def _died(self, at: str) -> PredictorError:
        try:
            code = self._process.wait(GRACE)
        except subprocess.TimeoutExpired:
            self._kill()
            return Died(
                f"the predictor's process closed its connection {at} and went on: its code must "
                "not close the files and sockets that it has not opened"
            )
        if self.settings.sandbox == BUBBLEWRAP and code > SIGNALLED:
            code = SIGNALLED - code
        return Died(
            f"the predictor's process died {at} (exit code {code}; -9 is often lack of memory)"
        )

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        """End the process and all that it has started, whatever they do."""
        self._channel.close()
        for end in (None, self._process.terminate, self._kill):
            if end is not None:
                end()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(0 if error and end is None else 5)
                break
        tree.end(self._since)
        tree.release(self._process.pid)
        self._made.close()

    def _kill(self) -> None:
        """Kill what runs below the supervisor, then that."""
        for process in [*tree.processes(self._tree), self._tree]:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()


def printable(text: str) -> str:
    r"""Return text of a predictor's process without what a terminal would act on.

    Examples
    --------
    >>> printable("a\x1b[2Jb")
    'a\ufffd[2Jb'
    """
    return "".join(c if c.isprintable() or c in " \t" else "\ufffd" for c in text)
