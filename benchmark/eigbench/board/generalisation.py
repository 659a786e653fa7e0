"""How predictors do on what they were not trained on: a version's protocols side by side.

Each protocol tests shapes of the test split, so the same shapes can be scored twice: once by the
predictor whose training held them and their like out, once by the predictor that was trained on
everything. The difference is the drop. A model without training has none, and its predictions
under the protocol ``grouped`` are its predictions under every other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from eigbench.board.columns import Cell, Column, Group, six_digits
from eigbench.board.markdown import cell as escaped
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.board.tables import score
from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring import scores, truth
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.training import IMPORTED, trained_on, untrained
from eigbench.scoring.truth import Truth
from synthnet import recipe

SHOWN = ("rpd", "psnr20")
NOT_RUN = "not run"
TITLES = {
    "family": "each family unseen",
    "resolution": "fine meshes unseen",
    "genus": "genus 1 and more unseen",
    "boundary": "boundaries unseen",
}
NO_DROP = "None where nothing is trained, or the model is trained on another version."

EXPLAINED = (
    "The test shapes of the split above, predicted by models whose training held some of them "
    "out; models without training stay as they are. In brackets the drop: the score minus that of "
    "the same model, by the same code and with the same seeds, trained on everything, on the same "
    "shapes (for imported meshes, on the split above). There is no drop where nothing is trained, "
    "or the model is trained on another version. A family is held out together with those "
    "isometric to it. Not run: nobody has run it, or the model is trained on one set alone. "
    "[What is held out](docs/dataset-card-2.0.md#protocols)."
)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A model's mean score under a protocol.

    Parameters
    ----------
    score : float or None
        Mean of the metric; ``None`` where the model was not run.
    drop : float or None
        The score minus the mean, on the same shapes, of the same model trained on everything;
        ``None`` where the model is not trained, or on another version.
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
        Of each other protocol that tests generalisation.
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
        (model,) = (row.submission for row in self.rows if row.submission.slug == slug)
        return model

    def submitted(self, model: Submission, protocol: str) -> Submission | None:
        """Return a model's submission under a protocol, if there is one."""
        return {submission.slug: submission for submission in self.held_out.get(protocol, ())}.get(
            model.slug
        )

    def count(self, protocol: str) -> int:
        """Return how many meshes a protocol tests."""
        ran = self.held_out.get(protocol)
        labels = ran[0].truth if ran else tested(self.version, protocol)
        return len(np.unique(labels.shapes))

    def scored(self, model: Submission, protocol: str, key: str) -> HeldOut:
        """Return a model's mean of a metric under a protocol."""
        own = self.submitted(model, protocol)
        if own is not None:
            mean = _mean(own, own.truth, key)
            elsewhere = protocol.startswith(IMPORTED)
            seeds = len(own.predictions)  # the model trained on everything is scored on as many
            shapes = model.truth if elsewhere else own.truth
            meta = model.result["model"]
            if untrained(meta) or not trained_on(meta, self.version):
                return HeldOut(mean)
            return HeldOut(mean, mean - _mean(model, shapes, key, seeds))
        if untrained(model.result["model"]) and not protocol.startswith(IMPORTED):
            return HeldOut(_mean(model, tested(self.version, protocol), key))
        return HeldOut(None)


@lru_cache(maxsize=16)
def tested(version: str, protocol: str) -> Truth:
    """Return what a version's own protocol tests."""
    return truth.load(version, "test", protocol)


def _mean(model: Submission, labels: Truth, key: str, seeds: int | None = None) -> float:
    """Return the mean of a metric over some of a model's instances, and its first seeds."""
    return float(scores.of_metric(labels, predicted(model, labels)[:seeds], key).mean())


def predicted(model: Submission, labels: Truth) -> NDArray[np.float64]:
    """Return a model's predictions of some of its instances, shape (seeds, n, k).

    Raises
    ------
    EigbenchError
        If it does not predict one of them.
    """
    row_of = {id: row for row, id in enumerate(model.truth.ids)}
    missing = [id for id in labels.ids if id not in row_of]
    if missing:
        raise EigbenchError(f"{model.result_path} does not predict {missing[0]}")
    return np.asarray(model.predictions[:, [row_of[id] for id in labels.ids]])


