"""The frozen types that travel from a recipe to a stored sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Floats

Vertices: TypeAlias = NDArray[np.floating[Any]]
Faces: TypeAlias = NDArray[np.integer[Any]]
Parameters: TypeAlias = Mapping[str, float | int | str]

SPLITS = ("train", "validation", "test")
PROTOCOLS = ("grouped", "paper")


@dataclass(frozen=True, slots=True)
class Mesh:
    """A triangle mesh.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3), float32 or float64
        Coordinates in the mesh's own unit of length: in 1.0 a radius or width of the primitive.
    faces : ndarray of shape (m, 3), integer
        Vertex numbers of each triangle, counter-clockwise seen from outside.

    Raises
    ------
    ValueError
        If a shape or dtype is wrong, or a face names a vertex that is not there.

    Examples
    --------
    >>> import numpy as np
    >>> mesh = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    >>> mesh.vertices.shape, mesh.faces.shape
    ((3, 3), (1, 3))
    """

    vertices: Vertices
    faces: Faces

    def __post_init__(self) -> None:
        """Check shapes, dtypes and vertex numbers."""
        for name, array, kind in (("vertices", self.vertices, "f"), ("faces", self.faces, "iu")):
            if not isinstance(array, np.ndarray):
                raise ValueError(f"{name} must be a NumPy array, got {type(array).__name__}")  # noqa: TRY004 - one kind of error for all bad meshes
            if array.ndim != 2 or array.shape[1] != 3:
                raise ValueError(f"{name} must have shape (n, 3), got {array.shape}")
            if array.dtype.kind not in kind:
                required = "floating point" if kind == "f" else "integer"
                raise ValueError(f"{name} must be {required}, got {array.dtype}")
        if self.faces.size and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise ValueError(
                f"faces must name vertices 0 to {len(self.vertices) - 1}, "
                f"got {self.faces.min()} to {self.faces.max()}"
            )

    def stored(self) -> Mesh:
        """Return the mesh at the precision of the store: float32 and int32."""
        return Mesh(self.vertices.astype(np.float32), self.faces.astype(np.int32))


@dataclass(frozen=True, slots=True)
class Topology:
    """What kind of surface a mesh is.

    Parameters
    ----------
    euler_characteristic : int
        V − E + F.
    boundaries : int
        Number of closed curves the boundary consists of; 0 for a closed surface.
    orientable : bool
        Whether the surface has two sides.
    """

    euler_characteristic: int
    boundaries: int = 0
    orientable: bool = True


@dataclass(frozen=True, slots=True)
class ShapeSpec:
    """One drawn shape: everything its mesh is a function of.

    Parameters
    ----------
    id : str
        ``family-index``, e.g. ``cone-00042``; the same in every subset of a version.
    family : str
        A key of :data:`synthnet.families.FAMILIES`.
    index : int
        Number of the draw within the family, from 0.
    parameters : mapping of str to float or int
        Arguments of the family's generator.
    group : str
        Hash of what makes two shapes the same shape; copies never cross a split.
    """

    id: str
    family: str
    index: int
    parameters: Parameters
    group: str


@dataclass(frozen=True, slots=True)
class Certificate:
    """A proof that a spectrum is complete, see :func:`synthnet.spectrum.compute`.

    Parameters
    ----------
    count : int
        Eigenvalues below the shift, the trivial zero included, by the law of inertia; it
        equals the number computed.
    shift : float
        Where they were counted, in 1/length²: in a gap above the last eigenvalue of the
        label and those that agree with it to rounding.
    residual : float
        Largest relative residual of the pairs below the shift: the relative distance
        within which each has an eigenvalue of the matrices.
    error_bound : ndarray of shape (k,), float64, or None
        How far each eigenvalue is at most from that of the mesh in exact arithmetic, in 1/length²:
        rounding of the matrices, which the residual cannot see, is counted; of other than linear
        elements to first order, see :func:`synthnet.spectrum.rounding.of_matrices`. Infinite where
        rounding leaves nothing that could be proved. None for labels that are read from a store.
    zeros : int or None
        How many of those counted are zero: one for each component in which nothing is held at zero.
        None where that is not known: for labels that are read from a store.
    """

    count: int
    shift: float
    residual: float
    error_bound: Floats | None = field(default=None, compare=False)
    zeros: int | None = field(default=None, compare=False)


@dataclass(frozen=True, slots=True)
class Spectrum:
    r"""The smallest eigenpairs of :math:`A\varphi = \lambda B\varphi` on a mesh.

    Parameters
    ----------
    eigenvalues : ndarray of shape (k,), float64
        The k eigenvalues after the zero of each component, ascending, in 1/length².
    trivial : float
        The computed value of the zero eigenvalue of the constant function; NaN where functions are
        held at zero.
    certificate : Certificate
        Proof that no eigenvalue was missed.
    eigenvectors : ndarray of shape (n, k), float64
        Eigenfunctions at the vertices, orthonormal in the mass matrix.
    components : int
        Connected components of the mesh: as many eigenvalues are zero. Where functions are held at
        zero, the components of what is free, and ``certificate.zeros`` of them have a zero.
    mesh : Mesh or None
        The mesh that was solved, where ``compute`` was asked to repair what it was given.
    repairs : mapping of str to int
        How many vertices or faces each repair met, by its name.
    """

    eigenvalues: Floats
    trivial: float
    certificate: Certificate
    eigenvectors: Floats = field(repr=False)
    components: int = 1
    mesh: Mesh | None = field(default=None, repr=False, compare=False)
    repairs: Mapping[str, int] = field(default_factory=dict, repr=False, compare=False)


@dataclass(frozen=True, slots=True)
class Sample:
    """A labelled shape as it is stored.

    Parameters
    ----------
    spec : ShapeSpec
        What was drawn.
    mesh : Mesh
        float32 vertices and int32 faces.
    eigenvalues : ndarray of shape (k,), float64
        The label: eigenvalues after the trivial zero, in 1/length².
    trivial : float
        The computed value of the zero eigenvalue.
    certificate : Certificate
        Proof that the label misses no eigenvalue.
    isometries : ndarray of shape (c, 3, 3), float64
        Orthogonal matrices of the instances; the first is the identity.
    split : str
        Split of the shape under the protocol ``grouped``.
    paper_splits : tuple of c str
        Split of each instance under the protocol ``paper``.
    """

    spec: ShapeSpec
    mesh: Mesh
    eigenvalues: Floats
    trivial: float
    certificate: Certificate
    isometries: Floats
    split: str
    paper_splits: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Rejection:
    """A shape that a filter refused: its id, family, the check's name and the finding."""

    id: str
    family: str
    reason: str
    detail: str


