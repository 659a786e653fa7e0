"""A result together with its predictions: read, and every score computed anew.

Whatever compares, ranks or draws results reads them here, so no number that cannot be
recomputed from its predictions goes further. No predictor's code is run.
"""

import math
import os
import reprlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from eigbench import outside, results
from eigbench.errors import OutsideError, ResultError
from eigbench.results import predictions, sources
from eigbench.scoring import scores, targets, truth
from eigbench.scoring.metrics import METRIC_VERSION
from eigbench.scoring.names import slug
from eigbench.scoring.training import on_imports
from eigbench.scoring.truth import Truth
from synthnet import recipe, store
from synthnet.recipe.names import Kind

AGREE = 1e-9  # relative, between a score that is stored and the same computed here


@dataclass(frozen=True, slots=True)
class Submission:
    """A result that its predictions confirm, and the two files."""

    result: dict[str, Any]  #: as :mod:`eigbench.results` made it
    #: What was predicted, with the eigenvalues of one target; as it is read, the meshes' labels.
    truth: Truth
    #: Of shape (seeds, n, k), in the order of the truth's ids, in 1/length².
    predictions: NDArray[np.float64]
    result_path: Path
    predictions_path: Path
    #: Meshes in a call of the run; the times that are shown may be of another run.
    batch_size: int
    #: What a reader should know of the result, on one line, as that its code has changed since,
    #: and the text beside it. Empty if there is nothing to say.
    remark: str = ""

    @property
    def name(self) -> str:
        """Name of the model."""
        return str(self.result["model"]["name"])

    @property
    def slug(self) -> str:
        """Name of the model in a file's name: ``rayleigh-ritz-degree-7``."""
        return slug(self.name)

    @property
    def target(self) -> str:
        """The target of its truth: ``mesh``, or ``surface``."""
        return self.truth.target

    @property
    def scores(self) -> dict[str, Any]:
        """The scores at its target, as :func:`eigbench.scoring.scores.score` makes them."""
        scored: dict[str, Any] = self.result["scores"][self.target]
        return scored

    def at(self, target: str) -> Self | None:
        """Return the same predictions beside another target; None where it is not known."""
        labels = targets.at(self.truth, target)
        return None if labels is None else replace(self, truth=labels)

    @property
    def board(self) -> str:
        """Where its files are: ``1.0-test-grouped``, ``2.0-test-imported-scans``."""
        facts = self.result["dataset"]
        protocol = facts["protocol"].replace("/", "-")
        return f"{facts['version']}-{facts['split']}-{protocol}"


def remark_path(result: Path) -> Path:
    """Return where the remark on a result would be."""
    return result.with_suffix(".remark.txt")


def read(
    path: Path,
    predictions_path: Path | None = None,
    dataset: store.StoredDataset | None = None,
    below: Path | None = None,
) -> Submission:
    """Read a result and its predictions, and check one against the other.

    Parameters
    ----------
    path : Path
        The result's JSON.
    predictions_path : Path, optional
        Its predictions; looked for beside it, and in the board's ``predictions``.
    dataset : StoredDataset, optional
        What was predicted, if it is no version whose labels are pinned.
    below : Path, optional
        A folder above all the files: no name on the way from there may be a symbolic link.

    Raises
    ------
    ResultError
        If the result contradicts itself, its labels or its predictions, or the remark beside it
        is no text.
    PredictionsError
        If the predictions are missing, damaged, or not exactly the split's.
    """
    result = results.read(path, below)
    kept = predictions_path or _beside(path)
    labels, answers = _predicted(result, path, kept, dataset, below)
    try:
        _check_same(result["scores"], scores.of_targets(labels, answers), "scores", path)
    except ResultError as error:
        if dataset is None or dataset.kind is not Kind.SEALED:
            raise
        # A number of a sealed set would be a query that nobody has noted.
        raise ResultError(f"{path}: its scores are not those of its predictions") from error
    remark = " ".join(
        filter(None, [sources.remark(result, path), _remark(remark_path(path), below)])
    )
    return Submission(result, labels, answers, path, kept, result["cost"]["batch_size"], remark)


def rescored(path: Path, predictions_path: Path, below: Path) -> dict[str, Any]:
    """Return a result with the scores that its predictions have by the metrics of today.

    Raises
    ------
    ResultError, PredictionsError
        As :func:`read`, but for scores, which may be those of other metrics.
    """
    result = results.load(path, below)
    if isinstance(result, dict) and "metric_version" in result:
        result["metric_version"] = METRIC_VERSION
    results.check_schema(result, results.schema(), path)
    labels, answers = _predicted(result, path, predictions_path, None, below)
    result["scores"] = scores.of_targets(labels, answers)
    results.validate(result, path)
    return dict(result)


