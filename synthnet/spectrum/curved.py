r"""Quadratic and linear elements on triangles bent to the surface that a mesh samples.

Flat triangles cut the corners of a curved surface. Their area and their distances are off by terms
of order :math:`h^2`, as large as the error of linear elements: no element on them can be better.
On the patches of :mod:`synthnet.spectrum.bending` quadratic elements are isoparametric; where the
triangles around each vertex are nearly symmetric, errors of order :math:`h^4` are observed, as on
regular meshes of spheres. Elsewhere normals are off by terms of order h, except on spheres, and the
order may be two again, with a smaller constant. On straight patches they are the quadratic elements
of the flat triangles.

References
----------
G. Dziuk, "Finite elements for the Beltrami operator on arbitrary surfaces", LNM 1357 (1988). A.
Demlow, "Higher-order finite element methods and pointwise error estimates for elliptic problems on
surfaces", SIAM J. Numer. Anal. 47 (2009): why the surface's own approximation limits the order.
"""

import numpy as np

from synthnet.arrays import Booleans, Floats, Int32s
from synthnet.kernels import kernel, part
from synthnet.spectrum import fem
from synthnet.spectrum.bending import Patches, cross, dot
from synthnet.spectrum.fem import Matrices, products

FLATTEST = 0.3  # of the flat triangle's area, seen from above: a patch with less at a point folds

# Points in a triangle and weights for polynomials of degree four (Dunavant 1985).
_NEAR, _FAR = 0.091576213509770743, 0.44594849091596489
CORNERS = np.array(
    [(1 - 2 * a, a, a) for a in (_NEAR, _FAR)]
    + [(a, 1 - 2 * a, a) for a in (_NEAR, _FAR)]
    + [(a, a, 1 - 2 * a) for a in (_NEAR, _FAR)]
)
WEIGHTS = np.tile([0.10995174365532187, 0.22338158967801147], 3) / 2
SLOPES = np.array([(-1.0, -1.0), (1.0, 0.0), (0.0, 1.0)])  # of the three barycentric coordinates
SIDES = np.array([(0, 1), (1, 2), (2, 0)])
# Least eigenvalue of M⁻¹B on a triangle in Bernstein's form, where the density is constant
QUADRATIC = 1 / 15


def quadratic(patches: Patches) -> Matrices:
    r"""Assemble quadratic elements on patches: vertices are the first unknowns, then edges.

    The functions are :math:`s \lambda_i \lambda_j`, s = 1 for a corner (i = j) and 2 for an edge,
    which is Bernstein's form: a corner's unknown is the value there, and the constant 1 is the
    vector of ones.
    The mass matrix is at least as much of its lumped one as on flat triangles, times the least
    ratio of a patch's density, its area by the flat one's, at two points of the quadrature.

    Parameters
    ----------
    patches : Patches
        Of n vertices and e edges. A patch that would fold over is made flat.

    Returns
    -------
    Matrices
        Of n + e unknowns; the mass is in length², the stiffness has no unit.
    """
    stiffness, mass, ratio = _blocks(patches, *_bernstein())
    unknowns = len(patches.vertices) + len(patches.ends)
    numbers = np.concatenate([patches.faces, len(patches.vertices) + patches.sides], axis=1)
    return fem.gathered(numbers, stiffness, mass, unknowns, QUADRATIC * ratio)


def hierarchical(patches: Patches) -> tuple[Matrices, Floats, Floats]:
    """Assemble linear elements on patches, and the patches' own matrices with functions of edges.

    Parameters
    ----------
    patches : Patches
        Of n vertices and m faces. A patch that would fold over is made flat.

    Returns
    -------
    linear : Matrices
        Of the n vertices.
    stiffness, mass : ndarray of shape (m, 6, 6), float64
        Of each patch: of its corners' functions λᵢ, then of its sides' 2 λᵢ λⱼ. The mass is in
        length², the stiffness has no unit.
    """
    functions, slopes = _bernstein()
    functions[:, :3], slopes[:, :3] = CORNERS, SLOPES
    stiffness, mass, ratio = _blocks(patches, functions, slopes)
    indptr, indices = fem.pattern(patches.faces, len(patches.vertices))
    stiff, heavy = _summed(patches.faces, indptr, indices, stiffness, mass)
    lumped = np.add.reduceat(heavy, indptr[:-1])
    return Matrices(indptr, indices, stiff, heavy, lumped, ratio / 4), stiffness, mass


