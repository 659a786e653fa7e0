"""From the tables of a recipe file to settings; RecipeError says which key or value is wrong."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, asdict, fields
from functools import partial
from typing import Any, TypeVar

from synthnet.errors import RecipeError
from synthnet.recipe.distributions import DISTRIBUTIONS, quantile
from synthnet.recipe.names import SCALED, SEALED
from synthnet.recipe.recipe import (
    AugmentationSettings,
    FamilyRecipe,
    FilterSettings,
    Fold,
    LabelSettings,
    Recipe,
    Size,
    SplitSettings,
    Subset,
)
from synthnet.types import PROTOCOLS

VERSION = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")  # it is the name of a directory
LEAST_VERTICES = 50  # of a mesh that a recipe asks for
EACH_FAMILY = "each family"  # they are held out one after the other
NOTHING = "nothing"  # held out: tested are meshes from elsewhere
ENDS = 0.0, 1 - 2**-53  # the least and the largest number that a draw begins with

Settings = TypeVar("Settings")


def full_version(raw: dict[str, Any]) -> Recipe:
    """Turn the tables of a full version into a recipe."""
    readers: dict[str, Callable[[str, Any], Any]] = {
        "label": partial(_record, LabelSettings),
        "filters": partial(_record, FilterSettings),
        "augmentation": partial(_record, AugmentationSettings),
        "splits": partial(_record, SplitSettings),
        "families": _families,
        "sizes": _sizes,
    }
    tables = {name: read(name, raw.pop(name)) for name, read in readers.items() if name in raw}
    if "protocols" in raw:
        known = {
            "families": list(tables.get("families", ())),
            "sizes": [size.name for size in tables.get("sizes", ())],
        }
        tables["protocols"] = _protocols(raw.pop("protocols"), known)
    recipe = _record(Recipe, "recipe", {**raw, **tables})
    _check(recipe)
    return recipe


def extension(raw: dict[str, Any], name: Any, base: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of a version that adds to another one: its families stay, others come."""
    need("subset" not in base, f"{name} is a subset: extend the version that it is of")
    need("subset" not in raw, "a version is a subset of another or extends it, not both")
    need("version" in raw, "recipe has a missing key: version")  # or it had that of the other one
    families: dict[str, Any] = base["families"]
    more = raw.get("families", {})
    need(isinstance(more, Mapping), f"families must be tables, got {more!r}")
    again = sorted(set(more) & set(families))
    need(not again, f"{name} has families of this name already: {', '.join(again)}")
    return {**base, **raw, "families": {**families, **more}}


def subset_of(raw: Any) -> Subset:
    """Turn the table of a subset into settings."""
    subset = _record(Subset, "subset", raw)
    need(0 < subset.share <= 1, f"subset: share must be above 0, at most 1, got {subset.share}")
    need(subset.least >= 1, f"subset: least must be at least 1, got {subset.least}")
    return subset


def subset_version(raw: dict[str, Any], subset: Subset, base: Recipe) -> Recipe:
    """Return the recipe of a subset of another version."""
    inherited = {field.name: getattr(base, field.name) for field in fields(Recipe)}
    inherited.pop("version")
    unknown = set(raw) - {"version"}
    need(not unknown, f"a subset has a version and nothing else, got {', '.join(unknown)}")
    need(base.scale is None, f"{base.version} is scaled: take a share of what it came from")
    need(base.subset is None, f"{base.version} is a subset: take a share of {base.base}")
    recipe = _record(Recipe, "recipe", {**inherited, **raw, "subset": subset})
    _check(recipe)
    return recipe


def _record(kind: type[Settings], table: str, values: Any) -> Settings:
    """Make a settings dataclass of a TOML table, its keys and the kinds of numbers checked."""
    need(isinstance(values, Mapping), f"{table} must be a table, got {values!r}")
    types = {field.name: field.type for field in fields(kind)}  # type: ignore[arg-type]
    unknown = sorted(set(values) - set(types))
    need(not unknown, f"{table} has an unknown key: {', '.join(unknown)}")
    missing = sorted(f.name for f in fields(kind) if f.default is MISSING and f.name not in values)  # type: ignore[arg-type]
    need(not missing, f"{table} has a missing key: {', '.join(missing)}")
    for name, value in values.items():
        if types[name] == "int":
            need(type(value) is int, f"{table}: {name} must be an integer, got {value!r}")
        if types[name] in ("float", "float | None"):
            need(_is_number(value), f"{table}: {name} must be a number, got {value!r}")
        if types[name] == "str":
            need(isinstance(value, str), f"{table}: {name} must be a string, got {value!r}")
    return kind(**values)


