"""Tests of the orchestrator: same bytes always, and nothing finished is ever lost."""

import dataclasses
import os
import re
import signal
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import threadpoolctl

from evidence.build_process import Build, group, lay_out, shards_written
from synthnet import recipe, spectrum, store
from synthnet.build import filters
from synthnet.build.jobs import keep_or_make
from synthnet.build.label import make_sample
from synthnet.build.terms import terms_of
from synthnet.build.versions import build, ensure_built, shard_job
from synthnet.errors import BuildError, CertificateError, SpectrumError, StoreError, counted
from synthnet.recipe import FamilyRecipe
from synthnet.recipe.plan import plan_shards
from synthnet.store import files
from synthnet.types import Mesh, Rejection, Sample
from tests.datasets import contents

VERSION = "1.0-mini"
linux = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks into /proc")


def build_shard(plan, recipe, directory):
    """Make one shard in this process, or keep it."""
    return keep_or_make(shard_job(plan, terms_of(recipe, directory)))


def assert_same(built, expected):
    first, second = contents(built / VERSION), contents(expected / VERSION)
    assert list(first) == list(second)
    assert [name for name in first if first[name] != second[name]] == []


def one_line(text):
    """The one line of standard error that is no progress."""
    bar = re.compile(r"^(\w+ .* \d+/\d+ .*(-:--:--|\d:\d\d:\d\d)\s*|\w+: done)$")
    lines = [line for line in text.splitlines() if line.strip() and not bar.match(line)]
    assert len(lines) == 1, text
    return lines[0]


# Same bytes


def test_mini_has_the_files_it_should(mini_home):
    names = [plan.file for plan in plan_shards(recipe.load(VERSION))]
    limits = [name.replace("shards/", "limits/") for name in names]
    assert sorted(contents(mini_home / VERSION)) == sorted(["manifest.json", *names, *limits])
    manifest = store.open_dataset(VERSION, mini_home).manifest
    assert [shard.file for shard in manifest.shards] == names
    assert manifest.rows + len(manifest.rejections) == 335
    assert manifest.recipe_digest == recipe.load(VERSION).digest
    assert {"python", "synthnet", "numpy", "scipy", "pyarrow"} <= set(manifest.packages)
    for shard in manifest.shards:
        path = mini_home / VERSION / shard.file
        assert (shard.sha256, shard.size) == (files.sha256(path), path.stat().st_size)


@pytest.mark.slow
def test_one_worker_gives_the_same_bytes_as_two(mini_home, tmp_path, command):
    done = command("build", "--version", VERSION, "--out", tmp_path, "--workers", "1")
    assert done.returncode == 0, done.stderr
    assert_same(tmp_path, mini_home)


@pytest.fixture
def started():
    """Start builds in process groups of their own; end what is left of them."""
    builds = []

    def start(home):
        builds.append(Build(home, "--workers", "2"))
        return builds[-1]

    yield start
    for running in builds:
        running.kill_all()
        running.wait()


def wait_for(what, seconds=60):
    end = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def wait_for_files(home, count, running):
    wait_for(lambda: shards_written(home) >= count or running.process.poll() is not None)
    assert running.process.poll() is None, running.failure()


def lay_out_long_ones(home, expected):
    long = re.compile("split_sphere|inverted_cone")
    lay_out(home, contents(expected / VERSION), lambda name: not long.search(name))


def wait_for_its_end(running):
    wait_for(lambda: not list(group(running.process.pid)), seconds=30)


def finish(home, expected, command):
    """Resume a build: it keeps what is there, and ends with the same bytes."""
    kept = {p: p.stat().st_mtime_ns for p in (home / VERSION / "shards").glob("[!.]*.parquet")}
    done = command("build", "--version", VERSION, "--out", home, "--workers", "2")
    assert done.returncode == 0, done.stderr
    assert f", {counted(len(kept), 'shard')} kept from an earlier run" in done.stdout
    assert {p: p.stat().st_mtime_ns for p in kept} == kept
    assert_same(home, expected)


