"""Builds broken in every way we know.

A build of 1.0-mini is killed, starved of disk and memory, run twice at once, and its files
are altered. What is left must be, after another run, the bytes of an undisturbed build, or
be refused in one line with exit code 2; anything else is wrong. Needs Linux; a small disk needs
root, which may mount one. Half an hour on two cores.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

from evidence import markdown, numbers
from synthnet import recipe, store
from synthnet.errors import SynthNetError
from synthnet.recipe.plan import plan_shards
from synthnet.store.storage import RemotePath
from synthnet.verify.checks import verify_files

VERSION = "1.0-mini"
PATIENCE = 300.0  # seconds: a build that takes longer hangs
LARGE = ("split_sphere", "inverted_cone", "rectangular_prism", "cone", "cylinder")
WHO = ("the build", "a worker", "all its processes")
NAMES = (
    *("killed", "killed with --error-estimates", "disk full", "byte altered"),
    *("out of memory", "two at once", "two at one URL"),
)
AT_THE_END = 0.2  # of the kills: once the last shard is there, so that the manifest is hit


@dataclass
class Outcome:
    """What was done to builds, how often, and what became of them."""

    fault: str
    cases: int = 0
    refused: int = 0
    same: int = 0
    skipped: str = ""
    seen: Counter[str] = field(default_factory=Counter)
    wrong: list[str] = field(default_factory=list)

    def row(self) -> dict:
        """Return the same, ready for JSON; ``asdict`` would take a counter's pairs for its keys."""
        return {f.name: getattr(self, f.name) for f in fields(self)} | {"seen": dict(self.seen)}

    def judge(self, problem: str | None) -> None:
        """Count a case."""
        self.cases += 1
        if problem is None:
            self.same += 1
        else:
            self.wrong.append(problem)
        sys.stderr.write(f"{self.fault}: {self.cases} cases, {problem or 'as it should be'}\n")


# Builds as processes


