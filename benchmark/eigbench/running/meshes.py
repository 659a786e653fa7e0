"""The meshes of a split, instance by instance, as a predictor sees them."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from synthnet import store
from synthnet.families import FAMILIES
from synthnet.mesh import isometries
from synthnet.types import Mesh, Parameters


@dataclass(frozen=True, slots=True)
class Instances:
    """Shapes in memory, and the isometries that make their instances; both by the shape's id."""

    shapes: Mapping[str, Mesh]  # at the precision of the store
    isometries: Mapping[str, NDArray[np.float64]]  # of shape (c, 3, 3)

    def vertices(self, ids: Sequence[str]) -> NDArray[np.int64]:
        """Return the number of vertices of instances, shape (n,)."""
        return np.array([len(self.shapes[id.rpartition("/")[0]].vertices) for id in ids])

    def mesh(self, id: str) -> Mesh:
        """Return the mesh of an instance, such as ``cone-00042/3``, as :func:`view` does."""
        shape, _, number = id.rpartition("/")
        stored = self.shapes[shape]
        plain = Mesh(stored.vertices.astype(np.float64), stored.faces.astype(np.int64))
        return view(isometries.apply(plain, self.isometries[shape][int(number)]))


def read(dataset: store.StoredDataset, ids: Sequence[str]) -> Instances:
    """Read the shapes of instances into memory: about 0.2 GB for the test split of 1.0.

    The ids are those of instances, as in :class:`eigbench.scoring.truth.Truth`.

    Raises
    ------
    EigbenchError
        If the dataset lacks one.
    """
    asked = {id.rpartition("/")[0] for id in ids}
    families = {shape.rpartition("-")[0] for shape in asked}
    shapes, isometries = {}, {}
    for record in dataset.manifest.shards:
        path = dataset.directory / record.file
        if record.family not in families:
            continue
        if not asked.intersection(store.read_table(path, ["id"])["id"].to_pylist()):
            continue
        for sample in store.read_samples(path):
            if sample.spec.id in asked:  # a copy, since a view would hold the whole shard in memory
                mesh = sample.mesh
                shapes[sample.spec.id] = Mesh(mesh.vertices.copy(), mesh.faces.copy())
                isometries[sample.spec.id] = sample.isometries.copy()
    missing = sorted(asked - shapes.keys())
    if missing:
        raise EigbenchError(
            f"{dataset.directory} lacks {len(missing)} shapes of the split, first "
            f"{missing[0]}: check it with `synthnet verify`"
        )
    return Instances(shapes, isometries)


def view(mesh: Mesh) -> Mesh:
    """Return the mesh with read-only arrays, float64 vertices and int64 faces, and no more."""
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    vertices.flags.writeable = False
    faces.flags.writeable = False
    return Mesh(vertices, faces)


def warming(count: int) -> list[Mesh]:
    """Return meshes of 2,500 down to 200 vertices to warm up with; they are of no dataset."""
    return [_ellipsoid(2500 - 2300 * i // max(count - 1, 1), i) for i in range(count)]


@functools.cache
def _ellipsoid(vertices: int, seed: int) -> Mesh:
    surface: Parameters = {"a": 1.0, "b": 1.2, "c": 0.9}
    meshing: Parameters = {"triangulation": "irregular", "vertices": vertices, "seed": seed}
    return view(FAMILIES["ellipsoid"].generate({**surface, **meshing}))
