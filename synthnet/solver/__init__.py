"""A sparse symmetric eigenvalue solver for the matrices of triangle meshes.

In the order of use: :mod:`~synthnet.solver.fem` assembles the matrices,
:mod:`~synthnet.solver.ordering` finds an order of elimination with little fill,
:mod:`~synthnet.solver.ldl` factorises A − σB and counts eigenvalues below σ, and
:mod:`~synthnet.solver.lanczos` finds eigenpairs around σ. Plain arrays in and out, compiled
by Numba on first use and cached on disk.
"""
