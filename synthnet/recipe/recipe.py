"""Recipes: a version of the dataset as a frozen, checked value."""

from __future__ import annotations

import hashlib
import json
import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, replace
from functools import partial
from importlib import resources
from typing import Any, TypeVar

from synthnet.errors import RecipeError
from synthnet.recipe.distributions import DISTRIBUTIONS, draw
from synthnet.types import PROTOCOLS

SCHEMA = 1
SCALED = re.compile(r"(?P<version>.+)-x(?P<scale>[0-9]+)")
SEALED = re.compile(r".+-sealed-[0-9a-f]{12}")
LEAST_VERTICES = 50  # of a mesh that a recipe asks for
EACH_FAMILY = "each family"  # held out, one after the other
NOTHING = "nothing"  # held out: tested are meshes from elsewhere
MOST_SCALE = 100_000  # beyond it a family's numbers would not fit the store's int32


@dataclass(frozen=True, slots=True)
class LabelSettings:
    """How many eigenvalues after the trivial zero."""

    eigenvalues: int


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Limits of the checks in :mod:`synthnet.build.filters`."""

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
        """Return how many of ``count`` surfaces the subset takes."""
        return min(count, max(self.least, round(self.share * count)))


@dataclass(frozen=True, slots=True)
class Size:
    """One of the meshes of a surface: its name, and a draw of how many vertices are wanted."""

    name: str
    vertices: Any


@dataclass(frozen=True, slots=True)
class Fold:
    """A training of a protocol that asks for generalisation, by what it must not see.

    Parameters
    ----------
    name : str
        ``PROTOCOL``, or ``PROTOCOL/FAMILY`` where each family is held out in turn.
    families, sizes : tuple of str
        A mesh is held out if its family is one of these and its size is; empty: any.
    """

    name: str
    families: tuple[str, ...] = ()
    sizes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class FamilyRecipe:
    """How many shapes of a family, and each parameter's constant or distribution.

    Where surfaces come in several sizes, each of these is a shape.
    """

    count: int
    parameters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Sealed:
    """What a sealed recipe was drawn from, but for the salt, see :mod:`synthnet.verify.seal`.

    Parameters
    ----------
    of, digest : str
        The version, and the digest of its recipe.
    share : float
        Surfaces of each family, as a share of the version's.
    commitment : str
        SHA-256 of the salt and all of the above.
    beacon : str or None
        What went into the seed beside these.
    """

    of: str
    digest: str
    share: float
    commitment: str
    beacon: str | None


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
    sizes : tuple of Size or None
        The meshes that each surface comes in; ``None`` where the families' parameters say all.
    subset : Subset or None
        Which part of another version this is; ``None`` for a full version.
    protocols : mapping of str to tuple of Fold, or None
        The trainings that each protocol that asks for generalisation is made of; none where
        nothing is held out and the test is an imported dataset.
    scale : int or None
        How many times the shapes of the version it was scaled from; ``None`` for a version
        as it ships. See :func:`scaled`.
    sealed : Sealed or None
        What a sealed set was drawn from; its seed is a secret.
    """

    version: str
    seed: int
    shard_size: int
    label: LabelSettings
    filters: FilterSettings
    augmentation: AugmentationSettings
    splits: SplitSettings
    families: Mapping[str, FamilyRecipe]
    sizes: tuple[Size, ...] | None = None
    protocols: Mapping[str, tuple[Fold, ...]] | None = None
    subset: Subset | None = None
    scale: int | None = None
    sealed: Sealed | None = None

    @property
    def base(self) -> str:
        """The full version whose shapes these are; a scaled version's are its own."""
        if self.subset is None or self.scale is not None:
            return self.version
        return self.subset.of

    @property
    def count(self) -> int:
        """Number of shapes drawn."""
        return sum(self.drawn(name) for name in self.families)

    def drawn(self, family: str) -> int:
        """Return the number of shapes of one family."""
        surfaces = self.families[family].count // self.copies
        size = surfaces if self.subset is None else self.subset.size(surfaces)
        return size * self.copies * (self.scale or 1)

    @property
    def copies(self) -> int:
        """In how many meshes each surface comes."""
        return 1 if self.sizes is None else len(self.sizes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain, JSON-ready data; what 1.0 has not, where it is there."""
        values = asdict(self)
        for name in ("scale", "sealed", "sizes", "protocols"):  # 1.0's digests are older than they
            if values[name] is None:
                del values[name]
        return values

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
    ['1.0', '1.0-mini', '1.0-small', '2.0', '2.0-mini']
    """
    files = resources.files("synthnet.recipe.versions").iterdir()
    return sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml"))


def load(version: str) -> Recipe:
    """Read the recipe of a version that ships with the package, or scale it.

    ``1.0-x100`` is 1.0 scaled by 100, see :func:`scaled`.

    Raises
    ------
    RecipeError
        If there is no such version, the scale is below 2, or it is a sealed set.

    Examples
    --------
    >>> load("1.0").count, load("1.0-mini").count, load("1.0-x100").count
    (16550, 335, 1655000)
    """
    if suffixed := SCALED.fullmatch(version):
        return scaled(load(suffixed["version"]), int(suffixed["scale"]))
    if is_sealed(version):
        raise RecipeError(
            f"{version} is a sealed set: it is drawn from its salt, by `synthnet seal` or, when "
            "the salt is revealed, by `synthnet verify --sealed`"
        )
    if version not in available():
        told = (
            "" if version[:1].isdigit() else ", or make it of your own meshes by `synthnet import`"
        )
        raise RecipeError(
            f"unknown version {version!r}: choose one of {', '.join(available())} "
            f"(`synthnet versions` lists them){told}"
        )
    return parse(
        resources.files("synthnet.recipe.versions").joinpath(f"{version}.toml").read_text()
    )


def title(version: str) -> str:
    """Return what a dataset is called before readers: an import is none of ours.

    Examples
    --------
    >>> title("2.0"), title("1.0-x100"), title("scans")
    ('synthNet 2.0', 'synthNet 1.0-x100', 'scans')
    """
    ours = version in available() or SCALED.fullmatch(version) or is_sealed(version)
    return f"synthNet {version}" if ours else version


def is_sealed(version: str) -> bool:
    """Return whether a name is that of a sealed set, see :mod:`synthnet.verify.seal`.

    Examples
    --------
    >>> is_sealed("1.0-mini-sealed-0123456789ab"), is_sealed("1.0-mini")
    (True, False)
    """
    return SEALED.fullmatch(version) is not None


def scaled(recipe: Recipe, scale: int) -> Recipe:
    """Return the recipe of ``scale`` times as many shapes, none of them a shape of this one.

    Seed, distributions, filters and labels stay; the numbers of the shapes go on after the
    last of the full version. So every scaled version is the beginning of a larger one.

    Raises
    ------
    RecipeError
        If the scale is no integer of 2 or more, or the recipe is scaled already.

    Examples
    --------
    >>> larger = scaled(load("1.0"), 100)
    >>> larger.version, larger.drawn("torus")
    ('1.0-x100', 200000)
    """
    _need(recipe.scale is None, f"{recipe.version} is scaled already: scale what it came from")
    _need(
        type(scale) is int and 2 <= scale <= MOST_SCALE,
        f"scale must be an integer from 2 to {MOST_SCALE:,}, got {scale!r}",
    )
    return replace(recipe, version=f"{recipe.version}-x{scale}", scale=scale)


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
    schema = raw.pop("schema", None)
    if type(schema) is not int or schema != SCHEMA:
        raise RecipeError(f"recipe schema must be {SCHEMA}: use a matching synthnet release")
    _need("scale" not in raw, "a recipe file has no scale: build it with --scale")
    _need("sealed" not in raw, "a recipe file is not sealed: seal it with `synthnet seal`")
    if "subset" in raw:
        return _parse_subset(raw)
    tables: dict[str, Any] = {
        name: read(name, raw.pop(name))
        for name, read in (
            ("label", partial(_record, LabelSettings)),
            ("filters", partial(_record, FilterSettings)),
            ("augmentation", partial(_record, AugmentationSettings)),
            ("splits", partial(_record, SplitSettings)),
            ("families", _families),
            ("sizes", _sizes),
        )
        if name in raw
    }
    if "protocols" in raw:
        known = {
            "families": list(tables.get("families", ())),
            "sizes": [size.name for size in tables.get("sizes", ())],
        }
        tables["protocols"] = _protocols(raw.pop("protocols"), known)
    recipe = _record(Recipe, "recipe", {**raw, **tables})
    _check(recipe)
    return recipe


def _parse_subset(raw: dict[str, Any]) -> Recipe:
    subset = _record(Subset, "subset", raw.pop("subset"))
    _need(0 < subset.share <= 1, f"subset: share must be above 0, at most 1, got {subset.share}")
    _need(subset.least >= 1, f"subset: least must be at least 1, got {subset.least}")
    base = load(subset.of)
    inherited = {field.name: getattr(base, field.name) for field in fields(Recipe)}
    inherited.pop("version")
    unknown = set(raw) - {"version"}
    _need(not unknown, f"a subset has a version and nothing else, got {', '.join(unknown)}")
    return _record(Recipe, "recipe", {**inherited, **raw, "subset": subset})


Settings = TypeVar("Settings")


def _record(kind: type[Settings], table: str, values: Any) -> Settings:
    """Make a settings dataclass of a TOML table, its keys and the kinds of numbers checked."""
    _need(isinstance(values, Mapping), f"{table} must be a table, got {values!r}")
    wanted = {field.name: field.type for field in fields(kind)}  # type: ignore[arg-type]
    unknown = sorted(set(values) - set(wanted))
    _need(not unknown, f"{table} has an unknown key: {', '.join(unknown)}")
    missing = sorted(f.name for f in fields(kind) if f.default is MISSING and f.name not in values)  # type: ignore[arg-type]
    _need(not missing, f"{table} has a missing key: {', '.join(missing)}")
    for name, value in values.items():
        if wanted[name] == "int":
            _need(type(value) is int, f"{table}: {name} must be an integer, got {value!r}")
        if wanted[name] == "float":
            _need(_is_number(value), f"{table}: {name} must be a number, got {value!r}")
        if wanted[name] == "str":
            _need(isinstance(value, str), f"{table}: {name} must be a string, got {value!r}")
    return kind(**values)


def _families(_: str, tables: Any) -> dict[str, FamilyRecipe]:
    _need(isinstance(tables, Mapping) and tables, f"families must be tables, got {tables!r}")
    families = {
        name: _record(FamilyRecipe, f"family {name}", table) for name, table in tables.items()
    }
    for name, family in families.items():
        _need(family.count >= 1, f"family {name}: count must be at least 1, got {family.count}")
        for parameter, value in family.parameters.items():
            _check_draw(f"family {name}: parameter {parameter}", value)
    return families


def _sizes(_: str, tables: Any) -> tuple[Size, ...]:
    _need(isinstance(tables, list) and tables, f"sizes must be tables, got {tables!r}")
    sizes = tuple(_record(Size, "size", table) for table in tables)
    for size in sizes:
        what = f"size {size.name}: vertices"
        _check_draw(what, size.vertices)
        least = min(draw({what: size.vertices}, _Ends(u))[what] for u in (0.0, 1 - 2**-53))
        _need(least >= LEAST_VERTICES, f"{what} must be at least {LEAST_VERTICES}, got {least:g}")
    return sizes


def _protocols(tables: Any, known: Mapping[str, list[str]]) -> dict[str, tuple[Fold, ...]]:
    _need(isinstance(tables, Mapping) and tables, f"protocols must be tables, got {tables!r}")
    return {name: _folds(name, table, known) for name, table in tables.items()}


def _folds(name: str, table: Any, known: Mapping[str, list[str]]) -> tuple[Fold, ...]:
    """Read what a protocol holds out: families or sizes by name, or each family in turn."""
    what = f"protocol {name}"
    _need(name not in PROTOCOLS and "/" not in name, f"{what}: the name is taken or has a slash")
    _need(isinstance(table, Mapping), f"{what} must be a table, got {table!r}")
    _need(set(table) == {"held_out"}, f"{what} has held_out and nothing else, got {table!r}")
    held_out = table["held_out"]
    if held_out == NOTHING:
        return ()
    if held_out == EACH_FAMILY:
        return tuple(Fold(f"{name}/{family}", (family,)) for family in known["families"])
    _need(
        isinstance(held_out, Mapping) and held_out and set(held_out) <= set(known),
        f"{what}: held_out must be {EACH_FAMILY!r}, {NOTHING!r}, or lists of families or sizes, "
        f"got {held_out!r}",
    )
    for kind, names in held_out.items():
        _need(
            isinstance(names, list) and names and all(one in known[kind] for one in names),
            f"{what}: held-out {kind} must be of {', '.join(known[kind]) or 'none'}, got {names!r}",
        )
    return (Fold(name, **{kind: tuple(names) for kind, names in held_out.items()}),)


@dataclass(frozen=True, slots=True)
class _Ends:
    """In place of a generator: always the same number."""

    number: float

    def random(self) -> float:
        """Return the number."""
        return self.number


def _check_draw(what: str, value: Any) -> None:
    _need(
        _is_number(value) or _is_distribution(value),
        f"{what} must be a number or one of {', '.join(DISTRIBUTIONS)} with two arguments, "
        f"got {value!r}",
    )


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)


