r"""Discrete Laplace–Beltrami operators of a mesh: boundary condition, mass matrix and elements.

A mesh becomes the problem :math:`A u = \lambda B u` that the solver takes. Labels use one form of
it, linear elements with consistent mass, Neumann on a boundary; users of spectra also want others.

References
----------
G. Strang, G. J. Fix, "An Analysis of the Finite Element Method" (1973): mass matrices and orders of
convergence. N. Sharp, K. Crane, "A Laplacian for nonmanifold triangle meshes", Computer Graphics
Forum 39 (2020): the tufted cover. M. Reuter, F.-E. Wolter, N. Peinecke, "Laplace-Beltrami spectra
as 'Shape-DNA' of surfaces and solids", Computer-Aided Design 38 (2006): quadratic elements.
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy import sparse

from synthnet.arrays import Booleans, Floats, Int32s, Int64s
from synthnet.errors import needed_by
from synthnet.mesh.geometry import MeshFacts
from synthnet.spectrum import bending, curved, delaunay, fem
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.inputs import as_mesh
from synthnet.types import Mesh

BOUNDARIES = ("neumann", "dirichlet")
SHARES = {"consistent": 1.0, "mean": 0.5, "lumped": 0.0}  # of the consistent mass in each
MASSES = {
    "linear": tuple(SHARES),
    "quadratic": ("consistent",),
    "curved": ("consistent",),
    "delaunay": tuple(SHARES),
    "tufted": ("lumped",),
}


def _is_among(name: Any, names: Collection[str]) -> bool:
    """Return whether it is one of these names; a list, which has no hash, is none."""
    return isinstance(name, str) and name in names


@dataclass(frozen=True, slots=True, eq=False)
class Operator:
    r"""Which discrete operator of a mesh.

    Parameters
    ----------
    boundary : str or array_like of shape (n,), bool
        ``"neumann"``: the natural condition, no flow across a boundary. ``"dirichlet"``: functions
        are zero on the whole boundary, that is on edges of one face. A mask: they are zero at these
        vertices, and on edges between two of them; Neumann on the rest.
    mass : str, optional
        Of linear elements ``"consistent"`` (the default), ``"lumped"`` (its row sums, a diagonal
        matrix) or ``"mean"`` of both, whose errors have opposite signs. Quadratic and curved
        elements have the consistent one only, the tufted cover the lumped one only.
    elements : str
        ``"linear"``: as labels have, errors of order :math:`h^2`. ``"quadratic"``: with unknowns on
        edges too, on the same flat triangles; :math:`h^4` where these are the surface.
        ``"curved"``: quadratic on triangles that are bent to the surface through the vertices, see
        :mod:`synthnet.spectrum.curved`; :math:`h^4` on spheres and on smooth regular meshes, too.
        ``"delaunay"``: linear on the intrinsic Delaunay triangulation of the same flat triangles,
        see :mod:`synthnet.spectrum.delaunay`: for thin triangles, and where no entry of the
        stiffness off the diagonal may be positive.
        ``"tufted"``: linear on the intrinsic Delaunay triangulation of the tufted cover, for meshes
        that are no manifold or have thin or flat triangles; by ``robust_laplacian``.

    Raises
    ------
    ValueError
        If a name is unknown, or the elements have no such mass.

    Examples
    --------
    >>> Operator(boundary="dirichlet", mass="lumped")
    Operator(boundary='dirichlet', mass='lumped', elements='linear')
    """

    boundary: Literal["neumann", "dirichlet"] | Booleans = "neumann"
    mass: Literal["consistent", "mean", "lumped"] | None = None
    elements: Literal["linear", "quadratic", "curved", "delaunay", "tufted"] = "linear"

    def __post_init__(self) -> None:
        """Check the names; put the elements' own mass where none is given."""
        if isinstance(self.boundary, str) and self.boundary not in BOUNDARIES:
            raise ValueError(
                f"no boundary condition {self.boundary!r}: {_listed(BOUNDARIES)}, or a mask"
            )
        if not _is_among(self.elements, MASSES):
            raise ValueError(f"no elements {self.elements!r}: {_listed(MASSES)}")
        masses = MASSES[self.elements]
        if self.mass is None:
            object.__setattr__(self, "mass", masses[0])
        elif not _is_among(self.mass, SHARES):
            raise ValueError(f"no mass {self.mass!r}: {_listed(SHARES)}")
        elif self.mass not in masses:
            raise ValueError(f"{self.elements} elements have no {self.mass} mass: {masses[0]} only")

    def check_repairs(self, repairs: Mapping[str, int]) -> None:
        """Check that a mask, if there is one, is still of the vertices of a repaired mesh.

        Raises
        ------
        ValueError
            If anything was repaired: vertices may have other numbers since.
        """
        if repairs and not isinstance(self.boundary, str):
            done = ", ".join(f"{count} {name}" for name, count in repairs.items())
            raise ValueError(
                f"the mesh was repaired ({done}), and a mask is of the vertices as they were: "
                "repair it first by synthnet.mesh.repair.repair(mesh), and give a mask of what "
                "comes out"
            )

    @property
    def share(self) -> float:
        """The share of the consistent mass; the rest is lumped."""
        return SHARES[str(self.mass)]

    @property
    def on_edges(self) -> bool:
        """Whether edges have unknowns, too."""
        return self.elements in ("quadratic", "curved")


