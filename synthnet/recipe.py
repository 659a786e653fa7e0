"""Recipes: a version of the dataset as a frozen, checked value."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib import resources
from typing import Any

import numpy as np
from scipy.special import ndtri

from synthnet.errors import RecipeError

SCHEMA = 1
CLAMP = 3.0  # standard deviations; paper, caption of Table 5


@dataclass(frozen=True, slots=True)
class LabelSettings:
    """How many eigenvalues, and the shift (in 1/area) and tolerance of the solver."""

    eigenvalues: int
    shift: float
    tolerance: float


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Limits of the checks in :mod:`synthnet.filters`."""

    altitude: float
    trivial: float
    residual: float


@dataclass(frozen=True, slots=True)
class AugmentationSettings:
    """How many rotations and reflections; their products come on top."""

    rotations: int
    reflections: int

    @property
    def instances(self) -> int:
        """Copies of a shape, the shape itself included."""
        return (1 + self.rotations) * (1 + self.reflections)


@dataclass(frozen=True, slots=True)
class SplitSettings:
    """Shares of the three splits; they add up to one."""

    train: float
    validation: float
    test: float


@dataclass(frozen=True, slots=True)
class Subset:
    """A share of each family of another version, at least ``least`` shapes."""

    of: str
    share: float
    least: int

    def size(self, count: int) -> int:
        """Return how many of ``count`` shapes the subset takes."""
        return min(count, max(self.least, round(self.share * count)))


@dataclass(frozen=True, slots=True)
class FamilyRecipe:
    """How many shapes of a family, and each parameter's constant or distribution."""

    count: int
    parameters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Recipe:
    """Everything a version of the dataset is a function of.

    Parameters
    ----------
    version : str
        Name of the version.
    seed : int
        Root of all randomness.
    shard_size : int
        Most shapes in one Parquet file.
    label, filters, augmentation, splits
        Settings of the steps.
    families : mapping of str to FamilyRecipe
        In the order of the tables.
    subset : Subset or None
        Which part of another version this is; ``None`` for a full version.
    """

    version: str
    seed: int
    shard_size: int
    label: LabelSettings
    filters: FilterSettings
    augmentation: AugmentationSettings
    splits: SplitSettings
    families: Mapping[str, FamilyRecipe]
    subset: Subset | None = None

    @property
    def base(self) -> str:
        """The full version whose shapes these are."""
        return self.version if self.subset is None else self.subset.of

    @property
    def count(self) -> int:
        """Number of shapes drawn."""
        return sum(self.drawn(name) for name in self.families)

    def drawn(self, family: str) -> int:
        """Return the number of shapes of one family."""
        count = self.families[family].count
        return count if self.subset is None else self.subset.size(count)

    def to_dict(self) -> dict[str, Any]:
        """Return plain, JSON-ready data."""
        return asdict(self)

    @property
    def digest(self) -> str:
        """SHA-256 of the resolved recipe as canonical JSON."""
        text = json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()


def available() -> list[str]:
    """Return the versions that can be built.

    Examples
    --------
    >>> available()
    ['1.0', '1.0-mini', '1.0-small']
    """
    files = resources.files("synthnet.versions").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


def load(version: str) -> Recipe:
    """Read the recipe of a version that ships with the package.

    Raises
    ------
    RecipeError
        If there is no such version.

    Examples
    --------
    >>> load("1.0").count, load("1.0-mini").count
    (16550, 335)
    """
    if version not in available():
        raise RecipeError(
            f"unknown version {version!r}: choose one of {', '.join(available())} "
            "(`synthnet versions` lists them)"
        )
    return parse(resources.files("synthnet.versions").joinpath(f"{version}.toml").read_text())


def parse(text: str) -> Recipe:
    """Turn the text of a recipe file into a checked :class:`Recipe`.

    Raises
    ------
    RecipeError
        If the text is no TOML, a key is missing or unknown, or a value is out of range.
    """
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RecipeError(f"recipe is not valid TOML: {error}") from error
    if raw.pop("schema", None) != SCHEMA:
        raise RecipeError(f"recipe schema must be {SCHEMA}: use a matching synthnet release")
    if "subset" in raw:
        return _parse_subset(raw)
    try:
        families = {name: FamilyRecipe(**value) for name, value in raw.pop("families").items()}
        recipe = Recipe(
            label=LabelSettings(**raw.pop("label")),
            filters=FilterSettings(**raw.pop("filters")),
            augmentation=AugmentationSettings(**raw.pop("augmentation")),
            splits=SplitSettings(**raw.pop("splits")),
            families=families,
            **raw,
        )
    except KeyError as error:
        raise RecipeError(f"recipe lacks the table {error}") from error
    except TypeError as error:
        raise RecipeError(f"recipe has a missing or unknown key: {error}") from error
    _check(recipe)
    return recipe


def _parse_subset(raw: dict[str, Any]) -> Recipe:
    try:
        subset = Subset(**raw["subset"])
        base = load(subset.of)
        values = {name: getattr(base, name) for name in Recipe.__slots__}
        return Recipe(**{**values, "version": raw["version"], "subset": subset})
    except (KeyError, TypeError) as error:
        raise RecipeError(f"subset recipe has a missing or unknown key: {error}") from error


def _check(recipe: Recipe) -> None:
    shares = asdict(recipe.splits)
    if abs(sum(shares.values()) - 1) > 1e-9 or min(shares.values()) < 0:
        raise RecipeError(f"splits must be positive and add up to 1, got {shares}")
    for name, family in recipe.families.items():
        if family.count < 1:
            raise RecipeError(f"family {name}: count must be at least 1, got {family.count}")
        for parameter, value in family.parameters.items():
            if not isinstance(value, int | float | Mapping) or (
                isinstance(value, Mapping) and (len(value) != 1 or set(value) - set(DISTRIBUTIONS))
            ):
                raise RecipeError(
                    f"family {name}: parameter {parameter} must be a number or one of "
                    f"{', '.join(DISTRIBUTIONS)}, got {value!r}"
                )


def _log10_normal(u: float, mean: float, std: float) -> float:
    normal = mean + std * float(np.clip(ndtri(u), -CLAMP, CLAMP))
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


def draw(distributions: Mapping[str, Any], rng: np.random.Generator) -> dict[str, float | int]:
    """Draw parameters: one uniform number each, through the inverse distribution.

    ``Generator.random`` is the part of NumPy's streams that is a plain function of
    the bits; the other samplers may change between NumPy releases (NEP 19).

    Parameters
    ----------
    distributions : mapping of str to a number or ``{name: [arguments]}``
        As in a recipe.
    rng : numpy.random.Generator
        Source of the numbers.

    Examples
    --------
    >>> draw({"radius": 1.0, "n": {"integers": [3, 3]}}, np.random.default_rng(0))
    {'radius': 1.0, 'n': 3}
    """
    values: dict[str, float | int] = {}
    for name, value in distributions.items():
        u = float(rng.random())
        if isinstance(value, Mapping):
            ((kind, arguments),) = value.items()
            values[name] = DISTRIBUTIONS[kind](u, *arguments)
        else:
            values[name] = value
    return values


PARAMETERS, ISOMETRIES = 0, 1  # the streams of a shape


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
        :data:`PARAMETERS` or :data:`ISOMETRIES`.
    """
    key = int.from_bytes(hashlib.sha256(family.encode()).digest()[:4], "big")
    child = np.random.SeedSequence(seed, spawn_key=(key, index, stream))
    return np.random.Generator(np.random.PCG64(child))