def _is_distribution(value: Any) -> bool:
    if not isinstance(value, Mapping) or len(value) != 1:
        return False
    ((kind, arguments),) = value.items()
    if kind not in DISTRIBUTIONS or not isinstance(arguments, list) or len(arguments) != 2:
        return False
    if not all(_is_number(argument) for argument in arguments):
        return False
    first, second = arguments
    if kind == "log10_normal":
        return bool(second >= 0)
    whole = kind != "integers" or (type(first) is int and type(second) is int)
    return bool(whole and first <= second)


def _check(recipe: Recipe) -> None:
    shares = asdict(recipe.splits)
    _need(
        min(shares.values()) > 0 and abs(sum(shares.values()) - 1) <= 1e-9,
        f"splits must be positive and add up to 1, got {shares}",
    )
    for name, family in recipe.families.items():
        _need(
            family.count % recipe.copies == 0,
            f"family {name}: count must be a multiple of {recipe.copies}, the number of sizes, "
            f"got {family.count}",
        )
    copies = recipe.augmentation
    for name, value, least in (
        ("seed", recipe.seed, 0),
        ("shard_size", recipe.shard_size, 1),
        ("label: eigenvalues", recipe.label.eigenvalues, 1),
        ("augmentation: rotations", copies.rotations, 0),
        ("augmentation: reflections", copies.reflections, 0),
    ):
        _need(value >= least, f"{name} must be at least {least}, got {value}")


def _need(condition: object, message: str) -> None:
    if not condition:
        raise RecipeError(message)