def _predicted(
    result: dict[str, Any],
    path: Path,
    kept: Path,
    dataset: store.StoredDataset | None,
    below: Path | None,
) -> tuple[Truth, NDArray[np.float64]]:
    """Return the labels of a result, and its predictions from the file that it was made with."""
    labels = _truth(result, dataset, path)
    _check_labels(result, labels, path)
    answers = predictions.read(kept, labels, below)
    digest = outside.sha256(kept, most=predictions.most_bytes(labels), below=below)
    if digest != result["predictions"]["sha256"]:
        raise ResultError(
            f"{kept} is not the file that {path} was made with: its SHA-256 is "
            f"{digest[:12]}…, the result names {result['predictions']['sha256'][:12]}…"
        )
    if len(answers) != result["predictions"]["seeds"]:
        raise ResultError(
            f"{kept} has {len(answers)} seeds, {path} names {result['predictions']['seeds']}"
        )
    return labels, answers


def _remark(path: Path, below: Path | None) -> str:
    if not os.path.lexists(path):
        return ""
    try:
        text = outside.read_line(path, below=below)
    except OutsideError as error:
        raise ResultError(str(error)) from error
    if not text:
        raise ResultError(f"{path} is empty: write the remark into it, or remove it")
    return text


def _truth(result: dict[str, Any], dataset: store.StoredDataset | None, path: Path) -> Truth:
    facts = result["dataset"]
    split, protocol = facts["split"], facts["protocol"]
    if dataset is not None:
        check_dataset(result, dataset.manifest.version, path)
        if on_imports(protocol):
            labels = truth.of_import(dataset, facts["version"])
        else:
            labels = truth.of_dataset(dataset, split, protocol)
    elif facts["version"] in recipe.available():
        labels = _pinned(facts["version"], split, protocol)
    elif scores.is_sealed(facts["version"]):
        raise ResultError(
            f"{path} is of the sealed set {facts['version']}, which cannot be on a board: "
            "compare results of one with --dataset, its directory"
        )
    else:
        name = facts["version"]
        raise ResultError(
            f"{path} is of {name}, which is no version of synthNet: add --dataset {name}. No board "
            "has such a result; one of an import is for a board if it was evaluated with "
            f"--dataset 2.0 --protocol imported/{name}"
        )
    return labels.head(facts["instances"]) if result["partial"] else labels


def check_dataset(result: dict[str, Any], name: str, path: Path) -> None:
    """Check that a result is of the dataset that was named, a version or an import that it tests.

    Raises
    ------
    ResultError
        If it is of another one.
    """
    of, protocol = result["dataset"]["version"], result["dataset"]["protocol"]
    if on_imports(protocol) and name not in recipe.available():
        of = protocol.partition("/")[2]
    if name != of:
        raise ResultError(
            f"{path} is of the dataset {of}, not of {name}: give --dataset {of}, or leave it out "
            "where its labels are pinned"
        )


@lru_cache(maxsize=8)
def _pinned(version: str, split: str, protocol: str) -> Truth:
    return truth.load(version, split, protocol)


def _check_labels(result: dict[str, Any], labels: Truth, path: Path) -> None:
    for key, here in results.dataset_facts(labels).items():
        stored = result["dataset"][key]
        if stored != here:
            raise ResultError(
                f"{path} was made with other labels: its {key} is {str(stored)[:16]}, "
                f"that of {labels.version} here is {str(here)[:16]}"
            )


def _beside(path: Path) -> Path:
    beside = path.with_suffix(".parquet")
    on_board = path.parent.parent.parent / "predictions" / path.parent.name / beside.name
    for candidate in (beside, on_board):
        if candidate.is_file():
            return candidate
    raise ResultError(
        f"{path}: there are no predictions at {beside}: put them there, or name their file with "
        "--predictions where the command has that"
    )


def _check_same(stored: Any, computed: Any, key: str, path: Path) -> None:
    """Raise at the first number in which two trees differ."""
    if isinstance(computed, dict) and isinstance(stored, dict) and stored.keys() == computed.keys():
        for name, value in computed.items():
            _check_same(stored[name], value, f"{key}/{name}", path)
    elif isinstance(computed, list) and isinstance(stored, list) and len(stored) == len(computed):
        for i, value in enumerate(computed):
            _check_same(stored[i], value, f"{key}/{i}", path)
    elif stored != computed and not _is_close(stored, computed):
        was, made = reprlib.repr(stored), reprlib.repr(computed)
        raise ResultError(f"{path}: {key} is {was}, its predictions give {made}")


def _is_close(stored: Any, computed: Any) -> bool:
    numbers = isinstance(computed, float) and isinstance(stored, int | float)
    return numbers and math.isclose(stored, computed, rel_tol=AGREE, abs_tol=1e-15)
