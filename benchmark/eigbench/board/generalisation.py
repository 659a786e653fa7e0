"""How predictors do on what they were not trained on: a version's protocols side by side.

Each protocol tests shapes of the test split, so the same shapes can be scored twice: once by the
predictor whose training held them and their like out, once by the predictor that was trained on
everything. The difference is the drop. A model without training has none, and its predictions
under the protocol ``grouped`` are its predictions under every other.
"""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from eigbench import results
from eigbench.board import ranking
from eigbench.board.columns import Cell, Column, Group, of_score, six_digits, words
from eigbench.board.markdown import cell as escaped
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.board.tables import score, with_uncertainty
from eigbench.errors import EigbenchError
from eigbench.results.submission import Submission
from eigbench.scoring import neighbours as near
from eigbench.scoring import scores, targets, truth
from eigbench.scoring.metrics import METRICS
from eigbench.scoring.training import IMPORTED, may_be_trained_on, on_imports, untrained
from eigbench.scoring.truth import Truth
from synthnet import recipe

SHOWN = ("rpd", "psnr20")
NOT_RUN = "not run"
FAMILIAR = "familiar shapes"  # of the whole test split: i.i.d. with those of training
LEAD = "test meshes (share with a training shape within 1 %)"
TITLES = {
    "family": "each family unseen",
    "resolution": "fine meshes unseen",
    "genus": "genus 1 and more unseen",
    "boundary": "boundaries unseen",
    "cad": "parts unseen",
    "cortex": "folded surfaces unseen",
}
NO_DROP = "None where nothing is trained, or the model is trained on another version."

EXPLAINED = (
    "Each column after *familiar shapes* holds one kind of shape out of training, and tests on it. "
    "Scores are means ± half the width of their 95 % interval over shapes and seeds. In brackets "
    "with a sign is the drop: the score minus that of the same model, by the same code and with "
    "the same seeds, trained on everything, on the same test shapes. If one of the two has more "
    "seeds, the drop is of those that both have. Models without training and models trained on "
    "another version have no drop, and neither has any model on imported meshes, which are in no "
    "training set. A family is held out together with all families that share its surfaces. *Not "
    "run*: nobody has evaluated the model there; a note below the table says why, where one is "
    "marked."
)
MESH_EXPLAINED = (
    "The same tests, scored against the mesh, and those on imported meshes, for which nothing is "
    "held out of training."
)
NEAR_EXPLAINED = (
    "For each tested shape, the nearest shape of the training split that the protocol leaves: by "
    "the largest |ln(λ/λ')| of their surfaces' spectra (of imported meshes, of their labels), "
    "each divided by its geometric mean, so that scale does not count. If most tested shapes have "
    "such a neighbour within 1 %, the test is one of interpolation."
)


@dataclass(frozen=True, slots=True)
class HeldOut:
    """A model's mean score under a protocol.

    Drop and ``before`` are ``None`` where the model is not trained, or on another version. Both
    are of the seeds that the model has under the protocol and trained on everything.
    """

    #: The mean of the metric, with its interval and its deviation over seeds, as in the scores of a
    #: row; ``None`` where the model was not run.
    numbers: Mapping[str, float | None] | None
    #: The mean minus that, on the same shapes, of the same model trained on everything.
    drop: float | None = None
    before: float | None = None  #: that mean

    @property
    def score(self) -> float | None:
        """The mean of the metric; ``None`` where the model was not run."""
        return None if self.numbers is None else self.numbers["mean"]


@dataclass(frozen=True, slots=True)
class NotRun:
    """Why models have no row under some protocols of a version."""

    version: str
    protocols: Sequence[str]
    models: Sequence[str]  #: their names
    reason: str


