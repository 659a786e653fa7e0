r"""Laplace-Beltrami eigenvalues of any surface given by charts, each with an error bar.

Finite elements of high degree on the atlas itself: on smooth patches their error falls
exponentially with the degree. At a corner with the angle ω around it, eigenfunctions behave like
:math:`r^\alpha`, :math:`\alpha = 2\pi/\omega`, or :math:`\pi/\omega` on a boundary, so elements
shrink geometrically towards it, in more layers the smaller α is, unless α is an integer; two layers
are enough where the chart alone has a kink in a point, as at the centre of polar coordinates.

Two degrees on one triangulation, 6 and 8, give the bar: the difference of their eigenvalues, by
index in the complete ascending spectra. Where functions are smooth, the error of the higher degree
is a small part of that difference. What a singularity leaves in the smallest element falls like
:math:`p^{-4\alpha}`: it is below the difference for :math:`\alpha \geq 2/3`, and all corners of the
families have such an α. Measured against finer spectra, errors are below a quarter of the bars.

References
----------
C. Schwab, p- and hp-Finite Element Methods, Oxford 1998, chapters 3 and 4. V. A. Kondrat'ev,
"Boundary problems for elliptic equations in domains with conical or angular points", Trans. Moscow
Math. Soc. 16 (1967): the exponents.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.errors import SpectrumError
from synthnet.families.atlas import Atlas, Charted
from synthnet.families.elements import assemble
from synthnet.families.limits import Limit
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ordering import Ordering, find_ordering
from synthnet.spectrum.search import Setting, search
from synthnet.spectrum.solve import NORMAL, STRONGER

SHRINK = 0.2  # each layer towards a corner is so much thinner than the last
LEFT = 1e-5  # so much of a singularity the smallest element leaves
LAYERS = 8  # there are no more
KINKED = 2  # layers where the chart has a kink in a point, at least
ELEMENTS = 60  # about so many there are before layers
DEGREES = (6, 8)
TARGET = 2e-5  # relative: a bar should be below
SHARE = 0.1  # of the largest relative bar of a spectrum: no other bar is smaller
MOST = 150_000  # coefficients
ROUNDING = 1e-7  # relative error that no bar is below
# The second where rounding keeps the first from an answer
SETTINGS = (
    replace(NORMAL, residual=1e-6, excused=1e-5),
    replace(STRONGER, residual=1e-6, excused=1e-3),
)


def limit(atlas: Atlas, k: int) -> Limit:
    """Return the first k eigenvalues of a surface after zero, each with its bar.

    The triangulation gets finer until every bar is below :data:`TARGET`, or a finer one would have
    more than :data:`MOST` coefficients, or too small elements for the solver: the bars say what was
    reached.

    Parameters
    ----------
    atlas : Atlas
        Smooth on each patch.
    k : int
        Number of eigenvalues.

    Raises
    ------
    ValueError
        If images of patches do not meet, or a patch has no area.
    SpectrumError
        If the eigenvalues of the first triangulation cannot be found and counted.
    """
    layers = layers_at(atlas)
    least = 1 if (np.count_nonzero(layers[atlas.glued()], axis=1) <= 1).all() else 2
    n = max(least, round(math.sqrt(ELEMENTS / len(atlas.charts))))
    best: Limit | None = None
    while True:
        mesh = triangulation(atlas, n, layers)
        try:
            coarse, fine = (spectrum(atlas, mesh, degree, k) for degree in DEGREES)
        except SpectrumError:
            if best is None:
                raise
            return best  # elements so fine that rounding has the say: its bar must do
        apart = np.abs(coarse / fine - 1)
        # One difference may be small by chance.
        best = Limit(fine, fine * (np.maximum(apart, SHARE * apart.max()) + ROUNDING))
        finest = math.floor(math.sqrt(2 * MOST / len(atlas.charts)) / DEGREES[1])
        if apart.max() <= TARGET or n >= finest:
            return best
        # Where functions are smooth, what the lower degree leaves falls like n^(-2p).
        ahead = math.ceil(n * (apart.max() / TARGET) ** (1 / (2 * DEGREES[0])))
        n = min(max(n + 1, ahead), finest)


def layers_at(atlas: Atlas) -> Int64s:
    """Return how many layers of elements each vertex of the atlas needs, shape (n,)."""
    glued = atlas.glued()
    angles, kinks = _corners(atlas)
    n = int(glued.max()) + 1
    total = np.bincount(glued.ravel(), angles.ravel(), n)
    kinked = np.bincount(glued.ravel(), kinks.ravel(), n) > 0
    edges, of_side = Charted(glued, atlas.corners, atlas.charts).edges()
    outside = edges[np.bincount(of_side.ravel()) == 1]
    whole = np.full(n, 2 * np.pi)
    whole[outside.ravel()] = np.pi
    exponent = whole / total
    smooth = np.abs(exponent - np.round(exponent)) < 1e-3
    layers = np.minimum(np.ceil(np.log(LEFT) / (2 * exponent * np.log(SHRINK))), LAYERS)
    layers[smooth] = 0
    layers[kinked] = np.maximum(layers, KINKED)[kinked]
    return np.asarray(layers, dtype=np.int64)


def _corners(atlas: Atlas) -> tuple[Floats, Booleans]:
    """Return each patch corner's angle on the surface, and whether the chart has a kink there."""
    near, rays = 1e-4, 9
    t = np.linspace(0, 1, rays)
    angles = np.zeros((*atlas.charts.shape, 3))
    kinks = np.zeros(angles.shape, dtype=np.bool_)
    for corner in range(3):
        at, first, second = (atlas.corners[:, (corner + i) % 3, None] for i in range(3))
        directions = (1 - t)[:, None] * (first - at) + t[:, None] * (second - at)
        ends = np.concatenate([at, at + near * directions], axis=1)
        points = atlas.chart(np.repeat(atlas.charts, rays + 1), ends.reshape(-1, ends.shape[2]))
        points = points.reshape(len(ends), rays + 1, 3)
        rates = (points[:, 1:] - points[:, :1]) / near
        units = rates / np.linalg.norm(rates, axis=2, keepdims=True)
        cosines = (units[:, 1:] * units[:, :-1]).sum(axis=2)
        sines = np.linalg.norm(np.cross(units[:, 1:], units[:, :-1]), axis=2)
        angles[:, corner] = np.arctan2(sines, cosines).sum(axis=1)
        linear = (1 - t)[:, None] * rates[:, :1] + t[:, None] * rates[:, -1:]
        apart = np.linalg.norm(rates - linear, axis=2).max(axis=1)
        kinks[:, corner] = apart > 0.01 * np.linalg.norm(rates, axis=2).max(axis=1)
    return angles, kinks


