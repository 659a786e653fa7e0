"""Learned rows beside each other, by the boards of 2.0: what they see, and what that is worth."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from eigbench.board.generalisation import TITLES

from evidence import ROOT, markdown
from evidence.real_sets import SETS, board, scores
from evidence.real_sets import cells as of_set

BOARDS = ROOT / "benchmark" / "boards"
FAMILIAR = BOARDS / "2.0-test-grouped-surface.json"
HELD_OUT = BOARDS / "2.0-generalisation-surface.json"
MESH = BOARDS / "2.0-test-grouped-mesh.json"
HELD_OUT_MESH = BOARDS / "2.0-generalisation-mesh.json"
ROWS = (
    *("exact", "kriging", "ritz_mlp_surface", "patch_transformer", "boosted_trees"),
    *("gcn_scale_free", "weyl"),
)
SHARES = ("multilevel_masses", "curved", "two_masses", "spectrum_mlp")
SEEN = {  # by the files of the rows on real-28: what each has to learn from
    "exact": "linear elements, solved exactly",
    "multilevel_masses": "as here: two numbers",
    "spectrum_mlp": "`spectrum_mlp.py`: the mesh's two exact spectra and 28 numbers, a network",
    "ritz_mlp_surface": "`ritz_mlp_surface.py`: the 28 numbers, a network",
    "kriging": "`kriging.py`: ten Ritz values and eight moments",
    "gcn_scale_free": "`gcn_scale_free.py`: the mesh as a graph, the paper's network",
}


def points_table() -> str:
    """Return one row per predictor: its error on familiar and on real meshes, and its speed."""
    familiar = _rows(FAMILIAR)
    real = [board("2.0", name) for name in SETS]
    rows = []
    for code in (f"{row}.py" for row in ROWS):
        row = familiar[real[0][code]["model"]["name"]]
        surface = row["scores"]["overall"]
        rows.append(
            {
                "model": row["name"],
                "rpd": surface["rpd"]["mean"],
                "psnr20": surface["psnr20"]["mean"],
                "speed": float(f"{row['speed_against_lapy']:.2g}"),
                "real": [of_set(scores(found[code], 1))[0] for found in real],
            }
        )
    columns = {
        "row": "{model}",
        "RPD ↓, surface": "{rpd:.4f}",
        "PSNR>20 ↑, surface": "{psnr20:.2%}",
        "speed against LaPy": "{speed:,g} ×",
        **{f"RPD ↓, {name}, mesh": f"{{real[{i}]}}" for i, name in enumerate(SETS)},
    }
    return markdown.columns(rows, columns, "lr")


def held_out_table() -> str:
    """Return the error against the surface of familiar shapes and of those held out of training."""
    familiar, held_out, real = _rows(FAMILIAR), _rows(HELD_OUT), board("2.0", SETS[0])
    rows = []
    for code, seen in SEEN.items():
        name = real[f"{code}.py"]["model"]["name"]
        errors = _errors(familiar[name], held_out[name])
        rows.append([seen, *(_cell(error, "#.3g") for error in errors)])
    headers = ["row, RPD against the surface of 2.0's test shapes", *_titles(held_out[name])]
    return markdown.table(headers, rows, "lr")


def share_table() -> str:
    """Return errors as shares of an exact solver's, and times as shares of the certified one's."""
    familiar, held_out, real = _rows(FAMILIAR), _rows(HELD_OUT), board("2.0", SETS[0])
    exact, certified, *names = (
        real[f"{code}.py"]["model"]["name"] for code in ("exact", "certified", *SHARES)
    )

    def errors(name: str) -> list[float | None]:
        return _errors(familiar[name], held_out[name])

    def speed(name: str) -> float:
        return familiar[name]["speed_against_lapy"]

    rows = [
        [name, *_shares(errors(name), errors(exact)), speed(certified) / speed(name)]
        for name in names
    ]
    cells = [[name, *(_cell(share, ".2f") for share in shares)] for name, *shares in rows]
    return markdown.table(["row", *_titles(held_out[exact]), "time"], cells, "lr")


def accurate_table() -> str:
    """Return the share of meshes whose own spectrum the first network predicts, and Weyl's law."""
    familiar, held_out, real = _rows(MESH), _rows(HELD_OUT_MESH), board("2.0", SETS[0])
    rows = []
    for code in ("ritz_mlp", "weyl"):
        name = real[f"{code}.py"]["model"]["name"]
        shares = _errors(familiar[name], held_out[name], "psnr20")
        rows.append([name, *(_cell(share, ".2%") for share in shares)])
    return markdown.table(["row, PSNR>20 against the mesh", *_titles(held_out[name])], rows, "lr")


def _errors(familiar: dict, held_out: dict, metric: str = "rpd") -> list[float | None]:
    """Return a mean score of a model on familiar shapes, and under each protocol, by its two rows.

    It is ``None`` where the model was not run.
    """
    scores = held_out["protocols"].values()
    return [familiar["scores"]["overall"][metric]["mean"], *(by[metric]["score"] for by in scores)]


def _shares(errors: Sequence[float | None], whole: Sequence[float | None]) -> list[float | None]:
    pairs = zip(errors, whole, strict=True)
    return [None if error is None or of is None else error / of for error, of in pairs]


def _cell(number: float | None, digits: str) -> str:
    return "not run" if number is None else format(number, digits)


def _titles(held_out: dict) -> list[str]:
    """Return the headings of these errors: an imported set's is its name."""
    protocols = held_out["protocols"]
    return ["familiar shapes", *(TITLES.get(name, Path(name).name) for name in protocols)]


def _rows(path: Path) -> dict[str, dict]:
    """Return the rows of a board by the names of their models."""
    return {row["name"]: row for row in json.loads(path.read_text())["rows"]}
