"""What makes the difference in baselines/multilevel.py: docs/data/multilevel.json and its page.

    python scripts/ablate_multilevel.py scans
    python scripts/ablate_multilevel.py directory/of/meshes

The argument is the name of an imported dataset, or a directory that is imported for the occasion.
All variants, other baselines, LaPy and the certified solver answer each mesh in turn, ``REPEATS``
times over; times are medians of processor seconds, one thread. Meshes of 10,000 vertices and more
are those of the dataset and some of 2.0's families. A few minutes.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from tabulate import tabulate
from threadpoolctl import threadpool_limits

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "baselines"))

import certified  # noqa: E402
import decimate  # noqa: E402
import exact  # noqa: E402
import multilevel  # noqa: E402
import ritz  # noqa: E402
from eigbench.scoring.metrics import METRICS  # noqa: E402

from synthnet import Mesh, recipe, store  # noqa: E402
from synthnet.families import FAMILIES  # noqa: E402
from synthnet.recipe.drawing import draw_shape  # noqa: E402
from synthnet.store.files import write_marked, write_text  # noqa: E402

RESULT, PAGE = ROOT / "docs" / "data" / "multilevel.json", ROOT / "docs" / "real-shapes.md"
LARGE, REPEATS = 10_000, 5
SYNTHETIC = {"blob": 10_000, "pretzel": 20_000, "twisted_torus": 40_000, "ellipsoid": 100_000}
SETTING = multilevel.SETTING
VARIANTS = {
    "as it is": SETTING,
    "piecewise constant prolongation": replace(SETTING, weight=0.0),
    "no share of the prolongation dropped": replace(SETTING, least=0.0),
    "every neighbour strong": replace(SETTING, strength=0.0),
    "1 sweep before, 1 after": replace(SETTING, sweeps=(1, 1)),
    "2 sweeps before, 2 after": replace(SETTING, sweeps=(2, 2)),
    "1 cycle a level": replace(SETTING, cycles=1),
    "2 cycles a level": replace(SETTING, cycles=2, enough=0.0),
    "until no value falls by 10 %": replace(SETTING, enough=0.1),
    "until no value falls by 1 %": replace(SETTING, enough=0.01),
    "the last change forgotten": replace(SETTING, remember=False),
    "12 vectors": replace(SETTING, vectors=12),
    "16 vectors": replace(SETTING, vectors=16),
    "coarsest level up to 75 vertices": replace(SETTING, coarsest=75),
    "coarsest level up to 300 vertices": replace(SETTING, coarsest=300),
}
LAPY, CERTIFIED = "LaPy", "certified solver"
OURS = next(iter(VARIANTS))
Method = Callable[[Mesh], np.ndarray]


def methods() -> dict[str, Method]:
    """Return all that is compared, by name."""
    found: dict[str, Method] = {
        name: lambda mesh, setting=setting: multilevel.ritz_values(mesh, setting)
        for name, setting in VARIANTS.items()
    }
    for size in (1000, 300):
        found[f"decimation to {size:,} vertices"] = lambda mesh, size=size: decimate.predict(
            [mesh], size
        )[0]
    for degree in (7, 5):
        found[f"Rayleigh-Ritz, degree {degree}"] = lambda mesh, degree=degree: ritz.ritz_values(
            mesh, degree
        )
    found[CERTIFIED] = lambda mesh: certified.predict([mesh])[0]
    found[LAPY] = lambda mesh: exact.predict([mesh])[0]
    return found


def meshes(source: str) -> tuple[dict[str, Mesh], np.ndarray]:
    """Return the meshes of a dataset by their files' names, and their labels."""
    with tempfile.TemporaryDirectory() as home:
        place = None
        if Path(source).is_dir():
            command = [sys.executable, "-m", "synthnet", "import", source]
            subprocess.run([*command, "--name", "meshes", "--out", home], check=True)
            source, place = "meshes", Path(home)
        samples = list(store.open_dataset(source, place).samples())
    found = {str(sample.spec.parameters["file"]): as_given(sample.mesh) for sample in samples}
    return found, np.array([sample.eigenvalues for sample in samples])


def as_given(mesh: Mesh) -> Mesh:
    """Return a mesh in the types in which a predictor gets it."""
    return Mesh(mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64))


