"""The certified solver and others at their best: each a function of a mesh and of k.

All return the first k eigenvalues after the zero, ascending, float64, in 1/length².
"""

from __future__ import annotations

import numpy as np
import threadpoolctl

from synthnet import spectrum
from synthnet.types import Mesh


def ours(mesh: Mesh, k: int) -> np.ndarray:
    """Return what this project's solver finds."""
    return spectrum.compute(mesh, k).eigenvalues


def lapy(mesh: Mesh, k: int) -> np.ndarray:
    """Return what LaPy finds as it comes, by SuperLU."""
    from lapy import Solver, TriaMesh

    exact = TriaMesh(mesh.vertices.astype(np.float64), mesh.faces)
    return Solver(exact).eigs(k + 1, rng=0)[0][1:]


def lapy_cholmod(mesh: Mesh, k: int) -> np.ndarray:
    """Return what LaPy finds at its fastest."""
    import cholespy  # noqa: F401 - LaPy imports it in its first solve
    from lapy import Solver, TriaMesh

    exact = TriaMesh(mesh.vertices.astype(np.float64), mesh.faces)
    return Solver(exact, use_cholmod=True).eigs(k + 1, rng=0)[0][1:]


def robust(mesh: Mesh, k: int) -> np.ndarray:
    """Return what SciPy finds of robust_laplacian's matrices, as its README shows."""
    import robust_laplacian
    from scipy.sparse.linalg import eigsh

    stiffness, mass = robust_laplacian.mesh_laplacian(mesh.vertices, mesh.faces)
    return np.sort(eigsh(stiffness, k + 1, mass, sigma=-1e-8)[0])[1:]


def lobpcg(mesh: Mesh, k: int) -> np.ndarray:
    """Return what SciPy's LOBPCG finds, preconditioned by pyamg's smoothed aggregation."""
    import pyamg
    from scipy.sparse.linalg import lobpcg as iterate

    stiffness, mass = spectrum.fem_matrices(mesh)
    shifted = (stiffness + mass / mass.sum()).tocsr()
    start = np.random.default_rng(0).standard_normal((len(mesh.vertices), k + k // 4 + 4))
    start[:, 0] = 1
    solver = pyamg.smoothed_aggregation_solver(shifted, max_coarse=50)
    values = iterate(
        shifted, start, mass, solver.aspreconditioner(), tol=1e-6, maxiter=200, largest=False
    )[0]
    return np.sort(values)[1 : k + 1] - 1 / mass.sum()


def pardiso(mesh: Mesh, k: int) -> np.ndarray:
    """Return what SciPy finds with MKL's PARDISO, the bar of the hardware, by pypardiso."""
    import pypardiso
    from scipy.sparse import csr_matrix, triu
    from scipy.sparse.linalg import LinearOperator, eigsh

    stiffness, mass = spectrum.fem_matrices(mesh)
    upper = triu(csr_matrix(stiffness + 0.01 * mass), format="csr")
    solver = pypardiso.PyPardisoSolver(mtype=2)  # symmetric, positive definite
    with threadpoolctl.threadpool_limits(1):  # MKL is loaded only now
        solver.factorize(upper)
        inverse = LinearOperator(mass.shape, lambda b: solver.solve(upper, b), dtype=np.float64)
        start = np.random.default_rng(0).uniform(-1, 1, mass.shape[0])
        values = eigsh(stiffness, k + 1, mass, sigma=-0.01, OPinv=inverse, v0=start)[0]
    solver.free_memory(everything=True)
    return np.sort(values)[1:]
