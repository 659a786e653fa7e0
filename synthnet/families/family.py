"""A family of shapes: its name, its generator, and facts about its surfaces.

A family is a value, made once at the end of its own file. Start from the file of one that is like
it, such as ``annulus.py``: a new family is a surface given by charts, which
:func:`synthnet.families.charted.charted` triangulates. (The families of 1.0 are meshes that Open3D
or a formula gives.) The file needs

- ``atlas``, a function of the parameters to the surface in patches that are smooth within: its
  creases are borders of patches, and its limit comes from there;
- ``limit``, if the smooth spectrum is known, from :mod:`synthnet.families.limits`;
- ``FAMILY``, which names them with the parameters' least values and the Euler characteristic.

Then register it in ``CHARTED`` of ``synthnet/families/__init__.py``, and give its parameters'
distributions in a new recipe: a version that is published never changes.
"""

import hashlib
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, TypeAlias, TypeGuard

from synthnet.arrays import Floats
from synthnet.families import surface_limits
from synthnet.families.atlas import Atlas
from synthnet.families.limits import KNOWN, Limit
from synthnet.types import Mesh, Parameters, Topology

POSITIVE = math.ulp(0.0)  # a length may be any positive number
SHORTEST = 1e-4  # length of a border, of a surface about 1 wide; ends of shorter ones are merged
COARSEST = 4000  # about so many vertices has the first level of :meth:`Family.at_level`
Euler: TypeAlias = int | Callable[..., int]


