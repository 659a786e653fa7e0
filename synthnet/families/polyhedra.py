"""Atlases of surfaces of flat faces: the coordinates are the points themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from synthnet.arrays import Booleans, Floats
from synthnet.families.atlas import SAME, Atlas, glue_charts, rectangle, rows


def polyhedron(*faces: Floats, singular: Floats | None = None) -> Atlas:
    """Return the atlas of a polyhedron.

    Parameters
    ----------
    faces : ndarray of shape (p, 3, 3), each
        The patches of each flat face, or of faces in one plane.
    singular : ndarray of shape (c, 3), optional
        Corners to which a graded mesh is finer; see :class:`~synthnet.families.atlas.Atlas`.
    """
    corners, charts = glue_charts(faces)
    marked: Booleans | None = None
    if singular is not None:
        near = SAME * float(np.ptp(corners.reshape(-1, 3), axis=0).max())
        apart = np.linalg.norm(corners[:, :, None] - singular, axis=3)
        marked = (apart <= near).any(axis=2)
    return Atlas(corners, charts, lambda _, points: points, marked)


def flat(patches: Floats, height: float = 0.0, *, axis: int = 2, turned: bool = False) -> Floats:
    """Lift patches of the plane, (p, 3, 2), to a height; ``turned`` makes them face down.

    The plane is that of the two axes after ``axis``, in cyclic order.
    """
    points = np.full((*patches.shape[:2], 3), height, dtype=np.float64)
    points[..., [(axis + 1) % 3, (axis + 2) % 3]] = patches
    return points[:, ::-1] if turned else points


def prism(
    patches: Floats,
    outline: Floats,
    height: float,
    cell: float,
    walls: Sequence[int],
    inward: Floats,
) -> Atlas:
    """Return the atlas of the prism over a polygon.

    Parameters
    ----------
    patches : ndarray of shape (p, 3, 2)
        Triangles of the polygon, counter-clockwise; all corners on its outline are in
        ``outline``.
    outline : ndarray of shape (o, 2)
        The outline, counter-clockwise, every corner of a patch there included.
    height : float
        From z = 0 up.
    cell : float
        About the height of a row of patches of the walls; there are two at least.
    walls : sequence of o int
        Number of the wall that each piece of the outline belongs to; pieces in line are one.
    inward : ndarray of shape (c, 2)
        Corners of the outline that may turn inwards, no two of one patch.
    """
    heights = np.linspace(0, height, max(2, len(lines(height, cell)) - 1) + 1)
    faces = [flat(patches, 0.0, turned=True), flat(patches, height)]
    ahead = np.roll(outline, -1, axis=0)
    for wall in sorted(set(walls)):
        pieces = []
        for number in np.flatnonzero(np.array(walls) == wall):
            unit = rectangle(np.array([0.0, 1.0]), heights)
            along = unit[:, :, :1]
            base = np.where(along == 1, ahead[number], outline[number])
            pieces.append(np.concatenate([base, unit[:, :, 1:]], axis=2))
        faces.append(np.concatenate(pieces))
    ends = [np.column_stack([inward, np.full(len(inward), z)]) for z in (0.0, height)]
    return polyhedron(*faces, singular=np.concatenate(ends))


def lines(length: float, around: float) -> Floats:
    """Return equidistant coordinates from 0 to a length, about ``around`` apart."""
    return np.linspace(0, length, rows(length, around, most=6) + 1)
