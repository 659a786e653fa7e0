r"""How far a label is from the spectrum of the smooth or polyhedral surface.

The eigenvalues of linear finite elements approach those of the surface like h²: halving
the step divides their distance by four, the geometry's part of it (a mesh inscribed in the
surface) as well as the functions'. Two meshes therefore give the limit, and the error of
the label:

.. math::
    \lambda_0 \approx \lambda_{h/2} + \frac{\lambda_{h/2} - \lambda_h}{3}, \qquad
    e = \lambda_h - \lambda_0 \approx \frac{4}{3} (\lambda_h - \lambda_{h/2})

(Richardson). Eigenvalues are paired by their index in ascending order. A coarse mesh does
not follow that law yet, so it is refined again, and the two finest meshes give the limit:
families with triangles that reach across the whole surface at least twice
(:attr:`synthnet.families.Family.least_levels`), those of 2.0, whose refinements are uniform
meshes of the surface whatever the mesh in question, and any mesh while the last refinement
changed an eigenvalue by more than a tenth (half a per cent in 2.0), up to five times, or as often
as the solver can certify the finer mesh. Families of 2.0 whose limit is known have their error
from there.

References
----------
G. Strang, G. J. Fix, An Analysis of the Finite Element Method, 1973, chapter 6 (rate of
eigenvalues). G. Dziuk, C. M. Elliott, "Finite element methods for surface PDEs", Acta
Numerica 22 (2013), section 4 (inscribed meshes).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synthnet import spectrum
from synthnet.errors import SpectrumError
from synthnet.families import FAMILIES
from synthnet.types import ShapeSpec

Array = NDArray[np.float64]

MOST = 5  # refinements: 1,024 times the triangles


@dataclass(frozen=True, slots=True)
class Estimate:
    """The estimated discretisation error of a label.

    Parameters
    ----------
    id : str
        The shape.
    error : ndarray of shape (k,), float64
        Label minus extrapolated limit, in 1/length²; positive where the label is too large.
    refined : ndarray of shape (r, k), float64
        Eigenvalues of the mesh refined once, twice, … r times, or the limit itself, twice, where
        it is taken from a closed form; in 1/length².
    """

    id: str
    error: Array
    refined: Array


def estimate(
    spec: ShapeSpec, eigenvalues: Array, known: dict[str, Array] | None = None
) -> Estimate:
    """Estimate the error of a label by refinement and extrapolation.

    Parameters
    ----------
    spec : ShapeSpec
        The shape: its parameters say what the smooth surface is.
    eigenvalues : ndarray of shape (k,), float64
        Its label.
    known : dict, optional
        Spectra of refined meshes found before, to which those of this call are added: the
        triangulations of one surface share theirs.

    Raises
    ------
    SpectrumError
        If the solver fails on a refined mesh.

    Examples
    --------
    >>> sphere = ShapeSpec("sphere-00000", "sphere", 0, {"radius": 1.0, "resolution": 20}, "")
    >>> label = spectrum.compute(FAMILIES["sphere"].generate(sphere.parameters)).eigenvalues
    >>> (label - estimate(sphere, label).error).round(2)
    array([ 2.,  2.,  2.,  6.,  6.,  6.,  6.,  6., 12., 12.])
    """
    family = FAMILIES[spec.family]
    known = {} if known is None else known
    limit = family.limit_eigenvalues(spec.parameters, len(eigenvalues)) if family.exact else None
    if limit is not None:
        return Estimate(spec.id, eigenvalues - limit, np.array([limit, limit]))
    meshes = [eigenvalues]
    change = np.inf
    while len(meshes) <= family.least_levels or (len(meshes) <= MOST and change > family.settled):
        key = f"{len(eigenvalues)} {family.level_key(spec.parameters, len(meshes))}"
        if key not in known:
            mesh = family.refine(spec.parameters, len(meshes))
            try:
                known[key] = spectrum.compute(mesh, len(eigenvalues)).eigenvalues
            except SpectrumError:
                if len(meshes) <= family.least_levels:
                    raise
                break  # slivers so fine that rounding has the say: the meshes before must do
        meshes.append(known[key])
        change = float(np.max(np.abs(meshes[-2] / meshes[-1] - 1)))
    return Estimate(spec.id, eigenvalues - extrapolate(*meshes[-2:]), np.array(meshes[1:]))


def extrapolate(coarse: Array, fine: Array) -> Array:
    """Return the limit of eigenvalues that approach it like h², from those of h and h/2.

    Examples
    --------
    >>> extrapolate(np.array([2.4]), np.array([2.1])).round(12)
    array([2.])
    """
    return fine + (fine - coarse) / 3