PLAIN = Operator()


def check_operator(operator: Any) -> None:
    """Check that an operator is an :class:`Operator`.

    Raises
    ------
    ValueError
        If it is anything else, such as the name of one.
    """
    if isinstance(operator, Operator):
        return
    named: dict[str, Collection[str]] = {"boundary": BOUNDARIES, "mass": SHARES, "elements": MASSES}
    meant = [field for field, names in named.items() if _is_among(operator, names)]
    given = repr(operator) if isinstance(operator, str) else type(operator).__name__
    remedy = f"{meant[0]}={operator!r}" if meant else 'boundary="dirichlet"'
    raise ValueError(f"operator must be an Operator, such as Operator({remedy}), got {given}")


class Discrete(NamedTuple):
    """An operator of a mesh as matrices.

    Attributes
    ----------
    matrices : Matrices
        Of the m unknowns that are free. The first ones are values at vertices.
    free : ndarray of shape (m,), int64, or None
        Their numbers among all unknowns; None if all are free.
    vertices : int
        n, the vertices of the mesh.
    condition : float
        Of other than linear elements: the relative error of an element's area, in rounding units.
    entries : ndarray of shape (m,), float64, or None
        Of each unknown, to what the rounding errors of its elements' entries of A are relative: at
        least the sum of these elements' traces. None for linear elements, see
        :mod:`synthnet.spectrum.rounding`.
    """

    matrices: Matrices
    free: Int64s | None
    vertices: int
    condition: float = 1.0
    entries: Floats | None = None

    def at_vertices(self, rows: Floats) -> Floats:
        """Return functions (c, m) at the vertices, (c, n): zero where they are held."""
        if self.free is None:
            return rows if rows.shape[1] == self.vertices else rows[:, : self.vertices].copy()
        values = np.zeros((len(rows), self.vertices))
        there = self.free < self.vertices
        values[:, self.free[there]] = rows[:, there]
        return values


