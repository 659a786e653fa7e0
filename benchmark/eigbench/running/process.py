"""A predictor in a process of its own, and what becomes of it when it hangs or dies."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from eigbench.errors import Died, OverMemory, OverTime, PredictorError
from eigbench.running.worker import Answered, Failed, Job, Loaded, Status, work
from eigbench.scoring.training import DEFAULT
from synthnet.types import Mesh

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
REFERENCE_FILE = Path(__file__).with_name("reference.py")  # LaPy, timed beside each predictor
WATCH = 0.1  # seconds between two looks at a process whose memory is limited


class PredictorProcess:
    """A predictor that is loaded when the context is entered. This runs the file's code.

    Parameters
    ----------
    path : Path
        The predictor's file.
    k : int
        Number of eigenvalues.
    time_limit : float
        Most seconds for loading and for a batch.
    device, seed, training
        Handed to the predictor.
    threads : int
        Threads of BLAS and OpenMP.
    memory_limit : int, optional
        Most bytes that the process may have in memory (resident, where Linux tells).

    Raises
    ------
    PredictorError
        On entering and in each method: if the predictor fails, answers with the wrong shape
        or type, changes its input; :class:`OverTime`, :class:`OverMemory` and :class:`Died` if
        it hangs, takes too much or dies.
    """

    def __init__(
        self,
        path: Path,
        k: int,
        *,
        time_limit: float,
        device: str = "cpu",
        seed: int = 0,
        training: str = DEFAULT,
        threads: int = 1,
        memory_limit: int | None = None,
    ) -> None:
        self.job = Job(path, device, seed, training, k)
        self.threads, self.time_limit = threads, time_limit
        self.memory_limit = memory_limit
        self.loaded: Loaded

    def __enter__(self) -> Self:
        """Start the process and wait until the predictor is loaded."""
        context = multiprocessing.get_context("spawn")
        self._channel, other = context.Pipe()
        self._process = context.Process(target=work, args=(other, self.job))
        with _threads(self.threads):
            self._process.start()
        other.close()
        try:
            self.loaded = self._receive("while loading", ())
        except BaseException:
            self.__exit__(None, None, None)
            raise
        return self

    def predict(self, ids: Sequence[str], meshes: Sequence[Mesh]) -> Answered:
        """Return the answer to a batch. The ids are for messages; they stay here."""
        at = f"on the batch of {len(ids)} that begins with {', '.join(ids[:3])}"
        answered: Answered = self._ask(list(meshes), at, ids)
        return answered

    def status(self) -> Status:
        """Return the peak memory and the digests of the predictor's files."""
        status: Status = self._ask(None, "when all was predicted", ())
        return status

    def _ask(self, what: Any, at: str, ids: Sequence[str]) -> Any:
        try:
            self._channel.send(what)
        except OSError:
            raise self._died(at) from None
        return self._receive(at, ids)

    def _receive(self, at: str, ids: Sequence[str]) -> Any:
        self._wait(at)
        try:
            message = self._channel.recv()
        except (EOFError, OSError):
            raise self._died(at) from None
        if isinstance(message, Failed):
            error = PredictorError(f"{message.message}, {at}" if ids else message.message)
            error.add_note(f"In the predictor's process:\n{message.traceback}")
            raise error
        return message

    def _wait(self, at: str) -> None:
        """Wait for an answer, and watch the memory meanwhile if it is limited."""
        end = time.monotonic() + self.time_limit
        step = self.time_limit if self.memory_limit is None else WATCH
        while not self._channel.poll(max(0.0, min(step, end - time.monotonic()))):
            if time.monotonic() >= end:
                raise OverTime(
                    f"the predictor took more than {self.time_limit:g} s {at}: raise --time-limit"
                )
            limit = self.memory_limit
            if limit is not None and _resident_bytes(self._process.pid) > limit:
                raise OverMemory(
                    f"the predictor took more than {limit / 2**30:g} GiB {at}: raise --memory-limit"
                )

    def _died(self, at: str) -> PredictorError:
        self._process.join()
        return Died(
            f"the predictor's process died {at} (exit code {self._process.exitcode}; "
            "-9 is often lack of memory)"
        )

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """End the process, whatever it does."""
        self._channel.close()
        self._process.join(0 if error else 5)
        self._process.terminate()
        self._process.join(5)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _resident_bytes(pid: int | None) -> int:
    """Return the memory that a process has now; 0 where the system does not tell."""
    try:
        pages = Path(f"/proc/{pid}/statm").read_text().split()[1]
    except (FileNotFoundError, ProcessLookupError):
        return 0
    return int(pages) * resource.getpagesize()


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let a process started here use ``count`` threads: libraries read this when loaded."""
    before = {name: os.environ.get(name) for name in THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(count)))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
