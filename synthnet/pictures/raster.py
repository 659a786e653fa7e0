"""Pictures of triangle meshes: a depth buffer in main memory, so no display and no GPU is needed.

A picture is an orthographic view. Each pixel knows the triangle that is nearest to the viewer
and where in it the pixel's middle lies; shade, colour, edges and contours follow from these.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.kernels import kernel
from synthnet.types import Mesh

SAMPLES = 3  # in a pixel's width: what is drawn is the mean of nine
MARGIN = 0.04  # so much of the picture's smaller side is left free all around
SURFACE = (0.62, 0.79, 0.92)
# Okabe and Ito's blue and orange differ for colour-blind readers too, and in grey by lightness.
NEGATIVE, POSITIVE = (0.0, 0.447, 0.698), (0.902, 0.624, 0.0)
INK = (0.13, 0.15, 0.18)
LIGHT = np.array([-0.48, 0.60, 0.64])  # to the right, up, to the viewer; of length 1
DARKEST, DARKEST_COLOUR = 0.3, 0.62  # shade of what turns away from the light; colours stay light
EDGE_WIDTH, CONTOUR_WIDTH, OUTLINE_WIDTH = 0.7, 1.2, 1.0  # pixels
CLEAR = 7.0  # pixels: altitude of a triangle whose edges are drawn in full; smaller ones' fade
JUMP = 0.06  # of the surface's extent: a step of depth that is outlined
TOLERANCE = 1e-9  # of a triangle: no pixel on a common edge may fall between two triangles


@dataclass(frozen=True, slots=True)
class View:
    """Where the viewer is, in degrees: above the plane of x and y, and around z from x."""

    elevation: float = 24.0
    azimuth: float = -35.0

    def axes(self) -> Floats:
        """Return the unit vectors to the right, up and to the viewer, as rows."""
        up, around = np.radians(self.elevation), np.radians(self.azimuth)
        right = [-np.sin(around), np.cos(around), 0.0]
        viewer = [np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)]
        return np.array([right, np.cross(viewer, right), viewer])


def view_of(mesh: Mesh) -> View:
    """Return a view that shows a mesh well: the flatter it lies, the more from above."""
    extent = np.ptp(mesh.vertices.astype(np.float64), axis=0)
    flatness = 1 - min(1.0, float(extent[2] / max(0.35 * extent[:2].max(), 1e-300)))
    return View(elevation=24.0 + 41.0 * flatness)


def render(
    mesh: Mesh,
    width: int,
    height: int,
    *,
    view: View | None = None,
    values: Floats | None = None,
    edges: bool = False,
    transparent: bool = False,
) -> NDArray[np.uint8]:
    """Draw a mesh on white or on nothing, as large as there is room for.

    Both sides of a triangle look the same, so a surface need not be oriented, nor have two
    sides. The same arguments give the same picture.

    Parameters
    ----------
    mesh : Mesh
        Any triangles.
    width, height : int
        Size of the picture in pixels.
    view : View, optional
        Where from; chosen by :func:`view_of` if not given.
    values : ndarray of shape (n,), optional
        A function at the vertices, drawn in blue where it is negative, white at zero and
        orange where it is positive, with a line at zero. Its largest magnitude is the end
        of the colours.
    edges : bool
        Whether to draw the edges of the triangles; they fade where triangles get small.
    transparent : bool
        Whether there is nothing behind the mesh, in place of white.

    Returns
    -------
    ndarray of shape (height, width, 3), uint8
        Red, green and blue; and how opaque it is, if ``transparent``.

    Raises
    ------
    ValueError
        If there is no triangle, a coordinate or value is not finite, there is not one value a
        vertex, or the picture has no pixel.

    Examples
    --------
    >>> triangle = Mesh(np.eye(3), np.array([[0, 1, 2]]))
    >>> picture = render(triangle, 40, 30)
    >>> picture.shape, bool((picture[0] == 255).all()), bool((picture[15, 20] < 255).all())
    ((30, 40, 3), True, True)
    """
    _check(mesh, width, height, values)
    axes = (view or view_of(mesh)).axes()
    vertices = mesh.vertices.astype(np.float64)
    vertices = (vertices - vertices.mean(axis=0)) @ axes.T
    points, scale = _on_screen(vertices, SAMPLES * width, SAMPLES * height)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int64)
    depth = np.full((SAMPLES * height, SAMPLES * width), -np.inf)
    owner = np.full(depth.shape, -1, dtype=np.int64)
    weights = np.zeros((*depth.shape, 3))
    _nearest(points, faces, depth, owner, weights)

    seen = owner >= 0
    face, weight = owner[seen], weights[seen]
    if values is None:
        colours = np.array(SURFACE) * _shades(vertices, faces, DARKEST)[face, None]
    else:
        at = values / max(float(np.abs(values).max()), 1e-300)
        colours = diverging((at[faces[face]] * weight).sum(axis=1))
        colours *= _shades(vertices, faces, DARKEST_COLOUR)[face, None]
        colours = _inked(colours, 0.75 * _contour(points, faces, at, face, weight))
    if edges:
        colours = _inked(colours, 0.6 * _edges(points, faces, face, weight))
    picture = np.ones((*depth.shape, 3))
    picture[seen] = colours
    outline = _outline(depth, JUMP * scale * float(np.ptp(vertices, axis=0).max()))
    picture[outline] = _inked(picture[outline], np.full(int(outline.sum()), 0.65))
    blocks = picture.reshape(height, SAMPLES, width, SAMPLES, 3).mean(axis=(1, 3))
    if transparent:
        samples = (seen | outline).reshape(height, SAMPLES, width, SAMPLES)
        blocks = _without_white(blocks, samples.mean(axis=(1, 3)))
    return np.asarray(np.round(255 * blocks), dtype=np.uint8)


def _without_white(picture: Floats, opaque: Floats) -> Floats:
    """Return a picture on white as one on nothing, from how much of each pixel is covered."""
    share = np.maximum(opaque, 1e-9)[..., None]
    colours = np.clip(1 - (1 - picture) / share, 0, 1)
    return np.concatenate([np.where(share > 1e-9, colours, 1.0), opaque[..., None]], axis=2)


def _check(mesh: Mesh, width: int, height: int, values: Floats | None) -> None:
    if min(width, height) < 1:
        raise ValueError(f"a picture has at least one pixel, got {width} x {height}")
    if not len(mesh.faces):
        raise ValueError("a mesh without triangles cannot be drawn")
    if not np.isfinite(mesh.vertices).all():
        raise ValueError("a mesh with a coordinate that is not finite cannot be drawn")
    if values is not None and values.shape != (len(mesh.vertices),):
        raise ValueError(f"values must have shape ({len(mesh.vertices)},), got {values.shape}")
    if values is not None and not np.isfinite(values).all():
        raise ValueError("a function with a value that is not finite cannot be drawn")


def _on_screen(vertices: Floats, width: int, height: int) -> tuple[Floats, float]:
    """Return x to the right, y down and depth to the viewer in pixels, and pixels a length."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    room = np.array([width, height]) - 2 * MARGIN * min(width, height)
    scale = float((room / np.maximum(high - low, 1e-300)[:2]).min())
    points = (vertices - (low + high) / 2) * [scale, -scale, scale]
    points[:, :2] += np.array([width, height]) / 2
    return points, scale


