"""How predictors do on what they were not trained on: a version's protocols side by side.

Each protocol tests shapes of the test split, so the same shapes can be scored twice: once by the
predictor whose training held them and their like out, once by the one that was trained on
everything. The difference is the drop. What is not trained has none, and its predictions under
the protocol ``grouped`` are its predictions under every other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eigbench.board.markdown import cell as escaped
from eigbench.board.markdown import table
from eigbench.board.ranking import Ranked
from eigbench.board.tables import score
from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring import scores, truth
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.training import IMPORTED, trained_on, untrained
from eigbench.scoring.truth import Truth
from synthnet import recipe
from synthnet.store.files import sha256

SHOWN = ("rpd", "psnr20")
NOT_RUN = "not run"
TITLES = {
    "family": "each family unseen",
    "resolution": "fine meshes unseen",
    "genus": "genus 1 and more unseen",
    "boundary": "boundaries unseen",
}

EXPLAINED = (
    "The test shapes of the split above, predicted by models whose training held something "
    "of them out; models without training are as they were. In brackets the drop: the score "
    "minus that of the same model, by the same code and with the same seeds, trained on "
    "everything, on the same shapes (for imported meshes, on the split above); none where nothing "
    "is trained, or on another version. With a family, those that are isometric to it are held "
    "out. Not run: nobody has, or the model is trained on one set alone. "
    "[What is held out](docs/dataset-card-2.0.md#protocols)."
)


@dataclass(frozen=True, slots=True)
class Cell:
    """A model's mean score under a protocol, and by how much it is off the unheld one's.

    Parameters
    ----------
    score : float or None
        Mean of the metric; ``None`` where the model was not run.
    drop : float or None
        Minus the mean, on the same shapes, of the same model trained on everything; ``None``
        where the model is not trained, or on another version.
    """

    score: float | None
    drop: float | None = None


@dataclass(frozen=True, slots=True)
class Board:
    """All that a version's protocols know of its models.

    Parameters
    ----------
    rows : sequence of Ranked
        Of the protocol ``grouped``, best first.
    held_out : mapping of str to sequence of Submission
        Of each other protocol that asks for generalisation.
    """

    rows: Sequence[Ranked]
    held_out: Mapping[str, Sequence[Submission]]

    @property
    def version(self) -> str:
        """The version's name."""
        return self.rows[0].submission.truth.version

    @property
    def protocols(self) -> list[str]:
        """The recipe's protocols in its order, imported datasets by name at the end."""
        named = [name for name in recipe.load(self.version).protocols or {} if name != IMPORTED]
        imports = sorted(name for name in self.held_out if name.startswith(IMPORTED))
        return [*named, *imports]

    def model(self, slug: str) -> Submission:
        """Return the submission of that name under ``grouped``."""
        (found,) = (row.submission for row in self.rows if row.submission.slug == slug)
        return found

    def submitted(self, model: Submission, protocol: str) -> Submission | None:
        """Return a model's submission under a protocol, if there is one."""
        return {one.slug: one for one in self.held_out.get(protocol, ())}.get(model.slug)

    def cell(self, model: Submission, protocol: str, key: str) -> Cell:
        """Return a model's cell under a protocol."""
        own = self.submitted(model, protocol)
        if own is not None:
            mean = _mean(own, own.truth, key)
            elsewhere = protocol.startswith(IMPORTED)
            seeds = len(own.predictions)  # of the model trained on everything, the same
            shapes = model.truth if elsewhere else own.truth
            meta = model.result["model"]
            if untrained(meta) or not trained_on(meta, self.version):
                return Cell(mean)
            return Cell(mean, mean - _mean(model, shapes, key, seeds))
        if untrained(model.result["model"]) and not protocol.startswith(IMPORTED):
            return Cell(_mean(model, tested(self.version, protocol), key))
        return Cell(None)


@lru_cache(maxsize=16)
def tested(version: str, protocol: str) -> Truth:
    """Return what a version's own protocol tests."""
    return truth.load(version, "test", protocol)


def _mean(model: Submission, wanted: Truth, key: str, seeds: int | None = None) -> float:
    """Return the mean of a metric over some of a model's instances, and its first seeds."""
    found = predicted(model, wanted)[:seeds]
    return float(scores.of_metric(wanted, found, key).mean())


