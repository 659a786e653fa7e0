"""Protocols that ask for generalisation: what a recipe may say, and who trains on what."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from synthnet import recipe
from synthnet.errors import RecipeError
from synthnet.families import CHARTED, FAMILIES
from synthnet.loaders.pyg import SynthNet
from synthnet.recipe import splits
from synthnet.recipe.drawing import draw_shape
from synthnet.recipe.plan import plan_shards
from synthnet.types import SPLITS

VERSION = "2.0-mini"


@pytest.fixture(scope="module")
def shapes():
    return [shape for shard in plan_shards(recipe.load(VERSION)) for shape in shard.shapes]


def taken(shapes, protocol, split):
    version = recipe.load(VERSION)
    return {
        shape.spec.id
        for shape in shapes
        for fold in splits.folds(version, protocol, split)
        if shape.split == split and splits.takes(fold, version, split, shape.spec.id)
    }


@pytest.mark.parametrize("protocol", ["resolution", "genus", "boundary", "family/pretzel"])
def test_what_is_held_out_is_tested_and_never_trained_on(shapes, protocol):
    parts = {split: taken(shapes, protocol, split) for split in SPLITS}
    assert all(parts.values())
    kinds = {
        split: {(s.spec.family, s.spec.index % 3) for s in shapes if s.spec.id in parts[split]}
        for split in SPLITS
    }
    assert not kinds["test"] & (kinds["train"] | kinds["validation"])
    everything = {shape.spec.id for shape in shapes if shape.split == "train"}
    assert parts["train"] < everything


def test_each_family_is_tested_once_by_a_model_that_has_not_seen_it(shapes):
    families = Counter(id.rpartition("-")[0] for id in taken(shapes, "family", "test"))
    assert list(families)
    assert families.total() == sum(s.split == "test" for s in shapes)
    for fold in splits.folds(recipe.load(VERSION), "family"):
        assert not [i for i in taken(shapes, fold.name, "train") if i.startswith(fold.families[0])]


@pytest.mark.parametrize("group", splits.SAME_SURFACES)
def test_a_family_is_tested_by_a_model_that_has_seen_none_of_the_same_surfaces(shapes, group):
    assert len(group) > 1
    for family in group:
        seen = {id.rpartition("-")[0] for id in taken(shapes, f"family/{family}", "train")}
        assert not seen & set(group)
        assert len(seen) == 25 - len(group)
        tested = {id.rpartition("-")[0] for id in taken(shapes, f"family/{family}", "test")}
        assert tested == {family}


SAME = {  # of each family, sizes with which the families of a group are one surface
    "circular_cone": {"radius": 1.0, "height": 1.3},
    "flat_rectangle": {"width": 1.2, "height": 1.0},
    "rolled_sheet": {"angle": 2.0},
    "ellipsoid": {"a": 1.0, "b": 1.0, "c": 1.0},
    "conforming_split_sphere": {"radius": 1.0},
    "truncated_cone": {"radius": 1.0, "height": 1.3, "scaling": 1.0},
}


@pytest.mark.parametrize("group", splits.SAME_SURFACES)
def test_families_that_are_held_out_together_share_a_surface(group):
    version = recipe.load("2.0")
    spectra = []
    for family in group:
        drawn = dict(draw_shape(version, family, 0).parameters)
        sizes = {**SAME[group[0]], **SAME.get(family, {})}
        chosen = {key: sizes.get(key, value) for key, value in drawn.items()}
        limit = FAMILIES[family].limit_spectrum(chosen, 10)
        spectra.append((limit.eigenvalues, limit.bar))
    (first, bar), *others = spectra
    assert others
    for eigenvalues, own in others:
        np.testing.assert_array_less(np.abs(eigenvalues - first), bar + own + 1e-12)


def test_genus_and_boundary_hold_out_what_their_names_say():
    version = recipe.load("2.0")
    (genus,), (boundary,) = (splits.folds(version, name) for name in ("genus", "boundary"))
    families = {name: CHARTED[name] for name in version.families}
    assert set(boundary.families) == {name for name, f in families.items() if f.boundaries}
    closed = {name: f for name, f in families.items() if not f.boundaries}
    assert set(genus.families) == {
        name for name, f in closed.items() if f.euler_characteristic != 2
    }


@pytest.mark.parametrize(
    ("protocol", "split", "message"),
    [
        ("mine", "test", "protocol of 2.0-mini must be one of grouped, paper, family, resolution"),
        ("family/torus", "test", "must be one of .*, family/FAMILY: 'family/torus'"),
        ("family", "train", "protocol family has 25 trainings: say which, such as family/cuboid"),
        ("imported", "train", "protocol imported holds nothing of 2.0-mini out: train on grouped"),
        ("imported/scans", "test", "test on a dataset of `synthnet import`"),
    ],
)
def test_a_protocol_that_is_not_there_is_refused(protocol, split, message):
    with pytest.raises(RecipeError, match=message):
        splits.folds(recipe.load(VERSION), protocol, split)


def test_a_version_without_protocols_has_the_two_of_all():
    with pytest.raises(
        RecipeError, match=r"protocol of 1\.0 must be one of grouped, paper: 'genus'"
    ):
        splits.folds(recipe.load("1.0"), "genus")


@pytest.mark.parametrize("protocol", ["resolution", "genus", "family/pretzel", "family"])
def test_dataset_of_a_protocol_has_the_shapes_of_its_split(shapes, protocol):
    stored = SimpleNamespace(
        families=[shape.spec.family for shape in shapes],
        ids=[shape.spec.id for shape in shapes],
        splits=np.array([shape.split for shape in shapes]),
    )
    for split in ("train", "test") if protocol != "family" else ("test",):
        dataset = SimpleNamespace(version=VERSION, protocol=protocol, split=split)
        mine = SynthNet._held_out_or_not(dataset, stored)
        assert mine.any()
        assert {stored.ids[i] for i in np.flatnonzero(mine)} == taken(shapes, protocol, split)


def test_meshes_of_a_surface_have_the_sizes_in_the_order_of_the_recipe():
    version = recipe.load("2.0")
    sizes = version.sizes or ()
    assert len(sizes) == 3
    drawn = [draw_shape(version, "blob", i).parameters["vertices"] for i in range(60)]
    means = [float(np.mean(np.log10(drawn[i::3]))) for i in range(3)]
    for size, mean in zip(sizes, means, strict=True):
        expected, deviation = size.vertices["log10_normal"]
        assert abs(mean - expected) <= deviation