Marks = dict[tuple[str, str], tuple[str, str]]  # (model, protocol): the mark, the line below


def remark_marks(board: Board, rows: Sequence[Ranked]) -> Marks:
    """Return the mark of each score with a remark, and its line below the table."""
    superscript = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
    marks: Marks = {}
    for row in rows:
        for protocol in board.protocols:
            submission = board.submitted(row.submission, protocol)
            if submission is not None and submission.remark:
                mark = str(len(marks) + 1).translate(superscript)
                line = escaped(f"{mark} {submission.name}, {title(protocol)}: {submission.remark}")
                marks[submission.slug, protocol] = mark, line
    return marks


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


def with_drop(held_out: HeldOut, key: str) -> str:
    """Return a score as text, and in brackets the drop."""
    if held_out.score is None:
        return NOT_RUN
    text = score(held_out.score, key)
    if held_out.drop is None:
        return text
    return f"{text} ({signed(held_out.drop, key).removesuffix(' %')})"


def signed(drop: float, key: str) -> str:
    """Return a drop in a metric as text, with its sign.

    Examples
    --------
    >>> signed(0.25, "rpd"), signed(-0.25, "psnr20")
    ('+0.2500', '−25.00 %')
    """
    return f"{'+' if drop >= 0 else '−'}{score(abs(drop), key)}"


def table(board: Board, key: str, marks: Marks) -> Group[Ranked]:
    """Return the table of a metric under every protocol of a version, with marks for remarks."""
    metric = METRICS[key]

    def iid(row: Ranked) -> Cell:
        value = row.submission.result["scores"]["overall"][key]["mean"]
        return score(value, key), six_digits(value)

    def column(protocol: str) -> Column[Ranked]:
        def cell(row: Ranked) -> Cell:
            held_out = board.scored(row.submission, protocol, key)
            mark, _ = marks.get((row.submission.slug, protocol), ("", ""))
            return f"{with_drop(held_out, key)} {mark}".rstrip(), six_digits(held_out.score)

        count = f"{board.count(protocol):,}"
        note = (
            f"Mean {metric.title} on the {count} meshes that this protocol tests, by a model whose "
            "training held them and their like out; in brackets the drop against the same model "
            "trained on everything."
        )
        key_ = f"{key}-{protocol}"
        return Column(key_, title(protocol), note, cell, higher=metric.higher_is_better, lead=count)

    note = f"Mean {metric.title} on the whole test split, trained on everything."
    first = Column(f"{key}-iid", "i.i.d.", note, iid, higher=metric.higher_is_better)
    columns = [first, *map(column, board.protocols)]
    heading = f"Generalisation, {metric.heading}"
    return Group(f"protocols-{key}", heading, columns, lead="meshes")


def drops(board: Board, protocol: str) -> list[Column[Ranked]]:
    """Return the columns of the same model trained on everything, and of what it loses."""
    metric = METRICS[RANKED_BY].title

    def scored(row: Ranked) -> HeldOut:
        return board.scored(board.model(row.submission.slug), protocol, RANKED_BY)

    def iid(row: Ranked) -> Cell:
        held_out = scored(row)
        if held_out.score is None or held_out.drop is None:
            return "none", None
        value = held_out.score - held_out.drop
        return score(value, RANKED_BY), six_digits(value)

    def drop(row: Ranked) -> Cell:
        lost = scored(row).drop
        return ("none", None) if lost is None else (signed(lost, RANKED_BY), six_digits(lost))

    iid_note = (
        f"Mean {metric} of the same model, by the same code and with the same seeds, trained on "
        f"everything, on the same shapes (for imported meshes, on the test split). {NO_DROP}"
    )
    drop_note = (
        f"Mean {metric} minus that of the same model trained on everything: what it loses on what "
        f"was held out. {NO_DROP}"
    )
    return [
        Column("iid", f"i.i.d. {metric}", iid_note, iid),
        Column("drop", "drop", drop_note, drop),
    ]