def synthetic() -> dict[str, Mesh]:
    """Return large meshes of 2.0's families."""
    found = {}
    for family, vertices in SYNTHETIC.items():
        drawn = draw_shape(recipe.load("2.0"), family, 0).parameters
        drawn = {**drawn, "triangulation": "uniform", "vertices": vertices, "seed": 0}
        found[family] = as_given(FAMILIES[family].generate(drawn))
    return found


def timed(mesh: Mesh, ways: dict[str, Method]) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return each method's answer, and its median processor milliseconds, all in turn."""
    answers, seconds = {}, {name: [] for name in ways}
    for _ in range(REPEATS):
        for name, method in ways.items():
            begin = time.process_time()
            answers[name] = method(mesh)
            seconds[name].append(time.process_time() - begin)
    return answers, {name: 1e3 * float(np.median(all_)) for name, all_ in seconds.items()}


def measured(source: str) -> dict:
    """Return a row a method, and a row a large mesh."""
    ways = methods()
    real, labels = meshes(source)
    both = {**real, **synthetic()}
    timed(next(iter(real.values())), ways)  # compiles what has to be
    answers, ms = {}, {}
    for number, (name, mesh) in enumerate(both.items()):
        answers[name], ms[name] = timed(mesh, ways)
        print(f"{number + 1}/{len(both)} {name}", flush=True)
    large = [name for name, mesh in both.items() if len(mesh.vertices) >= LARGE]
    rows = []
    for way in ways:
        found = np.array([answers[name][way] for name in real])
        rpd = METRICS["rpd"].function(found, labels)
        whole = {who: sum(ms[name][who] for name in large) for who in (way, LAPY, CERTIFIED)}
        rows.append(
            {
                "method": way,
                "psnr20": float(METRICS["psnr20"].function(found, labels).mean()),
                "rpd": float(rpd.mean()),
                "median rpd": float(np.median(rpd)),
                "ms": float(np.mean([ms[name][way] for name in real])),
                "by LaPy": whole[LAPY] / whole[way],
                "by certified": whole[CERTIFIED] / whole[way],
            }
        )
    return {
        "meshes": len(real),
        "methods": rows,
        "large": [
            {
                "mesh": name,
                "vertices": len(both[name].vertices),
                "rpd": float(
                    METRICS["rpd"].function(
                        answers[name][OURS][None], answers[name][CERTIFIED][None]
                    )[0]
                ),
                **{way: ms[name][way] for way in (OURS, CERTIFIED, LAPY)},
            }
            for name in large
        ],
    }


def tables(found: dict) -> dict[str, str]:
    """Return both tables of the page."""
    first = [
        [
            row["method"],
            f"{row['psnr20']:.1%}",
            f"{row['rpd']:.4f}",
            f"{row['median rpd']:.4f}",
            f"{row['ms']:.1f}",
            f"{row['by LaPy']:.1f}",
            f"{row['by certified']:.1f}",
        ]
        for row in found["methods"]
    ]
    second = [
        [
            row["mesh"],
            f"{row['vertices']:,}",
            f"{row['rpd']:.4f}",
            f"{row[OURS]:.1f}",
            f"{row[LAPY] / row[OURS]:.1f}",
            f"{row[CERTIFIED] / row[OURS]:.1f}",
        ]
        for row in found["large"]
    ]
    times = ["LaPy's time by this", "certified solver's"]
    heads = (
        ["variant", "PSNR>20 ↑", "RPD ↓", "median RPD ↓", "ms a mesh ↓", *times],
        ["mesh", "vertices", "RPD ↓", "ms ↓", *times],
    )
    return {
        name: "\n"
        + tabulate(
            rows,
            head,
            tablefmt="github",
            disable_numparse=True,
            colalign=["left"] + ["right"] * (len(head) - 1),
        )
        + "\n"
        for name, rows, head in zip(("ablation", "large"), (first, second), heads, strict=True)
    }


def main() -> None:
    """Measure, write."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", help="name of an imported dataset, or a directory of meshes")
    options = parser.parse_args()
    with threadpool_limits(1):
        found = measured(options.source)
    write_text(RESULT, json.dumps(found, indent=1) + "\n")
    write_marked(PAGE, **tables(found))
    print(f"{RESULT} and {PAGE} written")


if __name__ == "__main__":
    main()
