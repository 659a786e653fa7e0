"""Whether networks as the paper's are faster than finite elements: our rows of 1.0, and its words.

Speeds are of `eigbench time`, errors of the board of 1.0 against the surface, and the speed in
batches as large as the paper's of ``measure gcn --figure-2``.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from eigbench.board.tables import number, times_faster
from eigbench.results import timing

from evidence import ROOT

VERSION = "1.0"
BOARD = ROOT / "benchmark" / "boards" / f"{VERSION}-test-grouped-surface.json"
PAPER = ROOT / "benchmark" / "reported" / "wu-2024.json"
FIGURE_2 = "Figure 2 (time)"
NETWORK = "GCN "  # how the names of networks of the paper's kind begin
LAPY, AT_ITS_BEST, CERTIFIED = "LaPy", "LaPy with CHOLMOD", "synthNet, certified"
ONE_THREAD = "cpu, 1 thread"
IN_BATCHES = ("LaPy,", "GCN,", "our certified solver,")  # how they begin in what was measured


def claim(measured: dict) -> str:
    """Return how fast and how near the best such network is, beside LaPy and the paper's words."""
    return " ".join(_sentences(measured, errors_on_board(), _costs()))


def short(measured: dict) -> str:
    """Return the answer first, and then the same without the paper's words and large batches."""
    errors, costs = errors_on_board(), _costs()
    _, speed, error, _ = _sentences(measured, errors, costs)
    network = costs[nearest(errors)]["reference"]
    return f"{answer(network, costs[CERTIFIED]['reference'])} {speed} {error}"


def answer(network: Mapping[str, Any], certified: Mapping[str, Any]) -> str:
    """Return in words whether a network is faster than LaPy, and than the certified solver.

    Parameters
    ----------
    network, certified
        LaPy's time over theirs: ``ratio``, and the ends of its interval, ``low`` and ``high``.
    """
    than_lapy = _compared(network, {"low": 1, "high": 1})
    than_certified = _compared(network, certified)
    return f"It is {than_lapy} LaPy, and {than_certified} our certified solver."


def _compared(speed: Mapping[str, Any], other: Mapping[str, Any]) -> str:
    if speed["low"] > other["high"]:
        return "faster than"
    return "slower than" if speed["high"] < other["low"] else "about as fast as"


def _costs() -> dict[str, dict[str, Any]]:
    return {row["name"]: row["cost"] for row in timing.read(ROOT)[VERSION]}


def _sentences(measured: dict, errors: Mapping[str, float], costs: Mapping[str, Any]) -> list[str]:
    paper = json.loads(PAPER.read_text())
    (figure,) = (table for table in paper["tables"] if table["title"] == FIGURE_2)
    return sentences(figure["rows"], errors, costs, measured["figure2"])


def errors_on_board() -> dict[str, float]:
    """Return the mean RPD to the surface of each row."""
    rows = json.loads(BOARD.read_text())["rows"]
    return {row["name"]: row["scores"]["overall"]["rpd"]["mean"] for row in rows}


def nearest(errors: Mapping[str, float]) -> str:
    """Return the name of the network of the paper's kind with the least error."""
    return min((name for name in errors if name.startswith(NETWORK)), key=errors.__getitem__)


def sentences(
    reported: list[list[str]],
    errors: Mapping[str, float],
    costs: Mapping[str, Any],
    batches: list[dict[str, Any]],
) -> list[str]:
    """Return the question, the paper's words, speed, error, and speed in large batches.

    Parameters
    ----------
    reported
        What the paper's Figure 2 says: what, where, seconds.
    errors
        Mean RPD to the surface by the names of rows.
    costs
        The ``cost`` of the timing file by the names of rows.
    batches
        Seconds for batches of 200 meshes, with ``what`` and ``where``.
    """
    name = nearest(errors)
    cost = costs[name]
    theirs = {what: seconds for what, where, seconds in reported if where.startswith("AMD")}
    seconds = {r["what"]: r["seconds"] for r in batches if r["where"] == ONE_THREAD}
    lapy, *others = (
        next(s for what, s in seconds.items() if what.startswith(start)) for start in IN_BATCHES
    )
    network, certified = (f"{lapy / other:.2g}" for other in others)
    solvers = dict.fromkeys(number(errors[solver]) for solver in (LAPY, AT_ITS_BEST))
    return [
        f"The paper reports {theirs['GCN, a batch of 200 meshes']} s for 200 meshes by its network "
        f"and {theirs['LaPy, one mesh']} s for one by LaPy, each on a CPU.",
        f"Here, on one thread of one machine, in batches of {cost['batch_size']} meshes of "
        f"{VERSION}, a network of the paper's kind is {times_faster(cost['reference'])} as fast "
        f"as LaPy and {times_faster(cost['peers'][AT_ITS_BEST])} as fast as {AT_ITS_BEST}; the "
        f"certified solver is {times_faster(costs[CERTIFIED]['reference'])} as fast as LaPy.",
        f"The network's mean RPD to the surface is {number(errors[name])}, that of the solvers "
        f"{' and '.join(solvers)}.",
        f"In batches of 200 meshes, measured on another processor and other meshes, network and "
        f"certified solver are {network} × and {certified} × as fast as LaPy. The network is "
        f"*{name}*.",
    ]
