import dataclasses
from collections import Counter, defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from synthnet.recipe import SplitSettings, splits
from synthnet.types import SPLITS, ShapeSpec

SHARES = SplitSettings(0.7, 0.2, 0.1)


def specs_of(sizes, family="cone"):
    groups = [f"{family}/{group}" for group, size in enumerate(sizes) for _ in range(size)]
    return [ShapeSpec(f"{family}-{i:05d}", family, i, {}, g) for i, g in enumerate(groups)]


@pytest.fixture(scope="module")
def grouped(specs, recipe_1_0):
    return splits.grouped(specs, recipe_1_0.splits, recipe_1_0.seed)


@pytest.fixture(scope="module")
def paper(specs, recipe_1_0):
    return splits.paper(specs, 9, recipe_1_0.splits, recipe_1_0.seed)


# --- version 1.0 ----------------------------------------------------------------------


def test_grouped_gives_every_family_its_shares(specs, grouped):
    assert set(grouped) == {spec.id for spec in specs}
    families = defaultdict(Counter)
    for spec in specs:
        families[spec.family][grouped[spec.id]] += 1
    for family, counts in families.items():
        shares = [counts[split] / counts.total() for split in SPLITS]
        assert shares == pytest.approx([0.7, 0.2, 0.1], abs=0.005), family


def test_paper_gives_all_instances_their_shares_exactly(paper):
    counts = Counter(split for instances in paper.values() for split in instances)
    assert counts == {"train": 104_265, "validation": 29_790, "test": 14_895}  # of 148,950
    assert all(len(instances) == 9 for instances in paper.values())


def test_no_group_crosses_under_grouped(specs, grouped):
    splits_of_group = defaultdict(set)
    for spec in specs:
        splits_of_group[spec.group].add(grouped[spec.id])
    assert {len(crossed) for crossed in splits_of_group.values()} == {1}
    assert len(splits_of_group) < len(specs)  # there are groups of several, so this says something


def test_equal_shapes_stay_together_under_grouped(specs, grouped):
    spheres, halves, tori = defaultdict(list), defaultdict(list), defaultdict(list)
    for spec in specs:
        p, split = spec.parameters, grouped[spec.id]
        if spec.family == "sphere":
            spheres[p["resolution"]].append(split)
        elif spec.family == "split_sphere":
            halves[frozenset([p["resolution_a"], p["resolution_b"]])].append(split)
        elif spec.family == "torus":
            tori[p["tube_radius"]].append(split)
    for shapes in (spheres, halves, tori):
        assert max(map(len, shapes.values())) > 1
        assert all(len(set(assigned)) == 1 for assigned in shapes.values())


def test_there_are_mirror_images_among_the_split_spheres(specs):
    drawn = {
        (s.parameters["resolution_a"], s.parameters["resolution_b"])
        for s in specs
        if s.family == "split_sphere"
    }
    assert sum((b, a) in drawn for a, b in drawn if a != b) > 100


def test_paper_leaks_as_documented(paper):
    leaking = [i for i, instances in paper.items() if {"train", "test"} <= set(instances)]
    # Of nine instances with shares 0.7 and 0.1: 1 - 0.9⁹ - 0.3⁹ + 0.2⁹ have both.
    expected = 1 - 0.9**9 - 0.3**9 + 0.2**9
    deviation = np.sqrt(expected * (1 - expected) / len(paper))
    assert abs(len(leaking) / len(paper) - expected) < 4 * deviation


def test_splits_are_what_they_always_were(grouped, paper):
    golden = {
        "cone-00000": "train",
        "inverted_cone-03999": "test",
        "sphere-00007": "validation",
        "split_sphere-01234": "train",
        "tetrahedron-00001": "test",
        "torus-00042": "train",
    }
    assert {i: grouped[i] for i in golden} == golden
    assert "".join(split[0] for split in paper["cone-00000"]) == "tvtvttvvt"
    assert paper["torus-00042"] == ("validation", *["train"] * 8)


def test_splits_do_not_hang_on_the_order_of_the_shapes(specs, recipe_1_0, grouped, paper):
    shuffled = [specs[i] for i in np.random.default_rng(0).permutation(len(specs))]
    assert splits.grouped(shuffled, recipe_1_0.splits, recipe_1_0.seed) == grouped
    assert splits.paper(shuffled, 9, recipe_1_0.splits, recipe_1_0.seed) == paper


