"""How predictors do on the two sets of real meshes, real-28 and pypi-246, by the boards."""

from __future__ import annotations

import json

from eigbench.scoring.training import untrained

from evidence import ROOT, markdown

SETS = ("real-28", "pypi-246")
VERSIONS = ("2.0", "2.1")
BOARDS = [(name, version) for name in SETS for version in VERSIONS]
PREDICTORS = (
    *("exact", "multilevel", "ritz_mlp", "curved", "kriging", "ritz_mlp_surface"),
    *("lumped", "weyl", "patch_transformer", "gcn_scale_free", "mean"),
)


def board(version: str, name: str) -> dict[str, dict]:
    """Return the results of a version's models on a set, by the names of their files."""
    folder = ROOT / "benchmark" / "results" / f"{version}-test-imported-{name}"
    results = [json.loads(path.read_text()) for path in sorted(folder.glob("*.json"))]
    return {result["model"]["code"]: result for result in results}


def scores(result: dict, shapes: int) -> dict[str, float]:
    """Return RPD, and how many shapes have a PSNR of at most 20, the mean over seeds."""
    overall = result["scores"]["mesh"]["overall"]
    return {
        "rpd": overall["rpd"]["mean"],
        "median": overall["rpd"]["median"],
        "failing": round((1 - overall["psnr20"]["mean"]) * shapes, 1),
    }


def table() -> str:
    """Return one row per predictor trained on 2.0 or on nothing, with columns of both sets."""
    boards = {name: board("2.0", name) for name in SETS}
    shapes = {name: found["exact.py"]["dataset"]["shapes"] for name, found in boards.items()}
    headers = ["predictor", "kind"]
    for name in SETS:
        headers += [f"RPD ↓, {name}", f"median, {name} ↓", f"fail, of {shapes[name]} ↓"]
    rows = []
    for code in PREDICTORS:
        sets = [scores(found[f"{code}.py"], shapes[name]) for name, found in boards.items()]
        model = boards[SETS[0]][f"{code}.py"]["model"]
        cells_of_both = [cell for values in sets for cell in cells(values)]
        rows.append((sets[-1]["rpd"], [model["name"], model["kind"], *cells_of_both]))
    return markdown.table(headers, [row for _, row in sorted(rows)], "llr")


def more_families() -> str:
    """Return the errors on both sets of models trained on 2.0, and of the same trained on 2.1."""
    rows = [
        [name, *(f"{error:.4f}" for error in errors)] for name, errors in _trained_twice().items()
    ]
    headers = [f"{name}: trained on {version}" for name, version in BOARDS]
    return markdown.table(["model", *headers], rows, "l" + "r" * len(BOARDS))


def changes() -> str:
    """Return on each set how many of these errors fall and rise, and by how much at most."""
    errors = list(_trained_twice().values())
    sentences = []
    for i, name in enumerate(SETS):
        changes = [100 * (row[2 * i + 1] / row[2 * i] - 1) for row in errors]
        parts = [
            f"{len(some)} of {len(changes)} errors {word} by up to {max(some):.1f} %"
            for some, word in (
                ([-change for change in changes if change < 0], "fell"),
                ([change for change in changes if change > 0], "rose"),
            )
            if some
        ]
        sentences.append(f"On {name}, {' and '.join(parts)}.")
    return " ".join(sentences)


def _trained_twice() -> dict[str, list[float]]:
    """Return the errors of the models that both versions' boards have, by their names."""
    results = [board(version, name) for name, version in BOARDS]
    trained = [code for code, row in results[-1].items() if not untrained(row["model"])]
    if not trained:
        raise ValueError(f"no trained model is on the board of {BOARDS[-1]}: run its rows")
    return {
        results[0][code]["model"]["name"]: [
            by_file[code]["scores"]["mesh"]["overall"]["rpd"]["mean"] for by_file in results
        ]
        for code in trained
    }


def cells(values: dict[str, float]) -> list[str]:
    """Return the cells of a set.

    Examples
    --------
    >>> cells({"rpd": 0.12345, "median": 1e-9, "failing": 2.0})
    ['0.1235', 'exact', '2']
    """
    errors = [
        "exact" if value < 1e-6 else f"{value:.4f}" for value in (values["rpd"], values["median"])
    ]
    return [*errors, f"{values['failing']:g}"]
