"""The labels of a split: sizes, ids, digest, head; equal to a built dataset's."""

import dataclasses

import numpy as np
import pytest
import trimesh
from eigbench.errors import EigbenchError
from eigbench.scoring import truth

from synthnet import store
from synthnet.build import importing
from synthnet.errors import RecipeError
from synthnet.families import FAMILIES

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
    parts = [splits["1.0-mini", split, protocol] for split in ("train", "validation", "test")]
    ids = [id for part in parts for id in part.ids]
    assert len(ids) == len(set(ids)) == 335 * 9


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


def test_instances_of_a_shape_have_one_label(mini_truth):
    shapes = np.unique(mini_truth.shapes)
    assert len(shapes) == 34
    for shape in shapes:
        assert len(np.unique(mini_truth.eigenvalues[mini_truth.shapes == shape], axis=0)) == 1


def test_digest_is_the_same_for_every_load(splits, mini_truth):
    assert splits["1.0-mini", "test", "grouped"].digest == mini_truth.digest
    assert len(mini_truth.digest) == 64
    assert len({split.digest for split in splits.values()}) == len(SIZES)


def test_digest_changes_with_the_last_bit_of_a_label_with_an_id_and_with_the_order(mini_truth):
    first, second, *others = mini_truth.ids
    labels = mini_truth.eigenvalues.copy()
    labels[200, 3] = np.nextafter(labels[200, 3], 0)
    for change in (
        {"eigenvalues": labels},
        {"ids": ("cone-99999/0", second, *others)},
        {"ids": (second, first, *others)},
    ):
        assert dataclasses.replace(mini_truth, **change).digest != mini_truth.digest


@pytest.mark.parametrize("count", [1, 30, 305])
def test_head_is_a_subset_in_the_order_of_the_whole(mini_truth, count):
    head = mini_truth.head(count)
    rows = [mini_truth.ids.index(id) for id in head.ids]
    assert len(rows) == count
    assert rows == sorted(rows)
    for name in ("eigenvalues", "shapes", "families"):
        np.testing.assert_array_equal(getattr(head, name), getattr(mini_truth, name)[rows])
    assert head.digest != mini_truth.digest
    assert head.recipe_digest == mini_truth.recipe_digest


def test_heads_are_the_same_each_time_inside_larger_ones_and_of_many_families(splits, mini_truth):
    again = splits["1.0-mini", "test", "grouped"]
    assert mini_truth.head(30).digest == mini_truth.head(30).digest == again.head(30).digest
    small, middle, large = (set(mini_truth.head(count).ids) for count in (10, 30, 100))
    assert small < middle < large
    assert mini_truth.head(1000).digest == mini_truth.digest
    assert len(set(splits["1.0", "test", "grouped"].head(100).families.tolist())) >= 8


@pytest.mark.parametrize(
    ("question", "error", "message"),
    [
        (
            ("1.0-mini", "tests"),
            EigbenchError,
            "split must be one of train, validation, test, got 't",
        ),
        (
            ("1.0-mini", "test", "random"),
            RecipeError,
            "protocol of 1.0-mini must be one of grouped, paper: 'random'",
        ),
        (("9.9",), RecipeError, r"unknown version '9\.9': choose one of 1\.0"),
    ],
)
def test_what_is_not_there_is_refused(question, error, message):
    with pytest.raises(error, match=message):
        truth.load(*question)


def test_version_without_pins_is_refused(monkeypatch):
    monkeypatch.setattr("synthnet.store.pins.read", lambda version: None)
    with pytest.raises(EigbenchError, match=r"the labels of 1\.0 are not pinned"):
        truth.load("1.0-mini")


# --- the labels of 1.0, and that they stay what they are --------------------------------


def test_labels_are_those_of_the_leaderboard(splits):
    """Of the ids and labels that it stands on. A change is a new dataset version."""
    expected = "6b9c2670abcdd84ffd1a15381c615256d5923c7c7e5f491de219a4ab5b52d094"
    assert splits["1.0", "test", "grouped"].digest == expected


def test_equal_shapes_are_one_group(splits):
    labels = splits["1.0", "test", "grouped"]
    shapes, groups = len(set(labels.shapes.tolist())), len(set(labels.groups.tolist()))
    assert groups < shapes  # there are more draws of spheres than spheres
    for group in set(labels.groups.tolist()):
        families = set(labels.families[labels.groups == group].tolist())
        assert len(families) == 1


def test_copies_of_an_imported_file_are_one_shape(tmp_path):
    scans = tmp_path / "scans"
    scans.mkdir()
    for name, radius in {"a": 1.0, "b": 2.0, "copy": 1.0}.items():
        sphere = FAMILIES["sphere"].generate({"radius": radius, "resolution": 12})
        trimesh.Trimesh(sphere.vertices, sphere.faces).export(scans / f"{name}.ply")
    importing.import_meshes([scans], "mine", root=tmp_path / "data", workers=1)
    labels = truth.of_import(store.open_dataset("mine", tmp_path / "data"), "2.0")
    assert len(labels.ids) == 3
    assert sorted(np.unique(labels.groups, return_counts=True)[1].tolist()) == [1, 2]
