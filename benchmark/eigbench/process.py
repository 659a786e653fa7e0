"""A predictor in a process of its own, and what becomes of it when it hangs or dies."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from eigbench.errors import PredictorError
from eigbench.worker import Answered, Failed, Job, Loaded, Status, work
from synthnet.types import Mesh

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class PredictorProcess:
    """A predictor that is loaded when the context is entered. This runs the file's code.

    Parameters
    ----------
    path : Path
        The predictor's file.
    k : int
        Number of eigenvalues.
    device, seed, training
        Handed to the predictor.
    threads : int
        Threads of BLAS and OpenMP.
    time_limit : float
        Most seconds for loading and for a batch.

    Raises
    ------
    PredictorError
        On entering and in each method: if the predictor fails, answers with the wrong shape
        or type, changes its input, hangs or dies.
    """

    def __init__(
        self,
        path: Path,
        k: int,
        *,
        device: str,
        seed: int,
        training: str,
        threads: int,
        time_limit: float,
    ) -> None:
        self.job = Job(path, device, seed, training, k)
        self.threads, self.time_limit = threads, time_limit
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
        if not self._channel.poll(self.time_limit):
            raise PredictorError(
                f"the predictor took more than {self.time_limit:g} s {at}: raise --time-limit"
            )
        try:
            message = self._channel.recv()
        except (EOFError, OSError):
            raise self._died(at) from None
        if isinstance(message, Failed):
            first = f" (first ids: {', '.join(ids[:3])})" if ids else ""
            raise PredictorError(f"{message.message}{first}")
        return message

    def _died(self, at: str) -> PredictorError:
        self._process.join()
        return PredictorError(
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