def triangulation(atlas: Atlas, n: int, layers: Int64s) -> Charted:
    """Cut every patch into n² triangles, and those at corners into layers.

    Parameters
    ----------
    atlas : Atlas
        The surface.
    n : int
        At least 2 if a patch has two corners with layers: then none of its triangles has two.
    layers : ndarray of shape (v,), int64
        Of each vertex of the atlas, as :func:`layers_at` says.
    """
    mesh = atlas.uniform(n)
    of_vertex = np.zeros(mesh.n_vertices, dtype=np.int64)
    of_vertex[: len(layers)] = layers  # uniform numbers the atlas's vertices first
    return layered(mesh, of_vertex)


def layered(mesh: Charted, layers: Int64s) -> Charted:
    """Cut each triangle towards its corner into as many layers as that vertex wants."""
    here = layers[mesh.faces]
    most = int(layers.max(initial=0))
    plain = (here == 0).all(axis=1)
    parts = [(mesh.faces[plain], mesh.corners[plain], mesh.charts[plain])]
    for corner in range(3):
        for count in range(1, most + 1):
            chosen = np.flatnonzero(here[:, corner] == count)
            parts.extend(_cut(mesh, chosen, corner, count, most))
    faces, corners, charts = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    _, numbers = np.unique(faces, return_inverse=True)
    return Charted(numbers.reshape(-1, 3), corners, charts)


def _cut(
    mesh: Charted, chosen: Int64s, corner: int, count: int, most: int
) -> Iterator[tuple[Int64s, Floats, Int64s]]:
    """Cut chosen triangles into layers; point i of edge e is vertex n + e · most + i."""
    _, of_side = mesh.edges()
    left, right = (corner + 1) % 3, (corner + 2) % 3
    tip = mesh.corners[chosen, corner]
    numbers, places = [], []
    for far, side in ((left, corner), (right, right)):
        new = mesh.n_vertices + of_side[chosen, side][:, None] * most + np.arange(count)
        shares = SHRINK ** np.arange(count + 1)[:, None]
        numbers.append(np.concatenate([mesh.faces[chosen, far][:, None], new], axis=1))
        places.append(tip[:, None] + shares * (mesh.corners[chosen, far] - tip)[:, None])
    ends = mesh.faces[chosen, corner][:, None], tip[:, None]
    # The columns are the left side, the right side and the corner itself.
    number = np.concatenate([*numbers, ends[0]], axis=1)
    points = np.concatenate([*places, ends[1]], axis=1)
    behind = count + 1
    for i in range(count):
        for three in ([i, behind + i, i + 1], [behind + i, behind + i + 1, i + 1]):
            yield number[:, three], points[:, three], mesh.charts[chosen]
    last = [2 * behind, count, behind + count]
    yield number[:, last], points[:, last], mesh.charts[chosen]


def spectrum(atlas: Atlas, mesh: Charted, degree: int, k: int) -> Floats:
    """Return the first k eigenvalues after zero in the elements' space, counted by inertia."""
    matrices = assemble(atlas, mesh, degree)
    ordering = find_ordering(matrices.indptr, matrices.indices)
    try:
        return _counted(matrices, ordering, k, SETTINGS[0])
    except SpectrumError:
        return _counted(matrices, ordering, k, SETTINGS[1])


def _counted(matrices: Matrices, ordering: Ordering, k: int, setting: Setting) -> Floats:
    candidate, counted = search(matrices, ordering, k, setting)
    if counted.negative != len(candidate.values) + 1:
        raise SpectrumError(
            f"{counted.negative} eigenvalues are below {candidate.middle:g}, "
            f"but {len(candidate.values) + 1} were found"
        )
    return candidate.values[:k]
