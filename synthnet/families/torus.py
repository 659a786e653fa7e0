"""Tori of revolution (paper §C: torus radius 1, log-normal tube radius)."""

import math

import numpy as np

from synthnet.arrays import Floats
from synthnet.families import limits, primitives, twisted_torus
from synthnet.families.atlas import Atlas
from synthnet.families.family import POSITIVE, Family
from synthnet.families.limits import Arc


def limit(k: int, *, torus_radius: float, tube_radius: float, **_: float) -> Floats:
    """Spectrum of the smooth torus, as a surface of revolution."""
    half = math.pi * tube_radius
    outer = Arc(half, lambda s: torus_radius + tube_radius * np.sin(s / tube_radius))
    inner = Arc(half, lambda s: torus_radius - tube_radius * np.sin(s / tube_radius))
    return limits.of_revolution([outer, inner], k, closed=True)


def atlas(*, torus_radius: float, tube_radius: float, **_: float) -> Atlas:
    """Return the smooth torus in patches."""
    unit = twisted_torus.atlas(tube_radius=tube_radius / torus_radius, flatness=1.0, half_turns=0)
    return unit.put_through(lambda points: torus_radius * points)


FAMILY = Family(
    name="torus",
    title="Torus",
    surface=primitives.torus,
    least={
        "torus_radius": POSITIVE,
        "tube_radius": POSITIVE,
        "radial_resolution": 3,
        "tubular_resolution": 3,
    },
    euler_characteristic=0,
    limit=limit,
    atlas=atlas,
)