class Build:
    """``synthnet build`` in a process group of its own."""

    def __init__(self, home: Path | str, *options: str) -> None:
        self.errors = tempfile.TemporaryFile("w+")  # noqa: SIM115 - as long as the process
        self.text = ""
        command = [sys.executable, "-m", "synthnet", "build", "--version", VERSION]
        self.process = subprocess.Popen(
            [*command, "--out", str(home), *options],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
            stdout=subprocess.DEVNULL,
            stderr=self.errors,
        )

    def wait(self) -> int:
        """Return the exit code; a build that hangs is killed, and its code is not 0 or 2."""
        try:
            self.process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.kill_all()
        code = self.process.wait()
        if not self.errors.closed:
            self.errors.seek(0)
            self.text = self.errors.read()
            self.errors.close()
        return code

    def said(self) -> str:
        """Return what it wrote to standard error by its end."""
        self.wait()
        return self.text

    def refusal(self) -> str | None:
        """Return the one line of a build that has ended with exit code 2."""
        lines = [line for line in self.said().splitlines() if line.startswith("synthnet: ")]
        alone = len(lines) == 1 and "Traceback" not in self.said()
        return lines[0] if alone and self.wait() == 2 else None

    def workers(self) -> list[int]:
        """Return the processes that make shards."""
        return [pid for pid, line in group(self.process.pid) if "spawn_main" in line]

    def kill(self, who: str, rng: random.Random) -> None:
        """Kill a part of it, which does not get to notice."""
        if who == "all its processes":
            self.kill_all()
        elif who == "a worker" and (workers := self.workers()):
            with contextlib.suppress(ProcessLookupError):
                os.kill(rng.choice(workers), signal.SIGKILL)
        else:
            self.process.kill()

    def kill_all(self) -> None:
        """Kill the group."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)


def group(leader: int) -> Iterator[tuple[int, str]]:
    """Yield number and command line of the processes alive in a group."""
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        with contextlib.suppress(OSError):  # it may end meanwhile
            state, _, pgrp = (entry / "stat").read_text().rpartition(") ")[2].split()[:3]
            if int(pgrp) == leader and state not in "ZX":
                yield int(entry.name), (entry / "cmdline").read_text().replace("\0", " ")


def contents(home: Path) -> dict[str, bytes]:
    """Return all files of a dataset but the lock, by name."""
    directory = home / VERSION
    return {
        str(p.relative_to(directory)): p.read_bytes()
        for p in sorted(directory.rglob("*"))
        if p.is_file() and p.name != ".lock"
    }


def finish(home: Path, expected: dict[str, bytes], *options: str) -> str | None:
    """Run the build again; return how its files differ from the expected ones."""
    build = Build(home, *options)
    code = build.wait()
    if code != 0:
        return f"exit code {code} instead of 0: {build.said()[-500:]}"
    return difference(contents(home), expected)


def difference(found: dict[str, bytes], expected: dict[str, bytes]) -> str | None:
    """Return the names of files that are too few, too many or of other bytes."""
    names = [n for n in sorted({*found, *expected}) if found.get(n) != expected.get(n)]
    return f"differ: {', '.join(names)}" if names else None


def begun(home: Path, reference: Path, missing: Callable[[str], bool]) -> None:
    """Lay out a dataset that lacks some files of the reference, and so the manifest."""
    for name, content in contents(reference).items():
        if not missing(name):
            path = home / VERSION / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


def everything(name: str) -> bool:
    """Leave out every file: a build from nothing."""
    return True


def small_ones(name: str) -> bool:
    """Leave out the manifest, and the shards and estimates that take little time."""
    return not Path(name).name.startswith(LARGE)


# Faults


def kill_builds(
    reference: Path,
    place: Path,
    kills: int,
    rng: random.Random,
    *options: str,
    missing: Callable[[str], bool] = everything,
    seconds: float | None = None,
) -> Outcome:
    """Kill builds at random times, and what resumes them, and let the last one finish."""
    outcome = Outcome(f"killed{' with ' if options else ''}{' '.join(options)}")
    expected = contents(reference)
    if "--error-estimates" not in options:
        expected = {name: c for name, c in expected.items() if not name.startswith("errors/")}
    seconds = seconds or undisturbed_seconds(reference, place, missing, *options)
    while outcome.cases < kills:
        home = place / f"killed-{outcome.cases}"
        begun(home, reference, lambda name: missing(name) or name not in expected)
        done = 0
        for _ in range(rng.randint(1, 3)):
            killed = _kill_once(home, seconds, len(expected), rng, outcome, *options)
            done += killed
            if not killed or outcome.cases + done == kills:
                break
        problem = finish(home, expected, *options)
        for _ in range(done):
            outcome.judge(problem)
        shutil.rmtree(home)
    return outcome


def undisturbed_seconds(
    reference: Path, place: Path, missing: Callable[[str], bool], *options: str
) -> float:
    """Return how long the build takes that is to be killed."""
    home = place / "undisturbed"
    begun(home, reference, missing)
    started = time.monotonic()
    build = Build(home, *options)
    if build.wait():
        raise RuntimeError(f"an undisturbed build fails: {build.said()}")
    shutil.rmtree(home)
    return time.monotonic() - started


def _kill_once(
    home: Path, seconds: float, files: int, rng: random.Random, outcome: Outcome, *options: str
) -> bool:
    """Start a build and kill it; return whether it was not too late."""
    at_the_end, who = rng.random() < AT_THE_END, rng.choice(WHO)
    build = Build(home, *options)
    if at_the_end:
        while build.process.poll() is None and _written(home) < files - 1:
            time.sleep(0.002)
        time.sleep(rng.uniform(0, 0.05))
    else:
        _sleep(rng.uniform(0, seconds), build.process)
    if build.process.poll() is not None:
        build.wait()
        return False
    outcome.seen[f"{who}, {_phase(home, build, files)}"] += 1
    build.kill(who, rng)
    code = build.wait()  # after its parent's death a worker may live on for a moment
    if code == 2 and build.refusal():
        outcome.refused += 1
    elif code not in (0, -signal.SIGKILL):
        outcome.wrong.append(f"{who} killed: exit code {code}, {build.said()[-500:]}")
    return True


def _sleep(seconds: float, process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(seconds)


def _written(home: Path) -> int:
    return sum(1 for _ in (home / VERSION).glob("*/[!.]*.parquet"))


def _phase(home: Path, build: Build, files: int) -> str:
    if _written(home) >= files - 1:
        return "all shards written"
    return "at work" if build.workers() else "starting"


def fill_disks(
    reference: Path,
    place: Path,
    cases: int,
    rng: random.Random,
    missing: Callable[[str], bool] = everything,
) -> Outcome:
    """Build on disks too small, then give them room."""
    outcome = Outcome("disk full")
    expected = _without_estimates(reference)
    given = sum(len(c) for name, c in expected.items() if not missing(name))
    total = sum(map(len, expected.values()))
    for number in range(cases):
        disk = place / f"disk-{number}"
        disk.mkdir()
        size = int(rng.uniform(given + 0.05 * (total - given), given + 0.9 * (total - given)))
        options = f"size={size // 1024}k"
        mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(disk)]
        done = subprocess.run(mount, capture_output=True, text=True, check=False)
        if done.returncode:
            outcome.skipped = f"cannot mount a small disk: {done.stderr.strip()}"
            return outcome
        try:
            begun(disk, reference, lambda name: missing(name) or name not in expected)
            outcome.judge(_fill(disk, expected, outcome))
        finally:
            subprocess.run(["umount", str(disk)], check=True)
    return outcome


def _fill(disk: Path, expected: dict[str, bytes], outcome: Outcome) -> str | None:
    build = Build(disk)
    code, line = build.wait(), build.refusal()
    if line is None or "o space left" not in line or str(disk) not in line:
        return f"exit code {code}: {build.said()[-500:]}"
    outcome.refused += 1
    if leftovers := list((disk / VERSION).rglob("*.partial")):
        return f"left behind: {leftovers}"
    subprocess.run(["mount", "-o", "remount,size=1g", str(disk)], check=True)
    return finish(disk, expected)


def starve_workers(
    reference: Path,
    place: Path,
    cases: int,
    rng: random.Random,
    missing: Callable[[str], bool] = everything,
) -> Outcome:
    """Take the memory from a worker at work, by the kernel's limit of its data."""
    outcome = Outcome("out of memory")
    expected = _without_estimates(reference)
    while outcome.cases < cases:
        home = place / f"starved-{outcome.cases}"
        begun(home, reference, lambda name: missing(name) or name not in expected)
        outcome.judge(_starve(home, expected, rng, outcome))
        shutil.rmtree(home)
    return outcome


