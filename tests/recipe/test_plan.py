import dataclasses
from collections import Counter, defaultdict

import pytest

from synthnet import recipe
from synthnet.recipe import splits
from synthnet.recipe.plan import plan_shards
from synthnet.types import SPLITS

SUBSETS = ("1.0-mini", "1.0-small")


@pytest.fixture(scope="module")
def plans():
    return {version: plan_shards(recipe.load(version)) for version in ("1.0", *SUBSETS)}


def shapes_of(shards):
    return {shape.spec.id: shape for shard in shards for shape in shard.shapes}


def test_the_full_plan_is_the_draw_with_its_splits(plans, specs, recipe_1_0):
    planned = [shape for shard in plans["1.0"] for shape in shard.shapes]
    assert [shape.spec for shape in planned] == specs
    grouped = splits.grouped(specs, recipe_1_0.splits, recipe_1_0.seed)
    assert {shape.spec.id: shape.split for shape in planned} == grouped
    paper = splits.paper(specs, 9, recipe_1_0.splits, recipe_1_0.seed)
    assert {shape.spec.id: shape.paper_splits for shape in planned} == paper


@pytest.mark.parametrize("version", SUBSETS)
def test_a_subset_has_shapes_and_splits_of_the_full_version(plans, version):
    full, part = shapes_of(plans["1.0"]), shapes_of(plans[version])
    assert part == {i: full[i] for i in part}


def test_mini_is_part_of_small(plans):
    assert shapes_of(plans["1.0-mini"]).keys() < shapes_of(plans["1.0-small"]).keys()


@pytest.mark.parametrize(
    ("version", "share", "spheres", "total"),
    [("1.0-mini", 0.02, 5, 335), ("1.0-small", 0.1, 5, 1655), ("1.0", 1, 50, 16_550)],
)
def test_sizes(plans, recipe_1_0, version, share, spheres, total):
    counts = Counter(shape.spec.family for shape in shapes_of(plans[version]).values())
    assert counts.pop("sphere") == spheres
    families = recipe_1_0.families
    assert counts == {n: share * families[n].count for n in families if n != "sphere"}
    assert counts.total() + spheres == total == recipe.load(version).count


@pytest.mark.parametrize("version", SUBSETS)
def test_each_family_of_a_subset_has_the_shares_of_the_recipe(plans, version):
    families = defaultdict(Counter)
    for shape in shapes_of(plans[version]).values():
        families[shape.spec.family][shape.split] += 1
    assert set(families.pop("sphere")) == {*SPLITS}  # too few for shares, and all three splits
    assert len(families) == 9
    for family, counts in families.items():
        shares = [counts[split] / counts.total() for split in SPLITS]
        assert shares == pytest.approx([0.7, 0.2, 0.1], abs=1e-12), family


@pytest.mark.parametrize("version", ["1.0", *SUBSETS])
def test_shards_are_full_but_the_last_of_a_family_and_have_names_of_their_own(plans, version):
    shards, most = plans[version], recipe.load(version).shard_size
    assert len({shard.file for shard in shards}) == len(shards)
    for shard, following in zip(shards, [*shards[1:], None], strict=True):
        last = following is None or following.family != shard.family
        assert 1 <= len(shard.shapes) <= most
        assert last or len(shard.shapes) == most
        assert {shape.spec.family for shape in shard.shapes} == {shard.family}
        indices = [shape.spec.index for shape in shard.shapes]
        assert indices == sorted(indices)


def test_names_of_shards_count_from_zero_in_each_family(plans):
    names = [shard.file for shard in plans["1.0-small"] if shard.family in ("cone", "sphere")]
    assert names == [f"shards/{name}.parquet" for name in ("cone-0000", "cone-0001", "sphere-0000")]
    assert len(plans["1.0"]) == 40 + 20 + 20 + 1 + 40 + 40 + 20 + 50 + 20 + 80


def test_the_size_of_the_shards_changes_no_shape(plans):
    other = plan_shards(dataclasses.replace(recipe.load("1.0-mini"), shard_size=7))
    assert shapes_of(other) == shapes_of(plans["1.0-mini"])
    assert max(len(shard.shapes) for shard in other) == 7


# Scaled


def test_scaled_shapes_are_new_and_a_smaller_scale_is_the_beginning_of_a_larger():
    base = shapes_of(plan_shards(recipe.load("1.0-mini")))
    twice, thrice = (shapes_of(plan_shards(recipe.load(f"1.0-mini-x{n}"))) for n in (2, 3))
    assert len(base) == 335
    assert (len(twice), len(thrice)) == (2 * 335, 3 * 335)
    assert {id: thrice[id] for id in twice} == twice  # splits and all
    full = recipe.load("1.0").families
    assert all(s.spec.index >= full[s.spec.family].count for s in thrice.values())


@pytest.mark.slow
def test_no_shape_is_in_another_split_than_its_equal_in_the_full_version(plans):
    split_of = {s.spec.group: s.split for s in shapes_of(plans["1.0"]).values()}
    shapes = [s for plan in plan_shards(recipe.load("1.0-x2")) for s in plan.shapes]
    spheres = [s for s in shapes if s.spec.family == "sphere" and s.spec.group in split_of]
    assert len(spheres) > 20
    assert all(s.split == split_of.get(s.spec.group, s.split) for s in shapes)
    own = defaultdict(set)
    for shape in shapes:
        own[shape.spec.group].add(shape.split)
    assert {len(splits) for splits in own.values()} == {1}


def test_plan_of_a_scaled_version_is_a_sequence():
    shards = plan_shards(recipe.load("1.0-x100"))
    assert len(shards) == 33_100
    assert shards[-1].family == "inverted_cone"
    assert shards[0:2] == [shards[0], shards[1]]
    assert shards[0].shapes[0].spec.id == "rectangular_prism-02000"
    with pytest.raises(IndexError):
        shards[33_100]


def test_shares_of_a_scaled_version_hold_in_the_mean():
    shapes = shapes_of(plan_shards(recipe.load("1.0-mini-x10"))).values()
    counts = Counter(shape.split for shape in shapes)
    shares = [counts[split] / counts.total() for split in SPLITS]
    assert shares == pytest.approx([0.7, 0.2, 0.1], abs=0.03)
