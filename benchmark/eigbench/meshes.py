"""The meshes of a split, instance by instance, as a predictor sees them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from eigbench.errors import EigbenchError
from synthnet import augment, store
from synthnet.types import Mesh


def instances(
    dataset: store.StoredDataset, ids: Sequence[str], skip: int = 0
) -> Iterator[tuple[str, Mesh]]:
    """Yield each instance's id and mesh, in the order of ``ids``, which is the shards'.

    A mesh has float64 vertices (n, 3) and int64 faces (m, 3), both read-only, and nothing
    that tells its label, family or parameters.

    Parameters
    ----------
    dataset : StoredDataset
        A built dataset.
    ids : sequence of str
        Instances as in :class:`eigbench.truth.Truth`.
    skip : int
        How many of the first to leave out.

    Raises
    ------
    EigbenchError
        If the dataset lacks one.
    """
    wanted: dict[str, list[int]] = {}
    for id in ids[skip:]:
        shape, _, number = id.rpartition("/")
        wanted.setdefault(shape, []).append(int(number))
    if not wanted:
        return
    families = {shape.rpartition("-")[0] for shape in wanted}
    for record in dataset.manifest.shards:
        if record.family not in families:
            continue
        path = dataset.directory / record.file
        if not set(store.read_table(path, ["id"])["id"].to_pylist()) & wanted.keys():
            continue
        for sample in store.read_samples(path):
            for instance in wanted.pop(sample.spec.id, ()):
                yield (
                    f"{sample.spec.id}/{instance}",
                    view(
                        augment.apply(
                            Mesh(
                                sample.mesh.vertices.astype(np.float64),
                                sample.mesh.faces.astype(np.int64),
                            ),
                            sample.isometries[instance],
                        )
                    ),
                )
        if not wanted:
            return
    raise EigbenchError(
        f"{dataset.directory} lacks {len(wanted)} shapes of the split, first "
        f"{next(iter(wanted))}: check it with `synthnet verify`"
    )


def view(mesh: Mesh) -> Mesh:
    """Return the mesh with read-only arrays."""
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    vertices.flags.writeable = False
    faces.flags.writeable = False
    return Mesh(vertices, faces)
