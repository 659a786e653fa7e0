"""Tests of the limits on disk: looked up or computed, kept, found and verified."""

import dataclasses
import json
import shutil
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import Mock

import numpy as np
import pyarrow.parquet as pq
import pytest
from eigbench.scoring import metrics

import synthnet
from synthnet import recipe, store
from synthnet.build import limits as building
from synthnet.build import versions
from synthnet.build.jobs import exclusive
from synthnet.build.versions import build
from synthnet.build.workers import given
from synthnet.commands import info
from synthnet.errors import BuildError, DamagedError, SpectrumError, StoreError
from synthnet.families import FAMILIES
from synthnet.families.family import Family
from synthnet.families.limits import Limit
from synthnet.recipe.drawing import draw_shape
from synthnet.store import limits, pins
from synthnet.types import ShardRecord
from synthnet.verify import checks, shapes
from synthnet.verify.checks import verify, verify_files
from tests.datasets import contents

VERSION = "1.0-mini"
FAMILY = "split_cone"


def record_of(dataset):
    return next(r for r in dataset.manifest.shards if r.family == FAMILY)


def without(files, folder):
    return {name: content for name, content in files.items() if not name.startswith(folder)}


@pytest.fixture
def dataset(mini_copy):
    """A copy of 1.0-mini with its limits, which a test may change."""
    return store.open_dataset(VERSION, mini_copy)


@pytest.fixture
def threads():
    """Engines of one thread of this process."""
    with ThreadPoolExecutor(1) as pool:
        yield lambda: given(pool, workers=1)


@pytest.fixture
def round_shapes(tiny):
    """A recipe that no pin is of: two tori and a sphere, whose limits are quick to compute."""
    families = {name: tiny.families[name] for name in ("torus", "sphere")}
    families["torus"] = dataclasses.replace(families["torus"], count=2)
    return dataclasses.replace(tiny, families=families)


@pytest.fixture
def built(round_shapes, tmp_path, threads):
    build(round_shapes, root=tmp_path, engine=threads())
    return round_shapes, tmp_path


# Looked up


def test_a_build_writes_the_pinned_limits(mini_home):
    stored = store.open_dataset(VERSION, mini_home)
    pinned = pins.read_limits("1.0")
    assert pinned is not None
    rows, samples = list(limits.read(stored)), list(stored.samples())
    assert [row.id for row in rows] == [sample.spec.id for sample in samples]
    labels = np.array([sample.eigenvalues for sample in samples])
    values = np.array([row.eigenvalues for row in rows])
    np.testing.assert_array_equal(values, [pinned[row.id].eigenvalues for row in rows])
    np.testing.assert_array_equal([row.bar for row in rows], [pinned[row.id].bar for row in rows])
    np.testing.assert_allclose([row.error for row in rows], (labels - values) / values, atol=1e-14)
    above = metrics.psnr_above_20(labels, values)
    assert [row.above_20_db for row in rows] == above.astype(bool).tolist()
    assert 0.1 < 1 - above.mean() < 0.25  # 16 % of 1.0's labels fail


def test_a_dataset_that_was_built_without_gets_them(dataset):
    before = contents(dataset.directory)
    shutil.rmtree(dataset.directory / limits.DIRECTORY)
    assert not limits.any_there(dataset)
    assert build(VERSION, root=dataset.directory.parent).nothing_to_do
    assert contents(dataset.directory) == before


def test_damaged_limits_are_written_again(dataset):
    before = contents(dataset.directory)
    limits.path_of(dataset.directory, record_of(dataset)).write_bytes(b"no Parquet")
    assert build(VERSION, root=dataset.directory.parent).nothing_to_do
    assert contents(dataset.directory) == before


def test_shards_and_manifest_do_not_depend_on_limits(built, tmp_path, threads, monkeypatch):
    resolved, home = built
    plain = contents(home / "tiny")
    assert not any(name.startswith("limits") for name in plain)
    ids = ["torus-00000", "torus-00001", "sphere-00000"]
    pinned = {id: Limit(np.arange(1.0, 11), np.full(10, 1e-6)) for id in ids}
    monkeypatch.setattr(versions.limits, "pinned", lambda _: pinned)
    build(resolved, root=tmp_path / "other", engine=threads())
    files = contents(tmp_path / "other" / "tiny")
    assert without(files, "limits") == plain
    assert len(files) == len(plain) + 2


