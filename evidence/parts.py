"""How far off baselines/multilevel.py is where nobody tuned it, and how often it hands on.

Meshes are solids of evidence/solids.py of a seed that was not used in tuning, the real ones, as a
dataset or a directory, and the test split of a version. Errors are those of the worst eigenvalue of
a mesh against the certified solver. From 10,000 vertices on, LaPy with CHOLMOD is timed beside it,
in processor seconds of one thread. A quarter of an hour and more, most of it to make the meshes.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from evidence import baseline, markdown
from evidence.multilevel import LARGE, as_given, read_meshes
from evidence.timing import in_turn, progress
from synthnet import Mesh, spectrum, store
from synthnet.errors import SpectrumError

OFF = (0.05, 0.1)  # errors that are counted
REFUSED, UNCERTIFIED = "refused by import", "without a certificate"


def measure(
    *,
    real: tuple[str, ...] = ("real-28",),
    versions: tuple[str, ...] = (),
    count: int = 300,
    seed: int = 3,
) -> dict:
    """Return one row per set of meshes.

    Parameters
    ----------
    real
        Datasets of `synthnet import`, or directories of files.
    versions
        Of synthNet, built.
    count, seed
        Of the solids.
    """
    sets = {f"{count} solids, seed {seed}": partial(made, count, seed)}
    sets |= {name.rstrip("/").rpartition("/")[2]: partial(imported, name) for name in real}
    sets |= {f"{version}, test": partial(built, version) for version in versions}
    with threadpool_limits(1):
        rows = [row(name, meshes) for name, meshes in sets.items()]
    return {"seed": seed, "rows": rows}


def problems(data: dict) -> list[str]:
    """Return the sets with a mesh that is off by more than it may."""
    return [
        f"{row['set']}: {row['off'][0]} meshes are off by more than {OFF[0]:.0%}"
        for row in data["rows"]
        if row["off"][0]
    ]


def made(count: int, seed: int) -> Iterator[tuple[str, Mesh | None]]:
    """Yield solids; None in place of one that import refuses."""
    from evidence.solids import Solid, solids

    for solid in solids(count, seed):
        if isinstance(solid, Solid):
            yield solid.name, as_given(solid.mesh)
        else:
            yield solid, None


def imported(source: str) -> Iterable[tuple[str, Mesh]]:
    """Return the meshes of an import, or of the files of a directory that can be imported."""
    return read_meshes(source)[0].items()


def built(version: str) -> Iterator[tuple[str, Mesh]]:
    """Yield the meshes of a version's test split."""
    for sample in store.open_dataset(version).samples():
        if sample.split == "test":
            yield sample.spec.id, as_given(sample.mesh)


def row(name: str, meshes: partial[Iterable[tuple[str, Mesh | None]]]) -> dict:
    """Return what is counted over a set of meshes."""
    cases, left_out = [], Counter({REFUSED: 0, UNCERTIFIED: 0})
    for label, mesh in progress(meshes(), name):
        if mesh is None:
            left_out[REFUSED] += 1
            continue
        try:
            cases.append({"mesh": label, **measured(mesh)})
        except SpectrumError:
            left_out[UNCERTIFIED] += 1
    tested = [case for case in cases if case["tested"]]
    large = [case for case in cases if "LaPy" in case]
    worst = max(cases, key=lambda case: case["error"])
    return {
        "set": name,
        "meshes": len(cases),
        **left_out,
        "tested": len(tested),
        "handed on": sum(case["certified"] for case in tested),
        "off": [sum(case["error"] > off for case in cases) for off in OFF],
        "worst": worst["error"],
        "worst mesh": worst["mesh"],
        "alone off": [sum(case["alone"] > off for case in cases) for off in OFF],
        "alone worst": max(case["alone"] for case in cases),
        "large": len(large),
        "large handed on": sum(case["certified"] for case in large),
        "large ms": 1e3 * sum(case["ours"] for case in large),
        "LaPy ms": 1e3 * sum(case["LaPy"] for case in large),
        "LaPy by ours": sorted(round(case["LaPy"] / case["ours"], 2) for case in large),
    }


def measured(mesh: Mesh) -> dict:
    """Return the errors of one mesh, and times if it is large."""
    multilevel = baseline("multilevel")
    exact = spectrum.compute(mesh).eigenvalues
    sides = {"ours": lambda: multilevel.eigenvalues(mesh)}
    if len(mesh.vertices) >= LARGE:
        sides["LaPy"] = partial(baseline("lapy_cholmod").eigenvalues, mesh)
    timed = in_turn(sides)
    values, certified = timed["ours"].answer
    alone = multilevel.ritz_values(mesh)
    return {
        "error": float(np.abs(values / exact - 1).max()),
        "alone": float(np.abs(alone / exact - 1).max()),
        "tested": len(mesh.vertices) > multilevel.CERTIFIED,
        "certified": certified,
        **{side: time.seconds for side, time in timed.items()},
    }


def table(data: dict) -> str:
    """Return one row per set."""
    rows = [
        {**row, "ratio": f"{row['LaPy ms'] / row['large ms']:.1f}" if row["large"] else ""}
        for row in data["rows"]
    ]
    columns = {
        "meshes": "{set}",
        "number": "{meshes:,}",
        "iteration alone: off by over 5 %": "{alone off[0]:,}",
        "off by over 5 %": "{off[0]:,}",
        "off by over 10 %": "{off[1]:,}",
        "worst": "{worst:.1%}",
        "over 5,000 vertices": "{tested:,}",
        "of these, solved by the certified solver": "{handed on:,}",
        "of 10,000 and more": "{large:,}",
        "LaPy with CHOLMOD's time ÷ this": "{ratio}",
    }
    return markdown.columns(rows, columns, "lr")
