"""Linear finite elements on a triangle mesh: the pattern and the values of the matrices."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from synthnet.kernels import kernel


class Matrices(NamedTuple):
    """Stiffness and mass, symmetric, with the same pattern.

    Attributes
    ----------
    indptr : ndarray of shape (n + 1,), int32
        Start of each row in ``indices``.
    indices : ndarray of shape (nnz,), int32
        Columns of each row, ascending, the diagonal among them.
    stiffness, mass : ndarray of shape (nnz,), float64
        Values of A (no unit) and B (length²).
    lumped : ndarray of shape (n,), float64
        Row sums of B.
    """

    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    stiffness: NDArray[np.float64]
    mass: NDArray[np.float64]
    lumped: NDArray[np.float64]


def assemble(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> Matrices:
    """Assemble the matrices of a mesh in which every vertex belongs to a face.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3), float64
        Coordinates.
    faces : ndarray of shape (m, 3), int32
        Corners of the triangles.

    Raises
    ------
    ValueError
        If a face has no area.
    """
    indptr, indices = pattern(faces, len(vertices))
    stiffness, mass = np.zeros(len(indices)), np.zeros(len(indices))
    flat = _add_triangles(vertices, faces, indptr, indices, stiffness, mass)
    if flat:
        raise ValueError(f"{flat} of {len(faces)} faces have no area: remove them first")
    lumped = np.add.reduceat(mass, indptr[:-1])
    return Matrices(indptr, indices, stiffness, mass, lumped)


def with_lumped_mass(matrices: Matrices) -> Matrices:
    """Return the matrices with the lumped mass, a diagonal, in place of B; the pattern stays."""
    rows = np.repeat(np.arange(len(matrices.lumped)), np.diff(matrices.indptr))
    on_diagonal = rows == matrices.indices
    return matrices._replace(mass=np.where(on_diagonal, matrices.lumped[rows], 0.0))


@kernel
def pattern(faces: NDArray[np.int32], n: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return ``indptr`` and ``indices``: each vertex with itself and its neighbours, sorted."""
    start = np.zeros(n + 1, np.int32)
    for f in range(faces.shape[0]):
        for c in range(3):
            start[faces[f, c] + 1] += 1
    for i in range(n):
        start[i + 1] += start[i]
    fill = start[:-1].copy()
    around = np.empty(3 * faces.shape[0], np.int32)  # the faces at each vertex
    for f in range(faces.shape[0]):
        for c in range(3):
            i = faces[f, c]
            around[fill[i]] = f
            fill[i] += 1
    indptr = np.zeros(n + 1, np.int32)
    indices = np.empty(6 * faces.shape[0] + n, np.int32)
    seen = np.full(n, -1, np.int32)
    count = 0
    for i in range(n):
        first = count
        seen[i] = i
        indices[count] = i
        count += 1
        for p in range(start[i], start[i + 1]):
            for c in range(3):
                j = faces[around[p], c]
                if seen[j] != i:
                    seen[j] = i
                    indices[count] = j
                    count += 1
        _sort(indices[first:count])
        indptr[i + 1] = count
    return indptr, indices[:count].copy()


@kernel
def _sort(numbers: NDArray[np.int32]) -> None:
    if numbers.shape[0] > 32:
        numbers.sort()
        return
    for p in range(1, numbers.shape[0]):
        number = numbers[p]
        q = p
        while q > 0 and numbers[q - 1] > number:
            numbers[q] = numbers[q - 1]
            q -= 1
        numbers[q] = number


@kernel
def _index(numbers: NDArray[np.int32], low: int, high: int, number: int) -> int:
    """Return the index of a number in an ascending range of numbers."""
    while high - low > 8:
        middle = (low + high) // 2
        if numbers[middle] <= number:
            low = middle
        else:
            high = middle
    while numbers[low] != number:
        low += 1
    return low


@kernel
def _add_triangles(
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    stiffness: NDArray[np.float64],
    mass: NDArray[np.float64],
) -> int:
    """Add every triangle's part; return how many have an area of zero or NaN."""
    flat = 0
    edges = np.empty((3, 3))  # edge i is opposite corner i
    local = np.empty((3, 3))
    for f in range(faces.shape[0]):
        for c in range(3):
            head, tail = faces[f, (c + 2) % 3], faces[f, (c + 1) % 3]
            for x in range(3):
                edges[c, x] = vertices[head, x] - vertices[tail, x]
        x = edges[0, 1] * edges[1, 2] - edges[0, 2] * edges[1, 1]
        y = edges[0, 2] * edges[1, 0] - edges[0, 0] * edges[1, 2]
        z = edges[0, 0] * edges[1, 1] - edges[0, 1] * edges[1, 0]
        area = 0.5 * np.sqrt(x * x + y * y + z * z)
        if not area > 0:
            flat += 1
        scale = 1 / (4 * area)
        for c in range(3):
            for d in range(3):
                dot = 0.0
                for x in range(3):
                    dot += edges[c, x] * edges[d, x]
                local[c, d] = dot * scale
        for c in range(3):
            row = faces[f, c]
            for d in range(3):
                p = _index(indices, indptr[row], indptr[row + 1], faces[f, d])
                stiffness[p] += local[c, d]
                mass[p] += area / 6 if c == d else area / 12
    return flat


def multiply(
    matrices: Matrices, values: NDArray[np.float64], rows: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the products of vectors, the rows of a (c, n) array, with A or B by its values."""
    even = np.concatenate([rows, rows[len(rows) - len(rows) % 2 :]])
    product = np.empty_like(even)
    for i in range(0, len(even), 2):
        multiply_two(matrices.indptr, matrices.indices, values, even[i : i + 2], product[i : i + 2])
    return product[: len(rows)]


@kernel
def multiply_two(
    indptr: NDArray[np.int32],
    indices: NDArray[np.int32],
    values: NDArray[np.float64],
    x: NDArray[np.float64],
    y: NDArray[np.float64],
) -> None:
    """Set the two rows of y to the products of a matrix and the two rows of x."""
    x0, x1, y0, y1 = x[0], x[1], y[0], y[1]
    for i in range(indptr.shape[0] - 1):
        s0 = 0.0
        s1 = 0.0
        for p in range(indptr[i], indptr[i + 1]):
            j = indices[p]
            s0 += values[p] * x0[j]
            s1 += values[p] * x1[j]
        y0[i] = s0
        y1[i] = s1
