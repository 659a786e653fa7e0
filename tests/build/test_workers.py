"""Any executor gives the same bytes: threads, a Dask cluster of processes, an MPI job."""

import dataclasses
import json
import os
import platform
import shutil
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from synthnet import processes
from synthnet.build import jobs, workers
from synthnet.build.jobs import work
from synthnet.build.terms import is_ours, terms_of
from synthnet.build.versions import build, shard_job
from synthnet.build.workers import Workers, dask_cluster, given
from synthnet.errors import BuildError
from synthnet.recipe.plan import plan_shards
from tests.conftest import only_line
from tests.datasets import contents

MPIEXEC = Path(sys.executable).parent / "mpiexec"


@pytest.fixture(scope="module")
def small(tiny):
    """Shards of one shape, so that there are many."""
    return dataclasses.replace(tiny, version="many", shard_size=1)


@pytest.fixture(scope="module")
def expected(small, tmp_path_factory):
    home = tmp_path_factory.mktemp("local")
    build(small, root=home, workers=1)
    return contents(home / "many")


def test_threads_give_the_bytes_of_processes(small, expected, tmp_path):
    with ThreadPoolExecutor(3) as pool:
        report = build(small, root=tmp_path, engine=given(pool, workers=3))
        assert pool.submit(int, "1").result() == 1  # it is the caller's, and stays open
    assert report.reused == 0
    assert contents(tmp_path / "many") == expected


UNGUARDED = """
from synthnet.processes import WorkerContext
print("script", flush=True)
process = WorkerContext().Process(target=print, args=("worker",))
process.start()
process.join()
"""


@pytest.mark.parametrize("from_input", [False, True])
def test_workers_do_not_run_the_script_that_starts_them(from_input, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(UNGUARDED)
    command = [sys.executable, "-" if from_input else str(script)]
    done = subprocess.run(command, input=UNGUARDED, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("script\nworker\n", "")


def test_threads_that_start_workers_at_once_leave_the_script_in_its_place():
    main = sys.modules["__main__"]

    def start(number):
        process = processes.WorkerContext().Process(target=int)
        process.start()
        process.join()
        return process.exitcode

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(start, range(4))) == [0] * 4
    assert sys.modules["__main__"] is main


def test_workers_of_one_pool_outlive_another_s_end():
    def numbers(count):
        with processes.worker_pool(1) as pool:
            yield from (pool.submit(abs, -number).result() for number in range(count))

    one, other = numbers(3), numbers(3)
    assert next(one) == next(other) == 0
    one.close()
    assert list(other) == [1, 2]


def test_few_shards_are_submitted_at_a_time(small, tmp_path):
    at_once, most = set(), []

    class Watcher(jobs.Watcher):
        def submitted(self, plan):
            at_once.add(plan.file)
            most.append(len(at_once))

        def finished(self, plan, result):
            at_once.discard(plan.file)

    with ThreadPoolExecutor(1) as pool:
        build(small, root=tmp_path, engine=given(pool, workers=1), watcher=Watcher())
    assert (len(most), max(most)) == (10, 2)


def test_shards_kept_submitted_follow_the_workers():
    with ThreadPoolExecutor(1) as pool:
        workers = Workers(pool, iter([0, 1, 8, 80]).__next__)
        assert [workers.ahead for _ in range(4)] == [1, 2, 10, 91]


@pytest.fixture
def terms(small, tmp_path):
    (tmp_path / "shards").mkdir()
    return terms_of(small, tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda terms: {"packages": {**terms.packages, "numpy": "0.1"}},
            r"has numpy .*, the build has 0\.1: install the same",
        ),
        (lambda _: {"digest": "0" * 64}, "understands another recipe than the build"),
        (
            lambda terms: {"directory": terms.directory / "elsewhere"},
            r"does not see .*: --out must be a directory that all",
        ),
        (
            lambda _: {"processor": "m68000-0"},
            r"has a processor of another kind .* than the build \(m68",
        ),
    ],
    ids=["version", "recipe", "directory", "processor"],
)
def test_worker_of_another_kind_is_refused(change, message, small, terms):
    other = dataclasses.replace(terms, **change(terms))
    with pytest.raises(BuildError, match=message):
        work(shard_job(plan_shards(small)[0], other))


def test_shard_written_to_another_disk_is_noticed(tmp_path, monkeypatch):
    monkeypatch.setattr(jobs, "SEEN_WITHIN", 0.0)
    path = tmp_path / "a.parquet"
    unseen = "is not there: --out must be a directory that all"
    with pytest.raises(BuildError, match=unseen):
        jobs.see(path, 14)
    path.write_bytes(b"an older shard")
    with pytest.raises(BuildError, match=unseen):
        jobs.see(path, 10)
    jobs.see(path, 14)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--engine", "dask"], "--engine dask needs --scheduler"),
        (["--scheduler", "tcp://a:1"], "--scheduler is for --engine dask"),
        (["--engine", "mpi", "--workers", "2"], "--workers is for local processes"),
        (["--engine", "dask", "--scheduler", "nonsense::"], "no Dask scheduler answers at"),
        (["--scale", "1"], "scale must be an integer from 2 to"),
        (["--version", "1.0-x2", "--scale", "2"], "1.0-x2 is scaled already"),
    ],
)
def test_wrong_options_are_one_line(arguments, message, tmp_path, run):
    line = only_line(*run("build", "--out", tmp_path, *arguments))
    assert line.startswith(f"synthnet: {message}")


