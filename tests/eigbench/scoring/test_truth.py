"""The labels of a split: sizes, ids, digest, head; equal to a built dataset's."""

import dataclasses

import numpy as np
import pytest
from eigbench.errors import EigbenchError
from eigbench.scoring import truth

from synthnet import store
from synthnet.errors import RecipeError

SIZES = {
    ("1.0-mini", "train", "grouped"): (2106, 234),
    ("1.0-mini", "validation", "grouped"): (603, 67),
    ("1.0-mini", "test", "grouped"): (306, 34),
    ("1.0-mini", "train", "paper"): (2111, 335),
    ("1.0-mini", "validation", "paper"): (607, 298),
    ("1.0-mini", "test", "paper"): (297, 206),
    ("1.0", "test", "grouped"): (14886, 1654),
    ("1.0", "test", "paper"): (14894, 10142),
}


@pytest.fixture(scope="module")
def splits():
    return {key: truth.load(*key) for key in SIZES}


@pytest.fixture(scope="module")
def built(mini_home):
    return list(store.open_dataset("1.0-mini", mini_home).samples())


@pytest.mark.parametrize("key", SIZES, ids=" ".join)
def test_sizes_of_a_split(splits, key):
    split = splits[key]
    assert (len(split.ids), len(set(split.shapes.tolist()))) == SIZES[key]
    assert split.eigenvalues.shape == (len(split.ids), 10)
    assert (split.version, split.split, split.protocol) == key


@pytest.mark.parametrize("protocol", ["grouped", "paper"])
def test_splits_of_the_mini_have_every_instance_once(splits, protocol):
    ids = [
        id
        for split in ("train", "validation", "test")
        for id in splits["1.0-mini", split, protocol].ids
    ]
    assert len(ids) == len(set(ids)) == 335 * 9


def test_no_shape_crosses_the_grouped_splits(splits):
    shapes = [set(splits["1.0-mini", s, "grouped"].shapes) for s in ("train", "validation", "test")]
    assert not shapes[0] & shapes[1]
    assert not shapes[0] & shapes[2]
    assert not shapes[1] & shapes[2]


@pytest.mark.parametrize("key", SIZES, ids=" ".join)
def test_ids_name_the_shape_the_family_and_the_instance(splits, key):
    split = splits[key]
    assert len(split.ids) == SIZES[key][0]
    for id, shape, family in zip(split.ids, split.shapes, split.families, strict=True):
        assert id.rpartition("/")[0] == shape
        assert shape.rpartition("-")[0] == family
        assert 0 <= int(id.rpartition("/")[2]) < 9


@pytest.mark.parametrize("key", [key for key in SIZES if key[0] == "1.0-mini"], ids=" ".join)
def test_split_and_labels_are_those_of_the_built_dataset(splits, built, key):
    _, split, protocol = key
    labels = {}
    for sample in built:
        for instance, paper_split in enumerate(sample.paper_splits):
            if (sample.split if protocol == "grouped" else paper_split) == split:
                labels[f"{sample.spec.id}/{instance}"] = sample.eigenvalues
    loaded = splits[key]
    assert list(loaded.ids) == list(labels)
    np.testing.assert_allclose(loaded.eigenvalues, list(labels.values()), rtol=1e-6)


def test_labels_are_positive_and_ascending(splits):
    assert list(splits) == list(SIZES)
    for split in splits.values():
        assert (split.eigenvalues[:, 0] > 0).all()
        assert (np.diff(split.eigenvalues, axis=1) >= 0).all()


def test_instances_of_a_shape_have_one_label(splits):
    split = splits["1.0-mini", "test", "grouped"]
    assert len(np.unique(split.shapes)) == 34
    for shape in np.unique(split.shapes):
        assert len(np.unique(split.eigenvalues[split.shapes == shape], axis=0)) == 1


def test_digest_is_the_same_for_every_load(splits):
    digest = splits["1.0-mini", "test", "grouped"].digest
    assert digest == truth.load("1.0-mini", "test", "grouped").digest
    assert len(digest) == 64
    assert len({split.digest for split in splits.values()}) == len(SIZES)


