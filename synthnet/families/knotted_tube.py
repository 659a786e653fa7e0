"""Round tubes about torus knots, from the wavy ring to the trefoil and beyond."""

import math

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, rectangle, rows
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE

KNOTS = ((1, 2), (1, 3), (2, 3), (3, 2), (2, 5), (3, 4))  # times round the axis, and the tube
RADIUS = 0.45  # the knot winds on a torus of this radius about the unit circle


def atlas(*, knot: int, thickness: float) -> Atlas:
    """Tube of ``thickness`` times the largest radius at which it does not touch itself."""
    round_axis, round_tube = KNOTS[knot]
    core = _curve(np.linspace(0, 2 * math.pi, 721)[:-1], round_axis, round_tube)
    radius = thickness * _reach(core[0], core[1])

    def chart(_: Int64s, u: Floats) -> Floats:
        along, around = u.T
        points, tangents, normals = _curve(along, round_axis, round_tube)
        binormals = np.cross(tangents, normals)
        out = np.cos(around)[:, None] * normals + np.sin(around)[:, None] * binormals
        return np.asarray(points + radius * out)

    length = float(np.linalg.norm(np.diff(core[0], axis=0, append=core[0][:1]), axis=1).sum())
    cells = max(8, rows(length, 2 * math.pi * radius / 3, most=48))
    patches = rectangle(np.linspace(0, 2 * math.pi, cells + 1), np.linspace(0, 2 * math.pi, 4))
    return Atlas(patches[:, ::-1], np.zeros(len(patches), dtype=np.int64), chart)


def _curve(t: Floats, p: int, q: int) -> tuple[Floats, Floats, Floats]:
    """Return points, unit tangents and a unit normal, the torus's own, along the knot."""
    cp, sp, cq, sq = np.cos(p * t), np.sin(p * t), np.cos(q * t), np.sin(q * t)
    out = 1 + RADIUS * cq
    points = np.stack([out * cp, out * sp, RADIUS * sq], axis=1)
    rates = np.stack(
        [
            -p * out * sp - q * RADIUS * sq * cp,
            p * out * cp - q * RADIUS * sq * sp,
            q * RADIUS * cq,
        ],
        axis=1,
    )
    tangents = rates / np.linalg.norm(rates, axis=1, keepdims=True)
    return points, tangents, np.stack([cq * cp, cq * sp, sq], axis=1)


def _reach(points: Floats, tangents: Floats) -> float:
    """Return the largest radius of a tube about a closed curve, to six digits.

    For any two points the circle through both that touches the curve at one has at least
    twice the reach as its diameter.

    References
    ----------
    O. Gonzalez, J. H. Maddocks, "Global curvature, thickness, and the ideal shapes of knots",
    PNAS 96 (1999), equation (3).
    """
    gaps = points[:, None] - points
    squares = np.einsum("ijk,ijk->ij", gaps, gaps)
    along = np.einsum("ijk,jk->ij", gaps, tangents)
    away = np.sqrt(np.maximum(squares - along**2, 0))
    radii = np.divide(
        squares, 2 * away, out=np.full_like(squares, np.inf), where=away > 1e-9 * squares
    )
    np.fill_diagonal(radii, np.inf)
    return float(f"{radii.min():.6g}")


FAMILY = charted(
    "knotted_tube",
    "Knotted tube",
    atlas,
    {"knot": 0, "thickness": POSITIVE},
    euler_characteristic=0,
    most={"knot": len(KNOTS) - 1, "thickness": 0.95},
)
