r"""The spectrum of the surface that a mesh samples, from linear elements on bent triangles.

Linear elements on bent triangles (:mod:`synthnet.spectrum.bending`) leave one error of order
:math:`h^2`: between vertices, eigenfunctions are bent, too. It is estimated from the eigenpairs
(θ, u) of linear elements. With the functions :math:`2\lambda_i\lambda_j` of edges, A and B their
matrices beside those of vertices, and C and M their own,

.. math::
    r = \theta B u - A u, \qquad
    \lambda \approx \theta \exp(-r^T (C - \theta M)^{-1} r / \theta),

is what quadratic elements would find, to first order. On patches so large that θ M is not small
against C, it counts as half of C at most. C is as well conditioned as the triangles are well
shaped, so a few steps of conjugate gradients do, more on thin ones: they come near the energy from
below.

First order is enough where edges are short beside waves. Along an edge of length ℓ linear elements
find θ = λ (1 + λ ℓ² / 12). Where that is more than a fifth for the highest eigenvalue wanted, a
mesh may not show a wave, such as one along the triangles of a long tube. There, and where the
energy above is more than a twentieth of an eigenvalue, edges are cut until they add no more than
that (:mod:`synthnet.spectrum.splitting`), and the finer patches are solved anew. On long triangles
that takes as long as a mesh of good ones, many times as large, would.

References
----------
R. E. Bank, R. K. Smith, "A posteriori error estimates based on hierarchical bases", SIAM J. Numer.
Anal. 30 (1993). K. Neymeyr, "A posteriori error estimation for elliptic eigenproblems", Numer.
Linear Algebra Appl. 9 (2002).
"""

from typing import Any

import numpy as np

from synthnet.arrays import Floats, Int32s
from synthnet.errors import SpectrumError
from synthnet.kernels import kernel, part
from synthnet.spectrum import curved, fem
from synthnet.spectrum.bending import Patches, bend
from synthnet.spectrum.inputs import as_count, as_mesh
from synthnet.spectrum.sheets import warn_of_sheets
from synthnet.spectrum.solve import of_matrices, thinness_named
from synthnet.spectrum.splitting import shorten, too_long
from synthnet.spectrum.warned import warn

RESOLVED = 0.05  # of an eigenvalue: edges are cut where linear elements miss more, and down to that
SEEN = 0.2  # of an eigenvalue: along an edge that adds more to it, a wave may not be seen
MOST, OF_EACH = 16, 100  # vertices after cutting: so many times those of the mesh and of each pair
IN_ALL, MOST_OF_MANY = 100_000, 4  # but no more than so many, or so many times those of the mesh
FIRST_ORDER = 0.3  # of an eigenvalue: where the edges' functions take more, it is no small error
COARSE = (
    "triangles are too long, too large or too thin for some of these eigenvalues, whose estimates "
    "may be far off, or of others: subdivide the mesh, or remesh it if triangles are thin"
)
ENOUGH, STEPS = 1e-4, 20  # conjugate gradients end with two that add no such share, or so many