def _families(_: str, tables: Any) -> dict[str, FamilyRecipe]:
    need(isinstance(tables, Mapping) and tables, f"families must be tables, got {tables!r}")
    families = {
        name: _record(FamilyRecipe, f"family {name}", table) for name, table in tables.items()
    }
    for name, family in families.items():
        need(family.count >= 1, f"family {name}: count must be at least 1, got {family.count}")
        parameters = family.parameters
        need(
            isinstance(parameters, Mapping),
            f"family {name}: parameters must be a table, got {parameters!r}",
        )
        for parameter, value in parameters.items():
            _check_draw(f"family {name}: parameter {parameter}", value)
    return families


def _sizes(_: str, tables: Any) -> tuple[Size, ...]:
    need(isinstance(tables, list) and tables, f"sizes must be tables, got {tables!r}")
    sizes = tuple(_record(Size, "size", table) for table in tables)
    for size in sizes:
        what = f"size {size.name}: vertices"
        _check_draw(what, size.vertices)
        least = min(quantile(size.vertices, u) for u in ENDS)
        need(least >= LEAST_VERTICES, f"{what} must be at least {LEAST_VERTICES}, got {least:g}")
    return sizes


def _protocols(tables: Any, known: Mapping[str, list[str]]) -> dict[str, tuple[Fold, ...]]:
    need(isinstance(tables, Mapping) and tables, f"protocols must be tables, got {tables!r}")
    return {name: _folds(name, table, known) for name, table in tables.items()}


def _folds(name: str, table: Any, known: Mapping[str, list[str]]) -> tuple[Fold, ...]:
    """Read what a protocol holds out: families or sizes by name, or each family in turn."""
    what = f"protocol {name}"
    need(name not in PROTOCOLS and "/" not in name, f"{what}: the name is taken or has a slash")
    need(isinstance(table, Mapping), f"{what} must be a table, got {table!r}")
    need(set(table) == {"held_out"}, f"{what} has held_out and nothing else, got {table!r}")
    held_out = table["held_out"]
    if held_out == NOTHING:
        return ()
    if held_out == EACH_FAMILY:
        return tuple(Fold(f"{name}/{family}", (family,)) for family in known["families"])
    need(
        isinstance(held_out, Mapping) and held_out and set(held_out) <= set(known),
        f"{what}: held_out must be {EACH_FAMILY!r}, {NOTHING!r}, or lists of families or sizes, "
        f"got {held_out!r}",
    )
    for kind, names in held_out.items():
        need(
            isinstance(names, list) and names and all(name in known[kind] for name in names),
            f"{what}: held-out {kind} must be of {', '.join(known[kind]) or 'none'}, got {names!r}",
        )
    return (Fold(name, **{kind: tuple(names) for kind, names in held_out.items()}),)


def _check_draw(what: str, value: Any) -> None:
    need(
        _is_number(value) or _is_distribution(value),
        f"{what} must be a number or one of {', '.join(DISTRIBUTIONS)} with two arguments, "
        f"got {value!r}",
    )
    try:
        ends = [quantile(value, u) for u in ENDS]
    except OverflowError:
        ends = [math.inf]
    need(all(map(_is_number, ends)), f"{what} must have finite draws, got {value!r}")


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) <= sys.float_info.max


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
    version = recipe.version
    need(
        VERSION.fullmatch(version),
        "version must be at most 100 letters, digits, '.', '_' or '-', the first a letter or a "
        f"digit, got {version!r}",
    )
    need(
        not (SCALED.fullmatch(version) or SEALED.fullmatch(version)),
        f"version must not end as scaled versions (-x5) and sealed sets do, got {version!r}",
    )
    shares = asdict(recipe.splits)
    need(
        min(shares.values()) > 0 and abs(sum(shares.values()) - 1) <= 1e-9,
        f"splits must be positive and add up to 1, got {shares}",
    )
    for name, family in recipe.families.items():
        need(
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
        need(value >= least, f"{name} must be at least {least}, got {value}")


def need(condition: object, message: str) -> None:
    """Raise RecipeError with a message unless a condition holds."""
    if not condition:
        raise RecipeError(message)
