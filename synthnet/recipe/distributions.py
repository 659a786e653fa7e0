"""Draws: the distributions a recipe can name, and the generator each shape has for itself."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.special import ndtri

CLAMP = 3.0  # standard deviations, as the caption of the paper's Table 5 says


def _log10_normal(u: float, mean: float, std: float) -> float:
    normal = mean + std * min(max(float(ndtri(u)), -CLAMP), CLAMP)
    # Nine significant digits: libraries disagree in the last bits of a power, and
    # the same recipe must give the same parameters on every machine.
    return float(f"{10.0**normal:.9g}")


def _uniform(u: float, low: float, high: float) -> float:
    return float(f"{low + (high - low) * u:.9g}")


def _integers(u: float, low: int, high: int) -> int:
    return low + int(u * (high - low + 1))


DISTRIBUTIONS: dict[str, Callable[..., float | int]] = {
    "log10_normal": _log10_normal,
    "uniform": _uniform,
    "integers": _integers,
}


def quantile(value: Any, u: float) -> float | int:
    """Return a constant, or where a distribution has a share ``u`` of its draws below."""
    if not isinstance(value, Mapping):
        return value  # type: ignore[no-any-return]  # a number, by the recipe's checks
    ((kind, arguments),) = value.items()
    return DISTRIBUTIONS[kind](u, *arguments)


def draw(distributions: Mapping[str, Any], rng: np.random.Generator) -> dict[str, float | int]:
    """Draw parameters: one uniform number each, through the inverse distribution.

    ``Generator.random`` is the part of NumPy's streams that is a plain function of
    the bits; the other samplers may change between NumPy releases (NEP 19).

    Parameters
    ----------
    distributions : mapping of str to a number or ``{name: [arguments]}``
        As in a recipe.
    rng : numpy.random.Generator
        Source of the numbers in [0, 1).

    Examples
    --------
    >>> draw({"radius": 1.0, "n": {"integers": [3, 3]}}, np.random.default_rng(0))
    {'radius': 1.0, 'n': 3}
    """
    return {name: quantile(value, float(rng.random())) for name, value in distributions.items()}


PARAMETERS, ISOMETRIES, MESHES = 0, 1, 2  # the streams that a shape has


def generator(seed: int, family: str, index: int, stream: int) -> np.random.Generator:
    """Return a generator on the shape's own child of the recipe's seed.

    It depends on nothing but the shape, so order and parallelism cannot matter.

    Parameters
    ----------
    seed : int
        The recipe's seed.
    family, index : str, int
        The shape.
    stream : int
        :data:`PARAMETERS`, :data:`ISOMETRIES` or :data:`MESHES`.

    Examples
    --------
    >>> first, second = (generator(0, "cone", 42, PARAMETERS) for _ in range(2))
    >>> first.random() == second.random()
    True
    """
    key = int.from_bytes(hashlib.sha256(family.encode()).digest()[:4], "big")
    child = np.random.SeedSequence(seed, spawn_key=(key, index, stream))
    return np.random.Generator(np.random.PCG64(child))