def _starve(
    home: Path, expected: dict[str, bytes], rng: random.Random, outcome: Outcome
) -> str | None:
    build, shards = Build(home), rng.randint(1, len(expected) // 2)
    while build.process.poll() is None and _written(home) < shards:
        time.sleep(0.02)
    for worker in build.workers():
        with contextlib.suppress(OSError):
            limit = _data(worker) + int(rng.uniform(0, 10e6))
            resource.prlimit(worker, resource.RLIMIT_DATA, (limit, limit))
    code, line = build.wait(), build.refusal()
    if code == 0:
        outcome.seen["had enough"] += 1
    elif line is None or "memory" not in line:
        return f"exit code {code}: {build.said()[-500:]}"
    else:
        outcome.refused += 1
        outcome.seen[re.split(" at |:|\\(", line.removeprefix("synthnet: "))[0].strip()] += 1
    return finish(home, expected)


def _data(process: int) -> int:
    """Return the bytes of a process that the limit of its data is about."""
    with contextlib.suppress(OSError):
        text = Path(f"/proc/{process}/status").read_text()
        if found := re.search(r"VmData:\s*(\d+) kB", text):
            return 1024 * int(found[1])
    return 0


def build_twice(
    reference: Path,
    place: Path,
    cases: int,
    rng: random.Random,
    missing: Callable[[str], bool] = everything,
) -> Outcome:
    """Start two builds of one place at once, with --wait and without."""
    outcome = Outcome("two at once")
    pairs = [((), ()), (("--wait",), ("--wait",)), ((), ("--wait",))]
    pairs += [(("--wait",), ("--wait", "--error-estimates"))]
    for number in range(cases):
        options = pairs[number % len(pairs)]
        estimated = any("--error-estimates" in o for o in options)
        expected = contents(reference) if estimated else _without_estimates(reference)
        home = place / f"twice-{number}"
        begun(
            home,
            reference,
            lambda name, e=expected, m=small_ones if estimated else missing: (
                m(name) or name not in e
            ),
        )
        outcome.judge(_twice(home, expected, options, rng, outcome))
        shutil.rmtree(home)
    return outcome


def _twice(
    home: Path,
    expected: dict[str, bytes],
    options: Sequence[tuple[str, ...]],
    rng: random.Random,
    outcome: Outcome,
) -> str | None:
    builds = []
    for mine in rng.sample(options, len(options)):
        builds.append((mine, Build(home, *mine)))
        time.sleep(rng.choice((0, rng.uniform(0, 3))))
    for mine, build in builds:
        code, line = build.wait(), build.refusal()
        if "--wait" not in mine and line and "another build is writing to" in line:
            outcome.refused += 1
            outcome.seen["one refused"] += 1
        elif code != 0:
            return f"{' '.join(mine)}: exit code {code}: {build.said()[-500:]}"
    return difference(contents(home), expected)


def build_twice_at_a_url(reference: Path, cases: int, rng: random.Random) -> Outcome:
    """Start two builds at one URL, of an S3-compatible server of our own."""
    outcome = Outcome("two at one URL")
    try:
        import s3fs
        from moto.server import ThreadedMotoServer
    except ImportError as error:
        outcome.skipped = f"needs moto and s3fs ({error})"
        return outcome
    server = ThreadedMotoServer(port=0, verbose=False)
    server.start()
    endpoint = "http://{}:{}".format(*server.get_host_and_port())
    os.environ |= {"AWS_ENDPOINT_URL": endpoint, "AWS_DEFAULT_REGION": "us-east-1"}
    os.environ |= {"AWS_ACCESS_KEY_ID": "a", "AWS_SECRET_ACCESS_KEY": "b"}
    system = s3fs.S3FileSystem(endpoint_url=endpoint)
    expected = _without_estimates(reference)
    for number in range(cases):
        system.mkdir(f"data-{number}")
        outcome.judge(_twice_at(f"s3://data-{number}", expected, system, rng))
    server.stop()
    return outcome


def _twice_at(
    url: str, expected: dict[str, bytes], system: object, rng: random.Random
) -> str | None:
    for name, content in expected.items():
        if not small_ones(name):
            (RemotePath(url) / VERSION / name).write_bytes(content)
    builds = []
    for _ in range(2):
        builds.append(Build(url))
        time.sleep(rng.choice((0, rng.uniform(0, 3))))
    for build in builds:
        if code := build.wait():
            return f"exit code {code}: {build.said()[-500:]}"
    top = f"{url.removeprefix('s3://')}/{VERSION}/"
    system.invalidate_cache()  # type: ignore[attr-defined]
    names = system.find(top)  # type: ignore[attr-defined]
    found = {name.removeprefix(top): RemotePath(f"s3://{name}").read_bytes() for name in names}
    return difference(found, expected)


def flip_bytes(
    reference: Path, place: Path, flips: int, rng: random.Random, *, build_every: int = 10
) -> Outcome:
    """Alter one byte of one file at a time: verify must name it, a build mend or refuse."""
    outcome = Outcome("byte altered")
    expected = contents(reference)
    home = place / "flipped"
    shutil.copytree(reference, home)
    shards, errors = ([n for n in expected if n.startswith(d)] for d in ("shards/", "errors/"))
    kinds = [kind for kind in (shards, shards, errors, [store.MANIFEST]) if kind]
    if report := verify_files(VERSION, root=home).problems:
        raise RuntimeError(f"the reference is not in order: {report[0]}")
    for number in range(flips):
        name = rng.choice(rng.choice(kinds))
        at, content = rng.randrange(len(expected[name])), bytearray(expected[name])
        content[at] ^= rng.randrange(1, 256)
        (home / VERSION / name).write_bytes(content)
        problem = _found_by_verify(home, name, outcome)
        if problem is None and number % build_every == 0:
            problem = _mended_or_refused(home, name, expected, bool(errors), outcome)
        outcome.judge(problem and f"{name}, byte {at} is {content[at]}: {problem}")
        (home / VERSION / name).write_bytes(expected[name])
    shutil.rmtree(home)
    return outcome


def _found_by_verify(home: Path, name: str, outcome: Outcome) -> str | None:
    try:
        checks = verify_files(VERSION, root=home).checks
    except SynthNetError as error:
        outcome.seen["verify: refused"] += 1
        return None if name in str(error) else f"verify refuses {error}"
    for check in checks:
        if any(name in problem for problem in check.problems):
            outcome.seen[f"verify: {check.name}"] += 1
            return None
    return "verify does not name it"


def _mended_or_refused(
    home: Path, name: str, expected: dict[str, bytes], estimated: bool, outcome: Outcome
) -> str | None:
    options = ("--error-estimates",) if estimated else ()
    build = Build(home, *options)
    code, line = build.wait(), build.refusal()
    if code == 0:
        outcome.seen["build: mended"] += 1
        return difference(contents(home), expected)
    if line is None or name not in line:
        return f"a build over it: exit code {code}, {build.said()[-500:]}"
    outcome.refused += 1
    outcome.seen["build: refused"] += 1
    (home / VERSION / name).unlink()  # as the line says
    return finish(home, expected, *options)


def _without_estimates(reference: Path) -> dict[str, bytes]:
    return {n: c for n, c in contents(reference).items() if not n.startswith("errors/")}


# The measurement


def options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the measurement."""
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--flips", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", nargs="+", choices=NAMES, help="keep the rows of other faults")


def measure(options: argparse.Namespace) -> dict:
    """Do everything, or only some of it: a row a fault."""
    with tempfile.TemporaryDirectory(prefix="break-builds-") as temporary:
        outcomes = all_faults(options, Path(temporary))
    rows = {outcome.fault: outcome.row() for outcome in outcomes}
    if options.only:
        rows = {row["fault"]: row for row in numbers.read("faults")["rows"]} | rows
    return {"version": VERSION, "seed": options.seed, "rows": list(rows.values())}


def problems(data: dict) -> list[str]:
    """Return what was neither mended nor refused."""
    return [problem for row in data["rows"] for problem in row["wrong"]]


def all_faults(options: argparse.Namespace, place: Path) -> list[Outcome]:
    """Do everything, with a reference made first."""
    reference = place / "reference"
    sys.stderr.write("an undisturbed build, with error estimates, to compare with\n")
    build = Build(reference, "--error-estimates")
    if build.wait():
        raise RuntimeError(f"an undisturbed build fails: {build.said()}")
    if len(plan_shards(recipe.load(VERSION))) != sum(
        n[:7] == "shards/" for n in contents(reference)
    ):
        raise RuntimeError("the undisturbed build lacks shards")
    with_estimates = options.kills // 5
    few = max(1, options.kills // 10)
    faults: dict[str, Callable[[random.Random], Outcome]] = {
        "killed": lambda rng: kill_builds(reference, place, options.kills - with_estimates, rng),
        "killed with --error-estimates": lambda rng: kill_builds(
            reference, place, with_estimates, rng, "--error-estimates", missing=small_ones
        ),
        "disk full": lambda rng: fill_disks(reference, place, few, rng),
        "byte altered": lambda rng: flip_bytes(reference, place, options.flips, rng),
        "out of memory": lambda rng: starve_workers(reference, place, few, rng),
        "two at once": lambda rng: build_twice(reference, place, 2 * few, rng, small_ones),
        "two at one URL": lambda rng: build_twice_at_a_url(reference, few, rng),
    }
    chosen = options.only or NAMES
    return [faults[name](random.Random(f"{options.seed} {name}")) for name in chosen]


def table(data: dict) -> str:
    """Return a row a fault."""
    rows = []
    for row in data["rows"]:
        seen = ", ".join(f"{count} {what}" for what, count in sorted(row["seen"].items()))
        counts = [row[name] for name in ("cases", "refused", "same")] + [len(row["wrong"])]
        rows.append([row["fault"], *counts, row["skipped"] or seen])
    headers = ["fault", "cases", "refused in one line", "then as it should be", "wrong", "where"]
    return f"{data['version']}, seed {data['seed']}:\n\n{markdown.table(headers, rows, 'l')}"