@dataclass(frozen=True)  # a class with slots has no cached properties
class Board:
    """All that a version's protocols know of its models."""

    rows: Sequence[Ranked]  #: of the protocol ``grouped``, best first
    #: Of each other protocol that tests generalisation, at the same target.
    held_out: Mapping[str, Sequence[Submission]]
    not_run: Sequence[NotRun] = ()  #: of the version

    @property
    def version(self) -> str:
        """The version's name."""
        return self.rows[0].submission.truth.version

    @property
    def target(self) -> str:
        """What the predictions are compared with."""
        return self.rows[0].submission.target

    @property
    def protocols(self) -> list[str]:
        """The recipe's protocols in its order, imported datasets by name at the end."""
        named = [name for name in recipe.load(self.version).protocols or {} if name != IMPORTED]
        imports = sorted(name for name in self.held_out if on_imports(name))
        return [*named, *imports]

    @cached_property
    def under(self) -> dict[str, dict[str, Ranked]]:
        """By protocol and name the rows that have a score there, with their ranks, best first.

        Models without training are among them: their predictions of the whole split hold for a
        part of it. All have the times of the protocol ``grouped``.
        """
        every = {protocol: list(self._submissions(protocol)) for protocol in self.protocols}
        return {
            protocol: {row.submission.slug: row for row in ranking.ranked(mine)}
            for protocol, mine in every.items()
            if mine
        }

    def _submissions(self, protocol: str) -> Iterator[Submission]:
        for model in (row.submission for row in self.rows):
            if own := self.submitted(model, protocol):
                yield replace(own, result={**own.result, "cost": model.result["cost"]})
            elif untrained(model.result["model"]) and not on_imports(protocol):
                yield rescored(model, tested(self.version, protocol, self.target))

    @property
    def models(self) -> list[Ranked]:
        """Its rows, by their ranks under the first protocol; those without a score there last."""
        first = list(self.under.get(self.protocols[0], ()))

        def order(row: Ranked) -> int:
            slug = row.submission.slug
            return first.index(slug) if slug in first else len(first)

        return sorted(self.rows, key=order)

    def model(self, slug: str) -> Submission:
        """Return the submission of that name under ``grouped``."""
        (model,) = (row.submission for row in self.rows if row.submission.slug == slug)
        return model

    def is_trained(self, model: Submission) -> bool:
        """Return whether a model is trained on the version, and so anew for each protocol."""
        meta = model.result["model"]
        return not untrained(meta) and may_be_trained_on(meta, self.version)

    def submitted(self, model: Submission, protocol: str) -> Submission | None:
        """Return a model's submission under a protocol, if there is one."""
        ran = {submission.slug: submission for submission in self.held_out.get(protocol, ())}
        return ran.get(model.slug)

    def why_not(self, model: Submission, protocol: str) -> NotRun | None:
        """Return why a model was not run under a protocol, where that is known."""
        known = (e for e in self.not_run if protocol in e.protocols and model.name in e.models)
        return next(known, None)

    def count(self, protocol: str) -> int:
        """Return how many shapes a protocol tests."""
        ran = self.held_out.get(protocol)
        labels = ran[0].truth if ran else tested(self.version, protocol, self.target)
        return len(np.unique(labels.shapes))

    def row(self, protocol: str, slug: str) -> Ranked | None:
        """Return a model's row under a protocol, if it has one."""
        return self.under.get(protocol, {}).get(slug)

    def scored(self, model: Submission, protocol: str, key: str) -> HeldOut:
        """Return a model's mean of a metric under a protocol."""
        row = self.row(protocol, model.slug)
        if row is None:
            return HeldOut(None)
        own = row.submission
        numbers = row.scores["overall"][key]
        if not self.is_trained(model) or on_imports(protocol):
            return HeldOut(numbers)
        seeds = min(len(own.predictions), len(model.predictions))
        before = _mean(model, own.truth, key, seeds)
        return HeldOut(numbers, _mean(own, own.truth, key, seeds) - before, before)


@lru_cache(maxsize=16)
def tested(version: str, protocol: str, target: str) -> Truth:
    """Return what a version's own protocol tests.

    Raises
    ------
    EigbenchError
        If the target is not known.
    """
    labels = targets.at(truth.load(version, "test", protocol), target)
    if labels is None:
        raise EigbenchError(f"the surfaces' spectra of {version}, {protocol}, are not pinned")
    return labels


