r"""Patches cut into smaller ones where an edge is too long; the surface stays as it is.

A patch of :mod:`synthnet.spectrum.bending` is a quadratic map of a flat triangle, so each triangle
cut out of that is a patch again: with d the difference of an edge's ends in barycentric coordinates
and :math:`r_{ij}` the rises of the patch's sides, the rise of that edge is
:math:`-\sum_{i<j} d_i d_j r_{ij}`.

Each edge is cut or not by itself, so long triangles are cut across and not along. What is made of a
patch depends on lengths alone: a mesh that is turned, reflected or numbered anew is cut in the same
way.
"""

from collections.abc import Iterator

import numpy as np

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.spectrum import bending
from synthnet.spectrum.bending import Patches

Pattern = tuple[tuple[int, int, int], ...]  # the patches that become of one

# Corners of a patch are 0, 1 and 2, the middles of its sides 3, 4 and 5, the first from 0 to 1.
WHOLE: Pattern = ((0, 1, 2),)
ONE: Pattern = ((0, 3, 2), (3, 1, 2))  # side 0 is cut
THREE: Pattern = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))
# Sides 0 and 1 are cut. What is left beside corner 1 has a shorter diagonal, from 0 to 4 or from
# 3 to 2; where both are as long, it is cut to both from the middle of 3 and 4, which is 6.
FROM_CORNER: Pattern = ((3, 1, 4), (0, 3, 4), (0, 4, 2))
FROM_SIDE: Pattern = ((3, 1, 4), (0, 3, 2), (3, 4, 2))
FROM_MIDDLE: Pattern = ((3, 1, 6), (6, 1, 4), (0, 3, 6), (6, 4, 2), (0, 6, 2))
MIDDLE = np.array([1.0, 2.0, 1.0]) / 4
POINTS = np.vstack([np.eye(3), (np.eye(3) + np.roll(np.eye(3), 1, axis=1)) / 2, MIDDLE])
EQUAL_SIDES = 3**0.5 / 2  # the side of a triangle of equal sides over the diameter of its circle
WIDEST = 4.0  # times its longest side: a thin patch between good ones bends nothing else
FEW = 0.01  # of the patches
AS_LONG = 1e-6  # relative, between two lengths of which rounding must not choose one


def shorten(patches: Patches, longest: float, most: int) -> Patches:
    """Cut edges until none is too long, or there are twice the vertices; the longest come first.

    Parameters
    ----------
    patches : Patches
    longest : float
        As :func:`too_long` has it, in length.
    most : int
        Number of vertices; where a cut needs more, it is not made.

    Returns
    -------
    Patches
        The same object if nothing is cut.
    """
    start = len(patches.vertices)
    while len(patches.vertices) < 2 * start and len(over := too_long(patches, longest)):
        least = (0.5 + AS_LONG) * over.max()
        while least > 1 and np.count_nonzero(over > least) < start / 4:
            least /= 2
        finer = split(patches, over > max(least, 1.0))
        if len(finer.vertices) > most:
            break
        patches = finer
    return patches


def too_long(patches: Patches, longest: float) -> Floats:
    """Return how many times too long each edge is, (e,); nothing at all if none is.

    Linear functions are as far off on a triangle as it is wide around: by the diameter of the
    circle through its corners, which is much longer than its sides where an angle is obtuse. The
    longest side counts as long as that of the triangle of equal sides with such a circle; but where
    only a few patches are too wide, and none of their sides is too long, they do no harm.
    """
    edges = patches.vertices[patches.ends[:, 1]] - patches.vertices[patches.ends[:, 0]]
    lengths = np.sqrt((edges**2).sum(axis=1))
    sides = lengths[patches.sides]
    most = sides.max(axis=1)
    across = np.cross(edges[patches.sides[:, 0]], edges[patches.sides[:, 1]])
    with np.errstate(divide="ignore"):
        widths = EQUAL_SIDES * sides.prod(axis=1) / np.linalg.norm(across, axis=1)
    widths = np.minimum(widths, WIDEST * most)
    if lengths.max() <= longest and np.count_nonzero(widths > longest) <= FEW * len(widths):
        return np.empty(0)
    # Each side that is the longest one: rounding must choose none
    patch, side = np.nonzero(sides >= (1 - AS_LONG) * most[:, None])
    np.maximum.at(lengths, patches.sides[patch, side], widths[patch])
    return np.asarray(lengths / longest)


def split(patches: Patches, cut: Booleans) -> Patches:
    """Cut edges in the middle of their arcs, and with them the patches that have them.

    Parameters
    ----------
    patches : Patches
        Of n vertices, m faces and e edges.
    cut : ndarray of shape (e,), bool
        Which edges are cut.

    Returns
    -------
    Patches
        The first n vertices are those that were there.
    """
    old = len(patches.vertices)
    vertices = np.concatenate(
        [patches.vertices, patches.vertices[patches.ends[cut]].mean(axis=1) + patches.rises[cut]]
    )
    middles = old + np.cumsum(cut) - 1
    parents, faces, rises = [], [], []
    for which, turn, pattern in _patterns(patches, vertices, middles, cut):
        own, sides = (
            np.roll(each[which], -turn, axis=1) for each in (patches.faces, patches.sides)
        )
        bent = patches.rises[sides]
        points = np.concatenate([own, middles[sides]], axis=1)
        if pattern is FROM_MIDDLE:
            new = np.arange(len(vertices), len(vertices) + len(which))
            points = np.column_stack([points, new])
            inside = MIDDLE @ vertices[own] + 4 * (MIDDLE * np.roll(MIDDLE, -1)) @ bent
            vertices = np.concatenate([vertices, inside])
        for part in pattern:
            corners = POINTS[list(part)]
            across = corners - np.roll(corners, -1, axis=0)  # d of each side
            parents.append(which)
            faces.append(points[:, part])
            rises.append(-(across * np.roll(across, -1, axis=1)) @ bent)
    order = np.argsort(np.concatenate(parents), kind="stable")
    numbers = np.concatenate(faces)[order].astype(np.int32)
    ends, sides = bending.edges(numbers, len(vertices))
    on_edges = np.empty((len(ends), 3))
    on_edges[sides] = np.concatenate(rises)[order]
    return Patches(vertices, numbers, ends, sides, on_edges)


def _patterns(
    patches: Patches, vertices: Floats, middles: Int64s, cut: Booleans
) -> Iterator[tuple[Int64s, int, Pattern]]:
    """Yield patches, how far each is turned, and what becomes of them then."""
    cuts = cut[patches.sides]
    count = cuts.sum(axis=1)
    yield np.flatnonzero(count == 0), 0, WHOLE
    yield np.flatnonzero(count == 3), 0, THREE
    for turn in range(3):
        after, before = (turn + 1) % 3, (turn + 2) % 3
        yield np.flatnonzero((count == 1) & cuts[:, turn]), turn, ONE
        pairs = np.flatnonzero((count == 2) & ~cuts[:, before])
        faces, sides = patches.faces[pairs], middles[patches.sides[pairs]]
        from_corner = np.linalg.norm(vertices[faces[:, turn]] - vertices[sides[:, after]], axis=1)
        from_side = np.linalg.norm(vertices[sides[:, turn]] - vertices[faces[:, before]], axis=1)
        alike = np.isclose(from_corner, from_side, rtol=AS_LONG, atol=0.0)
        yield pairs[alike], turn, FROM_MIDDLE
        yield pairs[~alike & (from_corner < from_side)], turn, FROM_CORNER
        yield pairs[~alike & (from_corner > from_side)], turn, FROM_SIDE
