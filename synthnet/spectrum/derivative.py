"""How eigenvalues change when the vertices move: derivatives without a system to solve."""

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.mesh.geometry import corner_edges
from synthnet.types import Mesh, Spectrum

UNIT = 1e-6  # most that φᵀBφ of an eigenvector may differ from 1


def clusters(eigenvalues: Floats, tolerance: float) -> Int64s:
    """Number the clusters: neighbours with a relative gap of at most the tolerance are in one.

    Parameters
    ----------
    eigenvalues : ndarray of shape (k,), float64
        Positive, ascending.
    tolerance : float
        Largest gap inside a cluster, over the larger of the two eigenvalues.

    Returns
    -------
    ndarray of shape (k,), int64
        The number of each eigenvalue's cluster, from 0, ascending.

    Examples
    --------
    >>> clusters(np.array([2.0, 2.0001, 6.0, 12.0]), 1e-3)
    array([0, 0, 1, 2])
    """
    gaps = np.diff(eigenvalues) > tolerance * eigenvalues[1:]
    return np.concatenate([[0], np.cumsum(gaps)])


def vertex_gradient(mesh: Mesh, spectrum: Spectrum, weights: Floats) -> Floats:
    r"""Differentiate a weighted sum of eigenvalues with respect to the vertices.

    If :math:`A\varphi = \lambda B\varphi` and :math:`\varphi^T B \varphi = 1`, a simple eigenvalue
    has the derivative

    .. math::
        d\lambda = \varphi^T (dA - \lambda\, dB)\, \varphi .

    With :math:`f_i` the values of φ at a triangle's corners, :math:`e_i` the edge opposite corner
    i, and :math:`g = \sum_i f_i e_i`, the triangle adds
    :math:`|g|^2 / 4|T| - \lambda |T| (\sum_i f_i^2 + (\sum_i f_i)^2) / 12` to
    :math:`\varphi^T (A - \lambda B) \varphi`; this is differentiated with φ and λ held fixed. The
    sum of the derivatives of a multiple eigenvalue is a derivative too; a single one is not,
    because it depends on the basis of the eigenspace.

    Parameters
    ----------
    mesh : Mesh
        Its vertices are taken as float64.
    spectrum : Spectrum
        k eigenpairs of this mesh by :func:`synthnet.spectrum.compute`: linear elements, consistent
        mass, Neumann on a boundary.
    weights : ndarray of shape (k,), float64
        Factor of each eigenvalue in the sum.

    Returns
    -------
    ndarray of shape (n, 3), float64
        In 1/length³ for weights without a unit.

    Raises
    ------
    ValueError
        If :math:`\varphi^T B \varphi` is not 1 for an eigenvector with a weight: it is of another
        operator, such as one of lumped mass, or of another mesh.

    References
    ----------
    J. R. Magnus, "On differentiating eigenvalues and eigenvectors", Econometric Theory 1 (1985).
    """
    edges = corner_edges(mesh)
    normals = np.cross(edges[:, 0], edges[:, 1])
    doubled = np.linalg.norm(normals, axis=1)[:, None, None]  # twice each area
    for i in np.flatnonzero(weights).tolist():
        values = spectrum.eigenvectors[mesh.faces, i]
        sums = np.square(values).sum(axis=1) + np.square(values.sum(axis=1))
        if not abs((square := doubled.ravel() @ sums / 24) - 1) <= UNIT:
            raise ValueError(
                f"eigenvector {i + 1} has a square of {square:.6g} in the consistent mass of this "
                "mesh, not 1: compute its spectrum by linear elements and consistent mass"
            )
    stiff = _corner_products(mesh, spectrum, weights)
    heavy = _corner_products(mesh, spectrum, weights * spectrum.eigenvalues)
    flows = stiff @ edges  # the sum of f_i g over the pairs
    energies = np.einsum("tic,tic->t", flows, edges)[:, None, None] / doubled**2
    masses = (np.einsum("tii->t", heavy) + heavy.sum(axis=(1, 2)))[:, None, None] / 12
    areas = np.cross((normals / doubled[:, 0])[:, None], edges) / 2  # how the area changes
    local = (flows[:, [1, 2, 0]] - flows[:, [2, 0, 1]]) / doubled - (energies + masses) * areas
    where, n = mesh.faces.ravel(), len(mesh.vertices)
    columns = [np.bincount(where, local[:, :, x].ravel(), minlength=n) for x in range(3)]
    return np.stack(columns, axis=1)


def _corner_products(mesh: Mesh, spectrum: Spectrum, weights: Floats) -> Floats:
    """Return each triangle's weighted sum of :math:`f f^T` over the pairs, shape (m, 3, 3)."""
    products = np.zeros((len(mesh.faces), 3, 3))
    for weight, vector in zip(weights, spectrum.eigenvectors.T, strict=True):
        if weight:
            values = vector[mesh.faces]
            products += weight * values[:, :, None] * values[:, None, :]
    return products
