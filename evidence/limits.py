"""How good the pinned spectra of the surfaces are: their bars, and a second method beside them.

The bars are those of all pinned shapes. On 25 surfaces of a family, evenly spaced, the pinned
spectrum is compared with one of another method that has no code in common with the first but the
shape's charts and their triangulation: finite elements of high degree where it comes from a closed
form or an equation of one variable, else scikit-fem's quadratic elements on finer and finer meshes,
extrapolated, with SciPy's eigensolver. A label's error is the label minus the limit.
"""

from __future__ import annotations

import json

import numpy as np
import threadpoolctl
from eigbench.scoring import metrics

from evidence import markdown, scikit_fem
from evidence.pins import surfaces_of
from evidence.shapes import new_families
from evidence.timing import progress
from synthnet import recipe
from synthnet.families import FAMILIES
from synthnet.families.limits import Limit
from synthnet.families.surface_limits import limit
from synthnet.store import pins

COMPARED = 25


def measure(*, version: str) -> dict:
    """Return one row per family that no version before has.

    Raises
    ------
    ValueError
        If the version has no pinned labels or limits.
    """
    labels, limits = pins.read(version), pins.read_limits(version)
    if labels is None or limits is None:
        raise ValueError(
            f"no limits of {version} are pinned: python -m evidence pin limits {version}"
        )
    surfaces = surfaces_of(version, limits)
    rows = []
    with threadpoolctl.threadpool_limits(1):
        for name in new_families(version):
            ids = [id for id in limits if id.rpartition("-")[0] == name]
            rows.append(family(name, ids, limits, surfaces))
            rows[-1] |= of_labels(np.array([labels[id].eigenvalues for id in ids]), ids, limits)
    return {"version": version, "compared": COMPARED, "second": "scikit-fem, P2", "rows": rows}


def family(name: str, ids: list[str], limits: dict[str, Limit], surfaces: dict[str, str]) -> dict:
    """Return the bars of one family, and the differences to another method."""
    bars = np.array([(limits[id].bar / limits[id].eigenvalues).max() for id in ids])
    known = FAMILIES[name].limit is not None
    # The first shape that has each surface
    first = list({surfaces[id]: id for id in reversed(ids)}.values())[::-1]
    chosen = np.linspace(0, len(first) - 1, min(COMPARED, len(first))).round().astype(int)
    apart, within = [], 0
    for i in progress(chosen.tolist(), name):
        limit = limits[first[i]]
        other = second(*json.loads(surfaces[first[i]]))
        distances = np.abs(other.eigenvalues - limit.eigenvalues)
        pairs = np.column_stack([distances, other.bar]) / limit.eigenvalues[:, None]
        apart.append(pairs[pairs[:, 0].argmax()].tolist())
        within += bool((distances <= limit.bar + other.bar).all())
    largest, own_bar = max(apart)
    return {
        "family": name,
        "shapes": len(ids),
        "known": known,
        "bar": [two_digits(value) for value in np.percentile(bars, (50, 99))],
        "compared": len(chosen),
        "apart": [two_digits(value) for value in (np.median(apart, axis=0)[0], largest)],
        "own_bar": two_digits(own_bar),
        "within": within,
    }


def two_digits(value: float) -> float:
    """Return a number with two digits."""
    return float(f"{value:.1e}")


def second(name: str, parameters: dict) -> Limit:
    """Return the spectrum of a surface by the other method."""
    chosen = FAMILIES[name]
    if chosen.limit is not None:
        return limit(chosen.atlas(**parameters), 10)
    return scikit_fem.limit(chosen.atlas(**parameters), 10)


def of_labels(labels: np.ndarray, ids: list[str], limits: dict[str, Limit]) -> dict:
    """Return how far labels are from the limits."""
    true = np.array([limits[id].eigenvalues for id in ids])
    errors = 100 * np.abs(labels / true - 1).mean(axis=1)
    return {
        "label_error": np.percentile(errors, (50, 95)).round(2).tolist(),
        "below_20_db": int(np.count_nonzero(metrics.psnr_above_20(labels, true) == 0)),
    }


def table(*versions: dict) -> str:
    """Return one row per family of every version."""
    cells = [
        [
            f"{FAMILIES[row['family']].title} ({data['version']})",
            f"{row['shapes']:,}",
            "known" if row["known"] else "elements",
            *(f"{value:.0e}" for value in row["bar"]),
            "elements" if row["known"] else data["second"],
            *(f"{value:.0e}" for value in (*row["apart"], row["own_bar"])),
            f"{row['within']} of {row['compared']}",
        ]
        for data in versions
        for row in data["rows"]
    ]
    headers = ["family", "shapes", "limit", "bar, median", "bar, 99 %", "second method"]
    headers += ["apart, median", "apart, largest", "second method's bar there", "within both bars"]
    return markdown.table(headers, cells, "lrlrrlr")


def agreement(*versions: dict) -> str:
    """Return on how many surfaces the two methods agree, in one sentence."""
    rows = [row for data in versions for row in data["rows"]]
    within, compared = (sum(row[key] for row in rows) for key in ("within", "compared"))
    number = f"all {compared:,}" if within == compared else f"{within:,} of {compared:,}"
    return (
        f"On {number} surfaces of the {len(rows)} families, no eigenvalue differs by more than "
        "both bars together."
    )


def below_20_db(data: dict) -> str:
    """Return how many labels of a version have a PSNR of 20 dB or less, by family."""
    rows = sorted(data["rows"], key=lambda row: row["below_20_db"] / row["shapes"], reverse=True)
    failing, shapes = (sum(row[key] for row in rows) for key in ("below_20_db", "shapes"))
    named = [
        f"{row['below_20_db']:,} of {row['shapes']:,} {plural(FAMILIES[row['family']].title)}"
        for row in rows
        if row["below_20_db"]
    ]
    return (
        f"The PSNR of {failing:,} of the {shapes:,} labels against their own surface is 20 dB or "
        f"less: {', '.join(named[:-1])} and {named[-1]}."
    )


def plural(title: str) -> str:
    """Return the name of several shapes of a family of 1.0.

    Examples
    --------
    >>> plural("Conical frustum"), plural("Tetrahedron"), plural("Split cone")
    ('conical frusta', 'tetrahedra', 'split cones')
    """
    name = title.lower()
    for one, several in (("frustum", "frusta"), ("hedron", "hedra")):
        name = name.replace(one, several)
    return name if name.endswith("a") else f"{name}s"


def failing_labels(*versions: dict) -> str:
    """Return how far the labels are from their own surfaces, and which fail the paper's bound."""
    cells = [
        [
            f"{FAMILIES[row['family']].title} ({data['version']})",
            f"{row['shapes']:,}",
            *(f"{value:.2f} %" for value in row["label_error"]),
            f"{row['below_20_db']:,}",
        ]
        for data in versions
        for row in data["rows"]
    ]
    for data in versions:
        failing, shapes = (
            sum(row[key] for row in data["rows"]) for key in ("below_20_db", "shapes")
        )
        whole = len(data["rows"]) == len(recipe.load(data["version"]).families)
        which = f"{'all of' if whole else 'added by'} {data['version']}"
        cells.append([which, f"{shapes:,}", "", "", f"{failing:,}"])
    headers = ["family", "shapes", "mean error, median", "95 %", "PSNR 20 dB or less"]
    return markdown.table(headers, cells, "lr")