def test_a_new_family_does_not_move_the_others(specs, recipe_1_0, grouped):
    more = [*specs, *specs_of([1] * 30 + [3] * 5, family="ellipsoid")]
    assigned = splits.grouped(more, recipe_1_0.splits, recipe_1_0.seed)
    assert {spec.id: assigned[spec.id] for spec in specs} == grouped
    spheres = [spec for spec in specs if spec.family == "sphere"]
    alone = splits.grouped(spheres, recipe_1_0.splits, recipe_1_0.seed)
    assert alone == {spec.id: grouped[spec.id] for spec in spheres}


# --- any draw -------------------------------------------------------------------------


@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=60),
    st.sampled_from([SHARES, SplitSettings(0.5, 0.5, 0.0), SplitSettings(0.0, 0.1, 0.9)]),
    st.integers(0, 2**32),
)
def test_every_shape_gets_one_split_and_no_group_crosses(sizes, shares, seed):
    specs = specs_of(sizes) + specs_of(sizes[::-1], family="torus")
    assigned = splits.grouped(specs, shares, seed)
    assert set(assigned) == {spec.id for spec in specs}
    assert set(assigned.values()) <= set(SPLITS)
    splits_of_group = defaultdict(set)
    for spec in specs:
        splits_of_group[spec.group].add(assigned[spec.id])
    assert all(len(crossed) == 1 for crossed in splits_of_group.values())
    for family in ("cone", "torus"):
        counts = Counter(split for i, split in assigned.items() if i.startswith(family))
        quotas = splits.quotas(sum(sizes), shares)
        assert counts["train"] <= quotas[0]
        assert counts["validation"] <= quotas[1]
        # Train and validation each lack less than the largest group, or all found room.
        assert counts["test"] - quotas[2] < 2 * max(sizes)


@given(st.integers(1, 500), st.integers(0, 2**32))
def test_single_shapes_meet_their_quotas_exactly(total, seed):
    counts = Counter(splits.grouped(specs_of([1] * total), SHARES, seed).values())
    assert [counts[split] for split in SPLITS] == splits.quotas(total, SHARES)


@given(st.integers(0, 40), st.integers(1, 9), st.integers(0, 2**32))
def test_paper_splits_meet_their_quotas_exactly(shapes, instances, seed):
    assigned = splits.paper(specs_of([1] * shapes), instances, SHARES, seed)
    assert all(len(of_shape) == instances for of_shape in assigned.values())
    counts = Counter(split for of_shape in assigned.values() for split in of_shape)
    assert [counts[split] for split in SPLITS] == splits.quotas(shapes * instances, SHARES)


@given(st.integers(0, 10**6), st.floats(0, 1), st.floats(0, 1))
def test_quotas_add_up_and_are_within_one_of_the_share(total, a, b):
    low, high = sorted((a, b))
    shares = SplitSettings(low, high - low, 1 - high)
    quotas = splits.quotas(total, shares)
    assert sum(quotas) == total
    for quota, share in zip(quotas, dataclasses.astuple(shares), strict=True):
        assert abs(quota - share * total) < 1 + 1e-6


@pytest.mark.parametrize(
    ("total", "expected"),
    [
        (0, [0, 0, 0]),
        (1, [1, 0, 0]),  # 0.7 0.2 0.1
        (3, [2, 1, 0]),  # 2.1 0.6 0.3
        (4, [3, 1, 0]),  # 2.8 0.8 0.4
        (7, [5, 1, 1]),  # 4.9 1.4 0.7
        (8, [5, 2, 1]),  # 5.6 1.6 0.8
        (16_550, [11_585, 3310, 1655]),
    ],
)
def test_quotas_by_largest_remainder(total, expected):
    assert splits.quotas(total, SHARES) == expected


def test_seeds_and_protocols_give_different_splits(specs):
    cones = [spec for spec in specs if spec.family == "cone"]
    by_group = [splits.grouped(cones, SHARES, seed) for seed in (0, 1)]
    one_instance = [splits.paper(cones, 1, SHARES, seed) for seed in (0, 1)]
    flat = [{i: split for i, (split,) in of.items()} for of in one_instance]
    # Independent splits agree with probability 0.7² + 0.2² + 0.1² = 0.54.
    for a, b in ((by_group[0], by_group[1]), (flat[0], flat[1]), (by_group[0], flat[0])):
        assert sum(a[i] == b[i] for i in a) / len(a) == pytest.approx(0.54, abs=0.07)
