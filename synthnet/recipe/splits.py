"""Which shape, or which instance of a shape, is for training, validation or test."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import astuple

from synthnet.errors import RecipeError, suggestion
from synthnet.recipe import Fold, Recipe, SplitSettings
from synthnet.types import PROTOCOLS, SPLITS, ShapeSpec

# Families that share surfaces, all of them up to an isometry or the special ones of the other: an
# ellipsoid with equal axes is a sphere, a truncated cone with equal radii a cylinder.
SAME_SURFACES = (
    ("circular_cone", "dented_cone", "conforming_split_cone"),
    ("flat_rectangle", "rolled_sheet"),
    ("ellipsoid", "conforming_split_sphere"),
    ("truncated_cone", "capped_cylinder"),
)


def grouped(specs: Sequence[ShapeSpec], shares: SplitSettings, seed: int) -> dict[str, str]:
    """Split by shape: no copy and no exact duplicate of a shape crosses.

    Within each family the groups of equal shapes are put in the order of a hash, and
    each split takes the groups that still fit its share.

    Parameters
    ----------
    specs : sequence of ShapeSpec
        All shapes drawn.
    shares : SplitSettings
        Shares of the splits.
    seed : int
        The recipe's seed.

    Returns
    -------
    dict of str to str
        Split by shape id.

    Examples
    --------
    >>> from synthnet.types import ShapeSpec
    >>> twins = [ShapeSpec(f"cone-{i:05d}", "cone", i, {}, group=str(i // 2)) for i in range(20)]
    >>> split = grouped(twins, SplitSettings(0.7, 0.2, 0.1), seed=0)
    >>> [sum(name == part for name in split.values()) for part in ("train", "validation", "test")]
    [14, 4, 2]
    >>> all(split[a.id] == split[b.id] for a, b in zip(twins[::2], twins[1::2], strict=True))
    True
    """
    families: defaultdict[str, defaultdict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    for spec in specs:
        families[spec.family][spec.group].append(spec.id)
    split_of: dict[str, str] = {}
    for groups in families.values():
        waiting = sorted(groups, key=lambda group: _rank(seed, "grouped", group))
        total = sum(len(ids) for ids in groups.values())
        for split, room in zip(SPLITS, quotas(total, shares), strict=True):
            late = []
            for group in waiting:
                ids = groups[group]
                if len(ids) <= room or split == SPLITS[-1]:
                    split_of.update(dict.fromkeys(ids, split))
                    room -= len(ids)
                else:
                    late.append(group)
            waiting = late
    return split_of


def paper(
    specs: Sequence[ShapeSpec], instances: int, shares: SplitSettings, seed: int
) -> dict[str, tuple[str, ...]]:
    """Split over instances, as the paper does: copies of one shape cross.

    Parameters
    ----------
    specs : sequence of ShapeSpec
        All shapes drawn.
    instances : int
        Copies of each shape.
    shares, seed
        As in :func:`grouped`.

    Returns
    -------
    dict of str to tuple of str
        Split of each instance by shape id.
    """
    keys = [(spec.id, instance) for spec in specs for instance in range(instances)]
    keys.sort(key=lambda key: _rank(seed, "paper", f"{key[0]}/{key[1]}"))
    names = [
        split
        for split, quota in zip(SPLITS, quotas(len(keys), shares), strict=True)
        for _ in range(quota)
    ]
    split_of = dict(zip(keys, names, strict=True))
    return {s.id: tuple(split_of[s.id, i] for i in range(instances)) for s in specs}


def folds(recipe: Recipe, protocol: str, split: str = "test") -> tuple[Fold, ...]:
    """Return the trainings of a protocol that asks for generalisation, or the one that is named.

    Raises
    ------
    RecipeError
        If the recipe has no such protocol, nothing of the version is tested under it, or
        the split is to be trained on and there are several trainings.

    Examples
    --------
    >>> from synthnet import recipe
    >>> version = recipe.load("2.0")
    >>> folds(version, "resolution")
    (Fold(name='resolution', families=(), sizes=('fine',)),)
    >>> len(folds(version, "family")), folds(version, "family/pretzel", "train")[0].families
    (25, ('pretzel',))
    """
    known = recipe.protocols or {}
    kind = protocol.partition("/")[0]
    if kind in known and not known[kind]:
        raise RecipeError(
            f"protocol {protocol} holds nothing of {recipe.version} out: train on grouped, and "
            "test on a dataset of `synthnet import`"
        )
    every = [fold for parts in known.values() for fold in parts]
    trainings = known.get(protocol) or tuple(fold for fold in every if fold.name == protocol)
    if not trainings:
        several = (f"{name}/FAMILY" for name, parts in known.items() if len(parts) > 1)
        choices = ", ".join([*PROTOCOLS, *known, *several])
        names = [*PROTOCOLS, *known, *(fold.name for fold in every)]
        raise RecipeError(
            f"protocol of {recipe.version} must be one of {choices}: {protocol!r}"
            f"{suggestion(protocol, names)}"
        )
    if split != "test" and len(trainings) > 1:
        raise RecipeError(
            f"protocol {protocol} has {len(trainings)} trainings: say which, such as "
            f"{trainings[0].name}"
        )
    return trainings


def takes(fold: Fold, recipe: Recipe, split: str, id: str) -> bool:
    """Return whether a version's shape is used in a fold, by its id; see :func:`uses`.

    Examples
    --------
    >>> from synthnet import recipe
    >>> version = recipe.load("2.0")
    >>> (fold,) = folds(version, "resolution")
    >>> [takes(fold, version, "test", f"blob-0000{index}") for index in range(3)]  # coarse to fine
    [False, False, True]
    """
    family, _, number = id.rpartition("-")
    return uses(fold, recipe, split, family, int(number))


def uses(fold: Fold, recipe: Recipe, split: str, family: str, index: int) -> bool:
    """Return whether a shape of a split is used in a fold, by its family and index there.

    Of the split ``test`` it is what the fold holds out that is tested. Of ``train`` and
    ``validation`` that is left out, and with a family those of the same surfaces. So no
    training sees a test shape of another protocol, and the same shapes can be compared between
    protocols.

    Examples
    --------
    >>> from synthnet import recipe
    >>> version = recipe.load("2.0")
    >>> (fold,) = folds(version, "family/dented_cone")
    >>> [uses(fold, version, split, "circular_cone", 0) for split in ("train", "test")]
    [False, False]
    """
    if split == "test":
        return _held_out(fold, recipe, family, index)
    alike = next((group for group in SAME_SURFACES if family in group), (family,))
    return not any(_held_out(fold, recipe, name, index) for name in alike)


def _held_out(fold: Fold, recipe: Recipe, family: str, index: int) -> bool:
    if fold.families and family not in fold.families:
        return False
    if not fold.sizes:
        return True
    sizes = recipe.sizes or ()
    return sizes[index % recipe.copies].name in fold.sizes


def by_hash(protocol: str, key: str, shares: SplitSettings, seed: int) -> str:
    """Split by the hash of a group or an instance alone: equal keys are never apart.

    The shares hold in the mean, and no other shape has to be known.

    Examples
    --------
    >>> shares = SplitSettings(0.7, 0.2, 0.1)
    >>> drawn = [by_hash("grouped", str(i), shares, seed=0) for i in range(1000)]
    >>> [drawn.count(split) for split in SPLITS]
    [712, 200, 88]
    """
    uniform = int.from_bytes(_rank(seed, protocol, key)[:8], "big") / 2**64
    if uniform < shares.train:
        return SPLITS[0]
    return SPLITS[1] if uniform < shares.train + shares.validation else SPLITS[2]


def _rank(seed: int, protocol: str, key: str) -> bytes:
    # A hash, unlike a shuffle, is equal on every machine, whatever the library's version.
    return hashlib.sha256(f"{seed}/{protocol}/{key}".encode()).digest()


def quotas(total: int, shares: SplitSettings) -> list[int]:
    """Round the shares of ``total`` to whole numbers that add up.

    By largest remainder; where remainders are equal the later split comes first, so that
    a family of five has a shape to test.

    Examples
    --------
    >>> quotas(5, SplitSettings(0.7, 0.2, 0.1))
    [3, 1, 1]
    """
    exact = [round(share * total, 9) for share in astuple(shares)]
    whole = [int(value) for value in exact]
    remainders = [round(value - floor, 9) for value, floor in zip(exact, whole, strict=True)]
    by_remainder = sorted(range(len(exact)), key=lambda i: (remainders[i], i), reverse=True)
    for i in by_remainder[: total - sum(whole)]:
        whole[i] += 1
    return whole