def discretise(mesh: Any, operator: Operator = PLAIN) -> Discrete:
    """Return an operator of a mesh as matrices, without a warning of a mesh that is no surface.

    Parameters
    ----------
    mesh : Mesh or other
        As of :func:`synthnet.spectrum.compute`, of n vertices.
    operator : Operator
        Which.

    Raises
    ------
    ValueError
        If it is no mesh, or the operator no :class:`Operator`; if there are no triangles, a
        coordinate is not finite, the size has no square in float64, a triangle has no area (but
        under the tufted cover), or a vertex no triangle; if an edge of more than two faces has no
        intrinsic triangulation; if a mask does not fit, everything is held, or a closed mesh is to
        be held at its boundary.
    MissingPackageError
        If the tufted cover is asked for and robust_laplacian is not installed.
    """
    mesh = as_mesh(mesh)
    check_operator(operator)
    fem.check_used(mesh)
    n = len(mesh.vertices)
    matrices, condition = _assembled(mesh, operator)
    entries = None
    if operator.elements != "linear":
        diagonal = matrices.stiffness[_on_diagonal(matrices.indptr, matrices.indices)]
        entries = np.add.reduceat(diagonal[matrices.indices], matrices.indptr[:-1])
    if isinstance(operator.boundary, str) and operator.boundary == "neumann":
        return Discrete(matrices, None, n, condition, entries)
    held = np.concatenate(_held(operator.boundary, mesh))[: len(matrices.lumped)]
    if not held.any():
        return Discrete(matrices, None, n, condition, entries)
    if held.all():
        raise ValueError("every unknown is held at zero: nothing is left to solve")
    free = np.flatnonzero(~held)
    left = None if entries is None else entries[free]
    return Discrete(_without(matrices, held), free, n, condition, left)


def _assembled(mesh: Mesh, operator: Operator) -> tuple[Matrices, float]:
    """Return the matrices of all unknowns, and their condition, see :class:`Discrete`.

    From two edges, an area is computed with an error of rounding units times the longest edge over
    the altitude. Of the tufted cover nothing is known but its matrices.
    """
    if operator.elements == "tufted":
        return _tufted(mesh), 1.0
    if operator.elements == "linear":
        return _with_mass(fem.assemble(*fem.as_arrays(mesh)), operator.share), 1.0
    if operator.elements == "delaunay":
        matrices, condition = delaunay.assemble(mesh)
        return _with_mass(matrices, operator.share), condition
    bent = operator.elements == "curved"
    matrices = curved.quadratic(bending.bend(mesh) if bent else bending.straight(mesh))
    thinnest = 1 / float(MeshFacts(mesh).relative_altitudes.min())  # none is flat: that is refused
    return matrices, thinnest / (curved.FLATTEST if bent else 1.0)


def fem_matrices(mesh: Any) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    r"""Assemble stiffness and consistent mass of linear finite elements.

    .. math::
        A_{ij} = \int_S \nabla\varphi_i \cdot \nabla\varphi_j,
        \qquad B_{ij} = \int_S \varphi_i \varphi_j

    With :math:`e_i` the edge opposite corner i and :math:`|T|` the area, a triangle adds
    :math:`e_i \cdot e_j / 4|T|` to A and :math:`|T| (1 + \delta_{ij}) / 12` to B. No
    boundary term is added: the natural (Neumann) condition holds on a boundary. These
    are the matrices of ``lapy.Solver(..., lump=False)``.

    Parameters
    ----------
    mesh : Mesh or other
        As of :func:`synthnet.spectrum.compute`, of n vertices.

    Returns
    -------
    stiffness, mass : csc_matrix of shape (n, n), float64
        Symmetric; the mass is in length², the stiffness has no unit.

    Raises
    ------
    ValueError
        If it is no mesh, there are no triangles, a coordinate is not finite, the size has no square
        in float64, a triangle has no area, or a vertex no triangle.

    References
    ----------
    M. Reuter, F.-E. Wolter, N. Peinecke, "Laplace-Beltrami spectra as 'Shape-DNA' of
    surfaces and solids", Computer-Aided Design 38 (2006).

    Examples
    --------
    >>> stiffness, mass = fem_matrices(Mesh(np.eye(3), np.array([[0, 1, 2]])))
    >>> round(float(mass.sum() ** 2), 9)  # the square of the area, √3 / 2
    0.75
    >>> bool(abs(stiffness.sum(axis=0)).max() < 1e-15)  # constants are in its kernel
    True
    """
    return as_sparse(discretise(mesh).matrices)


