"""The log of a sealed set: every score that is shown of it is recorded first."""

from __future__ import annotations

import json
import os
from datetime import UTC, datetime
from pathlib import Path

from eigbench.errors import EigbenchError
from synthnet.recipe import Kind
from synthnet.store import StoredDataset, storage


def log_of(dataset: StoredDataset) -> Path:
    """Return the log of a sealed set, beside its directory."""
    directory = storage.local(dataset.directory, dataset.manifest.version)
    return directory.with_name(f"{dataset.manifest.version}.queries.jsonl")


def note(dataset: StoredDataset | None, command: str, model: str, digest: str) -> None:
    """Append a line for a score of a sealed set: time, command, model, digest of its predictions.

    Of other datasets nothing is noted.

    Raises
    ------
    EigbenchError
        If that cannot be done: then the score must not be shown.
    """
    if dataset is None or dataset.kind is not Kind.SEALED:
        return
    entry = {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "model": model,
        "predictions": digest,
    }
    path = log_of(dataset)
    line = f"{json.dumps(entry)}\n".encode()
    try:
        descriptor = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        with os.fdopen(descriptor, "ab", buffering=0) as file:
            file.write(line)  # in one call, so that two commands cannot mix theirs
            os.fsync(file.fileno())
    except OSError as error:
        raise EigbenchError(
            f"cannot note the query in {path} ({error.strerror}): no score of a sealed set is "
            "shown without"
        ) from error
