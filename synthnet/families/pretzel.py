r"""Pretzels: smooth surfaces of genus 2 and more, a disc with round holes made thick.

.. math::
    z^2 = t^2 (1 - |x|^2) \prod_{i=1}^{g} \frac{|x - c_i|^2 - a^2}{|x - c_i|^2 + a^2},
    \qquad x \in \mathbb{R}^2
"""

import math

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, glue_charts, rectangle
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE


def atlas(*, genus: int, hole: float, thickness: float, stretch: float, bend: float) -> Atlas:
    """Disc of radius 1 with ``genus`` holes on a circle, bent by ``bend`` radians along x.

    ``hole`` is the radius of the holes over the largest there is room for; ``stretch``
    multiplies y.

    A wedge of the disc about each hole, and each of its two sides, is a chart. Its coordinates
    say how far from the hole's rim to the wedge's border, and to which point of it: −1 to 1 is
    the disc's rim, 2 and −2 are its centre.
    """
    half = math.pi / genus
    centre = 1 / (1 + math.sin(half))
    radius = hole * centre * math.sin(half)
    middles = 2 * half * np.arange(genus, dtype=np.float64)
    centres = centre * _on_circle(middles)

    def chart(charts: Int64s, u: Floats) -> Floats:
        away, around = u.T
        # Quadratic at the rims, where z is the root of the distance, linear within.
        inner = np.clip(np.abs(around) - 1, 0, 1)
        angle = middles[charts // 2] + half * np.clip(around, -1, 1)
        border = (1 - _from_rim(inner))[:, None] * _on_circle(angle)
        ray = border - centres[charts // 2]
        length = np.linalg.norm(ray, axis=1)
        share = (1 - inner) * np.sin(math.pi / 2 * away) ** 2 + inner * _from_rim(away)
        distance = radius + share * (length - radius)
        x = centres[charts // 2] + (distance / length)[:, None] * ray
        squares = ((x[:, None] - centres) ** 2).sum(axis=2)
        square = (1 - (x**2).sum(axis=1)) * np.prod(
            (squares - radius**2) / (squares + radius**2), axis=1
        )
        on_rim = (away == 0) | ((away == 1) & (np.abs(around) <= 1))
        z = thickness * np.sqrt(np.where(on_rim, 0, np.maximum(square, 0)))
        z = np.where(charts % 2 == 0, z, -z)
        return _bent(np.stack([x[:, 0], stretch * x[:, 1], z], axis=1), bend)

    sheet = rectangle(np.linspace(0, 1, 3), np.linspace(-2, 2, 5))
    sheets = [sheet if number % 2 == 0 else sheet[:, ::-1] for number in range(2 * genus)]
    return Atlas(*glue_charts(sheets), chart)


def _from_rim(share: Floats) -> Floats:
    return np.asarray(1 - np.cos(math.pi / 2 * share))


def _on_circle(angles: Floats) -> Floats:
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _bent(points: Floats, bend: float) -> Floats:
    """Bend space so that x in [−1, 1] becomes an arc of ``bend`` radians."""
    if bend == 0:
        return points
    curvature = bend / 2
    x, y, z = points.T
    out = 1 / curvature - z
    return np.stack(
        [out * np.sin(curvature * x), y, 1 / curvature - out * np.cos(curvature * x)], axis=1
    )


def euler(*, genus: int, **_: object) -> int:
    """Return 2 − 2g."""
    return 2 - 2 * genus


FAMILY = charted(
    "pretzel",
    "Pretzel",
    atlas,
    {"genus": 2, "hole": POSITIVE, "thickness": POSITIVE, "stretch": POSITIVE, "bend": 0.0},
    euler_characteristic=euler,
    most={"genus": 8, "hole": 0.9, "thickness": 1.0, "bend": 1.5},
)
