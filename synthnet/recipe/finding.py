"""Find the recipe of a version: the files that ship with the package, and their scaled versions."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from importlib import resources
from typing import Any

from synthnet.errors import RecipeError, suggestion
from synthnet.recipe import parsing
from synthnet.recipe.names import Kind, available, parse_name
from synthnet.recipe.recipe import Recipe

SCHEMA = 1
MOST_SCALE = 100_000  # beyond it a family's numbers would not fit the store's int32


def load(version: str, known: Iterable[str] = ()) -> Recipe:
    """Read the recipe of a version that ships with the package, or scale it.

    ``1.0-x100`` is 1.0 scaled by 100, see :func:`scaled`. For an unknown version, one of the names
    of ``known`` is suggested; by default, of the versions that there are.

    Raises
    ------
    RecipeError
        If there is no such version, the scale is below 2, or it is a sealed set.

    Examples
    --------
    >>> load("1.0").count, load("1.0-mini").count, load("1.0-x100").count
    (16550, 335, 1655000)
    """
    name = parse_name(version)
    if name.kind is Kind.SCALED:
        return scaled(load(name.version), name.scale)
    if name.kind is Kind.SEALED:
        raise RecipeError(
            f"{version} is a sealed set: it is drawn from its salt, by `synthnet seal` or, when "
            "the salt is revealed, by `synthnet verify --sealed`"
        )
    if name.kind is Kind.IMPORTED:
        imports = (
            "" if version[:1].isdigit() else ", or make it of your own meshes by `synthnet import`"
        )
        raise RecipeError(
            f"unknown version {version!r}: choose one of {', '.join(available())} "
            f"(`synthnet versions` lists them){imports}{suggestion(version, known or available())}"
        )
    return _shipped(version)


@lru_cache
def _shipped(version: str) -> Recipe:
    return parse(_text(version))


def _text(version: str) -> str:
    """Return the recipe file of a version that ships."""
    file = resources.files("synthnet.recipe.versions").joinpath(f"{version}.toml")
    return file.read_text(encoding="utf-8")


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
    parsing.need(
        recipe.scale is None, f"{recipe.version} is scaled already: scale what it came from"
    )
    parsing.need(
        type(scale) is int and 2 <= scale <= MOST_SCALE,
        f"scale must be an integer from 2 to {MOST_SCALE:,}, got {scale!r}",
    )
    return replace(recipe, version=f"{recipe.version}-x{scale}", scale=scale)


def _tables(text: str) -> dict[str, Any]:
    """Read the tables of a recipe file; where it extends a version, beside those of that one."""
    try:
        raw = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise RecipeError(f"recipe is not valid TOML: {error}") from error
    schema = raw.pop("schema", None)
    if type(schema) is not int or schema != SCHEMA:
        raise RecipeError(f"recipe schema must be {SCHEMA}: use a matching synthnet release")
    extended = raw.pop("extends", None)
    if extended is None:
        return raw
    there = available()
    parsing.need(extended in there, f"extends must be one of {', '.join(there)}, got {extended!r}")
    return parsing.extension(raw, extended, _tables(_text(extended)))


def parse(text: str) -> Recipe:
    """Turn the text of a recipe file into a checked :class:`Recipe`.

    Raises
    ------
    RecipeError
        If the text is no TOML, a key is missing or unknown, or a value is out of range.
    """
    raw = _tables(text)
    parsing.need("scale" not in raw, "a recipe file has no scale: build it with --scale")
    parsing.need("sealed" not in raw, "a recipe file is not sealed: seal it with `synthnet seal`")
    if "subset" not in raw:
        return parsing.full_version(raw)
    subset = parsing.subset_of(raw.pop("subset"))
    return parsing.subset_version(raw, subset, load(subset.of))