def neighbours(board: Board) -> list[list[str]]:
    """Return one line per protocol: its name, shapes tested, and how near training comes."""
    lines = []
    for protocol in ["grouped", *board.protocols]:
        apart = near.distances(board.version, protocol)
        shares = [near.share(board.version, protocol, bound) for bound in (near.SIMILAR, 0.05)]
        name = FAMILIAR if protocol == "grouped" else title(protocol)
        lines.append([name, f"{len(apart):,}", f"{100 * np.median(apart):.1f} %", *shares])
    return lines


def _mean(model: Submission, labels: Truth, key: str, seeds: int) -> float:
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


def restricted(model: Submission, labels: Truth) -> Submission:
    """Return a submission as if it had predicted only some of its instances, with its result.

    Raises
    ------
    EigbenchError
        If it does not predict one of them.
    """
    return replace(model, truth=labels, predictions=predicted(model, labels))


def rescored(model: Submission, labels: Truth) -> Submission:
    """Return a submission as if it had predicted only some of its instances, with their scores.

    Raises
    ------
    EigbenchError
        If it does not predict one of them.
    """
    some = restricted(model, labels)
    result = {
        **model.result,
        "dataset": results.dataset_facts(labels),
        "scores": {labels.target: scores.score(labels, some.predictions)},
    }
    return replace(some, result=result)


Marks = dict[tuple[str, str], tuple[str, str]]  # (model, protocol): the mark, the line below


def remark_marks(board: Board, rows: Sequence[Ranked]) -> Marks:
    """Return the mark of each cell with a remark or a reason, and its line below the table."""
    superscript = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")
    marks: Marks = {}
    numbers: dict[str, str] = {}  # by line: a reason can be that of several cells
    for row, protocol in itertools.product(rows, board.protocols):
        if line := _remark(board, row.submission, protocol):
            mark = numbers.setdefault(line, str(len(numbers) + 1).translate(superscript))
            marks[row.submission.slug, protocol] = mark, escaped(f"{mark} {line}")
    return marks


def _remark(board: Board, model: Submission, protocol: str) -> str:
    """Return what is said of a model under a protocol, with the names of both; empty if nothing."""
    own = board.submitted(model, protocol)
    if own is not None and own.remark:
        return f"{own.name}, {title(protocol)}: {own.remark}"
    entry = board.why_not(model, protocol)
    if entry is None:
        return ""
    return f"{' and '.join(entry.models)}, {', '.join(map(title, entry.protocols))}: {entry.reason}"


def lines(marks: Marks) -> list[str]:
    """Return the lines below a table, each once."""
    return list(dict.fromkeys(line for _, line in marks.values()))


def title(protocol: str) -> str:
    """Return what a column is called.

    Examples
    --------
    >>> title("genus"), title("imported/scans"), title("mine")
    ('genus 1 and more unseen', 'imported: scans', 'mine')
    """
    return TITLES.get(protocol, protocol.replace("/", ": "))


def _without_seeds(numbers: Mapping[str, float | None], key: str) -> str:
    """Return a score ± half its interval: what brackets hold here is the drop."""
    return with_uncertainty({**numbers, "seed_std": None}, key)


def with_drop(held_out: HeldOut, key: str) -> str:
    """Return a score ± half its interval as text, and in brackets the drop."""
    if held_out.numbers is None:
        return NOT_RUN
    text = _without_seeds(held_out.numbers, key)
    if held_out.drop is None:
        return text
    return f"{text} ({signed(held_out.drop, key).removesuffix(' %')})"


