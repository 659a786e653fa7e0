"""How far ratios of times carry: speed against LaPy of the same rows, on two machines.

The first is the run that made a row, timed beside LaPy on some of its batches; the second the clock
of `eigbench time`, on other meshes of the same split and another machine. Rows whose code has
changed since, runs on the clock's own processor, and runs of earlier releases, which did not charge
the way to the predictor and back, are left out.
"""

import numpy as np
from eigbench import results
from eigbench.board.leaderboard import RESULTS
from eigbench.board.tables import number
from eigbench.results import timing

from evidence import ROOT, markdown
from synthnet.store.files import sha256


def measure() -> dict:
    """Return one row per result and dataset, and how much the ratios of the two machines differ."""
    rows = []
    for version, timed in timing.read(ROOT).items():
        for path in sorted((ROOT / RESULTS / f"{version}-test-grouped").glob("*.json")):
            result = results.load(path)
            row, own = timing.row_of(result, timed), result["cost"]
            if row is None or own.get("reference") is None:
                continue
            cost = timing.cost_of(row)
            # Without copies_ratio, by a clock in the predictor's process
            if own["hardware"] == cost["hardware"] or "copies_ratio" not in own:
                continue
            first, second = own["reference"]["ratio"], cost["reference"]["ratio"]
            rows.append(
                {
                    "dataset": version,
                    "model": result["model"]["name"],
                    "first machine": own["hardware"],
                    "first": round(first, 3),
                    "second machine": cost["hardware"],
                    "second": round(second, 3),
                    "second / first": round(second / first, 3),
                    "result": sha256(path)[:12],
                }
            )
    quotients = np.array([row["second / first"] for row in rows])
    spread = np.exp(np.abs(np.log(quotients)))
    return {
        "rows": rows,
        "median_factor": round(float(np.median(spread)), 3),
        "largest_factor": round(float(spread.max()), 3),
    }


def table(data: dict) -> str:
    """Return the ratios on both machines, and by which factor they differ."""
    headers = {
        "model": "model",
        "dataset": "dataset",
        "first machine": "first machine",
        "first": "× LaPy",
        "second machine": "second machine",
        "second": "× LaPy",
        "second / first": "quotient",
    }
    cells = [
        [number(row[key], 2) if isinstance(row[key], float) else row[key] for key in headers]
        for row in data["rows"]
    ]
    sentence = (
        f"The ratios of the two machines differ by a factor of {data['median_factor']} in the "
        f"median, and of {data['largest_factor']} at most."
    )
    return f"{markdown.table(list(headers.values()), cells, 'lllrlrr')}\n\n{sentence}"
