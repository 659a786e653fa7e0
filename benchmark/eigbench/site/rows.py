"""What a row opens to: all its numbers, and its worst and its median shape."""

from typing import Any

import numpy as np

from eigbench.board import ranking, tables
from eigbench.board.columns import six_digits
from eigbench.board.ranking import RANKED_BY, Ranked
from eigbench.board.tables import Table, error, family_title, score
from eigbench.results.submission import Submission
from eigbench.results.verification import is_verified
from eigbench.scoring.metrics import METRICS
from eigbench.site import origin, shapes
from synthnet.store.files import sha256

QUANTILES = {"worst": 1.0, "median": 0.5}
NO_MESH = "The mesh is not shown: its file is not part of this project."


def content(row: Ranked, where: str, own: str | None, code: str) -> dict[str, Any]:
    """Return what the page shows of a row when it is opened: no cost of a declared one.

    ``where`` is the title of its board, ``own`` its protocol if that is the version's own: the row
    was timed under ``grouped`` then. ``code`` is the address of a file of the checkout, with ``{}``
    for its path.
    """
    submission = row.submission
    result = submission.result
    cost = "Cost" if own is None else "Cost under the protocol grouped"
    return {
        "facts": origin.facts(result, submission.result_path, code),
        "verified": is_verified(result),
        "bibtex": origin.bibtex(result, submission.result_path, submission.slug, where),
        "tables": [
            _table("Metrics", tables.overall(submission.scores)),
            _table("By family, means", tables.families(submission.scores)),
            _table("By eigenvalue", _indices(submission.scores)),
            *([] if row.cost is None else [_table(cost, tables.cost(result))]),
            _table("Files and versions", _files(submission)),
        ],
        "shapes": [_shape(submission, name, i) for name, i in chosen(submission).items()],
    }


def _table(title: str, table: Table) -> dict[str, Any]:
    return {"title": title, "headers": table.headers, "rows": table.rows}


def _indices(scored: dict[str, Any]) -> Table:
    """Return the errors by eigenvalue, a line each: for a narrow screen."""
    cells = scored["per_index"]
    lines = [
        [f"λ{i}", error(cell["mean"]), error(cell["median"])] for i, cell in enumerate(cells, 1)
    ]
    return Table(["", "mean relative error", "median"], lines)


def _files(submission: Submission) -> Table:
    facts, model = submission.result["dataset"], submission.result["model"]
    lines = [
        ["result, SHA-256", sha256(submission.result_path)],
        ["predictions, SHA-256", sha256(submission.predictions_path)],
        ["recipe", facts["recipe_digest"]],
        ["labels", facts["split_digest"]],
        *([f"{name}, digest", digest] for name, digest in sorted(model["sources"].items())),
        *([name, str(value)] for name, value in submission.result.get("checkout", {}).items()),
        *([name, text] for name, text in submission.result["environment"].items()),
    ]
    return Table(["", ""], lines)


def chosen(submission: Submission) -> dict[str, int]:
    """Return the instances that are shown, by what they are of the row's RPD."""
    errors = ranking.per_mesh(submission, RANKED_BY)
    return {name: ranking.at_quantile(errors, q) for name, q in QUANTILES.items()}


def _shape(submission: Submission, name: str, i: int) -> dict[str, Any]:
    shape, label, predicted = (
        submission.truth.shapes[i],
        submission.truth.eigenvalues[i],
        submission.predictions[0, i],
    )
    spec = shapes.spec_of(submission.truth, shape)
    errors = {key: float(ranking.per_mesh(submission, key)[i]) for key in ("rpd", "invlap", "psnr")}
    return {
        "name": name,
        "id": submission.truth.ids[i],
        "family": family_title(submission.truth.families[i]),
        "parameters": {} if spec is None else {k: _short(v) for k, v in spec.parameters.items()},
        "scores": [[METRICS[key].title, _score(key, value)] for key, value in errors.items()],
        "label": [six_digits(float(value)) for value in label],
        "predicted": [six_digits(float(value)) for value in predicted],
        "errors": [error(float(value)) for value in np.abs(predicted - label) / np.abs(label)],
        "several": len(submission.predictions) > 1,
        "mesh": None if spec is None else shapes.location(submission.truth, shape),
        "why": NO_MESH if spec is None else "",
    }


def _score(key: str, value: float) -> str:
    text = score(value, key) if np.isfinite(value) else "∞"
    return f"{text} {METRICS[key].unit}".strip()


def _short(value: float | int | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
