"""How sharply meshes of smooth surfaces are bent, in 2.0.

On a smooth surface the angle between two triangles' normals goes to 0 as the mesh gets finer.
Where it stays large, triangles are slivers that do not lie along the surface, though their
vertices are on it. Needs a built 2.0.
"""

from collections import defaultdict

import numpy as np
import trimesh

from evidence import markdown
from evidence.timing import progress
from synthnet import recipe, store
from synthnet.families import FAMILIES
from synthnet.types import Mesh

VERSION = "2.0"
SMOOTH = ("ellipsoid", "twisted_torus", "knotted_tube", "pretzel", "blob")  # these have no crease
SHARP = 60.0  # degrees between normals


def measure() -> dict:
    """Measure every mesh of the smooth families: medians and maxima by size."""
    dataset, version = store.open_dataset(VERSION), recipe.load(VERSION)
    sizes = [size.name for size in version.sizes]
    folds = defaultdict(list)
    shards = [shard for shard in dataset.manifest.shards if shard.family in SMOOTH]
    for shard in progress(shards, "folds"):
        for sample in store.read_samples(dataset.directory / shard.file):
            size = sizes[sample.spec.index % version.copies]
            folds[sample.spec.family, size].append(folded(sample.mesh))
    rows = []
    for (family, size), pairs in folds.items():
        row = {"family": family, "size": size}
        for name, reduced in (("median", np.median), ("largest", np.max)):
            angle, area = reduced(pairs, axis=0).tolist()
            row[name] = {"angle": angle, "area": area}
        rows.append(row)
    return {"version": VERSION, "rows": rows}


def folded(mesh: Mesh) -> tuple[float, float]:
    """Return the largest angle between neighbours, and the share of area beside sharp edges."""
    surface = trimesh.Trimesh(mesh.vertices.astype(np.float64), mesh.faces, process=False)
    angles = np.degrees(surface.face_adjacency_angles)
    beside = np.unique(surface.face_adjacency[angles > SHARP])
    return float(angles.max()), float(surface.area_faces[beside].sum() / surface.area)


def table(data: dict) -> str:
    """Return one row per family, with the angle and the area of each size."""
    cells: dict[str, list[str]] = {}
    for row in data["rows"]:
        middle, most = row["median"], row["largest"]
        cells.setdefault(FAMILIES[row["family"]].title, []).extend(
            [
                f"{middle['angle']:.0f}° ({most['angle']:.0f}°)",
                f"{100 * middle['area']:.1f} % ({100 * most['area']:.1f} %)",
            ]
        )
    sizes = dict.fromkeys(row["size"] for row in data["rows"])
    headers = ["family", *(text for size in sizes for text in (f"{size}: angle", "area"))]
    return markdown.table(headers, ([title, *row] for title, row in cells.items()), "l")