@kernel
def _nearest(
    points: Floats,
    faces: Int64s,
    depth: Floats,
    owner: Int64s,
    weights: Floats,
) -> None:
    """Set each pixel's depth, triangle and barycentric weights to those of the nearest one."""
    height, width = depth.shape
    for f in range(faces.shape[0]):
        a, b, c = points[faces[f, 0]], points[faces[f, 1]], points[faces[f, 2]]
        doubled = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if doubled == 0:  # it is seen from its edge
            continue
        left = max(0, int(np.ceil(min(a[0], b[0], c[0]) - 0.5)))
        right = min(width - 1, int(np.floor(max(a[0], b[0], c[0]) - 0.5)))
        top = max(0, int(np.ceil(min(a[1], b[1], c[1]) - 0.5)))
        bottom = min(height - 1, int(np.floor(max(a[1], b[1], c[1]) - 0.5)))
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                x = column + 0.5
                u = ((b[0] - x) * (c[1] - y) - (c[0] - x) * (b[1] - y)) / doubled
                v = ((c[0] - x) * (a[1] - y) - (a[0] - x) * (c[1] - y)) / doubled
                w = 1 - u - v
                if min(u, v, w) < -TOLERANCE:
                    continue
                z = u * a[2] + v * b[2] + w * c[2]
                if z > depth[row, column]:
                    depth[row, column] = z
                    owner[row, column] = f
                    weights[row, column, 0] = u
                    weights[row, column, 1] = v
                    weights[row, column, 2] = w


