"""Tests of the Hugging Face dataset over the shards: local, offline, equal to the store."""

import errno
import os
import shutil
import socket
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pyarrow as pa
import pytest

import synthnet
from synthnet import recipe, store
from synthnet.errors import BuildError, DamagedError
from synthnet.recipe.plan import plan_shards
from synthnet.store import limits
from synthnet.types import SPLITS
from synthnet.verify import verify_files

VERSION = "1.0-mini"


@pytest.fixture(scope="module")
def home(unpacking_home):
    """A copy of the dataset in which the library, which must be there, may put its cache."""
    pytest.importorskip("datasets")
    return unpacking_home


@pytest.fixture(autouse=True)
def _no_network(monkeypatch):
    refuse = Mock(side_effect=AssertionError("this must not use the network"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    monkeypatch.setenv("HF_DATASETS_OFFLINE", "1")
    for name in ("connect", "connect_ex", "sendto"):
        monkeypatch.setattr(socket.socket, name, refuse)
    monkeypatch.setattr(socket, "getaddrinfo", refuse)


def test_the_network_is_blocked():
    with pytest.raises(AssertionError, match="must not use the network"):
        socket.create_connection(("127.0.0.1", 9))


@pytest.mark.parametrize("split", SPLITS)
def test_split_holds_its_shapes(split, home):
    dataset = synthnet.load_dataset(VERSION, split=split, root=home)
    planned = [s for plan in plan_shards(recipe.load(VERSION)) for s in plan.shapes]
    assert dataset["id"][:] == [s.spec.id for s in planned if s.split == split]
    assert set(dataset["split"][:]) == {split}
    assert str(dataset.split) == split
    assert dataset.column_names == [*store.SCHEMA.names, "surface_eigenvalues", "surface_bar"]


def test_rows_are_those_of_the_store(home):
    stored = store.open_dataset(VERSION, home)
    dataset = synthnet.load_dataset(VERSION, split="test", root=home)
    for row in dataset:
        sample = stored.find(str(row["id"]))
        for name, expected in (
            ("vertices", sample.mesh.vertices),
            ("faces", sample.mesh.faces),
            ("eigenvalues", sample.eigenvalues),
            ("isometries", sample.isometries.reshape(9, 9)),
        ):
            array = np.asarray(row[name])
            assert array.shape == expected.shape
            assert np.array_equal(array, expected), (sample.spec.id, name)
        assert str(row["family"]) == sample.spec.family
    assert len(dataset) > 0


def test_limits_are_those_of_the_shapes(home, tmp_path):
    dataset = synthnet.load_dataset(VERSION, split="test", root=home)
    known = {row.id: row for row in limits.read(store.open_dataset(VERSION, home))}
    assert len(dataset) == 34
    for row in dataset:
        limit = known[str(row["id"])]
        assert row["surface_eigenvalues"] == limit.eigenvalues.tolist()
        assert row["surface_bar"] == limit.bar.tolist()
    shutil.copytree(home / VERSION, tmp_path / VERSION)
    shutil.rmtree(tmp_path / VERSION / limits.DIRECTORY)
    added = synthnet.load_dataset(VERSION, split="test", root=tmp_path)  # from the pins
    assert added["surface_eigenvalues"][:] == dataset["surface_eigenvalues"][:]
    assert added.column_names == dataset.column_names


def test_split_is_train_unless_said(home):
    assert set(synthnet.load_dataset(VERSION, root=home)["split"][:]) == {"train"}


def test_dataset_lies_beside_the_shards(home):
    dataset = synthnet.load_dataset(VERSION, split="test", root=home)
    assert dataset.cache_files
    for file in dataset.cache_files:
        assert Path(file["filename"]).is_relative_to(home / VERSION)


def test_unknown_split_is_refused(mini_home):
    message = "split must be one of train, validation, test, got 'dev'"
    with pytest.raises(ValueError, match=message):
        synthnet.load_dataset(VERSION, split="dev", root=mini_home)


def test_a_directory_that_cannot_be_written_is_one_line_with_what_to_do(home):
    cache = store.open_dataset(VERSION, home).directory / "datasets-cache"
    shutil.rmtree(cache, ignore_errors=True)
    cache.touch()
    line = rf"cannot write to {cache} \(.*\): choose another .* with \$SYNTHNET_HOME or root=$"
    try:
        with pytest.raises(BuildError, match=line):
            synthnet.load_dataset(VERSION, root=home)
    finally:
        cache.unlink()


def flip(path):
    """Flip a bit in the middle of a file."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 64
    path.write_bytes(content)


def test_a_damaged_shard_is_an_error_that_names_it(home, tmp_path):
    shutil.copytree(home / VERSION, tmp_path / VERSION)
    shutil.rmtree(tmp_path / VERSION / "datasets-cache", ignore_errors=True)
    shard = tmp_path / VERSION / "shards" / "torus-0000.parquet"
    flip(shard)
    with pytest.raises(DamagedError, match=rf"^{shard} is damaged \(.*\): remove it and run "):
        synthnet.load_dataset(VERSION, split="test", root=tmp_path)
    assert not (tmp_path / VERSION / "datasets-cache" / "test").exists()


def test_damaged_rows_are_found_and_unpacked_anew(home, tmp_path, capsys):
    shutil.copytree(home / VERSION, tmp_path / VERSION)
    before = synthnet.load_dataset(VERSION, split="test", root=tmp_path)[:]
    (file,) = (tmp_path / VERSION / "datasets-cache" / "test").glob("*.arrow")
    assert not verify_files(VERSION, root=tmp_path).problems
    flip(file)
    problem = f"{file} is damaged (its SHA-256 is another)"
    assert verify_files(VERSION, root=tmp_path).problems == (
        f"{problem}: it is unpacked anew when it is opened",
    )
    capsys.readouterr()
    assert synthnet.load_dataset(VERSION, split="test", root=tmp_path)[:] == before
    line = f"{problem}: unpacking synthNet {VERSION} anew for Hugging Face datasets\n"
    assert capsys.readouterr().err == line
    assert not verify_files(VERSION, root=tmp_path).problems


def test_a_full_disk_is_one_line_with_what_to_do(home, tmp_path, monkeypatch):
    shutil.copytree(home / VERSION, tmp_path / VERSION)
    cache = tmp_path / VERSION / "datasets-cache"
    shutil.rmtree(cache, ignore_errors=True)
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    monkeypatch.setattr(pa.ipc, "new_stream", Mock(side_effect=full))
    with pytest.raises(BuildError, match=rf"no space left for {cache / 'test'}: free some "):
        synthnet.load_dataset(VERSION, split="test", root=tmp_path)
    assert [path.name for path in cache.iterdir()] == [".test.lock"]


def test_a_home_may_have_any_name(home, tmp_path):
    odd = tmp_path / "a [1] {b,c}*?"
    shutil.copytree(home / VERSION, odd / VERSION)
    assert len(synthnet.load_dataset(VERSION, split="test", root=odd)) == 34
