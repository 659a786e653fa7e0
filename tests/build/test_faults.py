"""Builds killed, starved and damaged, a few times each; evidence/faults.py does more."""

import json
import random
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import pytest

from evidence import faults
from synthnet.build import versions
from synthnet.build.versions import build
from synthnet.build.workers import given
from synthnet.errors import BuildError
from synthnet.store import files

VERSION = "1.0-mini"
SHARD = "shards/torus-0000.parquet"
linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")


@linux
@pytest.mark.slow
def test_killed_builds_end_with_the_same_bytes(mini_home, tmp_path):
    rng, small = random.Random(1), faults.small_ones
    outcome = faults.kill_builds(mini_home, tmp_path, 2, rng, missing=small, seconds=4.0)
    assert (outcome.wrong, outcome.cases, outcome.same) == ([], 2, 2)


@linux
@pytest.mark.slow
def test_full_disk_is_one_line_and_the_build_goes_on(mini_home, tmp_path):
    outcome = faults.fill_disks(mini_home, tmp_path, 1, random.Random(0), faults.small_ones)
    if outcome.skipped:
        pytest.skip(outcome.skipped)
    assert (outcome.wrong, outcome.refused, outcome.same) == ([], 1, 1)


@linux
@pytest.mark.slow
def test_every_altered_byte_is_found_and_mended_or_refused(mini_home, tmp_path):
    outcome = faults.flip_bytes(mini_home, tmp_path, 30, random.Random(3), build_every=30)
    assert (outcome.wrong, outcome.same) == ([], 30)
    assert {"verify: digests", "verify: refused"} <= set(outcome.seen)


def test_harness_notices_what_is_wrong():
    expected = {"a": b"1", "b": b"2"}
    assert faults.difference(expected, expected) is None
    assert faults.difference({"a": b"0", "b": b"2"}, expected) == "differ: a"
    assert faults.difference({**expected, ".x.partial": b""}, expected) == "differ: .x.partial"
    assert faults.difference({"b": b"2"}, expected) == "differ: a"


@pytest.mark.parametrize("error", [MemoryError(), SystemError("error return without exception")])
def test_worker_out_of_memory_is_one_line_and_the_build_goes_on(error, tiny, tmp_path, monkeypatch):
    with monkeypatch.context() as patch, ThreadPoolExecutor(1) as pool:
        patch.setattr(versions, "make_sample", Mock(side_effect=error))
        with pytest.raises(BuildError, match=r"ran out of memory at shards/.*: finished"):
            build(tiny, root=tmp_path, engine=given(pool, workers=1))
    assert not list((tmp_path / "tiny").rglob("*.p*"))
    with ThreadPoolExecutor(1) as pool:
        assert not build(tiny, root=tmp_path, engine=given(pool, workers=1)).nothing_to_do


def test_a_report_survives_json():
    outcome = faults.Outcome("killed", cases=3, refused=1, same=2, wrong=["left behind"])
    outcome.seen["the build, at work"] = 3
    row = json.loads(json.dumps(outcome.row()))
    assert row["seen"] == {"the build, at work": 3}
    table = faults.table({"version": "1.0-mini", "seed": 0, "rows": [row]})
    assert re.search(r"killed +\| 3 +\| 1 +\| 2 +\| 1 +\| 3 the build, at work", table)


def test_a_build_that_fails_leaves_no_partial_file_of_a_stopped_worker(tiny, tmp_path, monkeypatch):
    shards = tmp_path / "tiny" / "shards"
    begun = []

    def stopped(*_):
        if not begun:  # a job that has been queued may begin when the build is over
            (shards / ".torus-0000.parquet.1.partial").write_text("of a worker that was stopped")
        begun.append(True)
        raise BuildError("no space left")

    monkeypatch.setattr(versions, "make_shard", stopped)
    with ThreadPoolExecutor(1) as pool, pytest.raises(BuildError, match="no space left"):
        build(tiny, root=tmp_path, engine=given(pool, workers=1))
    assert not list(tmp_path.rglob("*.partial"))


def test_two_builds_may_look_for_a_place_at_once(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(files.make_directory, [tmp_path / "place"] * 2000))
    assert list((tmp_path / "place").iterdir()) == []


def test_leftover_that_vanishes_is_no_error(tmp_path, monkeypatch):
    gone = tmp_path / ".torus-0000.parquet.1.partial"
    monkeypatch.setattr(Path, "glob", lambda *_: [gone])  # a dying worker has just moved it
    files.remove_partial_files(tmp_path)
