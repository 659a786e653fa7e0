"""What a family of shapes is: a name, a generator, and what is known of its surfaces."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from synthnet.types import Mesh, Parameters

POSITIVE = math.ulp(0.0)  # least value of a length: any positive number


@dataclass(frozen=True, slots=True)
class Family:
    """A family of triangulated surfaces.

    Parameters
    ----------
    name : str
        Key of the family in recipes, ids and tables.
    title : str
        Name for people.
    surface : callable
        Pure function of the parameters, by keyword, to a float64 :class:`Mesh`.
    least : mapping of str to number
        The parameters there are, and the least value of each.
    euler_characteristic : int
        V − E + F of every mesh of the family.
    congruent : callable, optional
        Maps parameters to a representative of all parameters that give a congruent
        shape, so that mirror images count as one shape in the splits.
    """

    name: str
    title: str
    surface: Callable[..., Mesh]
    least: Mapping[str, float]
    euler_characteristic: int
    congruent: Callable[[Parameters], Parameters] | None = None

    def generate(self, parameters: Parameters) -> Mesh:
        """Make the mesh of the given parameters.

        Returns
        -------
        Mesh
            float64 vertices (n, 3) in units of the radius or width, int64 faces (m, 3),
            closed and oriented outwards.

        Raises
        ------
        ValueError
            If a parameter is missing, unknown, not finite or below its limit.
        """
        if set(parameters) != set(self.least):
            raise ValueError(
                f"{self.name} takes the parameters {', '.join(self.least)}; "
                f"got {', '.join(parameters) or 'none'}"
            )
        for name, least in self.least.items():
            value = parameters[name]
            if not math.isfinite(value) or value < least:
                limit = "positive" if least == POSITIVE else f"at least {least:g}"
                raise ValueError(f"{self.name}: {name} must be {limit}, got {value}")
            if isinstance(least, int) and value != int(value):
                raise ValueError(f"{self.name}: {name} must be an integer, got {value}")
        whole = {name for name, least in self.least.items() if isinstance(least, int)}
        return self.surface(**{k: int(v) if k in whole else v for k, v in parameters.items()})

    def group(self, parameters: Parameters) -> str:
        """Hash of family and parameters: equal for shapes that are the same shape."""
        representative = parameters if self.congruent is None else self.congruent(parameters)
        text = json.dumps([self.name, dict(representative)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