def test_digest_changes_with_the_last_bit_of_one_label(splits):
    split = splits["1.0-mini", "test", "grouped"]
    changed = split.eigenvalues.copy()
    changed[200, 3] = np.nextafter(changed[200, 3], 0)
    assert dataclasses.replace(split, eigenvalues=changed).digest != split.digest


def test_digest_changes_with_an_id_and_with_the_order(splits):
    split = splits["1.0-mini", "test", "grouped"]
    renamed = ("cone-99999/0", *split.ids[1:])
    assert dataclasses.replace(split, ids=renamed).digest != split.digest
    swapped = (split.ids[1], split.ids[0], *split.ids[2:])
    assert dataclasses.replace(split, ids=swapped).digest != split.digest


@pytest.mark.parametrize("count", [1, 30, 305])
def test_head_is_a_subset_in_the_order_of_the_whole(splits, count):
    whole = splits["1.0-mini", "test", "grouped"]
    head = whole.head(count)
    rows = [whole.ids.index(id) for id in head.ids]
    assert len(rows) == count
    assert rows == sorted(rows)
    np.testing.assert_array_equal(head.eigenvalues, whole.eigenvalues[rows])
    np.testing.assert_array_equal(head.shapes, whole.shapes[rows])
    np.testing.assert_array_equal(head.families, whole.families[rows])
    assert head.digest != whole.digest
    assert head.recipe_digest == whole.recipe_digest


def test_head_is_the_same_for_every_call_and_for_another_load(splits):
    whole = splits["1.0-mini", "test", "grouped"]
    assert whole.head(30).digest == whole.head(30).digest
    assert whole.head(30).digest == truth.load("1.0-mini").head(30).digest


def test_smaller_heads_are_inside_larger_ones(splits):
    whole = splits["1.0-mini", "test", "grouped"]
    assert set(whole.head(10).ids) < set(whole.head(30).ids) < set(whole.head(100).ids)


def test_head_mixes_the_families(splits):
    assert len(set(splits["1.0", "test", "grouped"].head(100).families.tolist())) >= 8


def test_head_of_more_than_there_is_is_the_whole(splits):
    whole = splits["1.0-mini", "test", "grouped"]
    assert whole.head(1000).digest == whole.digest


def test_unknown_split_is_refused():
    with pytest.raises(EigbenchError, match="split must be one of train, validation, test, got 't"):
        truth.load("1.0-mini", "tests")


def test_unknown_protocol_is_refused():
    message = "protocol of 1.0-mini must be one of grouped, paper: 'random'"
    with pytest.raises(RecipeError, match=message):
        truth.load("1.0-mini", "test", "random")


def test_unknown_version_is_refused():
    with pytest.raises(RecipeError, match=r"unknown version '9\.9': choose one of 1\.0"):
        truth.load("9.9")


def test_version_without_pins_is_refused(monkeypatch):
    monkeypatch.setattr("synthnet.store.pins.read", lambda version: None)
    with pytest.raises(EigbenchError, match=r"the labels of 1\.0 are not pinned"):
        truth.load("1.0-mini")


# --- the labels of 1.0, and that they stay what they are --------------------------------

# Of the ids and labels that the leaderboard stands on. A change is a new dataset version.
DIGESTS = {
    ("1.0", "test", "grouped"): "6b9c2670abcdd84ffd1a15381c615256d5923c7c7e5f491de219a4ab5b52d094",
}


@pytest.mark.parametrize("which", DIGESTS, ids="-".join)
def test_labels_are_those_of_the_leaderboard(which):
    assert truth.load(*which).digest == DIGESTS[which]


def test_equal_shapes_are_one_group():
    labels = truth.load("1.0")
    shapes, groups = len(set(labels.shapes.tolist())), len(set(labels.groups.tolist()))
    assert groups < shapes  # there are more draws of spheres than spheres
    for group in set(labels.groups.tolist()):
        families = set(labels.families[labels.groups == group].tolist())
        assert len(families) == 1
