"""A dataset is of one kind, by its name before it is opened and by its manifest afterwards."""

import re
from pathlib import Path

import pytest

from synthnet import recipe, store
from synthnet.errors import DamagedError, StoreError
from synthnet.recipe import Kind, parse_name
from synthnet.store import ImportDescription, StoredDataset, description_of
from synthnet.types import Manifest
from synthnet.verify.seal import sealed_recipe

DESCRIPTION = ImportDescription(
    {"unit_area": False, "split": "test"}, "1.0", 1, {"a-00000": {"file": "a.ply", "sha256": "0"}}
)


def manifest(version, made_from):
    return Manifest(version, "0" * 64, made_from, {}, (), {})


@pytest.mark.parametrize(
    ("name", "kind", "version", "scale"),
    [
        ("1.0", Kind.VERSION, "1.0", 1),
        ("2.0-mini", Kind.VERSION, "2.0-mini", 1),
        ("1.0-mini-x3", Kind.SCALED, "1.0-mini", 3),
        ("2.0-sealed-0123456789ab", Kind.SEALED, "2.0", 1),
        ("2.0-sealed-0123456789a", Kind.IMPORTED, "2.0-sealed-0123456789a", 1),
        ("scans", Kind.IMPORTED, "scans", 1),
        ("9.9", Kind.IMPORTED, "9.9", 1),
    ],
)
def test_a_name_says_the_kind_and_the_version(name, kind, version, scale):
    parsed = parse_name(name)
    assert (parsed.kind, parsed.version, parsed.scale) == (kind, version, scale)


@pytest.mark.parametrize(
    ("resolved", "kind"),
    [
        (recipe.load("1.0-mini"), Kind.VERSION),
        (recipe.load("1.0-mini-x2"), Kind.SCALED),
        (sealed_recipe("1.0-mini", bytes(range(32))), Kind.SEALED),
    ],
    ids=lambda value: getattr(value, "version", ""),
)
def test_recipe_manifest_and_name_agree(resolved, kind):
    made = manifest(resolved.version, resolved.to_dict())
    assert resolved.kind is kind
    assert StoredDataset(Path(), made).kind is kind
    assert parse_name(resolved.version).kind is kind


def test_an_import_is_known_by_its_manifest_whatever_its_name(tmp_path):
    for name in ("scans", "mesh-x100"):
        (tmp_path / name).mkdir()
        store.write_manifest(tmp_path / name, manifest(name, DESCRIPTION.to_dict()))
        dataset = store.open_unversioned(name, tmp_path)
        assert dataset.kind is Kind.IMPORTED
        assert description_of(dataset.manifest) == DESCRIPTION
    assert store.open_unversioned("1.0-mini", tmp_path) is None


@pytest.mark.parametrize(
    ("name", "made_from"),
    [
        ("1.0-mini", sealed_recipe("1.0-mini", bytes(range(32))).to_dict()),
        ("1.0-mini", recipe.load("1.0-mini-x2").to_dict()),
        ("1.0-mini", DESCRIPTION.to_dict()),
        ("1.0-mini-x2", recipe.load("1.0-mini").to_dict()),
        ("1.0-mini-x2", DESCRIPTION.to_dict()),
        ("1.0-mini-sealed-0123456789ab", recipe.load("1.0-mini").to_dict()),
        ("scans", recipe.load("1.0-mini-x2").to_dict()),
    ],
)
def test_a_manifest_of_another_kind_than_its_name_is_refused(name, made_from, tmp_path):
    (tmp_path / name).mkdir()
    store.write_manifest(tmp_path / name, manifest(name, made_from))
    with pytest.raises(StoreError, match=rf"which cannot have the name {re.escape(name)}: "):
        store.open_dataset(name, tmp_path)


def test_a_recipe_of_your_own_may_have_any_name(tmp_path):
    (tmp_path / "mine").mkdir()
    made = manifest("mine", recipe.load("1.0-mini").to_dict())
    store.write_manifest(tmp_path / "mine", made)
    assert store.open_dataset("mine", tmp_path).manifest == made


def test_a_description_with_other_parts_is_of_another_release():
    newer = manifest("scans", {**DESCRIPTION.to_dict(), "units": "mm"})
    with pytest.raises(StoreError, match=r"scans was imported by a newer synthnet \(units\)"):
        description_of(newer)
    older = manifest("scans", {"imported": {}, "rules": "1.0"})
    with pytest.raises(StoreError, match="scans was imported by an older synthnet"):
        description_of(older)


@pytest.mark.parametrize(
    "part",
    [
        {"imported": []},
        {"imported": {}},
        {"limits": None},
        {"rules": "1.0"},
        {"files": []},
        {"files": {"a-00000": None}},
        {"files": {"a-00000": {}}},
        {"files": {"a-00000": {"file": "a.ply"}}},
        {"files": {"a-00000": {"file": 1, "sha256": "0"}}},
    ],
)
def test_a_description_that_no_import_writes_is_damaged(part):
    damaged = manifest("scans", {**DESCRIPTION.to_dict(), **part})
    with pytest.raises(DamagedError, match=r"^the manifest of scans does not say how each of its"):
        StoredDataset(Path(), damaged).files()
