"""Certified spectra of triangle meshes, by a sparse symmetric eigenvalue solver of its own.

In the order of use: :mod:`~synthnet.spectrum.fem` assembles the matrices,
:mod:`~synthnet.spectrum.ordering` finds an order of elimination with little fill,
:mod:`~synthnet.spectrum.ldl` factorises A − σB and counts eigenvalues below σ,
:mod:`~synthnet.spectrum.lanczos` finds eigenpairs around σ, and
:mod:`~synthnet.spectrum.solve` puts them together and certifies the answer. Plain arrays in
and out, compiled by Numba on first use and cached on disk.
"""

from synthnet.spectrum.solve import compile_solver, compute, count_below, fem_matrices

__all__ = ["compile_solver", "compute", "count_below", "fem_matrices"]
