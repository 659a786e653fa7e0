"""Spectra of surfaces by scikit-fem and SciPy: a second method, to check the limits by.

It shares the charts and the triangulation in their domain with :mod:`synthnet.families.elements`;
shape functions, quadrature, assembly, metric and eigensolver are others. A triangle's coordinates
are those of the unit triangle, and the metric of the surface over it is found by differences.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import skfem
from scipy.sparse.linalg import eigsh
from skfem import BilinearForm
from skfem.helpers import grad

from synthnet.arrays import Floats
from synthnet.families.atlas import Atlas, Charted
from synthnet.families.limits import Limit
from synthnet.families.surface_limits import ELEMENTS, layers_at, triangulation

ORDER = 4  # of an eigenvalue's error in the length of the edges
AT_CORNERS = 2  # the same where the smallest elements at a corner have the say
STEP = 1e-5  # of the differences, in units of a triangle
LEAST, MOST = 2500, 60_000  # triangles of the first mesh, and of the last
DEGREE = 8  # that the quadrature is exact for


def limit(atlas: Atlas, k: int, close: float = 1e-5) -> Limit:
    """Return the first k eigenvalues after zero by quadratic elements, extrapolated.

    Edges are halved until the extrapolation changes no eigenvalue by more than ``close``, or the
    next mesh would have more than :data:`MOST` triangles. The bar is twice that last change, since
    the meshes are not yet so fine that their order shows; more where there are corners with layers,
    whose smallest elements have a lower one.

    Parameters
    ----------
    atlas : Atlas
        Smooth on each patch.
    k : int
        Number of eigenvalues.
    close : float
        Relative.
    """
    n = max(2, round(math.sqrt(ELEMENTS / len(atlas.charts))))
    layers = layers_at(atlas)
    macro = triangulation(atlas, n, layers)
    cut = replace(atlas, corners=macro.corners, charts=macro.charts, singular=None)
    steps = max(1, round(math.sqrt(LEAST / len(macro.faces))))
    coarse = of_mesh(cut, cut.uniform(steps), k)
    while True:
        steps *= 2
        fine = of_mesh(cut, cut.uniform(steps), k)
        change = (fine - coarse) / (2**ORDER - 1)
        small = (np.abs(change) <= close * fine).all()
        if small or len(macro.faces) * (2 * steps) ** 2 > MOST:
            cornered = np.abs(fine - coarse) / (2**AT_CORNERS - 1)
            return Limit(fine + change, cornered if layers.any() else 2 * np.abs(change))
        coarse = fine


def of_mesh(atlas: Atlas, charted: Charted, k: int) -> Floats:
    """Return the first k eigenvalues after zero of a triangulation of a surface."""
    unit = np.tile([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], len(charted.faces))
    mesh = skfem.MeshTri1DG(unit, np.ascontiguousarray(charted.faces.T))
    basis = skfem.Basis(mesh, skfem.ElementTriP2(), intorder=DEGREE)
    g11, g12, g22 = metric(atlas, charted, np.asarray(basis.global_coordinates()))
    area = np.sqrt(g11 * g22 - g12**2)

    @BilinearForm
    def stiffness(u, v, w):
        (a, b), (c, d) = grad(u), grad(v)
        return (w.g22 * a * c - w.g12 * (a * d + b * c) + w.g11 * b * d) / w.area

    @BilinearForm
    def mass(u, v, w):
        return w.area * u * v

    fields = {"g11": g11, "g12": g12, "g22": g22, "area": area}
    energy, inertia = (form.assemble(basis, **fields) for form in (stiffness, mass))
    scale = 4 * np.pi / inertia.sum()  # Weyl's law: about one eigenvalue
    values = eigsh(energy, k + 1, inertia, sigma=-scale / 10, return_eigenvectors=False)
    return np.sort(values)[1:]


def metric(atlas: Atlas, charted: Charted, points: Floats) -> tuple[Floats, Floats, Floats]:
    """Return the metric g11, g12, g22 at points of the unit triangle, shape (2, m, q) to (m, q)."""

    def image(shift: Floats) -> Floats:
        s, t = points + shift[:, None, None]
        inside = np.stack([1 - s - t, s, t], axis=2) @ charted.corners
        charts = np.repeat(charted.charts, points.shape[2])
        return atlas.chart(charts, inside.reshape(-1, inside.shape[2])).reshape(*s.shape, 3)

    first, second = (
        (image(STEP * along) - image(-STEP * along)) / (2 * STEP) for along in np.eye(2)
    )
    pairs = ((first, first), (first, second), (second, second))
    g11, g12, g22 = ((a * b).sum(axis=2) for a, b in pairs)
    return g11, g12, g22
