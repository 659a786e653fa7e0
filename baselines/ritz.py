r"""Rayleigh-Ritz on polynomials: the eigenproblem in a space of a few dozen functions.

With V the polynomials of x, y and z up to a degree, at the vertices, and A, B the finite
element matrices, the eigenvalues of :math:`V^T A V c = \lambda V^T B V c` bound those of
(A, B) from above.
"""

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.legendre import legvander
from scipy.linalg import eigh

from synthnet import Mesh
from synthnet.spectrum import fem_matrices

DEPENDENT = 1e-10  # of the Gram matrix, below which polynomials agree on the surface


def polynomials(vertices: np.ndarray, degree: int) -> np.ndarray:
    """Return products of Legendre polynomials of total degree at most ``degree``, (n, m).

    In principal axes, each scaled to [−1, 1]: so the space, and the answer, do not depend on
    how the mesh lies.
    """
    centred = vertices - vertices.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    turned = centred @ axes
    x, y, z = (legvander(c / np.abs(c).max(initial=1e-300), degree) for c in turned.T)
    powers = range(degree + 1)
    terms = [(i, j, k) for i in powers for j in powers for k in powers if i + j + k <= degree]
    return np.stack([x[:, i] * y[:, j] * z[:, k] for i, j, k in terms], axis=1)


def ritz_values(mesh: Mesh, degree: int, count: int = 10) -> np.ndarray:
    """Return the first ``count`` Ritz values after zero, ascending, in 1/length².

    Where the surface makes polynomials agree, as a plane does, the degree is raised until they
    span enough functions.
    """
    stiffness, mass = fem_matrices(mesh)
    basis = polynomials(mesh.vertices, degree)
    gram, directions = eigh(basis.T @ (mass @ basis))
    kept = gram > DEPENDENT * gram[-1]
    if np.count_nonzero(kept) <= count < len(mesh.vertices):
        return ritz_values(mesh, degree + 1, count)
    basis = basis @ (directions[:, kept] / np.sqrt(gram[kept]))
    values = np.linalg.eigvalsh(basis.T @ (stiffness @ basis))
    return values[1 : count + 1]


def predict(meshes: Sequence[Mesh], degree: int) -> np.ndarray:
    """Return the Ritz values of a batch, shape (B, 10)."""
    return np.array([ritz_values(mesh, degree) for mesh in meshes])
