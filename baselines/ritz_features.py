r"""Numbers of a closed surface for learning on top of Rayleigh-Ritz values.

Scale-free, and unchanged by every isometry of space: the Ritz values of all polynomials of degree
at most four (a space that no rotation changes), moments, the enclosed volume, and how coarse the
triangles are.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from synthnet import Mesh
from synthnet.solver.compiled import kernel

DEGREE = 4
VALUES, CORRECTED = 16, 10  # Ritz values that are features, and how many are corrected
TINY = 1e-6  # at area 1: below it a moment or a distance is as good as zero
DEPENDENT = 1e-11  # of the Gram matrix, below which polynomials agree on the surface


@kernel
def legendre(x, scales, degree, basis):  # type: ignore[no-untyped-def]
    """Write the products of Legendre polynomials up to a total degree, one row a vertex."""
    tables = np.empty((3, degree + 1))
    for v in range(x.shape[0]):
        for c in range(3):
            t = x[v, c] * scales[c]
            tables[c, 0] = 1.0
            tables[c, 1] = t
            for k in range(2, degree + 1):
                tables[c, k] = ((2 * k - 1) * t * tables[c, k - 1] - (k - 1) * tables[c, k - 2]) / k
        column = 0
        for i in range(degree + 1):
            for j in range(degree + 1 - i):
                for k in range(degree + 1 - i - j):
                    basis[v, column] = tables[0, i] * tables[1, j] * tables[2, k]
                    column += 1


@kernel
def products(x, faces, basis, a, b):  # type: ignore[no-untyped-def]
    """Add A V and B V to a and b, triangle by triangle; A and B are those of the label."""
    u, w = np.empty(3), np.empty(3)
    for f in range(faces.shape[0]):
        i, j, k = faces[f]
        uu, ww, uw = 0.0, 0.0, 0.0
        for c in range(3):
            u[c], w[c] = x[j, c] - x[i, c], x[k, c] - x[i, c]
            uu += u[c] * u[c]
            ww += w[c] * w[c]
            uw += u[c] * w[c]
        doubled = np.sqrt(uu * ww - uw * uw)
        # Half the cotangents, at i, j and k, each opposite the edge of the other two
        half = 0.5 / doubled
        at_i, at_j, at_k = half * uw, half * (uu - uw), half * (ww - uw)
        mass = doubled / 24
        for m in range(basis.shape[1]):
            p, q, r = basis[i, m], basis[j, m], basis[k, m]
            qr, pr, pq = at_i * (q - r), at_j * (p - r), at_k * (p - q)
            a[i, m] += pr + pq
            a[j, m] += qr - pq
            a[k, m] -= qr + pr
            total = p + q + r
            b[i, m] += mass * (total + p)
            b[j, m] += mass * (total + q)
            b[k, m] += mass * (total + r)


def ritz_values(x: np.ndarray, faces: np.ndarray, scales: np.ndarray, degree: int) -> np.ndarray:
    """Return the Ritz values after zero; x is centred and lies in principal axes."""
    terms = (degree + 1) * (degree + 2) * (degree + 3) // 6
    columns = -(-terms // 4) * 4  # a column of zeros costs less than an odd number of them
    basis, a, b = (np.zeros((len(x), columns)) for _ in range(3))
    legendre(x, scales, degree, basis)
    products(x, faces, basis, a, b)
    gram, directions = eigh(basis.T @ b, driver="evd", check_finite=False)
    kept = gram > DEPENDENT * gram[-1]
    frame = directions[:, kept] / np.sqrt(gram[kept])
    return np.linalg.eigvalsh(frame.T @ (basis.T @ a) @ frame)[1:]


@kernel
def surface(vertices, faces):  # type: ignore[no-untyped-def]
    """Return the area, the centroid, and the second moments about it, (3, 3), in length⁴."""
    area, centroid, second = 0.0, np.zeros(3), np.zeros((3, 3))
    total, u, w = np.empty(3), np.empty(3), np.empty(3)
    for f in range(faces.shape[0]):
        i, j, k = faces[f]
        for c in range(3):
            u[c] = vertices[j, c] - vertices[i, c]
            w[c] = vertices[k, c] - vertices[i, c]
            total[c] = vertices[i, c] + vertices[j, c] + vertices[k, c]
        x, y, z = u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]
        a = 0.5 * np.sqrt(x * x + y * y + z * z)
        area += a
        for c in range(3):
            centroid[c] += a * total[c] / 3
            for d in range(3):
                own = vertices[i, c] * vertices[i, d] + vertices[j, c] * vertices[j, d]
                own += vertices[k, c] * vertices[k, d]
                second[c, d] += a * (own + total[c] * total[d]) / 12
    centroid /= area
    for c in range(3):
        for d in range(3):
            second[c, d] -= area * centroid[c] * centroid[d]
    return area, centroid, second


@kernel
def higher(x, faces):  # type: ignore[no-untyped-def]
    """Return the volume, ∫|x|⁴, ∫|x|⁶, and means of squared edges, of a surface of area 1."""
    volume, fourth, sixth, longest, shortest, squares = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    u, w, centre = np.empty(3), np.empty(3), np.empty(3)
    for f in range(faces.shape[0]):
        i, j, k = faces[f]
        uu, ww, uw, r = 0.0, 0.0, 0.0, 0.0
        for c in range(3):
            u[c], w[c] = x[j, c] - x[i, c], x[k, c] - x[i, c]
            centre[c] = (x[i, c] + x[j, c] + x[k, c]) / 3
            uu += u[c] * u[c]
            ww += w[c] * w[c]
            uw += u[c] * w[c]
            r += centre[c] * centre[c]
        nx, ny, nz = u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]
        a = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
        volume += (x[i, 0] * nx + x[i, 1] * ny + x[i, 2] * nz) / 6
        fourth += a * r * r
        sixth += a * r * r * r
        third = uu + ww - 2 * uw
        longest += a * max(uu, ww, third)
        shortest += a * min(uu, ww, third)
        squares += a * a
    return abs(volume), fourth, sixth, longest, shortest, squares


NAMES = (
    *(f"log_ritz_{i + 1}" for i in range(VALUES)),
    *(f"log_inertia_{i + 1}" for i in range(3)),
    *("log_volume", "log_fourth_moment", "log_sixth_moment"),
    *("log_longest_edges", "log_shortest_edges", "log_triangle_areas"),
    *("log_farthest", "log_nearest", "log_vertices"),
)


def features(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Return the area in length², and the numbers of :data:`NAMES`, those of the mesh at area 1.

    Inertia are the principal second moments; the moments are of the distance to the centroid,
    whose largest and smallest squares over the vertices are farthest and nearest; edges are
    means of their squares, triangle areas the sum of theirs.

    Raises
    ------
    ValueError
        If the mesh has no area, or polynomials have fewer than ten values on it.
    """
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    area, centroid, second = surface(vertices, faces)
    if not area > 0:
        raise ValueError(f"the mesh has area {area}, it must be positive and finite")
    inertia, axes = np.linalg.eigh(second / area**2)
    x = ((vertices - centroid) / np.sqrt(area)) @ axes
    scales = 1 / np.maximum(np.abs(x).max(axis=0), TINY)
    ritz = ritz_values(x, faces, scales, DEGREE)[:VALUES]
    if len(ritz) < CORRECTED:
        raise ValueError(f"polynomials have {len(ritz)} values on the mesh, {CORRECTED} are needed")
    ritz = np.append(ritz, np.repeat(ritz[-1], VALUES - len(ritz)))  # on the plainest surfaces
    distances = np.einsum("ij,ij->i", x, x)
    others = [*inertia, *higher(x, faces), distances.max(), distances.min(), len(vertices)]
    return area, np.log(np.concatenate([ritz, np.maximum(others, TINY)]))
