"""libigl's Voronoi mass matrices of some shapes of each family: tests/golden/voronoi.parquet.

libigl is not among our requirements, since its wheel has GPL parts in it: ``pip install libigl``.
Shapes are those of 1.0 with the fewest vertices, and the one of each family with the most obtuse
triangles among fifty.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from evidence import ROOT
from synthnet import recipe
from synthnet.families import FAMILIES
from synthnet.recipe.plan import plan_shards
from synthnet.types import Mesh

GOLDEN = ROOT / "tests" / "golden" / "voronoi.parquet"
# So many shapes of a family are tried; the obtuse one has at most so many vertices
CONSIDERED, MOST_VERTICES = 50, 700


def pin_voronoi() -> None:
    """Choose shapes, compute their matrices by libigl, write them."""
    import igl

    families: dict[str, list[tuple[str, Mesh]]] = {}
    for plan in plan_shards(recipe.load("1.0")):
        members = families.setdefault(plan.family, [])
        for shape in plan.shapes[: CONSIDERED - len(members)]:
            mesh = FAMILIES[plan.family].generate(shape.spec.parameters).stored()
            members.append((shape.spec.id, mesh))
    rows = []
    for members in families.values():
        least = min(members, key=lambda member: len(member[1].vertices))
        small = [member for member in members if len(member[1].vertices) <= MOST_VERTICES]
        obtuse = max(small or [least], key=lambda member: obtuse_share(member[1]))
        for id, mesh in dict([least, obtuse]).items():
            vertices, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
            matrix = igl.massmatrix(vertices, faces, igl.MASSMATRIX_TYPE_VORONOI)
            rows.append([id, mesh.vertices.ravel(), mesh.faces.ravel(), matrix.diagonal()])
            print(f"{id}: {len(vertices)} vertices, {obtuse_share(mesh):.0%} obtuse")
    table = pa.table(list(zip(*rows, strict=True)), names=["id", "vertices", "faces", "areas"])
    pq.write_table(table, GOLDEN, compression="zstd", use_dictionary=False)
    print(f"{GOLDEN}: {GOLDEN.stat().st_size / 1e3:.0f} kB")


def obtuse_share(mesh: Mesh) -> float:
    """Return the share of triangles with an obtuse angle."""
    import igl

    squares = np.sort(igl.squared_edge_lengths(mesh.vertices.astype(float), mesh.faces), axis=1)
    return float((squares[:, 2] > squares[:, 0] + squares[:, 1]).mean())
