"""A version's shapes as flat, memory-mapped arrays: quick to open, small in memory.

The small files are checked when they are opened, see :mod:`synthnet.store.unpacked`; the digest of
a mesh, which one of them has, when the mesh is first read.
"""

from __future__ import annotations

import hashlib
import mmap
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from synthnet import store
from synthnet.arrays import Int32s, Int64s
from synthnet.errors import DamagedError
from synthnet.store import unpacked
from synthnet.store.files import one_line
from synthnet.types import Mesh

RELEASE_BYTES = 64 * 2**20  # bytes read after which mapped pages are handed back
TABLE = "shapes.parquet"
LARGE = ("vertices.npy", "faces.npy")
FORMAT = 2  # the format of the files here, which is part of their directory's name


def directory(dataset: store.StoredDataset) -> Path:
    """Return where a dataset's arrays are: the name holds all that they depend on."""
    return unpacked.folder(dataset) / f"{dataset.manifest.recipe_digest[:12]}-{FORMAT}"


def open_shapes(dataset: store.StoredDataset, *, wholly: bool = False) -> MappedShapes:
    """Map the shapes of a dataset on this machine; unpack them where they are missing or damaged.

    ``wholly`` says whether to read every byte of what is there. Raise DamagedError if what was
    just unpacked is damaged.
    """
    where = directory(dataset)
    return unpacked.open_or_unpack(
        where,
        dataset,
        lambda: MappedShapes(where),
        lambda to: write_shapes(to, dataset),
        by_item=LARGE,
        reader=unpacked.PYG,
        wholly=wholly,
    )