def _shades(vertices: Floats, faces: Int64s, darkest: float) -> Floats:
    """Return the shade of each triangle, its normal turned to the viewer, up to 1."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    normals[normals[:, 2] < 0] *= -1
    shades: Floats = darkest + (1 - darkest) * (1 + normals @ LIGHT) / 2
    return shades


def diverging(values: Floats) -> Floats:
    """Return the colours (p, 3) of p values from −1 to 1: blue, white at zero, orange.

    Examples
    --------
    >>> diverging(np.array([0.0, 1.0])).tolist()
    [[1.0, 1.0, 1.0], [0.902, 0.624, 0.0]]
    """
    ends = np.where(values[:, None] < 0, NEGATIVE, POSITIVE)
    colours: Floats = 1 - np.abs(values)[:, None] * (1 - ends)
    return colours


def _sides(points: Floats, faces: Int64s) -> tuple[Floats, Floats]:
    """Return each triangle's sides on the screen, (m, 3, 2), and twice its area there, (m,)."""
    corners = points[faces][:, :, :2]
    sides = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]
    return sides, np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])


def _edges(
    points: Floats,
    faces: Int64s,
    face: Int64s,
    weight: Floats,
) -> Floats:
    """Return how much ink each seen pixel gets from the edges of its triangle."""
    sides, doubled = _sides(points, faces)
    altitudes = doubled[:, None] / np.maximum(np.linalg.norm(sides, axis=2), 1e-300)
    away = (weight * altitudes[face]).min(axis=1)
    strength = np.clip(altitudes.min(axis=1) / (CLEAR * SAMPLES), 0, 1)
    return np.where(away < EDGE_WIDTH * SAMPLES / 2, strength[face], 0.0)


def _contour(
    points: Floats,
    faces: Int64s,
    values: Floats,
    face: Int64s,
    weight: Floats,
) -> Floats:
    """Return 1 for the seen pixels at the zero of a function that is linear on triangles.

    A value over the length of its gradient is how far on the screen the zero is, in the
    triangle or beside it: on fine meshes the line is wider than the triangles it crosses.
    """
    (sides, doubled), at = _sides(points, faces), values[faces]
    gradient = np.linalg.norm(np.einsum("mi,mix->mx", at, sides), axis=1)
    slope = gradient / np.maximum(doubled, 1e-300)
    value = np.abs((at[face] * weight).sum(axis=1))
    return np.asarray(value < slope[face] * CONTOUR_WIDTH * SAMPLES / 2, dtype=np.float64)


def _outline(depth: Floats, jump: float) -> Booleans:
    """Return the pixels beside which the surface ends, or begins again further back."""
    reach = max(1, round(OUTLINE_WIDTH * SAMPLES / 2))
    padded = np.pad(depth, reach, constant_values=-np.inf)
    height, width = depth.shape
    outline = np.zeros(depth.shape, dtype=np.bool_)
    for down, right in ((0, reach), (0, -reach), (reach, 0), (-reach, 0)):
        rows, columns = reach + down, reach + right
        beside = padded[rows : rows + height, columns : columns + width]
        outline |= depth > beside + jump
    return outline


def _inked(colours: Floats, ink: Floats) -> Floats:
    return colours * (1 - ink[:, None]) + np.array(INK) * ink[:, None]
