r"""Numbers of a closed surface for learning on top of Rayleigh-Ritz values.

Scale-free, and unchanged by every isometry of space: the Ritz values of all polynomials of degree
at most four (a space that no rotation changes), moments, the enclosed volume, and how coarse the
triangles are.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from synthnet import Mesh
from synthnet.kernels import kernel

DEGREE = 4
VALUES, CORRECTED = 16, 10  # Ritz values that are features, and how many are corrected
TINY = 1e-6  # at area 1: below it a moment or a distance is as good as zero
DEPENDENT = 1e-11  # of the Gram matrix, below which polynomials agree on the surface


@kernel
def legendre(x, scales, degree, basis):  # type: ignore[no-untyped-def]
    """Write the products of Legendre polynomials up to a total degree, one row a vertex."""
    rise, fall = np.empty(degree + 1), np.empty(degree + 1)
    for k in range(2, degree + 1):
        rise[k], fall[k] = (2 * k - 1) / k, (k - 1) / k
    tables = np.empty((3, degree + 1))
    for v in range(x.shape[0]):
        for c in range(3):
            t = x[v, c] * scales[c]
            tables[c, 0] = 1.0
            tables[c, 1] = t
            for k in range(2, degree + 1):
                tables[c, k] = rise[k] * t * tables[c, k - 1] - fall[k] * tables[c, k - 2]
        column = 0
        for i in range(degree + 1):
            for j in range(degree + 1 - i):
                both = tables[0, i] * tables[1, j]
                for k in range(degree + 1 - i - j):
                    basis[v, column] = both * tables[2, k]
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
    """Return the Ritz values after zero, ascending, in 1/length².

    ``x`` are the vertices, shape (n, 3), float64, centred and in principal axes.
    """
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
    area, first = 0.0, np.zeros(3)
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for f in range(faces.shape[0]):
        i, j, k = faces[f]
        # Scalars: Numba keeps them in registers, small arrays take three times as long
        ax, ay, az = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        bx, by, bz = vertices[j, 0], vertices[j, 1], vertices[j, 2]
        cx, cy, cz = vertices[k, 0], vertices[k, 1], vertices[k, 2]
        ux, uy, uz, wx, wy, wz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        a = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
        sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
        area += a
        first[0] += a * sx
        first[1] += a * sy
        first[2] += a * sz
        xx += a * (ax * ax + bx * bx + cx * cx + sx * sx)
        yy += a * (ay * ay + by * by + cy * cy + sy * sy)
        zz += a * (az * az + bz * bz + cz * cz + sz * sz)
        xy += a * (ax * ay + bx * by + cx * cy + sx * sy)
        xz += a * (ax * az + bx * bz + cx * cz + sx * sz)
        yz += a * (ay * az + by * bz + cy * cz + sy * sz)
    centroid = first / (3 * area)
    second = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))) / 12
    return area, centroid, second - area * np.outer(centroid, centroid)


@kernel
def higher(x, faces):  # type: ignore[no-untyped-def]
    """Return the volume, ∫|x|⁴, ∫|x|⁶, and means of squared edges, of a surface of area 1."""
    volume, fourth, sixth, longest, shortest, squares = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for f in range(faces.shape[0]):
        i, j, k = faces[f]
        ax, ay, az = x[i, 0], x[i, 1], x[i, 2]
        ux, uy, uz = x[j, 0] - ax, x[j, 1] - ay, x[j, 2] - az
        wx, wy, wz = x[k, 0] - ax, x[k, 1] - ay, x[k, 2] - az
        mx, my, mz = ax + (ux + wx) / 3, ay + (uy + wy) / 3, az + (uz + wz) / 3
        uu = ux * ux + uy * uy + uz * uz
        ww = wx * wx + wy * wy + wz * wz
        uw = ux * wx + uy * wy + uz * wz
        r = mx * mx + my * my + mz * mz
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        a = 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
        volume += (ax * nx + ay * ny + az * nz) / 6
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
        If the mesh has no faces or area, or polynomials have fewer than ten values on it.
    """
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    if not len(faces):
        raise ValueError("the mesh has no faces")
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
