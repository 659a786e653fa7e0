"""How far ratios of times carry: speed against LaPy of the same rows, timed on two machines.

Both are runs of `eigbench time` on the same meshes: docs/data/times-elsewhere.json on one machine,
the times of the same version on the boards on the other. Rows whose code or weights have changed
in between are left out.
"""

import json

import numpy as np
from eigbench.board.tables import number
from eigbench.results import timing

from evidence import DATA, ROOT, markdown

ELSEWHERE = DATA / "times-elsewhere.json"


def measure() -> dict:
    """Return both ratios of each row, and by how much those of the two machines differ."""
    first = json.loads(ELSEWHERE.read_text())
    second = json.loads((ROOT / timing.FOLDER / f"{first['dataset']}.json").read_text())
    if first["vertices"] != second["vertices"]:
        raise ValueError(f"{ELSEWHERE} is of other meshes than the times of the board")
    before = {row["name"]: row for row in first["rows"]}
    rows = []
    for row in second["rows"]:
        other = before.get(row["name"])
        if other is None or other["sources"] != row["sources"]:
            continue
        one, two = (of["cost"]["reference"]["ratio"] for of in (other, row))
        rows.append(
            {
                "model": row["name"],
                "first": round(one, 3),
                "second": round(two, 3),
                "second / first": round(two / one, 3),
            }
        )
    spread = np.exp(np.abs(np.log([row["second / first"] for row in rows])))
    return {
        "dataset": first["dataset"],
        "first": first["hardware"],
        "second": second["hardware"],
        "rows": rows,
        "median_factor": round(float(np.median(spread)), 3),
        "largest_factor": round(float(spread.max()), 3),
    }


def table(data: dict) -> str:
    """Return the ratios on both machines, and by which factor they differ."""
    headers = ["model", data["first"], data["second"], "quotient"]
    keys = ("first", "second", "second / first")
    cells = [[row["model"], *(number(row[key], 2) for key in keys)] for row in data["rows"]]
    sentence = (
        f"The ratios of the two machines differ by a factor of {data['median_factor']} in the "
        f"median, and of {data['largest_factor']} at most."
    )
    return f"{markdown.table(headers, cells, 'lrrr')}\n\n{sentence}"
