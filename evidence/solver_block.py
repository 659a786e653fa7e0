"""Put the numbers of benchmarks/solver.py into docs/labels.md.

python benchmarks/solver.py --json > docs/data/solver.json
python scripts/solver_table.py
"""

import json
from pathlib import Path

from tabulate import tabulate

from synthnet.store.files import write_marked

DOCS = Path(__file__).parent.parent / "docs"


def table(rows: list[dict]) -> str:
    """Return the comparison as Markdown."""
    cells = [
        [
            row["meshes"].replace("_", " "),
            row["number"],
            f"{row['mean vertices']:,}",
            f"{row['synthNet ms']:.1f}",
            f"{row['LaPy ms']:.1f}",
            f"{row['LaPy / synthNet']:.1f}",
            f"{row['largest difference']:.0e}",
        ]
        for row in rows
    ]
    headers = [
        "meshes",
        "number",
        "mean vertices",
        "synthNet ms",
        "LaPy ms",
        "ratio",
        "largest relative difference",
    ]
    align = ["left"] + ["right"] * 6
    return tabulate(cells, headers, tablefmt="github", disable_numparse=True, colalign=align)


if __name__ == "__main__":
    rows = json.loads((DOCS / "data" / "solver.json").read_text())
    write_marked(DOCS / "labels.md", solver=f"\n{table(rows)}\n")
