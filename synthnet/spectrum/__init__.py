"""Certified spectra of triangle meshes, by a sparse symmetric eigenvalue solver of its own.

Read :mod:`~synthnet.spectrum.reference` first: the whole problem in NumPy and SciPy alone. The fast
solver, in the order of use: :mod:`~synthnet.spectrum.fem` assembles the matrices and
:mod:`~synthnet.spectrum.operators` those of other boundary conditions, masses and elements,
:mod:`~synthnet.spectrum.ordering` finds an order of elimination with little fill,
:mod:`~synthnet.spectrum.ldl` factorises A − σB and counts eigenvalues below σ,
:mod:`~synthnet.spectrum.substitution` solves with the factors,
:mod:`~synthnet.spectrum.lanczos` finds eigenpairs around σ,
:mod:`~synthnet.spectrum.search` takes as many as there are below a gap,
:mod:`~synthnet.spectrum.certificate` proves that none is missing,
:mod:`~synthnet.spectrum.components` does so for each component of a mesh,
:mod:`~synthnet.spectrum.rounding` bounds what rounding did, and
:mod:`~synthnet.spectrum.solve` puts them together. :mod:`~synthnet.spectrum.verdict` judges the
eigenvalues of others, :mod:`~synthnet.spectrum.inputs` takes their meshes,
:mod:`~synthnet.spectrum.many` has spectra of many. :mod:`~synthnet.spectrum.bending` bends
triangles to the surface that a mesh samples, :mod:`~synthnet.spectrum.curved` has elements on them,
and :mod:`~synthnet.spectrum.surface` estimates that surface's spectrum. Plain arrays in and out,
compiled by Numba on first use and cached on disk.
"""

from synthnet.spectrum.inputs import as_mesh, check, repaired
from synthnet.spectrum.many import spectra
from synthnet.spectrum.operators import (
    Discrete,
    Operator,
    as_sparse,
    discretise,
    fem_matrices,
)
from synthnet.spectrum.solve import compile_solver, compute, count_below, of_matrices, smallest
from synthnet.spectrum.surface import surface_eigenvalues
from synthnet.spectrum.verdict import Verdict, certify

__all__ = [
    "Discrete",
    "Operator",
    "Verdict",
    "as_mesh",
    "as_sparse",
    "certify",
    "check",
    "compile_solver",
    "compute",
    "count_below",
    "discretise",
    "fem_matrices",
    "of_matrices",
    "repaired",
    "smallest",
    "spectra",
    "surface_eigenvalues",
]
