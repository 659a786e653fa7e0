"""The certified solver behind the names of ``lapy.Solver``. LaPy need not be installed."""

from __future__ import annotations

from typing import Any

from synthnet.arrays import Floats
from synthnet.mesh.repair import Repaired
from synthnet.spectrum import Operator, as_mesh, as_sparse, discretise, smallest
from synthnet.spectrum.inputs import repaired
from synthnet.spectrum.sheets import warn_of_sheets


class Solver:
    """Stiffness, mass and smallest eigenpairs of a triangle mesh, as ``lapy.Solver`` has them.

    Linear elements, Neumann on a boundary. Its ``stiffness``, without a unit, and its ``mass``, in
    length², are symmetric ``scipy.sparse.csc_matrix`` of shape (n, n), float64.

    Parameters
    ----------
    geometry : lapy.TriaMesh or other
        What :func:`synthnet.spectrum.as_mesh` takes.
    lump : bool
        Take the lumped, that is diagonal, mass matrix.
    aniso : None
        Isotropic elements only.
    use_cholmod : bool
        Has no effect: the factorisation is our own.
    repair : bool
        Not LaPy's: repair the mesh first, see :func:`synthnet.spectrum.compute`. Matrices and
        eigenvectors then belong to ``mesh``, and ``repairs`` names what was done.

    Raises
    ------
    ValueError
        If it is no triangle mesh, or has no spectrum; if ``aniso`` is given.
    Refused
        If it is to be repaired, and is no surface by a rule of :mod:`synthnet.mesh.repair`.

    Examples
    --------
    >>> square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]
    >>> values, vectors = Solver(square).eigs(k=2)
    >>> values.round(6), vectors.shape
    (array([ 0., 12.]), (4, 2))
    """

    def __init__(
        self,
        geometry: Any,
        lump: bool = False,
        aniso: None = None,
        *,
        use_cholmod: bool = False,
        repair: bool = False,
    ) -> None:
        if aniso is not None:
            raise ValueError("anisotropic elements are not solved here: use lapy.Solver")
        del use_cholmod
        operator = Operator(mass="lumped" if lump else "consistent")
        done = repaired(geometry) if repair else Repaired(as_mesh(geometry))
        self.mesh, self.repairs = done.mesh, done.repairs
        self._matrices = discretise(self.mesh, operator).matrices
        warn_of_sheets(self.mesh, operator.elements, stacklevel=3)
        self.stiffness, self.mass = as_sparse(self._matrices)
        if lump:
            self.mass.eliminate_zeros()

    def eigs(
        self, k: int = 10, sigma: float = -0.01, which: str = "LM", **without_effect: Any
    ) -> tuple[Floats, Floats]:
        """Return the k smallest eigenpairs, certified; the zeros are among them.

        Parameters
        ----------
        k : int
            Number of pairs, from one to the vertices.
        sigma, which : float, str
            Of LaPy's, those that mean the smallest: any shift below the spectrum and ``"LM"``.
        **without_effect
            ``v0``, ``mode`` and ``rng``: the answer depends on no start vector.

        Returns
        -------
        eigenvalues : ndarray of shape (k,), float64
            In 1/length², ascending, first a zero for each component.
        eigenvectors : ndarray of shape (n, k), float64
            Orthonormal in the mass matrix; those of zeros are constant on a component.

        Raises
        ------
        ValueError
            If k is out of range, or other eigenvalues than the smallest are asked for.
        TypeError
            If LaPy's ``eigs`` has no such parameter.
        CertificateError, SpectrumError
            See :func:`synthnet.spectrum.compute`.
        """
        unknown = sorted(without_effect.keys() - {"v0", "mode", "rng"})
        if unknown:
            raise TypeError(f"eigs has no parameter {unknown[0]}")
        if sigma > 0 or which != "LM" or without_effect.get("mode", "normal") != "normal":
            raise ValueError(
                "only the smallest eigenvalues are found here: leave sigma, which and mode out"
            )
        return smallest(self._matrices, k)
