"""Tables of a result: their cells, and as text for the terminal."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from tabulate import tabulate

from eigbench import results
from eigbench.scoring.metrics import MAIN, METRICS
from eigbench.scoring.physics import SHARES, TITLES
from eigbench.scoring.truth import EXACT
from synthnet.families import FAMILIES

SPEED = "speed against LaPy"
ROUNDING = 1e-12  # of a mean: a deviation below it is that of equal numbers
MANY = 1e10  # a number is not written out from here
LEAST = 1e-5  # relative: a smaller deviation from a law is not shown in digits


@dataclass(frozen=True, slots=True)
class Table:
    """Headers, and rows of as many cells."""

    headers: list[str]
    rows: list[list[str]]

    def __str__(self) -> str:
        """Return the table for the terminal; without headers in plain columns."""
        if not any(self.headers):
            return str(tabulate(self.rows, tablefmt="plain", disable_numparse=True))
        return str(tabulate(self.rows, headers=self.headers, disable_numparse=True))


def number(value: float | None, decimals: int = 4) -> str:
    """Return a number with fixed decimals.

    One that would be all zeros, or of more than ten digits, is given by its power of ten;
    ``∞/NaN`` stands for one that was not finite.

    Examples
    --------
    >>> number(0.04567), number(3.1e-11), number(0.0), number(1.65e15), number(None)
    ('0.0457', '3e-11', '0.0000', '1.65e+15', '∞/NaN')
    """
    if value is None:
        return "∞/NaN"
    if 0 < abs(value) < 0.5 * 10**-decimals:
        return f"{value:.0e}"
    if MANY <= abs(value) < math.inf:
        return f"{value:.2e}"
    return f"{value:.{decimals}f}"


def error(value: float | None, decimals: int = 4) -> str:
    """Return an error with fixed decimals, without powers of ten.

    One that only rounding can make is exact; any other that would be all zeros is below the last
    decimal.

    Examples
    --------
    >>> error(0.04567), error(3e-7), error(3e-7, 2), error(-2e-17), error(None)
    ('0.0457', '< 0.0001', '< 0.01', 'exact', '∞/NaN')
    """
    if value is not None and abs(value) <= ROUNDING:
        return "exact"
    return _plain(value, decimals)


def _plain(value: float | None, decimals: int) -> str:
    if value is not None and 0 < value < 0.5 * 10**-decimals:
        return f"< {10**-decimals:.{decimals}f}"
    return number(value, decimals)


def score(value: float | None, key: str) -> str:
    """Return a score as its metric is shown; shares in per cent.

    Examples
    --------
    >>> score(0.04567, "rpd"), score(0.9606, "psnr20"), score(None, "psnr20"), score(0.0, "l2")
    ('0.0457', '96.06 %', '∞/NaN %', 'exact')
    """
    if METRICS[key].unit == "share":
        return _plain(None if value is None else 100 * value, 2) + " %"
    return _bare(value, key)


def _bare(value: float | None, key: str) -> str:
    metric = METRICS[key]
    return (_plain if metric.higher_is_better else error)(value, metric.decimals)


def _spread(value: float, key: str) -> str:
    """Return half an interval, or a deviation, in the unit of a score, which is not repeated."""
    metric = METRICS[key]
    return _plain(100 * value, 2) if metric.unit == "share" else _plain(value, metric.decimals)


def interval(low: float | None, high: float | None, key: str) -> str:
    """Return an interval of scores.

    Examples
    --------
    >>> interval(0.0412, 0.0467, "rpd"), interval(0.0, 0.0, "rpd")
    ('0.0412 to 0.0467', 'exact')
    """
    ends = score(low, key), score(high, key)
    return ends[0] if ends == ("exact", "exact") else " to ".join(ends)


def with_uncertainty(cell: dict[str, float | None], key: str) -> str:
    """Return a mean ± half its interval, and in brackets the deviation over seeds.

    Where an interval of a share ends at 0 or 1, its other end stands in brackets instead of the ±.

    Examples
    --------
    >>> with_uncertainty({"mean": 0.5, "low": 0.4, "high": 0.7, "seed_std": None}, "rpd")
    '0.5000 ± 0.1500'
    >>> with_uncertainty({"mean": 0.9, "low": None, "high": None, "seed_std": 1e-16}, "psnr20")
    '90.00 % (0.00)'
    >>> with_uncertainty({"mean": 1.0, "low": 0.997, "high": 1.0, "seed_std": None}, "psnr20")
    '100 % (≥ 99.70 %)'
    >>> with_uncertainty({"mean": 0.999, "low": 0.99, "high": 1.0, "seed_std": None}, "psnr20")
    '99.90 % (≥ 99.00 %)'
    >>> with_uncertainty({"mean": 0.2, "low": 0.0, "high": 1.0, "seed_std": None}, "psnr20")
    '20.00 % (0 % to 100 %)'
    >>> with_uncertainty({"mean": 0.0, "low": 0.0, "high": 0.0, "seed_std": None}, "rpd")
    'exact'
    >>> with_uncertainty({"mean": 3e-7, "low": 0.0, "high": 8e-7, "seed_std": None}, "rpd")
    '< 0.0001'
    """
    mean, low, high = cell["mean"], cell["low"], cell["high"]
    settled = METRICS[key].unit == "share" and mean in (0, 1)  # of every seed
    text = ("100 %" if mean else "0 %") if settled else score(mean, key)
    if text == "exact" or (text.startswith("<") and text == score(high, key)):
        return text  # and so is its uncertainty
    if low is not None and high is not None:
        text += f" {_uncertainty(low, high, key)}"
    if not settled and (deviation := cell["seed_std"]) is not None:
        known = 0.0 if deviation <= ROUNDING * abs(mean or 0) else deviation
        text += f" ({_spread(known, key)})"
    return text


def _uncertainty(low: float, high: float, key: str) -> str:
    """Return half an interval; of a share's that reaches 0 or 1 the other end, in brackets."""
    if METRICS[key].unit == "share":
        if (low, high) == (0, 1):
            return "(0 % to 100 %)"
        if high == 1:
            return f"(≥ {score(low, key)})"
        if low == 0:
            return f"(≤ {score(high, key)})"
    return f"± {_spread((high - low) / 2, key)}"


