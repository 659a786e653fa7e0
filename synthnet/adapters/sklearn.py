"""ShapeDNA as a transformer of scikit-learn: meshes in, a table of numbers out."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Floats
from synthnet.errors import needed_by
from synthnet.mesh.geometry import area, enclosed_volume
from synthnet.spectrum import as_mesh, compute
from synthnet.spectrum.descriptors import shape_dna

with needed_by("synthnet.adapters.sklearn"):
    from sklearn.base import BaseEstimator, TransformerMixin


class ShapeDNA(TransformerMixin, BaseEstimator):  # type: ignore[misc]
    """Eigenvalues of meshes, normalised: a step of a ``Pipeline``. There is nothing to fit.

    Parameters
    ----------
    k : int
        Eigenvalues after the zeros.
    normalisation : str
        ``none``, ``area``, ``volume`` or ``first``, see
        :func:`synthnet.spectrum.descriptors.shape_dna`.
    reweighted : bool
        Divide the i-th by i.
    repair : bool
        Repair each mesh first, see :func:`synthnet.spectrum.compute`.
    """

    def __init__(
        self,
        k: int = 10,
        normalisation: str = "area",
        *,
        reweighted: bool = False,
        repair: bool = False,
    ) -> None:
        self.k = k
        self.normalisation = normalisation
        self.reweighted = reweighted
        self.repair = repair

    def fit(self, X: Iterable[Any], y: Any = None) -> ShapeDNA:
        """Return itself."""
        del X, y
        return self

    def transform(self, X: Iterable[Any]) -> Floats:
        """Return the descriptors of meshes, a row each.

        Parameters
        ----------
        X : iterable
            Of what :func:`synthnet.spectrum.as_mesh` takes.

        Returns
        -------
        ndarray of shape (meshes, k), float64

        Raises
        ------
        ValueError, Refused, CertificateError, SpectrumError
            See :func:`synthnet.spectrum.compute`,
            :func:`~synthnet.spectrum.descriptors.shape_dna` and, for ``volume``,
            :func:`synthnet.mesh.geometry.enclosed_volume`.
        """
        rows = [self._row(given) for given in X]
        return np.array(rows, dtype=np.float64).reshape(len(rows), self.k)

    def get_feature_names_out(self, input_features: Any = None) -> NDArray[np.object_]:
        """Return a name for each column: lambda1 and so on."""
        del input_features
        return np.array([f"lambda{i}" for i in range(1, self.k + 1)], dtype=object)

    def __sklearn_is_fitted__(self) -> bool:
        return True

    def _row(self, given: Any) -> Floats:
        spectrum = compute(given, self.k, repair=self.repair)
        mesh = as_mesh(given) if spectrum.mesh is None else spectrum.mesh
        return shape_dna(
            spectrum,
            self.normalisation,
            area=area(mesh) if self.normalisation == "area" else None,
            volume=enclosed_volume(mesh) if self.normalisation == "volume" else None,
            reweighted=self.reweighted,
        )