@linux
@pytest.mark.slow
def test_workers_end_with_a_build_that_is_killed(mini_home, tmp_path, started):
    lay_out_long_ones(tmp_path, mini_home)
    running = started(tmp_path)
    wait_for_files(tmp_path, shards_written(tmp_path) + 1, running)
    assert len(running.workers()) == 2
    running.process.kill()
    wait_for_its_end(running)
    assert not (tmp_path / VERSION / "manifest.json").exists()


@linux
@pytest.mark.slow
def test_worker_that_dies_ends_the_build_in_one_line(mini_home, tmp_path, command, started):
    running = started(tmp_path)
    wait_for_files(tmp_path, 2, running)
    os.kill(running.workers()[0], signal.SIGKILL)
    assert running.wait() == 2
    line = one_line(running.text)
    assert line.startswith("synthnet: a worker process died (out of memory?): finished shards are")
    assert "run the same command again; take fewer --workers" in line
    wait_for_its_end(running)
    assert 2 <= shards_written(tmp_path) < 22
    finish(tmp_path, mini_home, command)


@linux
@pytest.mark.slow
@pytest.mark.parametrize(
    ("when", "send", "number"),
    [
        ("workers start", os.killpg, signal.SIGINT),
        ("workers work", os.killpg, signal.SIGINT),
        ("workers work", os.kill, signal.SIGTERM),
    ],
    ids=["ctrl-c at the start", "ctrl-c", "sigterm"],
)
def test_an_interrupt_ends_the_build_in_one_line(
    when, send, number, mini_home, tmp_path, command, started
):
    if when == "workers work":  # the long ones are there already, to save time
        lay_out_long_ones(tmp_path, mini_home)
    running = started(tmp_path)
    if when == "workers start":
        wait_for(lambda: len(running.workers()) == 2)
        time.sleep(0.3)  # they import their modules
    else:
        wait_for_files(tmp_path, shards_written(tmp_path) + 1, running)
    send(running.process.pid, number)
    assert running.wait() == 130
    assert one_line(running.text) == (
        "synthnet: interrupted; finished shards are kept, run the same command to go on"
    )
    wait_for_its_end(running)
    if when == "workers work":
        finish(tmp_path, mini_home, command)


@linux
@pytest.mark.slow
def test_two_builds_at_once_do_not_mix(tmp_path, command, started):
    first = started(tmp_path)
    wait_for(first.workers)
    os.kill(first.process.pid, signal.SIGSTOP)  # or it may be done before the second has started
    second = command("build", "--version", VERSION, "--out", tmp_path)
    os.kill(first.process.pid, signal.SIGCONT)
    assert second.returncode == 2
    assert one_line(second.stderr) == (
        f"synthnet: another build is writing to {tmp_path / VERSION} (process "
        f"{first.process.pid}): wait for it (--wait) or choose another --out"
    )
    assert first.process.poll() is None


# Finished, and damaged again


def test_second_build_has_nothing_to_do(mini_home):
    files = {p: p.stat().st_mtime_ns for p in mini_home.rglob("*")}
    report = build(VERSION, root=mini_home)
    assert report.nothing_to_do
    assert report.seconds == {}
    assert {p: p.stat().st_mtime_ns for p in mini_home.rglob("*")} == files


@pytest.mark.slow
def test_missing_shard_is_built_again(mini_home, mini_copy, command):
    (mini_copy / VERSION / "shards" / "torus-0000.parquet").unlink()
    finish(mini_copy, mini_home, command)