def family_title(name: str) -> str:
    """Return a family's title; the name of one that synthnet does not make."""
    return FAMILIES[name].title if name in FAMILIES else name


def in_order(names: Iterable[str]) -> list[str]:
    """Return families in synthnet's order, others after them by name."""
    known = {name: rank for rank, name in enumerate(FAMILIES)}
    return sorted(set(names), key=lambda name: (known.get(name, len(known)), name))


def overall(scored: dict[str, Any]) -> Table:
    """Return the table of the metrics with their uncertainty.

    The macro average is the mean over families of their means.
    """
    one_seed = all(cell["seed_std"] is None for cell in scored["overall"].values())
    rows = []
    for key, metric in METRICS.items():
        cell = scored["overall"][key]
        deviation = "" if cell["seed_std"] is None else _spread(cell["seed_std"], key)
        mean = score(cell["mean"], key)
        between = f"{score(cell['low'], key)} to {score(cell['high'], key)}"
        if key == "psnr" and cell["mean"] is None:  # that of an exact spectrum is infinite
            mean = between = ""
        spread = [] if one_seed else [deviation]
        median = "" if key == "psnr20" else _bare(cell["median"], key)
        unit = "" if metric.unit == "share" else metric.unit
        macro = score(cell["by_family"], key) if mean else ""
        rows.append([metric.heading, mean, between, *spread, macro, median, unit])
    spread = [] if one_seed else ["sd over seeds"]
    headers = ["metric", "mean", "95 % interval", *spread, "macro average", "median", "unit"]
    return Table(headers, rows)


def families(scored: dict[str, Any]) -> Table:
    """Return the table by family, as the paper's Table 4, with all metrics."""
    rows = []
    for name in in_order(scored["families"]):
        family = scored["families"][name]
        cells = [score(family[key]["mean"], key) for key in MAIN]
        rows.append([family_title(name), f"{family['count']:,}", *cells])
    return Table(["family", "instances", *(METRICS[key].title for key in MAIN)], rows)