def as_sparse(matrices: Matrices) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    """Return stiffness and mass as matrices of SciPy, with arrays of their own."""
    shape = (len(matrices.lumped),) * 2
    stiffness, mass = (
        sparse.csc_matrix((values, matrices.indices, matrices.indptr), shape=shape, copy=True)
        for values in (matrices.stiffness, matrices.mass)
    )
    return stiffness, mass


def _on_diagonal(indptr: Int32s, indices: Int32s) -> Booleans:
    """Return which entries of a sparse matrix of compressed rows are on its diagonal."""
    rows = np.repeat(np.arange(len(indptr) - 1), np.diff(indptr))
    return np.asarray(rows == indices)


def _with_mass(matrices: Matrices, share: float) -> Matrices:
    """Return matrices of so much consistent and the rest lumped mass."""
    if share == 1:
        return matrices
    mass = share * matrices.mass
    mass[_on_diagonal(matrices.indptr, matrices.indices)] += (1 - share) * matrices.lumped
    return matrices._replace(mass=mass, least=share * matrices.least + 1 - share)


def _tufted(mesh: Mesh) -> Matrices:
    """Return the matrices of ``robust_laplacian``, whose mass is a diagonal."""
    with needed_by("the tufted Laplacian"):
        import robust_laplacian

    laplacian, weights = robust_laplacian.mesh_laplacian(
        np.ascontiguousarray(mesh.vertices, dtype=np.float64),
        np.ascontiguousarray(mesh.faces, dtype=np.int64),
    )
    lumped = weights.diagonal()
    if not (lumped > 0).all():
        raise ValueError("some vertex has no area even on the tufted cover: merge vertices first")
    whole = sparse.csr_array(laplacian + laplacian.T)
    whole.sort_indices()
    diagonal = _on_diagonal(whole.indptr, whole.indices)
    return Matrices(
        whole.indptr.astype(np.int32),
        whole.indices.astype(np.int32),
        whole.data / 2,
        np.where(diagonal, lumped[whole.indices], 0.0),
        lumped,
        least=1.0,
    )


def _held(boundary: str | Booleans, mesh: Mesh) -> tuple[Booleans, Booleans]:
    """Return which vertices and which edges are held at zero."""
    n = len(mesh.vertices)
    edges, rims = bending.edges_and_rims(mesh)
    if isinstance(boundary, str):
        if not rims.any():
            raise ValueError("the mesh is closed: it has no boundary where functions could be zero")
        vertices = np.zeros(n, dtype=np.bool_)
        vertices[edges[rims]] = True
        return vertices, rims
    mask = np.asarray(boundary)
    if mask.dtype != np.bool_ or mask.shape != (n,):
        raise ValueError(
            f"a mask of vertices must be bool of shape ({n},), got {mask.dtype} of {mask.shape}"
        )
    return mask, mask[edges[:, 0]] & mask[edges[:, 1]]


def _without(matrices: Matrices, held: Booleans) -> Matrices:
    """Return the matrices of the unknowns that are not held."""
    size = len(held)
    entries = sparse.csr_array(
        (np.arange(1, len(matrices.indices) + 1), matrices.indices, matrices.indptr),
        shape=(size, size),
    )
    free = np.flatnonzero(~held)
    kept = entries[free]
    anchored = np.add.reduceat(held[kept.indices], kept.indptr[:-1]) > 0
    kept = kept[:, free]
    kept.sort_indices()
    return Matrices(
        kept.indptr.astype(np.int32),
        kept.indices.astype(np.int32),
        matrices.stiffness[kept.data - 1],
        matrices.mass[kept.data - 1],
        matrices.lumped[free],
        matrices.least,
        anchored,
    )


def _listed(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names))