def test_what_a_recipe_of_ones_own_made_is_opened(built):
    pyg = pytest.importorskip("synthnet.pyg")
    pytest.importorskip("datasets")
    _, home = built
    split = next(versions.ensure_built("tiny", home).samples()).split
    shapes = pyg.SynthNet(home, "tiny", split, augment=False)
    assert shapes.shape_id == synthnet.load_dataset("tiny", split, root=home)["id"][:]
    with pytest.raises(StoreError, match="make them by synthnet"):
        pyg.SynthNet(home, "tiny", split, target="surface")


def test_a_recipe_of_ones_own_has_no_pins(recipe_1_0, round_shapes):
    for version in ("1.0", "1.0-mini"):
        assert building.pinned(recipe.load(version)) is not None
    assert building.pinned(round_shapes) is None
    assert building.pinned(recipe.scaled(recipe_1_0, 2)) is None
    same_name = dataclasses.replace(recipe_1_0, seed=1)
    assert same_name.version == "1.0"
    assert building.pinned(same_name) is None


# Computed


def compute(built, engine):
    resolved, home = built
    return building.build_limits(resolved, root=home, engine=engine)


def test_others_are_computed_and_a_run_goes_on_where_it_stopped(built, threads, monkeypatch):
    _, home = built
    report = compute(built, threads())
    assert (report.nothing_to_do, report.reused) == (False, 0)
    samples = {sample.spec.id: sample for sample in report.dataset.samples()}
    rows = list(limits.read(report.dataset))
    assert len(rows) == 3
    for row in rows:
        spec = samples[row.id].spec
        expected = FAMILIES[spec.family].limit_spectrum(spec.parameters)
        np.testing.assert_allclose(row.eigenvalues, expected.eigenvalues, rtol=1e-12)
        np.testing.assert_allclose(row.bar, expected.bar, rtol=1e-12)
    before = contents(home / "tiny")
    (home / "tiny/limits/torus-0000.parquet").unlink()
    (home / "tiny/limits/.x.parquet.1.partial").touch()
    assert compute(built, threads()).reused == 1
    assert contents(home / "tiny") == before
    assert compute(built, threads()).nothing_to_do


def test_triangulations_of_a_surface_share_its_limit(tmp_path, monkeypatch):
    specs = [draw_shape(recipe.load("2.0"), "ellipsoid", index) for index in range(6)]
    solve = Mock(return_value=Limit(np.arange(1.0, 11), np.ones(10)))
    monkeypatch.setattr(Family, "limit_spectrum", solve)
    monkeypatch.setattr(store, "read_labels", lambda _: ((s, np.arange(1.0, 11)) for s in specs))
    (tmp_path / limits.DIRECTORY).mkdir()
    record = ShardRecord("shards/ellipsoid-0000.parquet", "ellipsoid", "0" * 64, 1, 6, 1, 1, ())
    building.make_shard(tmp_path, record)
    assert solve.call_count == 2
    assert [row.id for row in limits.read_shard(tmp_path, record)] == [s.id for s in specs]


def test_a_surface_that_cannot_be_solved_names_the_shape(built, threads, monkeypatch):
    fail = Mock(side_effect=SpectrumError("factorisation failed"))
    monkeypatch.setattr(Family, "limit_spectrum", fail)
    with pytest.raises(SpectrumError, match=r"^torus-00000, its surface: factorisation failed$"):
        compute(built, threads())


def test_limits_need_a_dataset_of_this_recipe(built, tmp_path, threads):
    resolved, home = built
    with pytest.raises(StoreError, match="no finished dataset in"):
        building.build_limits(VERSION, root=tmp_path / "empty")
    with pytest.raises(ValueError, match="workers must be at least 1, got 0"):
        building.build_limits(resolved, root=home, workers=0)
    with pytest.raises(StoreError, match="of another recipe"):
        compute((dataclasses.replace(resolved, seed=1), home), threads())


def test_two_at_once_do_not_mix(built, threads):
    with (
        exclusive(built[1] / "tiny", wait_for_lock=False),
        pytest.raises(BuildError, match="another build is writing to"),
    ):
        compute(built, threads())


def test_the_command_finds_pinned_limits_there(mini_home, printed):
    arguments = ["build", "--version", VERSION, "--out", mini_home, "--limits"]
    out = printed(*arguments)
    assert "is built already" in out.splitlines()[0]
    assert "nothing to do" not in out.splitlines()[0]
    assert "its limits are there: nothing to compute" in out
    assert json.loads(printed(*arguments, "--json"))["limits"]["nothing_to_do"] is True