@dataclass(frozen=True, slots=True)
class Choice:
    """A parameter that is one of a few names."""

    names: tuple[str, ...]


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
    atlas : callable
        From the parameters to the surface itself in patches that are smooth within, for its limit
        by finite elements; see :meth:`limit_spectrum`.
    least : mapping of str to number or Choice
        The names of the parameters, and the least value of each, or its choices.
    euler_characteristic : int or callable
        V − E + F of every mesh of the family, 2 if not given; or a function that returns it and
        takes the parameters that ``shared`` leaves, by keyword.
    shared : callable, optional
        Maps parameters to those that the surface depends on, where these are fewer.
    most : mapping of str to number
        The largest value of parameters that have one.
    boundaries : int
        Number of closed curves the boundary consists of.
    orientable : bool
        Whether the surface has two sides.
    limit : callable, optional
        From k and the parameters to the spectrum of the smooth surface, where it is known;
        see :meth:`limit_eigenvalues`.
    congruent : callable, optional
        Maps parameters to a representative of all parameters that give a congruent
        shape, so that mirror images count as one shape in the splits.
    """

    name: str
    title: str
    surface: Callable[..., Mesh]
    atlas: Callable[..., Atlas]
    least: Mapping[str, float | Choice]
    euler_characteristic: Euler = 2
    limit: Callable[..., Floats] | None = None
    congruent: Callable[[Parameters], Parameters] | None = None
    shared: Callable[[Parameters], Parameters] | None = None
    most: Mapping[str, float] = field(default_factory=dict)
    boundaries: int = 0
    orientable: bool = True

    def topology(self, parameters: Parameters) -> Topology:
        """Return what the mesh of the given parameters must be as a surface."""
        euler = self.euler_characteristic
        if not isinstance(euler, int):
            euler = euler(**self._shape(self._arguments(parameters)))
        return Topology(euler, self.boundaries, self.orientable)

    def generate(self, parameters: Parameters) -> Mesh:
        """Make the mesh of the given parameters.

        Returns
        -------
        Mesh
            float64 vertices (n, 3) in units of the radius or width, int64 faces (m, 3),
            oriented, outwards if closed, unless the family is not orientable.

        Raises
        ------
        ValueError
            If a parameter is missing, unknown, not finite or beyond its limits.
        """
        return self.surface(**self._arguments(parameters))

    def at_level(self, parameters: Parameters, level: int) -> Mesh:
        """Triangulate the smooth or polyhedral surface, the step halved with each level.

        The mesh depends on the surface alone, not on how the parameters triangulate it, and is
        graded towards singular corners: its eigenvalues approach their limits like h².

        Parameters
        ----------
        parameters : mapping of str to number
            As for :meth:`generate`.
        level : int
            1 gives about 4,000 vertices, each further one four times as many.

        Returns
        -------
        Mesh
            float64 vertices, int64 faces.

        Raises
        ------
        ValueError
            As :meth:`generate`, or if ``level`` is below 1.
        """
        if level < 1:
            raise ValueError(f"level must be at least 1, got {level}")
        atlas = self.atlas(**self._arguments(parameters))
        steps = atlas.steps(COARSEST) * 2 ** (level - 1)
        return atlas.mesh(atlas.uniform(steps, graded=True))

    def surface_key(self, parameters: Parameters) -> str:
        """Return a text that is equal for triangulations of one surface."""
        return json.dumps([self.name, self._shape(parameters)], sort_keys=True)

    def limit_eigenvalues(self, parameters: Parameters, k: int = 10) -> Floats | None:
        """Return the first k non-zero eigenvalues of the smooth surface, or None if not known.

        Returns
        -------
        ndarray of shape (k,), float64, or None
            In 1/length², ascending, to a relative 1e-8.

        Raises
        ------
        ValueError
            As :meth:`generate`.
        """
        return None if self.limit is None else self.limit(k, **self._arguments(parameters))

    def limit_spectrum(self, parameters: Parameters, k: int = 10) -> Limit:
        """Return the first k non-zero eigenvalues of the smooth or polyhedral surface.

        From a closed form or an equation in one variable where ``limit`` is given, by finite
        elements of high degree on ``atlas`` elsewhere: see
        :mod:`synthnet.families.surface_limits`. Triangulations of one surface share it.

        Returns
        -------
        Limit
            The eigenvalues, ascending, and how far each may be from the truth, both of shape (k,),
            float64, in 1/length².

        Raises
        ------
        ValueError
            As :meth:`generate`.
        SpectrumError
            If the eigenvalues of the elements cannot be found and counted.
        """
        known = self.limit_eigenvalues(parameters, k)
        if known is not None:
            return Limit(known, KNOWN * known)
        return surface_limits.limit(self.atlas(**self._arguments(parameters)), k)

    def group(self, parameters: Parameters) -> str:
        """Hash of family and parameters: equal for shapes that are the same shape."""
        representative = parameters if self.congruent is None else self.congruent(parameters)
        text = json.dumps([self.name, dict(representative)], sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]

    def _shape(self, parameters: Parameters) -> dict[str, Any]:
        return dict(parameters if self.shared is None else self.shared(parameters))

    def _arguments(self, parameters: Parameters) -> dict[str, Any]:
        if set(parameters) != set(self.least):
            raise ValueError(
                f"{self.name} takes the parameters {', '.join(self.least)}; "
                f"got {', '.join(parameters) or 'none'}"
            )
        arguments: dict[str, Any] = {}
        for name, least in self.least.items():
            value = parameters[name]
            if isinstance(least, Choice):
                if value not in least.names:
                    names = ", ".join(least.names)
                    raise ValueError(f"{self.name}: {name} must be one of {names}, got {value!r}")
                arguments[name] = value
                continue
            if not _is_number(value):
                raise ValueError(f"{self.name}: {name} must be a number, got {value!r}")
            if not math.isfinite(value) or value < least:
                limit = "positive" if least == POSITIVE else f"at least {least:g}"
                raise ValueError(f"{self.name}: {name} must be {limit}, got {value}")
            if value > self.most.get(name, math.inf):
                limit = f"at most {self.most[name]:g}"
                raise ValueError(f"{self.name}: {name} must be {limit}, got {value}")
            if isinstance(least, int) and value != int(value):
                raise ValueError(f"{self.name}: {name} must be an integer, got {value}")
            arguments[name] = int(value) if isinstance(least, int) else value
        return arguments


def _is_number(value: Any) -> TypeGuard[float]:
    """Return whether it is a number that a float can be, of Python or NumPy; no truth value."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return False
    try:
        float(value)
    except OverflowError:
        return False
    return True
