"""Write libigl's Voronoi mass matrices of some shapes of each family: tests/golden/voronoi.parquet.

    pip install libigl
    python scripts/make_voronoi_golden.py

libigl is not among our requirements, since its wheel has GPL parts in it. Shapes are those of 1.0
with the fewest vertices, and the one of each family with the most obtuse triangles among fifty.
"""

from pathlib import Path

import igl
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from synthnet import recipe
from synthnet.families import FAMILIES
from synthnet.recipe.plan import plan_shards
from synthnet.types import Mesh

GOLDEN = Path(__file__).parent.parent / "tests" / "golden" / "voronoi.parquet"
LOOKED_AT, MOST_VERTICES = 50, 700


def obtuse_share(mesh: Mesh) -> float:
    """Return the share of triangles with an obtuse angle."""
    squares = np.sort(igl.squared_edge_lengths(mesh.vertices.astype(float), mesh.faces), axis=1)
    return float((squares[:, 2] > squares[:, 0] + squares[:, 1]).mean())


def main() -> None:
    """Choose shapes, ask libigl, write."""
    found: dict[str, list[tuple[str, Mesh]]] = {}
    for plan in plan_shards(recipe.load("1.0")):
        members = found.setdefault(plan.family, [])
        for shape in plan.shapes:
            if len(members) < LOOKED_AT:
                mesh = FAMILIES[plan.family].generate(shape.spec.parameters).stored()
                members.append((shape.spec.id, mesh))
    rows = []
    for members in found.values():
        least = min(members, key=lambda one: len(one[1].vertices))
        small = [one for one in members if len(one[1].vertices) <= MOST_VERTICES] or [least]
        obtuse = max(small, key=lambda one: obtuse_share(one[1]))
        for id, mesh in dict([least, obtuse]).items():
            vertices, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
            matrix = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_VORONOI)
            arrays = (mesh.vertices.ravel(), mesh.faces.ravel(), matrix.diagonal())
            rows.append([id, *arrays])
            print(f"{id}: {len(vertices)} vertices, {obtuse_share(mesh):.0%} obtuse")
    table = pa.table(list(zip(*rows, strict=True)), names=["id", "vertices", "faces", "areas"])
    pq.write_table(table, GOLDEN, compression="zstd", use_dictionary=False)
    print(f"{GOLDEN}: {GOLDEN.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