def _bernstein() -> tuple[Floats, Floats]:
    """Return λᵢ² and 2 λᵢ λⱼ at the points, (q, 6), and their slopes, (q, 6, 2)."""
    i, j = SIDES.T
    functions = np.concatenate([CORNERS**2, 2 * CORNERS[:, i] * CORNERS[:, j]], axis=1)
    at_corners = 2 * CORNERS[:, :, None] * SLOPES
    on_sides = 2 * (CORNERS[:, i, None] * SLOPES[j] + CORNERS[:, j, None] * SLOPES[i])
    return functions, np.concatenate([at_corners, on_sides], axis=1)


def _blocks(patches: Patches, functions: Floats, slopes: Floats) -> tuple[Floats, Floats, float]:
    """Return each patch's matrices of six functions, and the least ratio of a patch's densities."""
    m, points = len(patches.faces), len(WEIGHTS)
    scales, areas = np.empty((m, 3, points)), np.empty((m, points))
    while True:
        folded, ratio = _densities(patches, CORNERS, WEIGHTS, scales, areas)
        if not patches.rises[patches.sides[folded]].any():  # what is flat cannot fold
            break
        patches.rises[patches.sides[folded]] = 0.0
    u, v = np.moveaxis(slopes, 2, 0)
    energies = np.concatenate([products(u, u), products(u, v) + products(v, u), products(v, v)])
    stiffness = scales.reshape(m, -1) @ energies
    mass = areas @ products(functions, functions)
    return stiffness.reshape(m, 6, 6), mass.reshape(m, 6, 6), ratio


@part
def _tangents(
    vertices: Floats, face: Int32s, side: Int32s, rises: Floats, at: Floats, u: Floats, v: Floats
) -> None:
    """Set u and v to a patch's derivatives along two of its sides, at a point in its corners."""
    l0, l1, l2 = at
    for x in range(3):
        r0, r1, r2 = rises[side[0], x], rises[side[1], x], rises[side[2], x]
        corner = vertices[face[0], x]
        u[x] = vertices[face[1], x] - corner + 4 * ((l0 - l1) * r0 + l2 * r1 - l2 * r2)
        v[x] = vertices[face[2], x] - corner + 4 * (-l1 * r0 + l1 * r1 + (l0 - l2) * r2)


@kernel
def _densities(
    patches: Patches, corners: Floats, weights: Floats, scales: Floats, areas: Floats
) -> tuple[Booleans, float]:
    """Fill in areas at the points, (m, q), and what the metric makes of slopes, (m, 3, q).

    Return which patches have too little area somewhere, as seen from above their flat triangle, and
    the least ratio of a patch's densities.
    """
    vertices, faces, sides, rises = patches.vertices, patches.faces, patches.sides, patches.rises
    folded = np.zeros(faces.shape[0], np.bool_)
    straight, none = np.zeros((1, 3)), np.zeros(3, np.int32)
    u, v, normal, flat = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    ratio = 1.0
    for f in range(faces.shape[0]):
        _tangents(vertices, faces[f], none, straight, corners[0], u, v)
        cross(u, v, flat)
        square = dot(flat, flat)
        upright, least, most = np.inf, np.inf, 0.0
        for q in range(corners.shape[0]):
            _tangents(vertices, faces[f], sides[f], rises, corners[q], u, v)
            cross(u, v, normal)
            upright = min(upright, dot(normal, flat))
            density = np.sqrt(dot(normal, normal))  # on needles, the metric's root would cancel
            least, most = min(least, density), max(most, density)
            scale = weights[q] / density
            scales[f, 0, q] = dot(v, v) * scale
            scales[f, 1, q] = -dot(u, v) * scale
            scales[f, 2, q] = dot(u, u) * scale
            areas[f, q] = weights[q] * density
        folded[f] = upright < FLATTEST * square
        ratio = min(ratio, least / most)
    return folded, ratio


@kernel
def _summed(
    faces: Int32s, indptr: Int32s, indices: Int32s, stiffness: Floats, mass: Floats
) -> tuple[Floats, Floats]:
    """Return the values of the mesh's matrices: sums of the corners' parts of the patches'."""
    stiff, heavy = np.zeros(indices.shape[0]), np.zeros(indices.shape[0])
    for f in range(faces.shape[0]):
        for c in range(3):
            row = faces[f, c]
            for d in range(3):
                p = fem.index(indices, indptr[row], indptr[row + 1], faces[f, d])
                stiff[p] += stiffness[f, c, d]
                heavy[p] += mass[f, c, d]
    return stiff, heavy
