"""Meshes whose operator is not that of the surface they look like: said in warnings.

The problem is well posed on each of them, and is solved as it stands. Several components are no
such case: :class:`synthnet.types.Spectrum` says how many there are, and leaves out their zeros.
But where sheets are only meant to be one surface, or one point holds two of them together, the
eigenvalues are of something else.
"""

import numpy as np

from synthnet.arrays import Floats, Int32s
from synthnet.errors import counted
from synthnet.kernels import kernel
from synthnet.spectrum import fem
from synthnet.spectrum.warned import warn
from synthnet.types import Mesh

JOINED = "compute(…, repair=True).mesh has equal corners joined"  # the ends of warnings
PARTED = "compute(…, repair=True).mesh has them parted"
COARSE = 0.01  # of an edge: rounding to less moves eigenvalues by a few ten-thousandths
FEW = 100  # faces, whose edges say how long edges are


def warn_of_sheets(mesh: Mesh, elements: str, stacklevel: int) -> None:
    """Warn of faces that share no vertex, of slits, of edges of many faces, and of pinches.

    Nothing is said where ``elements`` are those of the tufted cover, which takes any mesh as it is.
    ``stacklevel`` counts from here to the line that is warned: 2 is the one that calls this.
    """
    if elements == "tufted":
        return
    vertices, faces = fem.as_arrays(mesh)
    many, pinched, rims = edges_and_fans(faces, len(vertices))
    if len(vertices) == faces.size > 3:
        warn(
            f"no two of the {len(faces)} faces share a vertex, as in an STL file: each is a "
            f"component by itself; {JOINED}",
            stacklevel=stacklevel,
        )
    elif slit := slits(vertices, rims):
        warn(
            f"the surface is slit: {counted(slit, 'pair')} of edges with one face are at the same "
            f"position, and not joined; {JOINED}",
            stacklevel=stacklevel,
        )
    if many:
        warn(
            f"{counted(many, 'edge has', 'edges have')} more than two faces: eigenfunctions are "
            "those of all sheets joined there, which is no surface; `synthnet import` cuts where "
            'sheets are clearly pairs, compute with Operator(elements="tufted") takes the mesh as '
            "it is",
            stacklevel=stacklevel,
        )
    elif pinched:
        warn(
            f"{counted(pinched, 'vertex joins', 'vertices join')} sheets that share no edge there: "
            "eigenfunctions are those of sheets that touch in a point, which is no "
            f"surface; {PARTED}",
            stacklevel=stacklevel,
        )
    # The cheap questions first: every mesh is asked
    with np.errstate(over="ignore", invalid="ignore"):  # no single precision has such a size
        step = float(np.spacing(np.float32(np.abs(vertices).max())))
    edge = typical_edge(vertices, faces)
    if step > COARSE * edge and is_rounded(vertices, step):
        warn(
            f"coordinates are of single precision, {step:.3g} apart so far from the origin, and "
            f"edges only {edge:.3g} long: the surface is a rounded one; save it in double "
            "precision, or move it to the origin before it is saved",
            stacklevel=stacklevel,
        )


def is_rounded(vertices: Floats, step: float) -> bool:
    """Return whether coordinates were rounded to single precision, a step apart where largest.

    They were not if one is no such number, or all are multiples of a larger one, as on a grid of
    integers.

    Examples
    --------
    >>> corners = np.array([[1e6, 0.0, 0.0], [1e6 + 0.5, 0.0, 0.0], [1e6, 1.0, 0.0]])
    >>> [is_rounded(corners + x, 0.0625) for x in (0.0625, 0.0, 1e-3)]
    [True, False, False]
    """
    if not (vertices.astype(np.float32) == vertices).all():
        return False
    size = np.abs(vertices)
    largest = vertices[size >= size.max() / 2]  # they have this step, smaller ones a finer one
    return bool((largest % (2 * step)).any())


def typical_edge(vertices: Floats, faces: Int32s) -> float:
    """Return the median length of the edges of some faces."""
    corners = vertices[faces[:: len(faces) // FEW + 1]]
    ends = corners - corners[:, [1, 2, 0]]
    squares = np.sort(np.einsum("fcx,fcx->fc", ends, ends), axis=None)
    return float(np.sqrt(squares[len(squares) // 2]))


@kernel
def edges_and_fans(faces: Int32s, n: int) -> tuple[int, int, Int32s]:
    """Count edges of more than two faces, and vertices where several fans of faces meet.

    Parameters
    ----------
    faces : ndarray of shape (m, 3), int32
        Of n vertices.

    Returns
    -------
    many, pinched : int
        How many edges have more than two faces; at how many vertices the faces are not all
        connected by edges there.
    rims : ndarray of shape (e, 2), int32
        The ends of each edge of one face.
    """
    start, corners = fem.grouped(faces.ravel(), n)
    seen, valence, parent = np.full(n, -1, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    rims = np.empty((3 * faces.shape[0], 2), np.int32)
    many = pinched = count = 0
    for v in range(n):
        fans = 0
        for p in range(start[v], start[v + 1]):
            f, c = corners[p] // 3, corners[p] % 3
            ends = faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]
            for j in ends:
                if seen[j] != v:
                    seen[j], valence[j], parent[j] = v, 0, j
                    fans += 1
                valence[j] += 1
            a, b = ends
            while parent[a] != a:
                parent[a] = parent[parent[a]]
                a = parent[a]
            while parent[b] != b:
                parent[b] = parent[parent[b]]
                b = parent[b]
            if a != b:
                parent[a] = b
                fans -= 1
        pinched += fans > 1
        for p in range(start[v], start[v + 1]):
            f, c = corners[p] // 3, corners[p] % 3
            for j in (faces[f, (c + 1) % 3], faces[f, (c + 2) % 3]):
                if j > v and valence[j] == 1:
                    rims[count, 0], rims[count, 1] = v, j
                    count += 1
                many += j > v and valence[j] > 2
                valence[j] = 0
    return many, pinched, rims[:count]


def slits(vertices: Floats, rims: Int32s) -> int:
    """Return how many pairs of edges of one face, ends (e, 2), are at the same position.

    Where three are, they are no slit: joined, they would be no surface.
    """
    if not len(rims):
        return 0
    ends, number = np.unique(rims, return_inverse=True)
    position = np.unique(vertices[ends], axis=0, return_inverse=True)[1].ravel()
    if position.max() + 1 == len(ends):
        return 0
    edges = np.sort(position[number.reshape(-1, 2)], axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] == 2).sum())