def predicted(model: Submission, wanted: Truth) -> NDArray[np.float64]:
    """Return a model's predictions of some of its instances, shape (seeds, n, k).

    Raises
    ------
    EigbenchError
        If it does not predict one of them.
    """
    row_of = {id: row for row, id in enumerate(model.truth.ids)}
    missing = [id for id in wanted.ids if id not in row_of]
    if missing:
        raise EigbenchError(f"{model.result_path} does not predict {missing[0]}")
    return np.asarray(model.predictions[:, [row_of[id] for id in wanted.ids]])


def section(board: Board, figure: str) -> list[str]:
    """Return the Markdown of a version's protocols, and the place of its figure."""
    parts = [
        f"## synthNet {board.version}: generalisation\n",
        f"{EXPLAINED}\n",
    ]
    counts = [f"{title(name)} ({_count(board, name)})" for name in board.protocols]
    marks = _marks(board, board.rows)
    for key in SHOWN:
        headers = [f"{METRICS[key].heading} of", "i.i.d.", *counts]
        parts.append(table(headers, _lines(board, key, board.rows, marks)))
    parts += [f"{line}\n" for _, line in marks.values()]
    parts.append(f"![Error under each protocol]({figure})\n")
    return [*parts, *_digests(board)]


def top(board: Board, count: int) -> str:
    """Return what the first rows of a board lose where it was held out, for the README."""
    key = SHOWN[0]
    headers = [f"{METRICS[key].heading} of", "i.i.d.", *map(title, board.protocols)]
    intro = (
        f"The same models on what training did not have, synthNet {board.version}; in brackets "
        "the drop of those that are trained:"
    )
    rows = board.rows[:count]
    marks = _marks(board, rows)
    below = "".join(f"\n{line}\n" for _, line in marks.values())
    return f"{intro}\n\n{table(headers, _lines(board, key, rows, marks))}{below}"


Marks = dict[tuple[str, str], tuple[str, str]]  # (model, protocol): the mark, the line below


def _lines(board: Board, key: str, rows: Sequence[Ranked], marks: Marks) -> list[list[str]]:
    found = []
    for row in rows:
        one = row.submission
        cells = [score(one.result["scores"]["overall"][key]["mean"], key)]
        for protocol in board.protocols:
            cell = with_drop(board.cell(one, protocol, key), key)
            mark, _ = marks.get((one.slug, protocol), ("", ""))
            cells.append(f"{cell} {mark}".rstrip())
        found.append([one.name, *cells])
    return found


def _marks(board: Board, rows: Sequence[Ranked]) -> Marks:
    """Return the mark of each cell with a remark, and its line below the table."""
    superscript = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
    found: Marks = {}
    for row in rows:
        for protocol in board.protocols:
            one = board.submitted(row.submission, protocol)
            if one is not None and one.remark:
                mark = str(len(found) + 1).translate(superscript)
                line = escaped(f"{mark} {one.name}, {title(protocol)}: {one.remark}")
                found[one.slug, protocol] = mark, line
    return found


def title(protocol: str) -> str:
    """Return what a column is called.

    Examples
    --------
    >>> title("genus"), title("imported/scans"), title("mine")
    ('genus 1 and more unseen', 'imported: scans', 'mine')
    """
    if protocol.startswith(IMPORTED):
        return protocol.replace("/", ": ")
    return TITLES.get(protocol, protocol)


def _count(board: Board, protocol: str) -> str:
    ran = board.held_out.get(protocol)
    wanted = ran[0].truth if ran else tested(board.version, protocol)
    return f"{len(np.unique(wanted.shapes)):,} meshes"


def with_drop(cell: Cell, key: str) -> str:
    """Return a cell as text: the score, and in brackets the drop."""
    if cell.score is None:
        return NOT_RUN
    text = score(cell.score, key)
    if cell.drop is None:
        return text
    return f"{text} ({signed(cell.drop, key).removesuffix(' %')})"


def signed(drop: float, key: str) -> str:
    """Return a drop in a metric as text, with its sign.

    Examples
    --------
    >>> signed(0.25, "rpd"), signed(-0.25, "psnr20")
    ('+0.2500', '−25.00 %')
    """
    return f"{'+' if drop >= 0 else '−'}{score(abs(drop), key)}"


def _digests(board: Board) -> list[str]:
    lines = [
        [
            name,
            one.name,
            str(len(one.predictions)),
            sha256(one.result_path),
            sha256(one.predictions_path),
        ]
        for name in board.protocols
        for one in sorted(board.held_out.get(name, ()), key=lambda one: one.slug)
    ]
    if not lines:
        return []
    headers = ["protocol", "model", "seeds", "result", "predictions"]
    return ["### Seeds and digests under these protocols\n", table(headers, lines, left=5)]