def surface_eigenvalues(mesh: Any, k: int = 10) -> Floats:
    """Estimate the first k eigenvalues, after the zeros, of the surface that a mesh samples.

    The surface is taken to go through the vertices, with a crease where two triangles meet at more
    than 55 degrees, and a smooth boundary but for its corners; Neumann there. The estimate comes
    with no certificate: nothing bounds how far the surface is from that. Its mean error is a fifth
    of that of the mesh's own eigenvalues on 2.0, and a fortieth on 1.0; see docs/spectrum.md.

    Parameters
    ----------
    mesh : Mesh or other
        As :func:`synthnet.spectrum.compute` takes it.
    k : int
        Number of eigenvalues, at most the vertices less the components.

    Returns
    -------
    ndarray of shape (k,), float64
        In 1/length², ascending.

    Raises
    ------
    ValueError
        As :func:`synthnet.spectrum.compute`.
    CertificateError, SpectrumError
        As :func:`synthnet.spectrum.compute`, of the linear elements; if triangles are so thin that
        rounding leaves no estimate.

    Warns
    -----
    UserWarning
        As :func:`synthnet.spectrum.compute`, if the mesh is no surface, or looks like another; if
        linear elements are more than about a quarter off on the finer patches, too, or these would
        be too many, so that an estimate may be far off, and eigenvalues may be missing.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 20})
    >>> surface_eigenvalues(sphere, k=4).round(2)  # the smooth sphere has 2, 2, 2, 6
    array([2., 2., 2., 6.])
    """
    k = as_count(k)
    mesh = as_mesh(mesh)
    fem.check_used(mesh)
    patches, n = bend(mesh), len(mesh.vertices)
    most = min(MOST * (n + OF_EACH * k), max(IN_ALL, MOST_OF_MANY * n))
    warn_of_sheets(mesh, "curved", stacklevel=3)
    with thinness_named(mesh):
        values, energies = _solved(patches, k)
    while True:
        wave = float(np.sqrt(12 / values[-1]))
        unseen = len(too_long(patches, wave * SEEN**0.5)) > 0
        if not unseen and np.all(energies <= RESOLVED * values):
            break
        finer = shorten(patches, wave * RESOLVED**0.5, most)
        if finer is patches:
            break
        try:
            values, energies = _solved(finer, k)
        except SpectrumError:  # cut across, needles may be too thin for what rounding leaves
            break
        patches = finer
    nearer = values * np.exp(-energies / values)
    if unseen or np.any(energies > FIRST_ORDER * values):
        warn(COARSE, stacklevel=2)
    return np.sort(nearer)


def _solved(patches: Patches, k: int) -> tuple[Floats, Floats]:
    """Return k eigenvalues of linear elements, and the energies of edges' functions, (k,) each.

    Raises
    ------
    SpectrumError
        As :func:`of_matrices`; if rounding leaves no energy.
    """
    linear, stiffness, mass = curved.hierarchical(patches)
    found = of_matrices(linear, k)
    values = found.eigenvalues
    energies = _edge_energies(patches, stiffness, mass, found.eigenvectors, values)
    if not np.isfinite(energies).all():
        raise SpectrumError("rounding leaves no estimate of what lies between vertices")
    return values, energies


def _edge_energies(
    patches: Patches, stiffness: Floats, mass: Floats, vectors: Floats, values: Floats
) -> Floats:
    r"""Return :math:`r^T (C - \theta M)^{-1} r`, (k,) in 1/length², from below.

    Of k eigenpairs of linear elements, whose vectors are columns, and the patches' matrices as
    :func:`synthnet.spectrum.curved.hierarchical` returns them.
    """
    columns = np.ascontiguousarray(vectors)
    residuals, diagonal = _residuals(patches, stiffness, mass, columns, values)
    return _energies(patches.sides, *_of_edges(stiffness, mass), values, diagonal, residuals)


@kernel
def _residuals(
    patches: Patches, stiffness: Floats, mass: Floats, vectors: Floats, values: Floats
) -> tuple[Floats, Floats]:
    """Return r = θ B u − A u of each pair, (edges, k), and the diagonal of C."""
    faces, sides, edges = patches.faces, patches.sides, patches.ends.shape[0]
    residuals, diagonal = np.zeros((edges, values.shape[0])), np.zeros(edges)
    for f in range(faces.shape[0]):
        for s in range(3):
            r = residuals[sides[f, s]]
            diagonal[sides[f, s]] += stiffness[f, 3 + s, 3 + s]
            for c in range(3):
                u, a, b = vectors[faces[f, c]], stiffness[f, 3 + s, c], mass[f, 3 + s, c]
                for j in range(values.shape[0]):
                    r[j] += (values[j] * b - a) * u[j]
    return residuals, diagonal


