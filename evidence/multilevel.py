"""What makes the difference in baselines/multilevel.py, and how it does on large meshes.

All variants, other baselines, LaPy and the certified solver answer each mesh in turn, ``REPEATS``
times over; times are medians of processor seconds, on one thread. Meshes of 10,000 vertices and
more are those of the dataset and some of 2.0's families. A few minutes.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from eigbench.scoring.metrics import METRICS
from threadpoolctl import threadpool_limits

from evidence import baseline, markdown
from evidence.timing import Timed, in_turn, progress
from synthnet import Mesh, recipe, store
from synthnet.families import FAMILIES
from synthnet.recipe.drawing import draw_shape

LARGE, REPEATS = 10_000, 5
SYNTHETIC = {"blob": 10_000, "pretzel": 20_000, "twisted_torus": 40_000, "ellipsoid": 100_000}
OURS, LAPY, CERTIFIED = "as it is", "LaPy", "certified solver"
VARIANTS: dict[str, dict[str, Any]] = {  # what is set otherwise
    OURS: {},
    "piecewise constant prolongation": {"weight": 0.0},
    "no share of the prolongation dropped": {"least": 0.0},
    "every neighbour strong": {"strength": 0.0},
    "1 sweep before, 1 after": {"sweeps": (1, 1)},
    "2 sweeps before, 2 after": {"sweeps": (2, 2)},
    "1 cycle a level": {"cycles": 1},
    "2 cycles a level": {"cycles": 2, "enough": 0.0},
    "until no value falls by 10 %": {"enough": 0.1},
    "until no value falls by 1 %": {"enough": 0.01},
    "the last change forgotten": {"remember": False},
    "12 vectors": {"vectors": 12},
    "16 vectors": {"vectors": 16},
    "coarsest level up to 75 vertices": {"coarsest": 75},
    "coarsest level up to 300 vertices": {"coarsest": 300},
}
Method = Callable[[Mesh], np.ndarray]


def measure(*, source: str) -> dict:
    """Return one row per method, and one per large mesh."""
    with threadpool_limits(1):
        real, labels = read_meshes(source)
        meshes = {**real, **synthetic()}
        compared = methods()
        in_turn(calls(compared, next(iter(real.values()))))  # compiles what has to be
        timed = {
            name: in_turn(calls(compared, mesh), REPEATS)
            for name, mesh in progress(meshes.items(), "meshes")
        }
    large = [name for name, mesh in meshes.items() if len(mesh.vertices) >= LARGE]
    rows = [
        method_row(method, [timed[name] for name in real], [timed[name] for name in large], labels)
        for method in compared
    ]
    return {
        "meshes": len(real),
        "methods": rows,
        "large": [large_row(name, len(meshes[name].vertices), timed[name]) for name in large],
    }


def methods() -> dict[str, Method]:
    """Return all that is compared, by name."""
    names = ("multilevel", "decimate", "ritz", "certified", "exact")
    multilevel, decimate, ritz, certified, exact = map(baseline, names)
    compared: dict[str, Method] = {
        name: partial(multilevel.ritz_values, setting=replace(multilevel.SETTING, **changed))
        for name, changed in VARIANTS.items()
    }
    for size in (1000, 300):
        title = f"decimation to {size:,} vertices"
        compared[title] = lambda mesh, size=size: decimate.predict([mesh], size)[0]
    for degree in (7, 5):
        compared[f"Rayleigh-Ritz, degree {degree}"] = partial(ritz.ritz_values, degree=degree)
    compared[CERTIFIED] = lambda mesh: certified.predict([mesh])[0]
    compared[LAPY] = lambda mesh: exact.predict([mesh])[0]
    return compared


def calls(methods: dict[str, Method], mesh: Mesh) -> dict[str, Callable[[], np.ndarray]]:
    """Return the methods on one mesh."""
    return {name: partial(method, mesh) for name, method in methods.items()}


def read_meshes(source: str) -> tuple[dict[str, Mesh], np.ndarray]:
    """Return the meshes of a dataset by their files' names, and their labels."""
    with tempfile.TemporaryDirectory() as temporary:
        home = None
        if Path(source).is_dir():
            command = [sys.executable, "-m", "synthnet", "import", source]
            subprocess.run([*command, "--name", "meshes", "--out", temporary], check=True)
            source, home = "meshes", Path(temporary)
        samples = list(store.open_dataset(source, home).samples())
    meshes = {str(sample.spec.parameters["file"]): as_given(sample.mesh) for sample in samples}
    return meshes, np.array([sample.eigenvalues for sample in samples])


def as_given(mesh: Mesh) -> Mesh:
    """Return a mesh in the types in which a predictor gets it."""
    return Mesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64))


def synthetic() -> dict[str, Mesh]:
    """Return large meshes of 2.0's families."""
    meshes = {}
    for family, vertices in SYNTHETIC.items():
        drawn = draw_shape(recipe.load("2.0"), family, 0).parameters
        drawn = {**drawn, "triangulation": "uniform", "vertices": vertices, "seed": 0}
        meshes[family] = as_given(FAMILIES[family].generate(drawn))
    return meshes


def method_row(
    method: str, real: list[dict[str, Timed]], large: list[dict[str, Timed]], labels: np.ndarray
) -> dict:
    """Return a method's scores and milliseconds on real meshes, and its speed on large ones."""
    answers = np.array([timed[method].answer for timed in real])
    rpd = METRICS["rpd"].function(answers, labels)
    whole = {
        name: sum(timed[name].seconds for timed in large) for name in (method, LAPY, CERTIFIED)
    }
    return {
        "method": method,
        "psnr20": float(METRICS["psnr20"].function(answers, labels).mean()),
        "rpd": float(rpd.mean()),
        "median rpd": float(np.median(rpd)),
        "ms": float(np.mean([1e3 * timed[method].seconds for timed in real])),
        "by LaPy": whole[LAPY] / whole[method],
        "by certified": whole[CERTIFIED] / whole[method],
    }


def large_row(name: str, vertices: int, timed: dict[str, Timed]) -> dict:
    """Return the error of the baseline on a large mesh, and milliseconds."""
    ours, certified = timed[OURS].answer[None], timed[CERTIFIED].answer[None]
    return {
        "mesh": name,
        "vertices": vertices,
        "rpd": float(METRICS["rpd"].function(ours, certified)[0]),
        **{method: 1e3 * timed[method].seconds for method in (OURS, CERTIFIED, LAPY)},
    }


def variants(data: dict) -> str:
    """Return one row per method."""
    columns = {
        "variant": "{method}",
        "PSNR>20 ↑": "{psnr20:.1%}",
        "RPD ↓": "{rpd:.4f}",
        "median RPD ↓": "{median rpd:.4f}",
        "ms per mesh ↓": "{ms:.1f}",
        "LaPy's time ÷ this": "{by LaPy:.1f}",
        "certified solver's time ÷ this": "{by certified:.1f}",
    }
    return markdown.columns(data["methods"], columns, "lr")


def large_meshes(data: dict) -> str:
    """Return one row per large mesh."""
    rows = [
        {**row, "by LaPy": row[LAPY] / row[OURS], "by certified": row[CERTIFIED] / row[OURS]}
        for row in data["large"]
    ]
    columns = {
        "mesh": "{mesh}",
        "vertices": "{vertices:,}",
        "RPD ↓": "{rpd:.4f}",
        "ms ↓": f"{{{OURS}:.1f}}",
        "LaPy's time ÷ this": "{by LaPy:.1f}",
        "certified solver's time ÷ this": "{by certified:.1f}",
    }
    return markdown.columns(rows, columns, "lr")
