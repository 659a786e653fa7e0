"""Polygons cut into triangles: fans where these do, ears where a polygon is not convex.

All corners are kept, those in the middle of a straight side too: neighbours end there. That is why
the ears are cut here and not by a library for drawing, where such corners are dropped, as the
earcut algorithm does; the surface would be slit along the side.

References
----------
G. H. Meisters, "Polygons have ears", American Mathematical Monthly 82 (1975).
"""

import numpy as np

from synthnet.arrays import Booleans, Floats, Int64s
from synthnet.errors import SynthNetError

FLAT = 1e-9  # altitude / longest edge of an ear that has no area to speak of
# Of a polygon's size: how far sides that cross reach beyond each other. Rounding of float32 is 6e-8
DEEP = 1e-6


class PolygonError(SynthNetError):
    """A polygon that cannot be cut: ``number`` is its place in the file."""

    def __init__(self, number: int, detail: str) -> None:
        super().__init__(detail)
        self.number, self.detail = number, detail


def triangles(
    vertices: Floats,
    corners: Int64s,
    sizes: Int64s,
    numbers: Int64s,
) -> tuple[Int64s, int]:
    """Cut polygons into triangles: fans around their first corners, or ears.

    Parameters
    ----------
    vertices : ndarray of shape (n, 3), float64
        Positions.
    corners : ndarray of int64
        The corners of all polygons in a row.
    sizes, numbers : ndarray of shape (p,), int64
        How many corners each polygon has, at least 3, and its number in errors.

    Returns
    -------
    faces : ndarray of shape (m, 3), int64
        Triangles in the order of the polygons.
    clipped : int
        How many polygons are no fan, so that ears were cut.

    Raises
    ------
    PolygonError
        If a corner is no vertex, or a polygon crosses itself, seen along its normal. Polygons that
        name a vertex twice are fans, whatever their shape, but for those that have no such fan.

    Examples
    --------
    >>> arrow = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0.5, 0], [1, 2, 0]])
    >>> faces, clipped = triangles(arrow, np.array([1, 2, 3, 0]), np.array([4]), np.array([1]))
    >>> faces.tolist(), clipped
    ([[2, 3, 0], [1, 2, 0]], 1)
    """
    outside = (corners < 0) | (corners >= len(vertices))
    if outside.any():
        number = int(np.repeat(numbers, sizes)[outside.argmax()])
        raise PolygonError(number, f"a corner is none of the {len(vertices):,} vertices")
    many = sizes - 2
    polygon = np.repeat(np.arange(len(sizes)), many)
    starts = np.cumsum(many) - many
    step = 1 + np.arange(len(polygon)) - np.repeat(starts, many)
    begins = np.cumsum(sizes) - sizes
    first = begins[polygon]
    faces = corners[np.stack([first, first + step, first + step + 1], axis=1)]
    several = (many[polygon] > 1) & (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not several.any():
        return faces, 0
    wedges, of = vertices[faces[several]], polygon[several]
    turned = np.unique(of[_turned(wedges, of)])
    doubtful = np.union1d(turned, _wide(wedges, of))
    for i in doubtful[sizes[doubtful] > 4].tolist():  # one of four has no ears then
        if _crosses(_in_plane(vertices[corners[begins[i] : begins[i] + sizes[i]]])):
            raise PolygonError(
                int(numbers[i]), "a polygon that crosses itself: save it as triangles"
            )
    for i in turned.tolist():
        here = corners[begins[i] : begins[i] + sizes[i]]
        faces[starts[i] : starts[i] + many[i]] = here[_ears(vertices[here], int(numbers[i]))]
    return faces, len(turned)


def _turned(corners: Floats, polygon: Int64s) -> Booleans:
    """Return which triangles do not face as their polygon does, from corners (t, 3, 3).

    A polygon whose areas overflow has none: its size is for a rule of the repair.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    with np.errstate(over="ignore", invalid="ignore"):
        normals = np.cross(b - a, c - a)
        whole = np.stack([np.bincount(polygon, n) for n in normals.T], axis=1)
        facing: Floats = np.einsum("ij,ij->i", normals, whole[polygon])
        finite: Booleans = np.isfinite(np.bincount(polygon, facing))[polygon]
    return (facing <= 0) & finite


def _wide(corners: Floats, polygon: Int64s) -> Int64s:
    """Return the polygons whose fans open by more than half a turn, from corners (t, 3, 3).

    One that does not, and does not turn, cannot cross itself: its corners come one after the other
    around the first, as those of all convex polygons do.
    """
    a, b, c = np.moveaxis(corners, 1, 0)
    with np.errstate(over="ignore", invalid="ignore"):
        sines = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        angles = np.arctan2(sines, np.einsum("ij,ij->i", b - a, c - a))
    return np.flatnonzero(np.bincount(polygon, angles) > np.pi)


def _crosses(flat: Floats) -> bool:
    """Return whether two sides of a polygon of corners (c, 2) cross, and not only touch."""
    ends = np.roll(flat, -1, axis=0)
    least = DEEP * np.linalg.norm(np.ptp(flat, axis=0))
    for i in range(len(flat) - 2):
        a, b, c, d = flat[i], ends[i], flat[i + 2 :], ends[i + 2 :]
        if (_beside(a, b, c, d, least) & _beside(c, d, a, b, least)).any():
            return True
    return False


def _beside(
    start: Floats,
    end: Floats,
    first: Floats,
    second: Floats,
    least: np.floating,
) -> Booleans:
    """Return whether two points lie on either side of a line, each so far from it at the least."""
    side = end - start
    with np.errstate(invalid="ignore", divide="ignore"):
        length = np.linalg.norm(side, axis=-1)
        one, other = (_cross(side, point - start) / length for point in (first, second))
    apart: Booleans = (one * other < 0) & (np.minimum(abs(one), abs(other)) > least)
    return apart


def _ears(points: Floats, number: int) -> Int64s:
    """Return the triangles of a polygon, (c - 2, 3), the best ear cut first.

    ``points`` are its corners in their order, (c, 3); ``number`` is the polygon's, for the error.
    A corner at the position of the next makes a triangle without area, which a repair drops.
    """
    left, flat = list(range(len(points))), _in_plane(points)
    ears = list[tuple[int, ...]]()
    for at in reversed(range(len(points))):
        after = left[(at + 1) % len(left)]
        if len(left) > 3 and (points[at] == points[after]).all():
            ears.append((left[at - 1], at, after))
            del left[at]
    # Rounding puts some corners on an ear's side outside it. Where the ears then leave a rest
    # without area, such corners count as inside.
    cut = _cut(flat, left, slack=0.0) or _cut(flat, left, slack=FLAT)
    if not cut:
        raise PolygonError(number, "a polygon that crosses itself or has no area")
    return np.array(ears + cut)


def _cut(flat: Floats, corners: list[int], *, slack: float) -> list[tuple[int, ...]]:
    """Return the ears of the polygon of these corners in the plane; none if it cannot be cut."""
    left, ears = list(corners), list[tuple[int, ...]]()
    scores = [_score(flat, left, at, slack) for at in range(len(left))]
    while len(left) > 3:
        at = int(np.argmax(scores))
        if not scores[at] > FLAT:
            return []
        ears.append((left[at - 1], left[at], left[(at + 1) % len(left)]))
        del left[at], scores[at]
        # A corner inside an ear keeps it from being one until it is itself gone
        near = {(at - 1) % len(left), at % len(left)}
        blocked = {i for i, score in enumerate(scores) if score == 0}
        for i in near | blocked:
            scores[i] = _score(flat, left, i, slack)
    return [*ears, tuple(left)] if _score(flat, left, 1, slack) > FLAT else []


def _in_plane(points: Floats) -> Floats:
    """Return the corners (c, 2) in the plane across Newell's normal, where they run to the left.

    They are scaled by a power of two to at most 1, so that no product overflows.
    """
    small = np.ldexp(points, -np.frexp(np.abs(points).max())[1])
    middle = small - small.mean(axis=0)
    normal = np.cross(middle, np.roll(middle, -1, axis=0)).sum(axis=0)
    least = np.zeros(3)
    least[np.abs(normal).argmin()] = 1
    right = np.cross(least, normal)
    up = np.cross(normal, right)
    with np.errstate(invalid="ignore", divide="ignore"):
        axes = np.stack([right / np.linalg.norm(right), up / np.linalg.norm(up)], axis=1)
        flat: Floats = middle @ axes
    return flat


def _score(flat: Floats, left: list[int], at: int, slack: float) -> float:
    """Return altitude / longest edge of the ear at a corner; 0 if blocked, negative if reflex.

    Corners outside by less than the slack, times the longest edge, block it as well.
    """
    names = left[at - 1], left[at], left[(at + 1) % len(left)]
    a, b, c = flat[list(names)]
    doubled = _cross(b - a, c - a)
    longest = max(np.sum((b - a) ** 2), np.sum((c - b) ** 2), np.sum((a - c) ** 2))
    if not doubled > FLAT * longest:
        return -1.0
    others = flat[[i for i in left if i not in names]]
    inside = np.ones(len(others), bool)
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= _cross(end - start, others - start) >= -slack * longest
        inside &= (others != start).any(axis=1)  # a hole is joined to the rim by a side of it twice
    return 0.0 if inside.any() else float(doubled / longest)


def _cross(first: Floats, second: Floats) -> Floats:
    """Return the z of cross products of vectors in the plane."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
