"""Tables of a result: their cells, and as text for the terminal."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from tabulate import tabulate

from eigbench import results
from eigbench.scoring.metrics import MAIN, METRICS
from eigbench.scoring.physics import SHARES, TITLES
from synthnet.families import FAMILIES

SPEED = "speed against LaPy"
ROUNDING = 1e-12  # of a mean: a deviation below it is that of equal numbers


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

    One that would be all zeros is given by its power of ten; ``∞/NaN`` stands for one that
    was not finite.

    Examples
    --------
    >>> number(0.04567), number(3.1e-11), number(0.0), number(None)
    ('0.0457', '3e-11', '0.0000', '∞/NaN')
    """
    if value is None:
        return "∞/NaN"
    if 0 < abs(value) < 0.5 * 10**-decimals:
        return f"{value:.0e}"
    return f"{value:.{decimals}f}"


def score(value: float | None, key: str) -> str:
    """Return a score as its metric is shown; shares in per cent.

    Examples
    --------
    >>> score(0.04567, "rpd"), score(0.9606, "psnr20"), score(None, "psnr20"), score(0.0, "l2")
    ('0.0457', '96.06 %', '∞/NaN %', 'exact')
    """
    if value == 0 and not METRICS[key].higher_is_better:
        return "exact"
    return _plain(value, key)


def _plain(value: float | None, key: str) -> str:
    if METRICS[key].unit == "share":
        return number(None if value is None else 100 * value, 2) + " %"
    return number(value, METRICS[key].decimals)


def with_uncertainty(cell: dict[str, float | None], key: str) -> str:
    """Return a mean ± half its interval, and in brackets the deviation over seeds.

    Where all succeed, or none, the bound of the rule of three stands in brackets instead.

    Examples
    --------
    >>> with_uncertainty({"mean": 0.5, "low": 0.4, "high": 0.7, "seed_std": None}, "rpd")
    '0.5000 ± 0.1500'
    >>> with_uncertainty({"mean": 0.9, "low": None, "high": None, "seed_std": 1e-16}, "psnr20")
    '90.00 % (0.00)'
    >>> with_uncertainty({"mean": 1.0, "low": 0.997, "high": 1.0, "seed_std": None}, "psnr20")
    '100 % (≥ 99.70 %)'
    >>> with_uncertainty({"mean": 0.0, "low": 0.0, "high": 0.0, "seed_std": None}, "rpd")
    'exact'
    """
    mean, low, high = cell["mean"], cell["low"], cell["high"]
    if METRICS[key].unit == "share" and low is not None and high is not None and mean in (0, 1):
        return f"100 % (≥ {score(low, key)})" if mean else f"0 % (≤ {score(high, key)})"
    text = score(mean, key)
    if text == "exact":
        return text
    if low is not None and high is not None:
        text += f" ± {_plain((high - low) / 2, key).removesuffix(' %')}"
    if (deviation := cell["seed_std"]) is not None:
        known = 0.0 if deviation <= ROUNDING * abs(mean or 0) else deviation
        text += f" ({_plain(known, key).removesuffix(' %')})"
    return text


def family_title(name: str) -> str:
    """Return a family's title; the name of one that synthnet does not make."""
    return FAMILIES[name].title if name in FAMILIES else name


def in_order(names: Iterable[str]) -> list[str]:
    """Return families in synthnet's order, others after them by name."""
    known = {name: rank for rank, name in enumerate(FAMILIES)}
    return sorted(set(names), key=lambda name: (known.get(name, len(known)), name))


def overall(scored: dict[str, Any]) -> Table:
    """Return the table of the six metrics with their uncertainty."""
    one_seed = all(cell["seed_std"] is None for cell in scored["overall"].values())
    rows = []
    for key, metric in METRICS.items():
        cell = scored["overall"][key]
        d = metric.decimals
        deviation = "" if cell["seed_std"] is None else f"{cell['seed_std']:.{d}f}"
        between = f"{number(cell['low'], d)} to {number(cell['high'], d)}"
        rows.append(
            [
                metric.heading,
                # The PSNR of an exact spectrum is infinite
                "" if key == "psnr" and cell["mean"] is None else number(cell["mean"], d),
                "" if key == "psnr" and cell["mean"] is None else between,
                *([] if one_seed else [deviation]),
                "" if key == "psnr20" else number(cell["median"], d),
                metric.unit,
            ]
        )
    spread = [] if one_seed else ["sd over seeds"]
    headers = ["metric", "mean", "95 % interval", *spread, "median", "unit"]
    return Table(headers, rows)


