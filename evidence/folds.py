"""Write the table of folds of 2.0's dataset card: how sharply meshes of smooth surfaces are bent.

    synthnet build --version 2.0
    python scripts/fold_table.py

On a smooth surface the angle between two triangles' normals goes to 0 as the mesh gets finer.
Where it stays large, triangles are slivers that do not lie along the surface, though their
vertices are on it.
"""

from collections import defaultdict
from pathlib import Path

import numpy as np
import trimesh
from rich.progress import track
from tabulate import tabulate

from synthnet import recipe, store
from synthnet.families import FAMILIES
from synthnet.store.files import write_marked
from synthnet.types import Mesh

CARD = Path(__file__).parent.parent / "docs" / "dataset-card-2.0.md"
VERSION = "2.0"
SMOOTH = ("ellipsoid", "twisted_torus", "knotted_tube", "pretzel", "blob")  # without any crease
SHARP = 60.0  # degrees between normals


def folded(mesh: Mesh) -> tuple[float, float]:
    """Return the largest angle between neighbours, and the share of area beside sharp edges."""
    surface = trimesh.Trimesh(mesh.vertices.astype(np.float64), mesh.faces, process=False)
    angles = np.degrees(surface.face_adjacency_angles)
    beside = np.unique(surface.face_adjacency[angles > SHARP])
    return float(angles.max()), float(surface.area_faces[beside].sum() / surface.area)


def main() -> None:
    """Measure every mesh of the smooth families, and rewrite the table."""
    dataset, wanted = store.open_dataset(VERSION), recipe.load(VERSION)
    sizes = [size.name for size in wanted.sizes or ()]
    found = defaultdict(list)
    shards = [shard for shard in dataset.manifest.shards if shard.family in SMOOTH]
    for shard in track(shards, "folds"):
        for sample in store.read_samples(dataset.directory / shard.file):
            size = sizes[sample.spec.index % wanted.copies]
            found[sample.spec.family, size].append(folded(sample.mesh))
    rows = []
    for family in SMOOTH:
        row = [FAMILIES[family].title]
        for size in sizes:
            angles, shares = np.array(found[family, size]).T
            row += [
                f"{np.median(angles):.0f}° ({angles.max():.0f}°)",
                f"{100 * np.median(shares):.1f} % ({100 * shares.max():.1f} %)",
            ]
        rows.append(row)
    headers = ["family", *(text for size in sizes for text in (f"{size}: angle", "area"))]
    table = tabulate(rows, headers, tablefmt="github", disable_numparse=True)
    write_marked(CARD, folds=f"\n{table}\n")
    print(CARD)


if __name__ == "__main__":
    main()