class MappedShapes:
    """All shapes of a version, in a directory that :func:`write_shapes` wrote.

    Raise DamagedError if files cannot be read or do not fit each other.

    Attributes
    ----------
    vertices : ndarray of shape (N, 3), float32, memory-mapped
        Vertices of all shapes in a row.
    faces : ndarray of shape (M, 3), int32, memory-mapped
        Faces of all shapes, counted from each shape's own first vertex.
    vertex_offsets, face_offsets : ndarray of shape (count + 1,), int64
        Where each shape begins.
    y : ndarray of shape (count, k), float32
        Eigenvalues in 1/length².
    isometries : ndarray of shape (count, instances, 3, 3), float32
        Orthogonal matrices, the first the identity.
    ids, families : list of str
        One a shape.
    splits : ndarray of shape (count,), str
        Protocol ``grouped``.
    paper_splits : ndarray of shape (count, instances), str
        Protocol ``paper``.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        try:
            self._open(directory)
        except (OSError, ValueError, KeyError, pa.ArrowException) as error:
            raise DamagedError(f"{directory} is damaged ({one_line(error)})") from error

    def _open(self, directory: Path) -> None:
        # Mapped copy-on-write: torch wants writable memory, the file stays as it is.
        self.vertices = np.load(directory / "vertices.npy", mmap_mode="c", allow_pickle=False)
        self.faces = np.load(directory / "faces.npy", mmap_mode="c", allow_pickle=False)
        self.y = np.load(directory / "y.npy", allow_pickle=False)
        self.isometries = np.load(directory / "isometries.npy", allow_pickle=False)
        table = pq.read_table(directory / TABLE)
        self.ids: list[str] = table["id"].to_pylist()
        self.families: list[str] = table["family"].to_pylist()
        self.splits = np.array(table["split"].to_pylist())
        self.count, self.instances = self.isometries.shape[:2]
        flat = table["paper_splits"].combine_chunks().flatten().to_pylist()
        self.paper_splits = np.array(flat).reshape(self.count, self.instances)
        self.vertex_offsets = _offsets(table["vertices"].to_numpy())
        self.face_offsets = _offsets(table["faces"].to_numpy())
        self._digests: list[bytes] = table["digest"].to_pylist()
        self._checked = np.zeros(self.count, dtype=np.bool_)
        self._read = 0
        k = self.y.shape[-1]
        for name, array, kind, shape in (
            ("vertices", self.vertices, np.float32, (self.vertex_offsets[-1], 3)),
            ("faces", self.faces, np.int32, (self.face_offsets[-1], 3)),
            ("y", self.y, np.float32, (len(self.ids), k)),
            ("isometries", self.isometries, np.float32, (len(self.ids), self.instances, 3, 3)),
        ):
            if array.dtype != kind or array.shape != shape:
                raise ValueError(f"{name} have the shape {array.shape} and {array.dtype}")

    def mesh(self, shape: int) -> Mesh:
        """Return a shape's mesh, copied out of the mapped arrays.

        Raise DamagedError if it is not as it was unpacked.
        """
        v, f = self.vertex_offsets, self.face_offsets
        vertices = np.array(self.vertices[v[shape] : v[shape + 1]])
        faces = np.array(self.faces[f[shape] : f[shape + 1]])
        if not self._checked[shape]:
            if _digest(vertices, faces) != self._digests[shape]:
                raise DamagedError(f"{self._directory}: the mesh of {self.ids[shape]} is damaged")
            self._checked[shape] = True
        self._release(vertices.nbytes + faces.nbytes)
        return Mesh(vertices, faces)

    def _release(self, size: int) -> None:
        # Pages of a mapped file count as this process's memory until they are given back
        # to the page cache, where the next epoch finds them.
        self._read += size
        if self._read < RELEASE_BYTES:
            return
        self._read = 0
        for array in (self.vertices, self.faces):
            pages = getattr(array, "_mmap", None)
            if pages is not None and hasattr(mmap, "MADV_DONTNEED"):
                pages.madvise(mmap.MADV_DONTNEED)


def write_shapes(to: Path, dataset: store.StoredDataset) -> None:
    """Unpack a dataset's shards into flat arrays in the directory ``to``, one at a time."""
    shards = dataset.manifest.shards
    columns: dict[str, list[Any]] = {
        name: []
        for name in ("id", "family", "split", "paper_splits", "vertices", "faces", "digest")
    }
    labels, isometries = [], []
    with (to / "vertices.npy").open("wb") as vertices, (to / "faces.npy").open("wb") as faces:
        _write_header(vertices, sum(s.vertices for s in shards), np.dtype(np.float32))
        _write_header(faces, sum(s.faces for s in shards), np.dtype(np.int32))
        for sample in dataset.samples():
            points = np.ascontiguousarray(sample.mesh.vertices, np.float32)
            triangles = np.ascontiguousarray(sample.mesh.faces, np.int32)
            vertices.write(points.data)
            faces.write(triangles.data)
            labels.append(sample.eigenvalues)
            isometries.append(sample.isometries)
            row = (
                sample.spec.id,
                sample.spec.family,
                sample.split,
                list(sample.paper_splits),
                len(sample.mesh.vertices),
                len(sample.mesh.faces),
                _digest(points, triangles),
            )
            for column, value in zip(columns.values(), row, strict=True):
                column.append(value)
    np.save(to / "y.npy", np.array(labels, np.float32), allow_pickle=False)
    np.save(to / "isometries.npy", np.array(isometries, np.float32), allow_pickle=False)
    pq.write_table(pa.table(columns), to / TABLE)


def _digest(vertices: NDArray[np.float32], faces: Int32s) -> bytes:
    """Return the SHA-256 of a mesh as it is unpacked."""
    state = hashlib.sha256(vertices.data)
    state.update(faces.data)
    return state.digest()


def _write_header(file: IO[bytes], rows: int, dtype: np.dtype[Any]) -> None:
    descr = np.lib.format.dtype_to_descr(dtype)
    header = {"descr": descr, "fortran_order": False, "shape": (rows, 3)}
    np.lib.format.write_array_header_1_0(file, header)


def _offsets(lengths: NDArray[np.integer[Any]]) -> Int64s:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