@kernel
def _of_edges(stiffness: Floats, mass: Floats) -> tuple[Floats, Floats, Floats]:
    """Return C and M of each patch, (m, 6), and a θ up to which θ M is at most half of C.

    Entries are 00, 01, 02, 11, 12 and 22; that θ is 1 / (2 tr C⁻¹ M), (m,).
    """
    own, masses = np.empty((stiffness.shape[0], 6)), np.empty((stiffness.shape[0], 6))
    highest = np.empty(stiffness.shape[0])
    for f in range(stiffness.shape[0]):
        c, m = stiffness[f, 3:, 3:], mass[f, 3:, 3:]
        entry = 0
        for s in range(3):
            for t in range(s, 3):
                own[f, entry], masses[f, entry] = c[s, t], m[s, t]
                entry += 1
        trace = 0.0
        determinant = 0.0
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            for s in range(3):
                t, u = (s + 1) % 3, (s + 2) % 3
                cofactor = c[j, t] * c[k, u] - c[j, u] * c[k, t]
                trace += cofactor * m[i, s]
                if i == 0:
                    determinant += cofactor * c[i, s]
        sound = determinant > 0 and trace > 0  # rounding on needles
        highest[f] = determinant / (2 * trace) if sound else 0.0
    return own, masses, highest


@kernel
def _energies(
    sides: Int32s,
    own: Floats,
    masses: Floats,
    highest: Floats,
    values: Floats,
    diagonal: Floats,
    r: Floats,
) -> Floats:
    """Return rᵀ (C − θ M)⁻¹ r of each column, from below; r is used up.

    A column ends by itself, so that it does not depend on how many there are.
    """
    edges, k = r.shape
    p, q = np.zeros((edges, k)), np.zeros((edges, k))
    energies, before, step = np.zeros(k), np.full(k, np.inf), np.zeros(k)
    ended, small = np.zeros(k, np.bool_), np.zeros(k, np.bool_)
    for _ in range(STEPS):
        now = _weighted_squares(r, q, step, diagonal)
        ratio = now / before
        for e in range(edges):
            inverse = 1 / diagonal[e]
            for j in range(k):
                p[e, j] = r[e, j] * inverse + ratio[j] * p[e, j]
        _multiply(sides, own, masses, highest, values, p, q)
        step[:] = 0.0
        for e in range(edges):
            for j in range(k):
                step[j] += p[e, j] * q[e, j]
        for j in range(k):
            if ended[j] or now[j] == 0.0:  # where nothing is left, there is nothing to add
                step[j] = 0.0
            else:
                step[j] = now[j] / step[j] if step[j] > 0 else np.nan
            energies[j] += step[j] * now[j]
            added = step[j] * now[j] > ENOUGH * energies[j]
            ended[j] |= small[j] and not added
            small[j] = not added
        if np.all(ended):
            break
        before = np.where(now > 0, now, np.inf)
    return energies


@part
def _weighted_squares(r: Floats, q: Floats, step: Floats, diagonal: Floats) -> Floats:
    """Take steps along q from r; return the sums of squares that are left, over the diagonal."""
    squares = np.zeros(r.shape[1])
    for e in range(r.shape[0]):
        inverse = 1 / diagonal[e]
        for j in range(r.shape[1]):
            left = r[e, j] - step[j] * q[e, j]
            r[e, j] = left
            squares[j] += left * left * inverse
    return squares


@part
def _multiply(
    sides: Int32s,
    own: Floats,
    masses: Floats,
    highest: Floats,
    values: Floats,
    p: Floats,
    q: Floats,
) -> None:
    """Set q to (C − θ M) p, patch by patch, θ at most what it may be there."""
    q[:] = 0.0
    for f in range(sides.shape[0]):
        a, b, c = sides[f]
        own00, own01, own02, own11, own12, own22 = own[f]
        mass00, mass01, mass02, mass11, mass12, mass22 = masses[f]
        for j in range(p.shape[1]):
            theta = min(values[j], highest[f])
            x, y, z = p[a, j], p[b, j], p[c, j]
            ab, ac, bc = own01 - theta * mass01, own02 - theta * mass02, own12 - theta * mass12
            q[a, j] += (own00 - theta * mass00) * x + ab * y + ac * z
            q[b, j] += ab * x + (own11 - theta * mass11) * y + bc * z
            q[c, j] += ac * x + bc * y + (own22 - theta * mass22) * z
