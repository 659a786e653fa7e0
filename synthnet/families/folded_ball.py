r"""Folded balls: closed surfaces of genus 0 with valleys all over, like a cortex or a walnut.

An ellipsoid's radius is smaller along the nodal lines of a random wave f of wavelength
:math:`2\pi/\kappa` on the sphere,

.. math::
    r(d) = r_0(d) \left(1 - \text{depth} \cdot e^{-2 f(d)^2}\right), \qquad
    f(d) = \sqrt{2/m} \sum_{i=1}^{m} \sin(\kappa\, n_i \cdot d + \varphi_i),

and the whole is put through shears of space, which bend folds over:

.. math::
    x \mapsto x + \frac{s}{\kappa'}\, e \sin(\kappa'\, n \cdot x + \varphi), \qquad n \perp e

A shear has an inverse, and so the surface never meets itself.
"""

from __future__ import annotations

import numpy as np

from synthnet.arrays import Floats
from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import SHORTEST
from synthnet.families.radial import radial, unit_vectors

WAVES = 12  # m
NARROW = 2.0  # how narrow valleys are
SHEARS = (1.0, 1.7, 2.9)  # their κ'


def atlas(*, b: float, c: float, folds: float, depth: float, slope: float, form: int) -> Atlas:
    """Ellipsoid with the half axes 1, b and c.

    ``folds`` is κ, ``slope`` is s, and ``form`` the seed of all directions and phases.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    axes = np.array([1.0, b, c])
    normals, phases = _directions(rng, WAVES), np.pi * (2 * rng.random(WAVES) - 1)
    along = _directions(rng, len(SHEARS))
    across = np.cross(along, _directions(rng, len(SHEARS)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    starts = np.pi * (2 * rng.random(len(SHEARS)) - 1)

    def distance(directions: Floats) -> Floats:
        smooth = 1 / np.linalg.norm(directions / axes, axis=1)
        wave = np.sqrt(2 / WAVES) * np.sin(folds * directions @ normals.T + phases).sum(axis=1)
        return np.asarray(smooth * (1 - depth * np.exp(-NARROW * wave**2)))

    def shear(points: Floats) -> Floats:
        for kappa, direction, shift, start in zip(SHEARS, along, across, starts, strict=True):
            points = (
                points + slope / kappa * np.sin(kappa * points @ direction + start)[:, None] * shift
            )
        return points

    return radial(distance).put_through(shear)


def _directions(rng: np.random.Generator, count: int) -> Floats:
    """Return unit vectors, spread evenly over the sphere."""
    return unit_vectors(*(2 * rng.random((2, count)) - 1))


FAMILY = charted(
    "folded_ball",
    "Folded ball",
    atlas,
    {"b": SHORTEST, "c": SHORTEST, "folds": 1.0, "depth": 0.0, "slope": 0.0, "form": 0},
    most={"b": 3.0, "c": 3.0, "folds": 12.0, "depth": 0.6, "slope": 1.5},
)