def families(scored: dict[str, Any]) -> Table:
    """Return the table by family, as the paper's Table 4, with all six metrics."""
    rows = []
    for name, family in scored["families"].items():
        cells = [
            number(family[key]["mean"], m.decimals) for key, m in METRICS.items() if key in MAIN
        ]
        rows.append([family_title(name), f"{family['count']:,}", *cells])
    headers = ["family", "instances", *(METRICS[key].title for key in MAIN)]
    return Table(headers, rows)


def per_index(scored: dict[str, Any]) -> Table:
    """Return the relative error of each eigenvalue."""
    cells = scored["per_index"]
    rows = [
        ["mean relative error", *(number(cell["mean"]) for cell in cells)],
        ["median relative error", *(number(cell["median"]) for cell in cells)],
    ]
    headers = ["", *(f"λ{i}" for i in range(1, len(cells) + 1))]
    return Table(headers, rows)


def cost(result: dict[str, Any]) -> Table:
    """Return what a mesh costs."""
    facts = result["cost"]
    low, high = facts["ms_per_mesh_quartiles"]
    parameters = result["model"]["parameters"]
    rows = [
        [
            "ms a mesh, median of batches (quartiles)",
            f"{facts['ms_per_mesh']:.2f} ({low:.2f} to {high:.2f})",
        ],
        ["ms a mesh, mean", f"{facts['ms_per_mesh_mean']:.2f}"],
        [f"{SPEED}, same meshes", beside_lapy(facts)],
        [
            "batch size, threads, device",
            f"{facts['batch_size']}, {facts['threads']}, {facts['device']}",
        ],
        [
            "cores used",
            f"{facts['cores_used']:.2f}",
        ],
        ["peak memory", f"{facts['peak_memory_mb']:.0f} MB"],
        *_remembering(facts),
        ["parameters", "none" if parameters is None else f"{parameters:,}"],
        ["training cost", results.declared(result, "training_cost")],
        ["hardware", facts["hardware"]],
    ]
    return Table(["", ""], rows)


def _remembering(facts: dict[str, Any]) -> list[list[str]]:
    """Return what loading took, and a copy of a shape beside a new one; older results lack both."""
    rows = []
    if "loading_seconds" in facts:
        rows.append(["loading", f"{facts['loading_seconds']:.1f} s"])
    if (ratio := facts.get("copies_ratio")) is not None:
        rows.append(["time of a copy of a shape, beside a new one", f"{ratio:.2f}"])
    return rows


def beside_lapy(facts: dict[str, Any]) -> str:
    """Return how many times faster than LaPy a run was, from a result's cost.

    Examples
    --------
    >>> beside_lapy({"reference": {"ratio": 14.04}}), beside_lapy({"reference": {"ratio": 0.515}})
    ('14 ×', '0.52 ×')
    >>> beside_lapy({"reference": None})
    'not timed'
    """
    beside = facts.get("reference")
    return "not timed" if beside is None else times_faster(beside)


def times_faster(ratio: dict[str, Any]) -> str:
    """Return a ratio of times as text, with its interval where it has one.

    Examples
    --------
    >>> times_faster({"ratio": 14.04, "low": 13.1, "high": 14.9})
    '14 × (13–15)'
    """
    two_digits = [f"{float(f'{ratio[k]:.2g}'):,g}" for k in ("ratio", "low", "high") if k in ratio]
    middle, *ends = two_digits
    return f"{middle} × ({'–'.join(ends)})" if ends else f"{middle} ×"


def deviation(key: str, value: float | None) -> str:
    """Return a number of the physics contract as text."""
    if value is None:
        return "not finite"
    return f"{100 * value:.0f} %" if key in SHARES else f"{value:.0e}"


def physics(contract: dict[str, float | None]) -> Table:
    """Return the physics contract."""
    rows = [[title, deviation(key, contract[key])] for key, title in TITLES.items()]
    headers = ["physics contract", "median relative deviation"]
    return Table(headers, rows)
