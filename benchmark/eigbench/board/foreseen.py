"""What a run of a predictor will cost, by the times that a board has of it, or of LaPy."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from eigbench import results
from eigbench.board.leaderboard import RESULTS
from eigbench.errors import EigbenchError, OutsideError
from eigbench.results.sources import digest
from eigbench.running.predictor import code_name, split
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.errors import counted


def line(root: Path, labels: Truth, code: Path, seeds: int) -> str:
    """Return what is known of a run before it starts, as one line.

    ``labels`` are what is to be predicted, ``seeds`` times. A row of the board in ``root`` tells
    most if it was made by the predictor's file, ``code``; there may be no board.
    """
    count = len(labels.ids) * seeds
    start = f"{counted(count, 'mesh', 'meshes')} to predict"
    for board in _boards(labels):
        rows = list(_readable(sorted((root / RESULTS / board).glob("*.json"))))
        own = [(row, f"the row of {code.name}") for row in rows if _is_made_by(code, row)]
        lapy = [(row, "LaPy") for row in rows if row["model"]["name"] == "LaPy"]
        if candidates := [*own, *lapy]:
            row, name = candidates[0]
            took = about(row["cost"]["ms_per_mesh_mean"] / 1e3 * count)
            setting = results.setting(row)
            return f"{start}: {name} took {took} for as many on the board ({setting})"
    return f"{start}; no result of them is recorded here: the first batch will show the time"


def _is_made_by(code: Path, row: dict[str, Any]) -> bool:
    """Return whether a row was made by a file of this name and code."""
    if row["model"]["code"] != code_name(code):
        return False
    file = split(code)[0].resolve()
    try:
        return bool(row["model"]["sources"].get(file.name) == digest(file))
    except (OSError, OutsideError):
        return False  # why it cannot be read is said when it is run


def _readable(paths: Sequence[Path]) -> Iterator[dict[str, Any]]:
    """Yield the results that are whole; of the others `eigbench leaderboard` speaks."""
    for path in paths:
        with contextlib.suppress(EigbenchError):
            yield results.read(path)


def _boards(labels: Truth) -> Iterator[str]:
    """Yield the boards whose times hold: its own, and that of the version whose part it is."""
    yield f"{labels.version}-test-{labels.protocol.replace('/', '-')}"
    if labels.version in recipe.available():
        yield f"{recipe.load(labels.version).base}-test-grouped"


def about(seconds: float) -> str:
    """Return a duration as a rough number of minutes.

    Examples
    --------
    >>> about(20), about(700)
    ('less than a minute', 'about 12 min')
    """
    return "less than a minute" if seconds < 60 else f"about {seconds / 60:.0f} min"
