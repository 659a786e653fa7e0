"""From a recipe to the list of shards: which shapes, in which file, in which split."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from synthnet import splits
from synthnet.families import draw_shapes
from synthnet.recipe import Recipe
from synthnet.types import SPLITS, ShapeSpec


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


def plan_shards(recipe: Recipe) -> list[ShardPlan]:
    """Draw the shapes, split them and share them out to shards.

    A pure function of the recipe: it looks at no mesh. A subset takes shapes of the full
    version with the splits they have there, from each split its share.

    Examples
    --------
    >>> from synthnet import recipe
    >>> shards = plan_shards(recipe.load("1.0-mini"))
    >>> len(shards), sum(len(shard.shapes) for shard in shards)
    (11, 335)
    """
    specs = draw_shapes(recipe)
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
            plans.append(ShardPlan(f"shards/{family}-{number:04d}.parquet", family, chunk))
    return plans


def _subset(
    members: Sequence[ShapeSpec], split_of: Mapping[str, str], recipe: Recipe
) -> list[ShapeSpec]:
    size = recipe.drawn(members[0].family)
    quotas = dict(zip(SPLITS, splits.quotas(size, recipe.splits), strict=True))
    taken = []
    for spec in members:
        if quotas[split_of[spec.id]]:
            quotas[split_of[spec.id]] -= 1
            taken.append(spec)
    return taken