# Dask


@pytest.fixture
def cluster(environment, tmp_path):
    """A scheduler and two workers, each a process of its own."""
    pytest.importorskip("distributed")
    file = tmp_path / "scheduler.json"

    def start(what, *more):
        common = ["--scheduler-file", str(file), "--no-dashboard"]
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{what}", *common, *more],
            env=environment,
            cwd=tmp_path,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    host = ["--host", "127.0.0.1"]
    processes = [start("scheduler", "--port", "0", *host)]
    try:
        processes += [start("worker", "--nthreads", "1", "--no-nanny", *host) for _ in range(2)]
        end = time.monotonic() + 30
        while not file.exists() and time.monotonic() < end:
            time.sleep(0.05)
        address = json.loads(file.read_text())["address"]
        yield address, processes[1:]
    finally:
        for process in processes:
            process.kill()
            process.wait()


@pytest.mark.slow
def test_dask_cluster_gives_the_same_bytes_though_a_worker_is_killed(
    cluster, small, expected, tmp_path
):
    address, workers = cluster
    made = []
    shards = tmp_path / "many" / "shards"
    finished = {}

    class Watcher(jobs.Watcher):
        def finished(self, plan, result):
            made.append(plan.file)
            if len(made) == 3:
                finished.update({p: p.stat().st_mtime_ns for p in shards.glob("[!.]*")})
                os.kill(workers[0].pid, signal.SIGKILL)

    report = build(small, root=tmp_path, engine=dask_cluster(address), watcher=Watcher())
    assert workers[0].wait() == -signal.SIGKILL
    assert workers[1].poll() is None
    assert sorted(made) == sorted(plan.file for plan in plan_shards(small))  # each once
    assert len(finished) >= 3
    assert {p: p.stat().st_mtime_ns for p in finished} == finished  # none is made again
    assert report.reused <= 2  # one the dead worker had written but not reported is read
    assert contents(tmp_path / "many") == expected


# MPI


@pytest.mark.slow
@pytest.mark.skipif(not MPIEXEC.exists(), reason="needs an MPI library: pip install mpich")
def test_mpi_job_gives_the_same_bytes(environment, mini_home, tmp_path):
    shards = tmp_path / "1.0-mini" / "shards"
    shards.mkdir(parents=True)
    for name in ("split_sphere-0000", "inverted_cone-0000", "inverted_cone-0001"):
        # The long ones are there already, to save time.
        shutil.copy2(mini_home / "1.0-mini" / "shards" / f"{name}.parquet", shards)
    job = [str(MPIEXEC), "-n", "3", sys.executable, "-m", "mpi4py.futures", "-m", "synthnet"]
    build = ["build", "--version", "1.0-mini", "--out", str(tmp_path), "--engine", "mpi"]
    done = subprocess.run(
        [*job, *build], env=environment, capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    assert contents(tmp_path / "1.0-mini") == contents(mini_home / "1.0-mini")


def test_mpi_outside_a_job_is_one_line(tmp_path, command):
    pytest.importorskip("mpi4py")
    done = command("build", "--out", tmp_path, "--engine", "mpi")
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.strip()]
    assert line.startswith("synthnet: --engine mpi ")
    assert list(tmp_path.iterdir()) == []


def test_worker_with_another_blas_kernel_is_refused(small, terms, environment):
    if "openblas" not in terms.blas:
        pytest.skip(f"only OpenBLAS is told which kernels to take, here is {terms.blas}")
    core = "Haswell" if platform.machine() == "x86_64" else "ARMV8"
    blas = "from synthnet.build.terms import blas_kernels; print(blas_kernels())"
    done = subprocess.run(
        [sys.executable, "-c", blas],
        env={**environment, "OPENBLAS_CORETYPE": core},
        capture_output=True,
        text=True,
        check=True,
    )
    assert core.lower() in done.stdout.lower()
    other = dataclasses.replace(terms, blas=done.stdout.strip())
    if other == terms:
        other = dataclasses.replace(terms, blas="openblas 0 none")
    with pytest.raises(BuildError, match=r"computes with other BLAS kernels .* OPENBLAS_CORETYPE"):
        work(shard_job(plan_shards(small)[0], other))


def test_blas_kernels_are_those_of_numpy_and_scipy_alone():
    """PyTorch and others bring their own, which only some processes load."""
    packages = Path(np.__file__).parent.parent
    assert is_ours(packages / "numpy.libs" / "libopenblas.so")
    assert is_ours(Path("/usr/lib/libblas.so"))
    assert not is_ours(packages / "torch" / "lib" / "libmkl.so")


@pytest.mark.parametrize("named", [None, "7"])
def test_the_solver_has_one_thread_until_the_last_shard_ends(named, monkeypatch):
    monkeypatch.delenv(processes.THREADS, raising=False)
    if named is not None:
        monkeypatch.setenv(processes.THREADS, named)
    before = processes.threads()
    with workers.one_thread:
        with workers.one_thread:
            assert processes.threads() == 1
        assert processes.threads() == 1
    assert processes.threads() == before
    assert os.environ.get(processes.THREADS) == named
