"""Tests of the error estimates on disk: made, kept, found, verified and pinned."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from synthnet import recipe, store
from synthnet.build import estimates
from synthnet.build.discretisation import Estimate, estimate
from synthnet.build.jobs import ShardResult, exclusive, keep_or_make
from synthnet.build.terms import terms_of
from synthnet.commands import cli
from synthnet.errors import BuildError, DamagedError, SpectrumError, StoreError
from synthnet.recipe.plan import plan_shards
from synthnet.store import StoredDataset, pins
from synthnet.types import Sample, ShapeSpec, ShardRecord
from synthnet.verify import checks, shapes
from synthnet.verify.checks import verify

VERSION = "1.0-mini"
FAMILY = "split_cone"  # small meshes
Command = Callable[..., subprocess.CompletedProcess[str]]


def no_error(sample: Sample) -> Estimate:
    """The estimate of a label that does not change under refinement."""
    label = sample.eigenvalues
    return Estimate(sample.spec.id, np.zeros_like(label), np.stack([label]))


def record_of(dataset: StoredDataset, family: str = FAMILY) -> ShardRecord:
    return next(r for r in dataset.manifest.shards if r.family == family)


def estimate_shard(dataset: StoredDataset, record: ShardRecord) -> ShardResult:
    """Estimate the errors of one shard in this process, or keep those that are there."""
    version = recipe.load(VERSION)
    plan = next(plan for plan in plan_shards(version) if plan.file == record.file)
    terms = terms_of(version, dataset.directory)
    return keep_or_make(estimates.estimates_job(plan, record, terms))


def rewrite(
    dataset: StoredDataset, change: Callable[[list[Estimate]], list[Estimate]] = lambda rows: rows
) -> list[Estimate]:
    """Write the estimates of a shard anew, changed, and return what they were."""
    record = record_of(dataset)
    rows = estimates.read_shard(dataset.directory, record)
    estimates._write_shard(estimates.path_of(dataset.directory, record), change(rows), record)
    return rows


@pytest.fixture(scope="session")
def estimated_home(mini_home: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Directory with 1.0-mini and estimates, all zero, of every shard. Read only."""
    home = tmp_path_factory.mktemp("estimated") / "home"
    shutil.copytree(mini_home, home)
    found = store.open_dataset(VERSION, home)
    (found.directory / estimates.DIRECTORY).mkdir()
    for record in found.manifest.shards:
        rows = [no_error(s) for s in store.read_samples(found.directory / record.file)]
        estimates._write_shard(estimates.path_of(found.directory, record), rows, record)
    return home


@pytest.fixture
def dataset(estimated_home: Path, tmp_path: Path) -> StoredDataset:
    """A copy of that dataset, which a test may change."""
    shutil.copytree(estimated_home, tmp_path / "copy")
    return store.open_dataset(VERSION, tmp_path / "copy")


