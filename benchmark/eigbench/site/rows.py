"""What a row opens to: all its numbers, and its worst and its median shape."""

from __future__ import annotations

from typing import Any

import numpy as np

from eigbench.board import ranking, tables
from eigbench.board.ranking import RANKED_BY
from eigbench.board.tables import Table, family_title, number, score
from eigbench.results.submission import Submission
from eigbench.scoring.metrics import METRICS
from eigbench.site import shapes
from eigbench.site.columns import number_of
from synthnet.store.files import sha256

QUANTILES = {"worst": 1.0, "median": 0.5}
NO_MESH = "The mesh is not shown: its file is not part of this project."
FACTS = {
    "authors": "authors",
    "paper": "paper",
    "licence": "licence",
    "training_data": "training set",
    "training_cost": "training cost",
    "hardware": "trained on",
    "code": "code",
}


def told(one: Submission, own: str | None = None) -> dict[str, Any]:
    """Return what the page shows of a row when it is opened.

    Parameters
    ----------
    one : Submission
        The row.
    own : str or None
        Its protocol, if it is one of the version's own: then it was timed elsewhere.
    """
    result = one.result
    cost = "Cost" if own is None else "Cost under the protocol grouped"
    return {
        "facts": _facts(one),
        "tables": [
            _table("Metrics", tables.overall(result)),
            _table("By family, means", tables.families(result)),
            _table("By eigenvalue", _indices(result)),
            _table("Physics", tables.physics(result["physics"])),
            _table(cost, tables.cost(result)),
            _table("Files and versions", _files(one)),
        ],
        "shapes": [_shape(one, name, i) for name, i in chosen(one).items()],
    }


def _facts(one: Submission) -> list[list[str]]:
    model = one.result["model"]
    found = [["kind", model["kind"]]]
    return found + [[title, model[key]] for key, title in FACTS.items() if key in model]


def _table(title: str, table: Table) -> dict[str, Any]:
    return {"title": title, "headers": table.headers, "rows": table.rows}


def _indices(result: dict[str, Any]) -> Table:
    """Return the errors by eigenvalue, a line each: for a narrow screen."""
    cells = result["scores"]["per_index"]
    lines = [
        [f"λ{i}", number(cell["mean"]), number(cell["median"])] for i, cell in enumerate(cells, 1)
    ]
    return Table(["", "mean relative error", "median"], lines)


def _files(one: Submission) -> Table:
    facts, model = one.result["dataset"], one.result["model"]
    lines = [
        ["result, SHA-256", sha256(one.result_path)],
        ["predictions, SHA-256", sha256(one.predictions_path)],
        ["recipe", facts["recipe_digest"]],
        ["labels", facts["split_digest"]],
        *([f"{name}, digest", digest] for name, digest in sorted(model["sources"].items())),
        *([name, str(value)] for name, value in one.result.get("checkout", {}).items()),
        *([name, text] for name, text in one.result["environment"].items()),
    ]
    return Table(["", ""], lines)


def chosen(one: Submission) -> dict[str, int]:
    """Return the instances that are shown, by what they are of the row's RPD."""
    errors = ranking.per_mesh(one, RANKED_BY)
    return {name: ranking.at_quantile(errors, q) for name, q in QUANTILES.items()}


def _shape(one: Submission, name: str, i: int) -> dict[str, Any]:
    shape, label, predicted = one.truth.shapes[i], one.truth.eigenvalues[i], one.predictions[0, i]
    spec = shapes.spec_of(one.truth, shape)
    found = {key: float(ranking.per_mesh(one, key)[i]) for key in ("rpd", "invlap", "psnr")}
    return {
        "name": name,
        "id": one.truth.ids[i],
        "family": family_title(one.truth.families[i]),
        "parameters": {} if spec is None else {k: _short(v) for k, v in spec.parameters.items()},
        "scores": [[METRICS[key].title, _score(key, value)] for key, value in found.items()],
        "label": [number_of(float(value)) for value in label],
        "predicted": [number_of(float(value)) for value in predicted],
        "errors": [number(float(value)) for value in np.abs(predicted - label) / np.abs(label)],
        "several": len(one.predictions) > 1,
        "mesh": None if spec is None else shapes.place(one.truth, shape),
        "why": NO_MESH if spec is None else "",
    }


def _score(key: str, value: float) -> str:
    text = score(value, key) if np.isfinite(value) else "∞"
    return f"{text} {METRICS[key].unit}".strip()


def _short(value: float | int | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
