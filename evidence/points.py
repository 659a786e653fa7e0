"""A network that sees only points beside rows that see more, and less, by the boards of 2.0."""

from __future__ import annotations

import json

from evidence import ROOT, markdown
from evidence.real_sets import SETS, board, scores
from evidence.real_sets import cells as of_set

FAMILIAR = ROOT / "benchmark" / "boards" / "2.0-test-grouped-surface.json"
ROWS = (
    *("exact", "kriging", "ritz_mlp_surface", "patch_transformer", "boosted_trees"),
    *("gcn_scale_free", "weyl"),
)


def table() -> str:
    """Return one row per predictor: its error on familiar and on real meshes, and its speed."""
    familiar = {row["name"]: row for row in json.loads(FAMILIAR.read_text())["rows"]}
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
        "RPD ↓": "{rpd:.4f}",
        "PSNR>20 ↑": "{psnr20:.2%}",
        "speed against LaPy": "{speed:,g} ×",
        **{f"RPD ↓, {name}": f"{{real[{i}]}}" for i, name in enumerate(SETS)},
    }
    return markdown.columns(rows, columns, "lr")
