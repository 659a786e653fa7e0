"""A network that sees only points beside rows that see more, and less, by the boards of 2.0."""

from __future__ import annotations

from evidence import ROOT, markdown
from evidence.real_sets import SETS, board, by_code

ROWS = (
    *("exact", "kriging", "ritz_mlp_surface", "patch_transformer", "boosted_trees"),
    *("gcn_scale_free", "weyl"),
)


def table() -> str:
    """Return a row a predictor: its error on familiar shapes and on real meshes, and its speed."""
    familiar = by_code(ROOT / "benchmark" / "results" / "2.0-test-grouped")
    real = [board("2.0", name) for name in SETS]
    rows = []
    for code in (f"{row}.py" for row in ROWS):
        result = familiar[code]
        surface = result["scores"]["surface"]["overall"]
        rows.append(
            {
                "model": result["model"]["name"],
                "rpd": surface["rpd"]["mean"],
                "psnr20": surface["psnr20"]["mean"],
                "speed": float(f"{result['cost']['reference']['ratio']:.2g}"),
                "real": [found[code]["scores"]["mesh"]["overall"]["rpd"]["mean"] for found in real],
            }
        )
    columns = {
        "row": "{model}",
        "RPD ↓": "{rpd:.4f}",
        "PSNR>20 ↑": "{psnr20:.2%}",
        "speed against LaPy": "{speed:,g} ×",
        **{f"RPD ↓, {name}": f"{{real[{i}]:.4f}}" for i, name in enumerate(SETS)},
    }
    return markdown.columns(rows, columns, "lr")
