"""How predictors do on the two sets of real meshes, real-28 and pypi-246, against their labels.

Scores on real-28 are those of the board. On pypi-246 a predictor is evaluated if the results of
`python -m baselines.rows --run --board 2.0/imported/pypi-246`, or of an earlier measurement, lack
it: a minute or two each. The set has to be imported (docs/import.md).
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from eigbench.scoring.training import untrained

from evidence import BASELINES, ROOT, markdown

BOARD = ROOT / "benchmark" / "results" / "2.0-test-imported-real-28"
SETS = ("real-28", "pypi-246")
VERSIONS = ("2.0", "2.1")
PREDICTORS = (
    *("exact", "multilevel", "ritz_mlp", "curved", "kriging", "ritz_mlp_surface"),
    *("lumped", "weyl", "gcn_scale_free", "mean"),
)


def measure(*, results: str = "runs/rows/2.0-imported-pypi-246") -> dict:
    """Return a row a predictor, in the order of its mean RPD on the larger set.

    Parameters
    ----------
    results
        Where the results on the larger set are, or are to be kept.
    """
    for code in PREDICTORS:
        evaluate(code, Path(results) / f"{code}.json")
    there = dict(zip(SETS, (by_code(BOARD), by_code(Path(results))), strict=True))
    shapes = {
        name: next(iter(found.values()))["dataset"]["shapes"] for name, found in there.items()
    }
    rows = []
    for code in PREDICTORS:
        found = {name: there[name][f"{code}.py"] for name in SETS}
        model = found[SETS[1]]["model"]
        sets = {name: scores(found[name], shapes[name]) for name in SETS}
        rows.append({"code": code, "name": model["name"], "kind": model["kind"], "sets": sets})
    return {"shapes": shapes, "rows": sorted(rows, key=lambda row: row["sets"][SETS[1]]["rpd"])}


def evaluate(code: str, out: Path) -> None:
    """Evaluate a predictor on the larger set, unless its result is there."""
    if not out.exists():
        out.parent.mkdir(parents=True, exist_ok=True)
        command = [sys.executable, "-m", "eigbench", "evaluate", str(BASELINES / f"{code}.py")]
        command += ["--dataset", "2.0", "--protocol", f"imported/{SETS[1]}", "--no-reference"]
        subprocess.run([*command, "--batch-size", "50", "--out", str(out)], check=True)


def by_code(folder: Path) -> dict[str, dict]:
    """Return the results of a board by the names of their predictors' files."""
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


def table(data: dict) -> str:
    """Return a row a predictor, with columns of both sets."""
    first, second = SETS
    headers = ["predictor", "kind"]
    for name in SETS:
        headers += [f"RPD ↓, {name}", "median ↓", f"fail, of {data['shapes'][name]} ↓"]
    rows = [
        [row["name"], row["kind"], *cells(row["sets"][first]), *cells(row["sets"][second])]
        for row in data["rows"]
    ]
    return markdown.table(headers, rows, "llr")


def more_families() -> str:
    """Return the errors on both sets of models trained on 2.0, and of the same trained on 2.1."""
    boards = [(name, version) for name in SETS for version in VERSIONS]
    results = [by_code(BOARD.with_name(f"{version}-test-imported-{n}")) for n, version in boards]
    trained = [code for code, row in results[-1].items() if not untrained(row["model"])]
    if not trained:
        raise ValueError(f"no trained model is on the board of {boards[-1]}: run its rows")
    rows = []
    for code in trained:
        found = [board[code] for board in results]
        errors = [result["scores"]["mesh"]["overall"]["rpd"]["mean"] for result in found]
        rows.append([found[0]["model"]["name"], *(f"{error:.4f}" for error in errors)])
    headers = [f"{name}: trained on {version}" for name, version in boards]
    return markdown.table(["model", *headers], rows, "l" + "r" * len(boards))


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
