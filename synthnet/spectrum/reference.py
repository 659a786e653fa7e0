r"""The eigenvalue problem in NumPy and SciPy alone: the solver of this room, made to be read.

On a surface S, the eigenfunctions of the Laplace–Beltrami operator solve
:math:`-\Delta u = \lambda u`. Multiplied by a test function v and integrated by parts, with no
boundary term (the natural, or Neumann, condition on a boundary), this is

.. math:: \int_S \nabla u \cdot \nabla v = \lambda \int_S u\,v \quad \text{for all } v,

and for u and v in the span of the hat functions :math:`\varphi_i` of a mesh it becomes the
generalised eigenvalue problem :math:`A u = \lambda B u`. This file assembles A and B
(:func:`matrices`), finds eigenpairs (:func:`eigenpairs`) and counts eigenvalues
(:func:`count_below`). :mod:`synthnet.spectrum.solve` does the same several times faster, and the
tests hold it to this file.

Do not label data with it. :func:`eigenpairs` has no certificate: ARPACK sees an eigenvalue of
several copies through rounding errors only, and may return a set that lacks one of a cluster and
still report convergence (SciPy's issue 26112). Compare with :func:`count_below`, or use
:func:`all_eigenvalues` where the mesh is small.

References
----------
M. Reuter, F.-E. Wolter, N. Peinecke, "Laplace-Beltrami spectra as 'Shape-DNA' of surfaces and
solids", Computer-Aided Design 38 (2006): the matrices. R. B. Lehoucq, D. C. Sorensen, C. Yang,
"ARPACK Users' Guide" (1998): the iteration. J. J. Sylvester, Philosophical Magazine 4 (1852): the
law of inertia. X. S. Li, J. W. Demmel, "Making sparse Gaussian elimination scalable by static
pivoting", SC98 (1998): elimination in an order chosen beforehand.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import linalg, sparse
from scipy.sparse.linalg import eigsh, splu

from synthnet.arrays import Floats


def matrices(
    vertices: NDArray[np.floating[Any]], faces: NDArray[np.integer[Any]]
) -> tuple[sparse.csc_array, sparse.csc_array]:
    r"""Assemble the stiffness matrix A and the consistent mass matrix B.

    .. math::
        A_{ij} = \int_S \nabla\varphi_i \cdot \nabla\varphi_j,
        \qquad B_{ij} = \int_S \varphi_i \varphi_j

    In a triangle T of unit normal n, with :math:`e_i` the edge opposite corner i, the gradient is
    :math:`\nabla\varphi_i = n \times e_i / 2|T|`, and the integral of
    :math:`\varphi_i \varphi_j` is :math:`|T| (1 + \delta_{ij}) / 12`.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3), float
        Coordinates, taken as float64.
    faces : ndarray of shape (m, 3), integer
        Corners of the triangles, each of positive area; every vertex belongs to one.

    Returns
    -------
    stiffness, mass : csc_array of shape (n, n), float64
        Symmetric; A has no unit, B is in length².

    Examples
    --------
    >>> A, B = matrices(np.eye(3), np.array([[0, 1, 2]]))
    >>> (A.toarray() * 3**0.5).round(9)  # minus half a cotangent of 60° beside the diagonal
    array([[ 1. , -0.5, -0.5],
           [-0.5,  1. , -0.5],
           [-0.5, -0.5,  1. ]])
    """
    corners = np.asarray(vertices, dtype=np.float64)[faces]
    edges = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)  # opposite each corner
    normals = np.cross(edges[:, 0], edges[:, 1])  # of length 2|T|
    doubled = np.linalg.norm(normals, axis=1)[:, None, None]
    gradients = np.cross(normals[:, None], edges) / doubled**2
    stiffness = doubled / 2 * gradients @ gradients.transpose(0, 2, 1)
    mass = doubled / 2 * (1 + np.eye(3)) / 12
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, 3).ravel()
    shape = (len(vertices), len(vertices))

    def assembled(parts: Floats) -> sparse.csc_array:
        return sparse.coo_array((parts.ravel(), (rows, columns)), shape=shape).tocsc()

    return assembled(stiffness), assembled(mass)


def eigenpairs(
    stiffness: sparse.csc_array, mass: sparse.csc_array, k: int
) -> tuple[Floats, Floats]:
    r"""Find the k smallest eigenpairs of :math:`A u = \lambda B u`, the zero included.

    By shift and invert: the eigenvalues next to σ are the largest in absolute value of
    :math:`(A - \sigma B)^{-1} B`, at :math:`1 / (\lambda - \sigma)`. A is semidefinite, so for
    :math:`\sigma = -1 / \mathrm{area}` the matrix to factorise is positive definite. The start
    vector is fixed: the same matrices give the same numbers.

    Parameters
    ----------
    stiffness, mass : csc_array of shape (n, n), float64
        Of :func:`matrices`.
    k : int
        Number of pairs, below n.

    Returns
    -------
    values : ndarray of shape (k,), float64
        In 1/length², ascending; not certified, see the head of this file.
    vectors : ndarray of shape (n, k), float64
        B-orthonormal columns.

    Raises
    ------
    scipy.sparse.linalg.ArpackNoConvergence
        If ARPACK does not converge.

    Examples
    --------
    >>> corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    >>> A, B = matrices(corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    >>> eigenpairs(A, B, 3)[0].round(9) + 0.0
    array([0., 2., 2.])
    """
    start = np.random.default_rng(0).random(stiffness.shape[0]) - 0.5
    sigma = -1 / mass.sum()
    values, vectors = eigsh(stiffness, k, mass, sigma=sigma, v0=start)
    order = np.argsort(values)
    return values[order], vectors[:, order]


def all_eigenvalues(stiffness: sparse.csc_array, mass: sparse.csc_array) -> Floats:
    """Return all n eigenvalues in 1/length², ascending, by LAPACK, which misses none.

    It takes n² numbers of memory and n³ operations: a quarter of a minute for 3,000 vertices.

    Parameters
    ----------
    stiffness, mass : csc_array of shape (n, n), float64
        Of :func:`matrices`.
    """
    return np.asarray(linalg.eigvalsh(stiffness.toarray(), mass.toarray()), dtype=np.float64)


def count_below(stiffness: sparse.csc_array, mass: sparse.csc_array, sigma: float) -> int:
    r"""Count the eigenvalues below σ, the zero included, without computing one.

    By Sylvester's law of inertia, the D of :math:`A - \sigma B = L D L^T` has as many negative
    entries as there are eigenvalues below σ. SuperLU gives that factorisation as L U, D the
    diagonal of U, if it orders rows as columns and never leaves the diagonal for a pivot.

    Parameters
    ----------
    stiffness, mass : csc_array of shape (n, n), float64
        Of :func:`matrices`.
    sigma : float
        The shift, in 1/length². Next to an eigenvalue rounding decides the count: choose a σ
        inside a gap.

    Raises
    ------
    RuntimeError
        If a pivot is zero, as where σ is an eigenvalue.

    Examples
    --------
    >>> corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    >>> A, B = matrices(corners, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]))
    >>> count_below(A, B, -1.0), count_below(A, B, 1.0), count_below(A, B, 3.0)  # of 0, 2, 2, 2
    (0, 1, 4)
    """
    factor = splu(
        (stiffness - sigma * mass).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    if (factor.perm_r != factor.perm_c).any():
        raise RuntimeError(f"a pivot of A - {sigma:g} B is zero")
    return int(np.count_nonzero(factor.U.diagonal() < 0))