@pytest.mark.slow
def test_the_command_computes_those_of_a_sealed_set(sealed_set, tmp_path, command):
    home, name = sealed_set.home, sealed_set.seal.dataset
    shutil.copytree(home, tmp_path / "home")
    arguments = ["build", "--version", name, "--out", tmp_path / "home", "--limits"]
    done = command(*arguments, "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert "limits computed in" in done.stdout
    assert "limits of torus: done" in done.stderr
    sealed_dataset = store.open_dataset(name, tmp_path / "home")
    assert len(list(limits.read(sealed_dataset))) == sealed_dataset.manifest.rows
    assert without(contents(sealed_dataset.directory), "limits") == contents(home / name)
    report = verify(name, root=tmp_path / "home", sample=10)
    assert report.problems == ()
    assert {c.name: c.examined for c in report.checks}["limits"] == sealed_dataset.manifest.rows


# Read


@pytest.mark.parametrize("damage", ["byte", "other shard", "schema", "missing"])
def test_damaged_limits_are_not_read(dataset, damage):
    record = record_of(dataset)
    path = limits.path_of(dataset.directory, record)
    if damage == "byte":
        content = bytearray(path.read_bytes())
        content[len(content) // 3] ^= 1
        path.write_bytes(content)
    elif damage == "other shard":
        record = dataclasses.replace(record, sha256="0" * 64)
    elif damage == "schema":
        pq.write_table(pq.read_table(path).drop_columns(["bar"]), path)
    else:
        path.unlink()
    assert not limits.is_whole(dataset.directory, record)
    remedy = "run `synthnet build --limits` again, with the same dataset and --out"
    with pytest.raises(DamagedError, match=remedy):
        limits.read_shard(dataset.directory, record)


def test_a_limit_is_found_by_its_id(dataset):
    last = list(limits.read(dataset))[-1]
    limit = limits.find(dataset, last.id)
    assert limit is not None
    np.testing.assert_array_equal(limit.eigenvalues, last.eigenvalues)
    assert limits.find(dataset, "torus-99999") is None
    shutil.rmtree(dataset.directory / limits.DIRECTORY)
    assert limits.find(dataset, last.id) is None


def test_psnr_is_that_of_the_paper():
    p, g = np.array([2.1, 4.0, 7.0]), np.array([2.0, 4.0, 6.0])
    expected = 10 * np.log10(16 / (1.01 / 3))
    assert limits.psnr(p, g) == pytest.approx(expected)
    assert limits.psnr(p, g) == pytest.approx(float(metrics.psnr(p[None], g[None])[0]))
    assert limits.psnr(g, g) == np.inf
    for mse, above in ((0.15, True), (0.17, False)):  # 20 dB is a hundredth of 4² in the mean
        shifted = limits.compare("x", g + np.sqrt(mse), Limit(g, g))
        assert shifted.above_20_db is above


def test_show_and_info_say_what_is_there(dataset, printed):
    location = ["--version", VERSION, "--out", dataset.directory.parent]
    row = next(row for row in limits.read(dataset) if not row.above_20_db)
    failing = sum(not row.above_20_db for row in limits.read(dataset))
    shown = json.loads(printed("show", row.id, "--json", *location))["limit"]
    assert shown["eigenvalues"] == row.eigenvalues.tolist()
    assert (shown["bar"], shown["error"]) == (row.bar.tolist(), row.error.tolist())
    assert shown["above_20_db"] is False
    lines = printed("show", row.id, *location).splitlines()
    at = lines.index("limits, the eigenvalues of the surface (1/length²)")
    assert [float(v) for v in lines[at + 1].split()] == pytest.approx(row.eigenvalues, rel=1e-5)
    assert lines[at + 4] == "errors, eigenvalue / limit - 1 (PSNR 20 dB or less)"
    assert lines[at + 5].split() == [f"{value:.2%}" for value in row.error]
    assert f"limits     of 335 labels; {failing} of them (" in printed("info", *location)
    counts = json.loads(printed("info", "--json", *location))["limits"]
    assert counts == {"labels": 335, "failing": failing}

    limits.path_of(dataset.directory, record_of(dataset)).unlink()  # as a run leaves it
    assert f"limits     of {335 - record_of(dataset).rows} labels; " in printed("info", *location)
    shutil.rmtree(dataset.directory / limits.DIRECTORY)
    assert "limits     none (--limits)\n" in printed("info", *location)
    assert json.loads(printed("show", row.id, "--json", *location))["limit"] is None
    assert "limits" not in printed("show", row.id, *location)
    text = info._say_limits({"labels": 0, "failing": 0}, recipe.Kind.IMPORTED)
    assert text == "none: no import has a known surface"


# Verified


@pytest.fixture
def problems(dataset, monkeypatch):
    """Return a function that verifies the limits. What verify does besides has its own tests."""
    for name in ("check_mesh", "check_label", "check_pin", "check_certificate"):
        monkeypatch.setattr(shapes, name, lambda *_: [])

    def found(sample=0):
        report = verify(VERSION, root=dataset.directory.parent, sample=sample)
        (check,) = (c for c in report.checks if c.name == "limits")
        assert report.problems == check.problems
        return list(check.problems)

    return found


def rewrite(dataset, change):
    """Write the limits of a shard anew, changed, and return what they were."""
    record = record_of(dataset)
    rows = limits.read_shard(dataset.directory, record)
    changed = list(rows)
    change(changed)
    limits.write(dataset.directory, record, changed)
    return rows


def test_whole_limits_pass(problems):
    assert problems() == []


def test_an_error_that_is_not_of_its_label_is_found(dataset, problems):
    def change(rows):
        rows[3] = dataclasses.replace(rows[3], error=rows[3].error + 1e-9)
        rows[4] = dataclasses.replace(rows[4], above_20_db=not rows[4].above_20_db)

    rows = rewrite(dataset, change)
    assert problems() == [
        f"{row.id}: error or PSNR are not those of its label and its limit" for row in rows[3:5]
    ]


def test_limits_of_other_shapes_or_lengths_are_found(dataset, problems):
    rows = rewrite(dataset, lambda rows: rows.pop(0) and None)
    file = record_of(dataset).file
    assert problems() == [f"{file}: the limits beside it are of other shapes"]
    first = {name: getattr(rows[0], name)[:9] for name in limits.NUMBERS}
    rows[0] = dataclasses.replace(rows[0], **first)
    limits.write(dataset.directory, record_of(dataset), rows)
    assert problems() == [f"{rows[0].id}: 9 limits of 10 eigenvalues"]


def test_limits_that_are_not_the_pinned_ones_are_found(dataset, problems):
    labels = {sample.spec.id: sample.eigenvalues for sample in dataset.samples()}

    def change(rows):
        limit = Limit(rows[2].eigenvalues * (1 + 1e-15), rows[2].bar)
        rows[2] = limits.compare(rows[2].id, labels[rows[2].id], limit)
        rows[5] = dataclasses.replace(rows[5], bar=rows[5].bar * 2)

    rows = rewrite(dataset, change)
    assert problems() == [f"{rows[i].id}: limit or bar are not the pinned ones" for i in (2, 5)]


def test_bars_are_compared_at_the_precision_of_the_pins(dataset, problems):
    def change(rows):
        for i, row in enumerate(rows):
            rows[i] = dataclasses.replace(row, bar=row.bar * (1 + 1e-10))  # as they are computed

    rewrite(dataset, change)
    assert problems() == []


def test_some_are_computed_anew(problems, monkeypatch):
    asked = []

    def off(family, parameters, k):
        asked.append(family.name)
        return Limit(np.full(k, 1000.0), np.zeros(k))

    monkeypatch.setattr(Family, "limit_spectrum", off)
    found = problems(sample=60)
    assert len(asked) == checks.LIMITS_MADE_ANEW == len(found)
    assert len(set(asked)) > 1
    assert not {"tetrahedron", "rectangular_prism"} & set(asked)  # these are not in closed form
    assert all("off one computed anew, more than the bars say" in text for text in found)


def test_missing_limits_of_one_shard_are_found(dataset):
    limits.path_of(dataset.directory, record_of(dataset)).unlink()
    (problem,) = verify_files(VERSION, root=dataset.directory.parent).problems
    assert "is missing: run `synthnet build --limits` again" in problem
    shutil.rmtree(dataset.directory / limits.DIRECTORY)  # none at all: built before there were any
    report = verify_files(VERSION, root=dataset.directory.parent)
    assert {c.name: (c.examined, c.problems) for c in report.checks}["limits"] == (0, ())