def per_index(scored: dict[str, Any]) -> Table:
    """Return the relative error of each eigenvalue."""
    cells = scored["per_index"]
    rows = [
        ["mean relative error", *(error(cell["mean"]) for cell in cells)],
        ["median relative error", *(error(cell["median"]) for cell in cells)],
    ]
    return Table(["", *(f"λ{i}" for i in range(1, len(cells) + 1))], rows)


def cost(result: dict[str, Any]) -> Table:
    """Return what a mesh costs."""
    facts = result["cost"]
    low, high = facts["ms_per_mesh_quartiles"]
    median = f"{facts['ms_per_mesh']:.2f} ({low:.2f} to {high:.2f})"
    setting = f"{facts['batch_size']}, {facts['threads']}, {facts['device']}"
    parameters = result["model"]["parameters"]
    rows = [
        ["ms per mesh, median of batches (quartiles)", median],
        ["ms per mesh, mean", f"{facts['ms_per_mesh_mean']:.2f}"],
        [f"{SPEED}, same meshes", times_faster(facts.get("reference"))],
        *([f"against {name}", times_faster(peer)] for name, peer in facts.get("peers", {}).items()),
        ["batch size, threads, device", setting],
        ["cores used", f"{facts['cores_used']:.2f}{_counted(facts, 'processor_time')}"],
        ["peak memory", f"{facts['peak_memory_mb']:.0f} MB{_counted(facts, 'memory')}"],
        *_remembering(facts),
        ["parameters", "none" if parameters is None else f"{parameters:,}"],
        ["training cost", results.declared(result, "training_cost")],
        ["hardware", facts["hardware"]],
    ]
    return Table(["", ""], rows)


def _counted(facts: dict[str, Any], what: str) -> str:
    """Return what counted processor time or memory; results before December 2026 do not say."""
    return f" (by the {facts['counted_by'][what]})" if "counted_by" in facts else ""


def _remembering(facts: dict[str, Any]) -> list[list[str]]:
    """Return what loading took, and a copy of a shape beside a new one; older results lack both."""
    rows = []
    if "loading_seconds" in facts:
        rows.append(["loading", f"{facts['loading_seconds']:.1f} s"])
    if (ratio := facts.get("copies_ratio")) is not None:
        rows.append(["time of a copy of a shape, beside a new one", f"{ratio:.2f}"])
    return rows


def times_faster(ratio: dict[str, Any] | None) -> str:
    """Return a ratio of times as text, with its interval where it has one.

    Examples
    --------
    >>> times_faster({"ratio": 14.04, "low": 13.1, "high": 14.9})
    '14 × (13–15)'
    >>> times_faster({"ratio": 0.515}), times_faster(None)
    ('0.52 ×', 'not timed')
    """
    if ratio is None:
        return "not timed"
    two_digits = [f"{float(f'{ratio[k]:.2g}'):,g}" for k in ("ratio", "low", "high") if k in ratio]
    middle, *ends = two_digits
    return f"{middle} × ({'–'.join(ends)})" if ends else f"{middle} ×"


def deviation(key: str, value: float | None) -> str:
    """Return a number of the physics contract in per cent; what only rounding can make is exact.

    Examples
    --------
    >>> deviation("rotation", 4e-16), deviation("rotation", 2e-8), deviation("rotation", 0.0123)
    ('exact', '< 0.001 %', '1.2 %')
    >>> deviation("scale_2", 3.04), deviation("positive", 0.584), deviation("rotation", None)
    ('304 %', '58 %', 'not finite')
    """
    if value is None:
        return "not finite"
    if key in SHARES:
        return f"{100 * value:.0f} %"
    if value <= EXACT:
        return "exact"
    if value < LEAST:
        return f"< {100 * LEAST:g} %"
    digits = max(0, 1 - math.floor(math.log10(100 * value)))  # two that count
    return f"{100 * value:.{digits}f} %"


def physics(contract: dict[str, float | None]) -> Table:
    """Return the physics contract."""
    rows = [[title, deviation(key, contract[key])] for key, title in TITLES.items()]
    return Table(["physics contract", "median relative deviation"], rows)