def signed(drop: float, key: str) -> str:
    """Return a drop in a metric as text, with its sign.

    Examples
    --------
    >>> signed(0.25, "rpd"), signed(-0.25, "psnr20"), signed(2e-5, "rpd")
    ('+0.2500', '−25.00 %', '±0')
    """
    text = score(abs(drop), key)
    return "±0" if text == "exact" or text.startswith("<") else f"{'+' if drop >= 0 else '−'}{text}"


def table(board: Board, key: str, marks: Marks) -> Group[Ranked]:
    """Return the table of a metric under every protocol of a version, with marks for remarks."""
    metric = METRICS[key]

    def iid(row: Ranked) -> Cell:
        numbers = row.scores["overall"][key]
        return _without_seeds(numbers, key), six_digits(numbers["mean"])

    def column(protocol: str) -> Column[Ranked]:
        def cell(row: Ranked) -> Cell:
            held_out = board.scored(row.submission, protocol, key)
            mark, _ = marks.get((row.submission.slug, protocol), ("", ""))
            return f"{with_drop(held_out, key)} {mark}".rstrip(), six_digits(held_out.score)

        count = f"{board.count(protocol):,}"
        note = (
            f"Mean {metric.title} on the {count} meshes that this protocol tests ± half its 95 % "
            "interval, by a model whose training held them and their like out; in brackets with a "
            "sign the drop against the same model trained on everything."
        )
        key_, lead = f"{key}-{protocol}", f"{count} ({near.share(board.version, protocol)})"
        return Column(key_, title(protocol), note, cell, higher=metric.higher_is_better, lead=lead)

    note = f"Mean {metric.title} on the whole test split, trained on everything."
    tested_ = board.rows[0].submission.result["dataset"]["shapes"]
    lead = f"{tested_:,} ({near.share(board.version, 'grouped')})"
    first = Column(f"{key}-iid", FAMILIAR, note, iid, higher=metric.higher_is_better, lead=lead)
    columns = [first, *map(column, board.protocols)]
    heading = f"Generalisation, {metric.heading}"
    return Group(f"protocols-{key}", heading, columns, lead=LEAD)


def rank(board: Board) -> Column[Ranked]:
    """Return the column of ranks under the first protocol."""
    first = board.protocols[0]

    def cell(row: Ranked) -> Cell:
        there = board.row(first, row.submission.slug)
        return words("" if there is None else there.shown_rank)

    note = f"By mean {METRICS[RANKED_BY].title} under the protocol {first}, as on a board."
    return Column("rank", f"rank, {title(first)}", note, cell, numeric=False)


def seeds(board: Board) -> Column[Ranked]:
    """Return the column of how many seeds each model has under the protocols."""

    def cell(row: Ranked) -> Cell:
        there = (rows.get(row.submission.slug) for rows in board.under.values())
        counts = {len(one.submission.predictions) for one in there if one is not None}
        return words(" or ".join(map(str, sorted(counts))))

    note = "Runs with other random numbers under these protocols; their mean is shown."
    return Column("seeds", "seeds", note, cell)


def drops(board: Board, protocol: str) -> list[Column[Ranked]]:
    """Return the columns of the same model trained on everything, and of what it loses."""
    metric = METRICS[RANKED_BY].title

    def scored(row: Ranked) -> HeldOut:
        return board.scored(board.model(row.submission.slug), protocol, RANKED_BY)

    def iid(row: Ranked) -> Cell:
        before = scored(row).before
        return ("none", None) if before is None else of_score(before, RANKED_BY)

    def drop(row: Ranked) -> Cell:
        lost = scored(row).drop
        return ("none", None) if lost is None else (signed(lost, RANKED_BY), six_digits(lost))

    iid_note = (
        f"Mean {metric} of the same model, by the same code and with the same seeds, trained on "
        f"everything, on the same shapes. {NO_DROP}"
    )
    drop_note = (
        f"Mean {metric} minus that of the same model trained on everything: what it loses on what "
        f"was held out. {NO_DROP}"
    )
    return [
        Column("iid", f"{FAMILIAR}, {metric}", iid_note, iid),
        Column("drop", "drop", drop_note, drop),
    ]