@dataclass(frozen=True, slots=True)
class ShardRecord:
    """A finished shard: what the manifest keeps of it."""

    file: str
    family: str
    sha256: str
    size: int
    rows: int
    vertices: int
    faces: int
    rejections: tuple[Rejection, ...]


@dataclass(frozen=True, slots=True)
class Manifest:
    """The table of contents of a built dataset, the last file a build writes.

    Parameters
    ----------
    version : str
        Version of the dataset, e.g. ``1.0-mini``.
    recipe_digest : str
        SHA-256 of the resolved recipe.
    recipe : mapping
        The resolved recipe itself.
    drawn : mapping of str to int
        Shapes drawn by family.
    shards : tuple of ShardRecord
        In order of family and index.
    packages : mapping of str to str
        Versions of the packages that made the data.
    """

    version: str
    recipe_digest: str
    recipe: Mapping[str, Any]
    drawn: Mapping[str, int]
    shards: tuple[ShardRecord, ...]
    packages: Mapping[str, str]

    @property
    def rejections(self) -> tuple[Rejection, ...]:
        """All refused shapes, in order of id."""
        return tuple(r for shard in self.shards for r in shard.rejections)

    @property
    def rows(self) -> int:
        """Number of shapes kept."""
        return sum(shard.rows for shard in self.shards)
