"""Linear finite elements on a triangle mesh: the pattern and the values of the matrices."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from synthnet.arrays import Booleans, Floats, Int32s
from synthnet.kernels import kernel
from synthnet.spectrum.inputs import check
from synthnet.types import Mesh

FEW, FINE = 24, 200_000  # functions, and entries of each, up to which products are taken at once
PIECE = 1024  # entries, or triangles, that are taken at a time beyond
FLAT = 1e-15  # a triangle's area relative to its longest edge's square that is rounding alone
REMEDY = "remove them first, as spectrum.compute(mesh, repair=True) does"


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
        Row sums of B, rows and columns of unknowns that are held at zero included.
    least : float
        B is at least so much of the diagonal matrix M of these sums: xᵀBx ≥ least · xᵀMx. For
        linear elements and consistent mass it is a quarter (Wathen).
    anchored : ndarray of shape (n,), bool, or None
        Rows that were next to an unknown that is held at zero and left out. None if there is none.
    """

    indptr: Int32s
    indices: Int32s
    stiffness: Floats
    mass: Floats
    lumped: Floats
    least: float = 0.25
    anchored: Booleans | None = None

    @property
    def zeros(self) -> int:
        """Zero eigenvalues of one component: 1, its constants, unless it is held somewhere."""
        return int(self.anchored is None or not self.anchored.any())


def check_used(mesh: Mesh) -> None:
    """Check a mesh as :func:`synthnet.spectrum.check` does, and that every vertex has a triangle.

    Raises
    ------
    ValueError
        If there is anything wrong with it.
    """
    check(mesh)
    unused = len(mesh.vertices) - np.count_nonzero(np.bincount(mesh.faces.ravel()))
    if unused:
        raise ValueError(f"{unused} vertices belong to no triangle: {REMEDY}")


def products(first: Floats, second: Floats) -> Floats:
    """Return the products of two functions at q points, shape (q, b²), from (q, b) of each."""
    return (first[:, :, None] * second[:, None, :]).reshape(len(first), -1)


def gathered(
    numbers: NDArray[np.integer], stiffness: Floats, mass: Floats, size: int, least: float = 0.25
) -> Matrices:
    """Add up the matrices of single triangles.

    Parameters
    ----------
    numbers : ndarray of shape (m, f), int
        Unknowns of each triangle, from 0 to ``size - 1``.
    stiffness, mass : ndarray of m f² float64
        A block f × f of each triangle, one after the other.
    size : int
        Unknowns.
    least : float
        As of :class:`Matrices`.
    """
    functions = numbers.shape[1]
    rows = np.repeat(numbers, functions, axis=1).ravel()
    columns = np.tile(numbers, functions).ravel()
    stiff, heavy = (
        sparse.coo_array((blocks.ravel(), (rows, columns)), shape=(size, size)).tocsr()
        for blocks in (stiffness, mass)
    )
    stiff.sort_indices()
    heavy.sort_indices()
    return Matrices(
        stiff.indptr.astype(np.int32),
        stiff.indices.astype(np.int32),
        stiff.data,
        heavy.data,
        np.asarray(heavy.sum(axis=1)),
        least=least,
    )


def assemble(vertices: Floats, faces: Int32s) -> Matrices:
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
    if flat := max(flat, flat_triangles(vertices, faces)):
        raise ValueError(f"{flat} of {len(faces)} faces have no area: {REMEDY}")
    lumped = np.add.reduceat(mass, indptr[:-1])
    return Matrices(indptr, indices, stiffness, mass, lumped)


def as_arrays(mesh: Mesh) -> tuple[Floats, Int32s]:
    """Return the vertices and faces of a mesh as kernels take them."""
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    return vertices, np.ascontiguousarray(mesh.faces, dtype=np.int32)


@kernel
def grouped(home: Int32s, count: int) -> tuple[Int32s, Int32s]:
    """Sort numbers 0, 1, ... by their group; return where each group begins, and the numbers.

    By the vertices ``faces.ravel()`` of m faces, these are the corners 3 f + c at each vertex.
    """
    start = np.zeros(count + 1, np.int32)
    for i in range(home.shape[0]):
        start[home[i] + 1] += 1
    for k in range(count):
        start[k + 1] += start[k]
    members = np.empty(home.shape[0], np.int32)
    fill = start[:-1].copy()
    for i in range(home.shape[0]):
        members[fill[home[i]]] = i
        fill[home[i]] += 1
    return start, members


@kernel
def pattern(faces: Int32s, n: int) -> tuple[Int32s, Int32s]:
    """Return ``indptr`` and ``indices``: each vertex with itself and its neighbours, sorted."""
    start, corners = grouped(faces.ravel(), n)
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
                j = faces[corners[p] // 3, c]
                if seen[j] != i:
                    seen[j] = i
                    indices[count] = j
                    count += 1
        sort(indices[first:count])
        indptr[i + 1] = count
    return indptr, indices[:count].copy()


@kernel
def sort(numbers: Int32s) -> None:
    """Sort a few numbers, or many, in place."""
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
def index(numbers: Int32s, low: int, high: int, number: int) -> int:
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
def flat_triangles(vertices: Floats, faces: Int32s) -> int:
    """Return how many triangles have an area of zero, but for rounding.

    Fused products leave a rounding error where two corners are one point. This stands apart from
    :func:`_add_triangles` because one more sum there rounds every label differently.
    """
    flat = 0
    for t in range(len(faces)):
        a, b, c = vertices[faces[t, 0]], vertices[faces[t, 1]], vertices[faces[t, 2]]
        ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        wx, wy, wz = c[0] - b[0], c[1] - b[1], c[2] - b[2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        longest = max(ux**2 + uy**2 + uz**2, vx**2 + vy**2 + vz**2, wx**2 + wy**2 + wz**2)
        if not 0.5 * np.sqrt(x * x + y * y + z * z) > FLAT * longest:
            flat += 1
    return flat


@kernel
def _add_triangles(
    vertices: Floats,
    faces: Int32s,
    indptr: Int32s,
    indices: Int32s,
    stiffness: Floats,
    mass: Floats,
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
                p = index(indices, indptr[row], indptr[row + 1], faces[f, d])
                stiffness[p] += local[c, d]
                mass[p] += area / 6 if c == d else area / 12
    return flat


def pieces(entries: int) -> list[slice]:
    """Return parts of all entries, each small enough for the cache."""
    return [slice(first, first + PIECE) for first in range(0, entries, PIECE)]


def multiply(matrices: Matrices, values: Floats, rows: Floats) -> Floats:
    """Return the products of vectors, the rows of a (c, n) array, with A or B by its values."""
    even = np.ascontiguousarray(rows if len(rows) % 2 == 0 else np.vstack([rows, rows[-1]]))
    product = np.empty_like(even)
    for i in range(0, len(even), 2):
        multiply_two(matrices.indptr, matrices.indices, values, even[i : i + 2], product[i : i + 2])
    return product[: len(rows)]


@kernel
def multiply_two(indptr: Int32s, indices: Int32s, values: Floats, x: Floats, y: Floats) -> None:
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
