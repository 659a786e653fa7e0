"""From a recipe to the list of shards: which shapes, in which file, in which split."""

import hashlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from typing import overload

from synthnet.errors import RecipeError
from synthnet.recipe import Recipe, load, splits
from synthnet.recipe.drawing import draw_shape, draw_shapes
from synthnet.types import SPLITS, ShapeSpec

MOST_TRIES = 100_000  # surfaces drawn for a family of a sealed set, before that gives up


@dataclass(frozen=True, slots=True)
class PlannedShape:
    """A drawn shape and its splits under both protocols."""

    spec: ShapeSpec
    split: str
    paper_splits: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ShardPlan:
    """The shapes of one Parquet file, all of one family; the unit of work of a build."""

    file: str
    family: str
    shapes: tuple[PlannedShape, ...]

    @property
    def ids(self) -> list[str]:
        """The shapes' ids, in order."""
        return [shape.spec.id for shape in self.shapes]


def plan_shards(recipe: Recipe) -> Sequence[ShardPlan]:
    """Draw the shapes, split them and share them out to shards.

    A pure function of the recipe: it looks at no mesh. A subset takes shapes of the full
    version with the splits they have there, from each split its share. A scaled version
    is planned as its shards are asked for, see :class:`ScaledPlan`. A sealed set has no
    shape of the version it was drawn from, see :func:`sealed_shapes`.

    Examples
    --------
    >>> from synthnet import recipe
    >>> shards = plan_shards(recipe.load("1.0-mini"))
    >>> len(shards), sum(len(shard.shapes) for shard in shards)
    (11, 335)
    """
    if recipe.scale is not None:
        return ScaledPlan(recipe)
    specs = draw_shapes(recipe) if recipe.sealed is None else sealed_shapes(recipe)
    split_of = splits.grouped(specs, recipe.splits, recipe.seed)
    paper_of = splits.paper(specs, recipe.augmentation.instances, recipe.splits, recipe.seed)
    by_family: defaultdict[str, list[ShapeSpec]] = defaultdict(list)
    for spec in specs:
        by_family[spec.family].append(spec)
    plans = []
    for family, members in by_family.items():
        if recipe.subset is not None:
            members = _subset(members, split_of, recipe)
        shapes = [PlannedShape(s, split_of[s.id], paper_of[s.id]) for s in members]
        for number, start in enumerate(range(0, len(shapes), recipe.shard_size)):
            chunk = tuple(shapes[start : start + recipe.shard_size])
            plans.append(ShardPlan(_file(family, number), family, chunk))
    return plans


@lru_cache(maxsize=4)
def planned(version: str) -> Sequence[ShardPlan]:
    """Return the plan of a version; it is kept, because drawing the shapes takes seconds.

    Raise RecipeError if the version is unknown.
    """
    return plan_shards(load(version))


def _file(family: str, number: int) -> str:
    return f"shards/{family}-{number:04d}.parquet"


class ScaledPlan(Sequence[ShardPlan]):
    """The shards of a scaled version, each drawn when it is asked for.

    A family's shapes are numbered from the end of the full version on. A shape that is
    also one of the full version has its split there; every other's is a function of the
    shape alone, see :func:`synthnet.recipe.splits.by_hash`. So no shape is kept in memory, and
    the splits of all scaled versions agree with each other and with the full one.

    Parameters
    ----------
    recipe : Recipe
        A scaled one.
    """

    def __init__(self, recipe: Recipe) -> None:
        self.recipe = recipe
        specs = draw_shapes(replace(recipe, scale=None))
        split_of = splits.grouped(specs, recipe.splits, recipe.seed)
        self._known = {spec.group: split_of[spec.id] for spec in specs}
        self._shards = [
            (name, number)
            for name in recipe.families
            for number in range(-(-recipe.drawn(name) // recipe.shard_size))
        ]

    def __len__(self) -> int:
        return len(self._shards)

    @overload
    def __getitem__(self, key: int) -> ShardPlan: ...
    @overload
    def __getitem__(self, key: slice) -> Sequence[ShardPlan]: ...
    def __getitem__(self, key: int | slice) -> ShardPlan | Sequence[ShardPlan]:
        if isinstance(key, slice):
            return [self._shard(*shard) for shard in self._shards[key]]
        return self._shard(*self._shards[key])

    def _shard(self, family: str, number: int) -> ShardPlan:
        recipe = self.recipe
        first = recipe.families[family].count
        indices = range(first, first + recipe.drawn(family))
        start = number * recipe.shard_size
        shapes = tuple(self._shape(family, i) for i in indices[start : start + recipe.shard_size])
        return ShardPlan(_file(family, number), family, shapes)

    def _shape(self, family: str, index: int) -> PlannedShape:
        recipe = self.recipe
        spec = draw_shape(recipe, family, index)
        split = self._known.get(spec.group)
        if split is None:
            split = splits.by_hash("grouped", spec.group, recipe.splits, recipe.seed)
        copies = (f"{spec.id}/{i}" for i in range(recipe.augmentation.instances))
        paper = tuple(splits.by_hash("paper", copy, recipe.splits, recipe.seed) for copy in copies)
        return PlannedShape(spec, split, paper)


def sealed_shapes(recipe: Recipe) -> list[ShapeSpec]:
    """Draw the shapes of a sealed recipe, with ids that depend on its secret seed.

    Surfaces that the full version has are left out, and the draw goes on: families with few
    discrete parameters would repeat them. Raise RecipeError if a family has too few other surfaces.
    """
    if recipe.sealed is None:
        raise ValueError(f"{recipe.version} is not sealed")
    public = _groups(recipe.sealed.of)
    shapes = []
    for family in recipe.families:
        count = recipe.drawn(family)
        taken: list[ShapeSpec] = []
        for surface in range(MOST_TRIES):
            numbers = range(surface * recipe.copies, (surface + 1) * recipe.copies)
            copies = [draw_shape(recipe, family, number) for number in numbers]
            if public.isdisjoint(spec.group for spec in copies):
                taken += [replace(spec, id=_sealed_id(recipe, spec)) for spec in copies]
            if len(taken) == count:
                break
        else:
            raise RecipeError(
                f"{family}: only {len(taken)} of {count} shapes could be drawn that are not "
                f"shapes of {recipe.sealed.of}: take a smaller share"
            )
        shapes += taken
    return shapes


@cache
def _groups(version: str) -> frozenset[str]:
    """Return the groups of all shapes of a full version."""
    return frozenset(spec.group for spec in draw_shapes(load(version)))


def _sealed_id(recipe: Recipe, spec: ShapeSpec) -> str:
    """Return an id that no other set has, and that says nothing without the seed."""
    key = f"{recipe.seed}/id/{spec.family}/{spec.index}"
    return f"{spec.family}-{hashlib.sha256(key.encode()).hexdigest()[:12]}"


def _subset(
    members: Sequence[ShapeSpec], split_of: Mapping[str, str], recipe: Recipe
) -> list[ShapeSpec]:
    surfaces = splits.quotas(recipe.drawn(members[0].family) // recipe.copies, recipe.splits)
    quotas = {split: n * recipe.copies for split, n in zip(SPLITS, surfaces, strict=True)}
    taken = []
    for spec in members:
        if quotas[split_of[spec.id]]:
            quotas[split_of[spec.id]] -= 1
            taken.append(spec)
    return taken