@pytest.mark.slow
def test_damaged_shards_are_built_again_and_leftovers_removed(mini_home, mini_copy, command):
    directory = mini_copy / VERSION
    truncated = directory / "shards" / "split_cone-0000.parquet"
    truncated.write_bytes(truncated.read_bytes()[:-100])
    altered = directory / "shards" / "torus-0000.parquet"
    content = bytearray(altered.read_bytes())
    content[len(content) // 2] ^= 1
    altered.write_bytes(content)
    (directory / "manifest.json").unlink()
    for name in ("shards/.torus-0000.parquet.77.partial", ".manifest.json.77.partial"):
        (directory / name).write_text("left by a killed build")
    done = command("build", "--version", VERSION, "--out", mini_copy, "--workers", "2")
    assert done.returncode == 0, done.stderr
    for path in (truncated, altered):
        assert f"\nbuilt again: {path} is damaged" in "\n" + done.stderr
    assert "9 shards kept from an earlier run" in done.stdout
    assert_same(mini_copy, mini_home)


def test_data_of_another_recipe_is_refused(mini_copy):
    manifest = store.open_dataset(VERSION, mini_copy).manifest
    other = dataclasses.replace(manifest, recipe_digest="0" * 64)
    store.write_manifest(mini_copy / VERSION, other)
    line = "holds 1.0-mini of another recipe: remove it or choose another --out"
    with pytest.raises(StoreError, match=line):
        build(VERSION, root=mini_copy)


def test_shard_of_another_recipe_is_refused(tiny, tmp_path):
    (plan, *_) = plan_shards(tiny)
    (tmp_path / "shards").mkdir()
    build_shard(plan, tiny, tmp_path)
    before = contents(tmp_path)
    assert before
    with pytest.raises(StoreError, match="belongs to another recipe"):
        build_shard(plan, dataclasses.replace(tiny, seed=1), tmp_path)
    assert contents(tmp_path) == before


@pytest.mark.parametrize("workers", [0, -1])
def test_workers_must_be_at_least_one(workers, tmp_path):
    with pytest.raises(ValueError, match=f"workers must be at least 1, got {workers}"):
        build(VERSION, root=tmp_path, workers=workers)
    assert list(tmp_path.iterdir()) == []


# On first use


def test_finished_dataset_is_opened_without_a_word(mini_home, capfd):
    assert ensure_built(VERSION, mini_home) == store.open_dataset(VERSION, mini_home)
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_unfinished_dataset_is_built_on_first_use_and_says_so(
    mini_home, mini_copy, environment, monkeypatch, capfd
):
    monkeypatch.setenv("PYTHONPATH", environment["PYTHONPATH"])
    (mini_copy / VERSION / "manifest.json").unlink()
    dataset = ensure_built(VERSION, mini_copy)
    out, err = capfd.readouterr()
    assert dataset.manifest == store.open_dataset(VERSION, mini_home).manifest
    assert f"synthNet {VERSION} is not in {mini_copy / VERSION} yet: building it\n" in err
    assert out == ""
    assert_same(mini_copy, mini_home)


def test_build_on_first_use_that_fails_says_so(tmp_path, environment, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", environment["PYTHONPATH"])
    (tmp_path / "file").write_text("no directory")
    with pytest.raises(BuildError, match=r"run `python -m synthnet build"):
        ensure_built(VERSION, tmp_path / "file" / "home")


# One shape, one shard


def of_tori(recipe):
    """The plan of the shard of tori."""
    return next(plan for plan in plan_shards(recipe) if plan.family == "torus")


def test_degenerate_shapes_are_rejected_and_counted(tiny, tmp_path):
    # A tube as thick as the torus meets itself in the axis: one ring of points becomes one.
    torus = tiny.families["torus"]
    touching = dataclasses.replace(torus, parameters={**torus.parameters, "tube_radius": 1.0})
    flat = dataclasses.replace(tiny, families={**tiny.families, "torus": touching})
    plan = of_tori(flat)
    (tmp_path / "shards").mkdir()
    result = build_shard(plan, flat, tmp_path)
    assert not result.reused
    assert (result.record.rows, result.record.vertices) == (0, 0)
    assert [r.id for r in result.record.rejections] == [f"torus-{i:05d}" for i in range(4)]
    for rejection in result.record.rejections:
        assert (rejection.family, rejection.reason) == ("torus", "degenerate_face")
        # 8 quadrilaterals on either side of the ring, in each one triangle loses its side
        assert rejection.detail.startswith("16 of 96 faces have altitude / longest edge at most")
    again = build_shard(plan, flat, tmp_path)
    assert again.reused
    assert again.record == result.record
    assert list(store.read_samples(tmp_path / plan.file)) == []


def test_solver_that_gives_up_is_counted(tiny, tmp_path, monkeypatch):
    plan = of_tori(tiny)
    solve, calls = spectrum.compute, []

    def third_fails(mesh, *args, **options):
        calls.append(mesh)
        if len(calls) == 3:
            raise SpectrumError("Lanczos iteration failed: planted")
        return solve(mesh, *args, **options)

    monkeypatch.setattr(spectrum, "compute", third_fails)
    (tmp_path / "shards").mkdir()
    record = build_shard(plan, tiny, tmp_path).record
    assert record.rejections == (
        Rejection("torus-00002", "torus", filters.SOLVER, "Lanczos iteration failed: planted"),
    )
    ids = [s.spec.id for s in store.read_samples(tmp_path / plan.file)]
    assert ids == ["torus-00000", "torus-00001", "torus-00003"]


def test_spectrum_without_certificate_is_counted(tiny, monkeypatch):
    finding = "12 eigenvalues are below 3, but 11 were found"
    monkeypatch.setattr(spectrum, "compute", Mock(side_effect=CertificateError(finding)))
    shape = plan_shards(tiny)[0].shapes[0]
    expected = Rejection(shape.spec.id, shape.spec.family, "certificate", finding)
    assert make_sample(shape, tiny) == expected


def test_spectrum_that_fails_a_check_is_counted(tiny, monkeypatch):
    solve = spectrum.compute

    def inexact(mesh, *args, **options):
        label = solve(mesh, *args, **options)
        worse = dataclasses.replace(label.certificate, residual=1e-3)
        return dataclasses.replace(label, certificate=worse)

    monkeypatch.setattr(spectrum, "compute", inexact)
    shape = plan_shards(tiny)[0].shapes[0]
    assert make_sample(shape, tiny) == Rejection(
        shape.spec.id, shape.spec.family, "residual", "relative residual is 0.001, above 1e-06"
    )


def test_a_mesh_with_too_few_vertices_is_counted(tiny):
    sphere = FamilyRecipe(1, {"radius": 1.0, "resolution": 2})
    shape = plan_shards(dataclasses.replace(tiny, families={"sphere": sphere}))[0].shapes[0]
    finding = "6 vertices, a spectrum needs at least 11"
    assert make_sample(shape, tiny) == Rejection("sphere-00000", "sphere", "few_vertices", finding)


def test_error_that_is_no_finding_is_not_swallowed(tiny, monkeypatch):
    monkeypatch.setattr(spectrum, "compute", Mock(side_effect=ZeroDivisionError("a bug")))
    with pytest.raises(ZeroDivisionError, match="a bug"):
        make_sample(plan_shards(tiny)[0].shapes[0], tiny)


@pytest.mark.parametrize("family", ["tetrahedron", "split_cone", "sphere", "torus"])
def test_label_is_of_the_stored_vertices(family, mini_home):
    path = mini_home / VERSION / "shards" / f"{family}-0000.parquet"
    samples = list(store.read_samples(path))[:2]
    assert len(samples) == 2
    for sample in samples:
        assert sample.mesh.vertices.dtype == np.float32
        exact = Mesh(sample.mesh.vertices.astype(np.float64), sample.mesh.faces)
        for mesh in (sample.mesh, exact):
            with threadpoolctl.threadpool_limits(1):  # as a worker; more change the last bit
                label = spectrum.compute(mesh, k=10)
            assert label.eigenvalues.tobytes() == sample.eigenvalues.tobytes()
            assert (label.trivial, label.certificate) == (sample.trivial, sample.certificate)


def test_shapes_do_not_depend_on_their_company(tiny):
    plan = of_tori(tiny)
    alone = make_sample(plan.shapes[-1], tiny)
    in_a_row = [make_sample(shape, tiny) for shape in plan.shapes][-1]
    assert isinstance(alone, Sample)
    assert isinstance(in_a_row, Sample)
    assert alone.eigenvalues.tobytes() == in_a_row.eigenvalues.tobytes()
    assert alone.isometries.tobytes() == in_a_row.isometries.tobytes()