def contents(home: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(home)): path.read_bytes()
        for path in sorted(home.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


# Made


@pytest.mark.slow
def test_command_makes_what_is_missing_and_keeps_the_rest(
    dataset: StoredDataset, mini_home: Path, command: Command
) -> None:
    home = dataset.directory.parent
    estimates.path_of(dataset.directory, record_of(dataset)).unlink()
    leftover = dataset.directory / estimates.DIRECTORY / ".x.parquet.1.partial"
    leftover.touch()
    arguments = ["build", "--version", VERSION, "--out", home, "--error-estimates"]
    done = command(*arguments, "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert "10 shards kept from an earlier run" in done.stdout
    assert f"errors of {FAMILY}: done" in done.stderr
    assert not leftover.exists()
    found = {row.id: row for row in estimates.read(dataset)}
    sample = next(store.read_samples(dataset.directory / record_of(dataset).file))
    expected = estimate(sample.spec, sample.eigenvalues)
    np.testing.assert_allclose(found[sample.spec.id].error, expected.error, rtol=1e-6)
    np.testing.assert_allclose(found[sample.spec.id].refined, expected.refined, rtol=1e-9)

    after = contents(home)
    assert {k: v for k, v in after.items() if "/errors/" not in k} == contents(mini_home)
    again = command(*arguments, "--json")
    assert json.loads(again.stdout)["error_estimates"]["nothing_to_do"] is True
    said = command(*arguments).stdout
    assert "its error estimates are there already: nothing to do" in said
    assert "is built already" in said.splitlines()[0]
    assert "nothing to do" not in said.splitlines()[0]
    for place, known in ((home, "of every label"), (mini_home, "none (--error-estimates)")):
        told = command("info", "--version", "1.0-mini", "--out", place).stdout
        assert f"estimates  {known}\n" in told
    assert contents(home) == after


@pytest.mark.slow
def test_the_same_shard_gives_the_same_bytes(dataset: StoredDataset) -> None:
    record = record_of(dataset)
    path = estimates.path_of(dataset.directory, record)
    found = []
    for _ in range(2):
        path.unlink()
        result = estimate_shard(dataset, record)
        assert (result.reused, result.damaged) == (False, None)
        found.append(path.read_bytes())
    assert found[0] == found[1]
    assert estimate_shard(dataset, record).reused


@pytest.mark.parametrize("damage", ["byte", "other shard", "schema"])
def test_damaged_estimates_are_not_read(dataset: StoredDataset, damage: str) -> None:
    record = record_of(dataset)
    path = estimates.path_of(dataset.directory, record)
    if damage == "byte":
        content = bytearray(path.read_bytes())
        content[len(content) // 3] ^= 1
        path.write_bytes(content)
    elif damage == "other shard":
        record = dataclasses.replace(record, sha256="0" * 64)
    else:
        pq.write_table(pq.read_table(path).drop_columns(["refined"]), path)
    with pytest.raises(DamagedError, match="run `synthnet build --error-estimates` again"):
        estimates.read_shard(dataset.directory, record)


def test_a_damaged_file_is_said_and_replaced(
    dataset: StoredDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fake(spec: ShapeSpec, values: np.ndarray, _: dict[str, np.ndarray]) -> Estimate:
        return Estimate(spec.id, values, np.stack([values]))

    monkeypatch.setattr(estimates, "estimate", fake)
    record = record_of(dataset)
    estimates.path_of(dataset.directory, record).write_bytes(b"no Parquet")
    assert not estimates.is_complete(dataset)
    assert estimates.any_made(dataset)
    result = estimate_shard(dataset, record)
    assert result.damaged is not None
    assert "is damaged" in result.damaged
    assert estimates.is_complete(dataset)


def test_a_solver_that_fails_names_the_shape(
    dataset: StoredDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(spec: ShapeSpec, values: np.ndarray, _: dict[str, np.ndarray]) -> Estimate:
        raise SpectrumError("factorisation failed")

    monkeypatch.setattr(estimates, "estimate", fail)
    record = record_of(dataset)
    estimates.path_of(dataset.directory, record).unlink()
    with pytest.raises(SpectrumError, match=rf"^{FAMILY}-\d+, refined: factorisation failed$"):
        estimate_shard(dataset, record)


def test_estimates_need_a_dataset_of_this_recipe(dataset: StoredDataset, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no finished dataset in"):
        estimates.build_estimates(VERSION, root=tmp_path / "empty")
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        estimates.build_estimates(VERSION, root=dataset.directory.parent, workers=0)
    other = dataclasses.replace(dataset.manifest, recipe_digest="0" * 64)
    store.write_manifest(dataset.directory, other)
    with pytest.raises(StoreError, match="of another recipe"):
        estimates.build_estimates(VERSION, root=dataset.directory.parent)


def test_two_at_once_do_not_mix(dataset: StoredDataset) -> None:
    estimates.path_of(dataset.directory, record_of(dataset)).unlink()
    with (
        exclusive(dataset.directory, wait_for_lock=False),
        pytest.raises(BuildError, match="another build is writing to"),
    ):
        estimates.build_estimates(VERSION, root=dataset.directory.parent)


# Read


def test_estimates_are_read_in_the_order_of_the_samples(dataset: StoredDataset) -> None:
    rows = list(estimates.read(dataset))
    assert [row.id for row in rows] == [sample.spec.id for sample in dataset.samples()]
    assert all(row.error.shape == (10,) and row.refined.shape == (1, 10) for row in rows)
    one = estimates.find(dataset, rows[-1].id)
    assert one is not None
    np.testing.assert_array_equal(one.refined, rows[-1].refined)


def test_a_dataset_without_estimates_has_none(mini_home: Path) -> None:
    plain = store.open_dataset(VERSION, mini_home)
    assert not estimates.is_complete(plain)
    assert estimates.find(plain, "torus-00000") is None
    with pytest.raises(DamagedError, match="is missing: run `synthnet build --error-estimates`"):
        next(estimates.read(plain))


def test_show_has_the_errors(
    dataset: StoredDataset, mini_home: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    id = next(estimates.read(dataset)).id
    for home, expected in ((mini_home, None), (dataset.directory.parent, [0.0] * 10)):
        arguments = ["show", id, "--version", VERSION, "--out", str(home)]
        assert cli.main([*arguments, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["error_estimate"] == expected
        assert cli.main(arguments) == 0
        assert ("their estimated errors" in capsys.readouterr().out) is (expected is not None)


# Verified


def found_errors(dataset: StoredDataset, sample: int = 0) -> list[str]:
    report = verify(VERSION, root=dataset.directory.parent, sample=sample)
    (check,) = (c for c in report.checks if c.name == "errors")
    assert all(c.problems == () for c in report.checks if c.name not in ("errors", "pins"))
    return list(check.problems)


@pytest.fixture(autouse=True)
def no_meshes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What verify does besides has its own tests."""
    monkeypatch.setattr(shapes, "check_mesh", lambda sample: [])
    monkeypatch.setattr(shapes, "check_label", lambda sample: [])
    monkeypatch.setattr(pins, "read_errors", lambda version: None)


def test_whole_estimates_pass(dataset: StoredDataset) -> None:
    assert found_errors(dataset) == []


def test_an_error_that_is_not_of_its_eigenvalues_is_found(dataset: StoredDataset) -> None:
    def change(rows: list[Estimate]) -> list[Estimate]:
        rows[3] = dataclasses.replace(rows[3], error=rows[3].refined[0] * 2e-5)
        return rows

    rows = rewrite(dataset, change)
    assert found_errors(dataset) == [
        f"{rows[3].id}: error estimate is 2e-05 of the label off its own refined eigenvalues, "
        "more than 1e-05"
    ]


def test_estimates_of_other_shapes_or_lengths_are_found(dataset: StoredDataset) -> None:
    rewrite(dataset, lambda rows: rows[1:])
    file = record_of(dataset).file
    assert found_errors(dataset) == [f"{file}: the error estimates beside it are of other shapes"]
    record = record_of(dataset)
    samples = list(store.read_samples(dataset.directory / record.file))
    rows = [no_error(sample) for sample in samples]
    rows[0] = Estimate(rows[0].id, rows[0].error[:9], rows[0].refined[:, :9])
    estimates._write_shard(estimates.path_of(dataset.directory, record), rows, record)
    assert found_errors(dataset) == [f"{rows[0].id}: 9 error estimates of 10 eigenvalues"]


def test_missing_estimates_of_one_shard_are_found(dataset: StoredDataset) -> None:
    estimates.path_of(dataset.directory, record_of(dataset)).unlink()
    (problem,) = found_errors(dataset)
    assert "is missing: run `synthnet build --error-estimates` again" in problem


def test_some_are_made_anew(dataset: StoredDataset, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def record(spec: ShapeSpec, label: np.ndarray) -> Estimate:
        asked.append(spec.id)
        return Estimate(spec.id, label * 0.01, label[None])

    monkeypatch.setattr(shapes, "estimate", record)
    problems = found_errors(dataset, sample=60)
    assert len(asked) == len(set(asked)) == checks.ERRORS_MADE_ANEW == len(problems)
    assert len({id.rpartition("-")[0] for id in asked}) > 1
    assert all("is 0.01 of the label off one made anew, more" in problem for problem in problems)


def test_estimates_that_are_not_the_pinned_ones_are_found(
    dataset: StoredDataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ids = [row.id for row in estimates.read(dataset)]
    pinned = {id: np.zeros(10, dtype=np.float32) for id in ids}
    pinned[ids[5]] = np.full(10, 3e-5, dtype=np.float32)
    monkeypatch.setattr(pins, "read_errors", lambda version: pinned)
    assert found_errors(dataset) == [
        f"{ids[5]}: error estimate is 3e-05 of the label off the pinned one, more than 1e-05"
    ]


# Pinned


def test_pins_are_read_as_they_were_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    written: dict[str, Any] = {"a-0": np.linspace(0, 0.3, 10), "b-1": np.full(10, -0.1)}
    pins.write_errors(tmp_path / "9.9.errors.parquet", written)
    monkeypatch.setattr(pins.resources, "files", lambda package: tmp_path)
    found = pins.read_errors("9.9")
    assert found is not None
    assert list(found) == list(written)
    for id, row in found.items():
        assert row.dtype == np.float32
        np.testing.assert_array_equal(row, written[id].astype(np.float32))
    assert pins.read_errors("9.8") is None
