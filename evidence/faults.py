"""Builds broken in every way we know.

A build of 1.0-mini is killed, starved of disk and memory, run twice at once, and its files
are altered. What is left must be, after another run, the bytes of an undisturbed build, or
be refused in one line with exit code 2; anything else is wrong. Needs Linux; a small disk needs
root, which may mount one. Half an hour on two cores.
"""

import contextlib
import os
import random
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path

from evidence import markdown
from evidence.build_process import (
    VERSION,
    Build,
    Files,
    begun,
    contents,
    difference,
    everything,
    finish,
    lay_out,
    shards_written,
    small_ones,
)
from synthnet import recipe, store
from synthnet.errors import SynthNetError
from synthnet.recipe.plan import plan_shards
from synthnet.store.storage import RemotePath
from synthnet.verify.checks import verify_files

VICTIMS = ("the build", "a worker", "all its processes")
AT_THE_END = 0.2  # of the kills: once the last shard is there, so that the manifest is hit
ALTERED = "byte altered"
Missing = Callable[[str], bool]


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


def measure(*, kills: int = 50, flips: int = 200, seed: int = 0, only: Sequence[str] = ()) -> dict:
    """Return one row per fault, with a reference made first."""
    with tempfile.TemporaryDirectory(prefix="break-builds-") as temporary:
        folder = Path(temporary)
        reference = folder / "reference"
        faults = all_faults(reference, folder, kills, flips)
        if unknown := {*only} - {*faults}:
            raise ValueError(f"no fault {min(unknown)!r}: there are {', '.join(faults)}")
        sys.stderr.write("an undisturbed build to compare with\n")
        undisturbed_seconds(reference)
        shards = [name for name in contents(reference) if name.startswith("shards/")]
        if len(plan_shards(recipe.load(VERSION))) != len(shards):
            raise RuntimeError("the undisturbed build lacks shards")
        rows = [faults[name](random.Random(f"{seed} {name}")).row() for name in only or faults]
    return {"version": VERSION, "seed": seed, "rows": rows}


def problems(data: dict) -> list[str]:
    """Return what was neither mended nor refused."""
    return [problem for row in data["rows"] for problem in row["wrong"]]


def all_faults(
    reference: Path, folder: Path, kills: int, flips: int
) -> dict[str, Callable[[random.Random], Outcome]]:
    """Return the faults by name, in the order of the page."""
    few = max(1, kills // 10)
    return {
        "killed": lambda rng: kill_builds(reference, folder, kills, rng),
        "disk full": lambda rng: fill_disks(reference, folder, few, rng),
        ALTERED: lambda rng: flip_bytes(reference, folder, flips, rng),
        "out of memory": lambda rng: starve_workers(reference, folder, few, rng),
        "two at once": lambda rng: build_twice(reference, folder, 2 * few, rng),
        "two at one URL": lambda rng: build_twice_at_a_url(reference, few, rng),
    }


# Killed


def kill_builds(
    reference: Path,
    folder: Path,
    kills: int,
    rng: random.Random,
    *,
    missing: Missing = everything,
    seconds: float | None = None,
) -> Outcome:
    """Kill builds at random times, and what resumes them, and let the last one finish."""
    outcome = Outcome("killed")
    expected = contents(reference)
    if seconds is None:
        with begun(folder, expected, missing) as home:
            seconds = undisturbed_seconds(home)
    while outcome.cases < kills:
        with begun(folder, expected, missing) as home:
            done = 0
            for _ in range(rng.randint(1, 3)):
                killed = kill_once(home, seconds, len(expected), rng, outcome)
                done += killed
                if not killed or outcome.cases + done == kills:
                    break
            problem = finish(home, expected)
            for _ in range(done):
                outcome.judge(problem)
    return outcome


def undisturbed_seconds(home: Path) -> float:
    """Build, and return how long it takes."""
    started = time.monotonic()
    build = Build(home)
    if build.wait():
        raise RuntimeError(f"an undisturbed build fails: {build.failure()}")
    return time.monotonic() - started


def kill_once(home: Path, seconds: float, files: int, rng: random.Random, outcome: Outcome) -> bool:
    """Start a build and kill it; return whether it was not too late."""
    at_the_end, victim = rng.random() < AT_THE_END, rng.choice(VICTIMS)
    build = Build(home)
    if at_the_end:
        while build.process.poll() is None and shards_written(home) < files - 1:
            time.sleep(0.002)
        time.sleep(rng.uniform(0, 0.05))
    else:
        with contextlib.suppress(subprocess.TimeoutExpired):
            build.process.wait(rng.uniform(0, seconds))
    if build.process.poll() is not None:
        build.wait()
        return False
    phase = "at work" if build.workers() else "starting"
    if shards_written(home) >= files - 1:
        phase = "all shards written"
    outcome.seen[f"{victim}, {phase}"] += 1
    build.kill(victim, rng)
    code = build.wait()  # after its parent's death a worker may live on for a moment
    if build.refusal():
        outcome.refused += 1
    elif code not in (0, -signal.SIGKILL):
        outcome.wrong.append(f"{victim} killed: {build.failure()}")
    return True


# No space, no memory


def fill_disks(
    reference: Path, folder: Path, cases: int, rng: random.Random, missing: Missing = everything
) -> Outcome:
    """Build on disks too small, then give them room."""
    outcome = Outcome("disk full")
    expected = contents(reference)
    given = sum(len(content) for name, content in expected.items() if not missing(name))
    rest = sum(map(len, expected.values())) - given
    for number in range(cases):
        disk = folder / f"disk-{number}"
        disk.mkdir()
        size = f"size={int(rng.uniform(given + 0.05 * rest, given + 0.9 * rest)) // 1024}k"
        mount = ["mount", "-t", "tmpfs", "-o", size, "tmpfs", str(disk)]
        done = subprocess.run(mount, capture_output=True, text=True, check=False)
        if done.returncode:
            outcome.skipped = f"cannot mount a small disk: {done.stderr.strip()}"
            return outcome
        try:
            lay_out(disk, expected, missing)
            outcome.judge(fill_disk(disk, expected, outcome))
        finally:
            subprocess.run(["umount", str(disk)], check=True)
    return outcome


def fill_disk(disk: Path, expected: Files, outcome: Outcome) -> str | None:
    """Build until the disk is full, then after it was enlarged; return what is wrong."""
    build = Build(disk)
    line = build.refusal()
    if line is None or "o space left" not in line or str(disk) not in line:
        return build.failure()
    outcome.refused += 1
    if leftovers := list((disk / VERSION).rglob("*.partial")):
        return f"left behind: {leftovers}"
    subprocess.run(["mount", "-o", "remount,size=1g", str(disk)], check=True)
    return finish(disk, expected)


def starve_workers(reference: Path, folder: Path, cases: int, rng: random.Random) -> Outcome:
    """Take the memory from a worker at work, by the kernel's limit of its data."""
    outcome = Outcome("out of memory")
    expected = contents(reference)
    for _ in range(cases):
        with begun(folder, expected, everything) as home:
            outcome.judge(starve(home, expected, rng, outcome))
    return outcome


def starve(home: Path, expected: Files, rng: random.Random, outcome: Outcome) -> str | None:
    """Limit the workers of a build once some shards are written; return what is wrong."""
    build, shards = Build(home), rng.randint(1, len(expected) // 2)
    while build.process.poll() is None and shards_written(home) < shards:
        time.sleep(0.02)
    for worker in build.workers():
        with contextlib.suppress(OSError):
            limit = data_bytes(worker) + int(rng.uniform(0, 10e6))
            resource.prlimit(worker, resource.RLIMIT_DATA, (limit, limit))
    code, line = build.wait(), build.refusal()
    if code == 0:
        outcome.seen["had enough"] += 1
    elif line is None or "memory" not in line:
        return build.failure()
    else:
        outcome.refused += 1
        outcome.seen[re.split(" at |:|\\(", line.removeprefix("synthnet: "))[0].strip()] += 1
    return finish(home, expected)


def data_bytes(process: int) -> int:
    """Return the bytes of a process to which the limit of its data applies."""
    with contextlib.suppress(OSError):
        status = Path(f"/proc/{process}/status").read_text()
        if size := re.search(r"VmData:\s*(\d+) kB", status):
            return 1024 * int(size[1])
    return 0


# Two at once


def build_twice(reference: Path, folder: Path, cases: int, rng: random.Random) -> Outcome:
    """Start two builds in one directory at once, with --wait and without."""
    outcome = Outcome("two at once")
    expected = contents(reference)
    pairs = [((), ()), (("--wait",), ("--wait",)), ((), ("--wait",))]
    for number in range(cases):
        options = pairs[number % len(pairs)]
        with begun(folder, expected, small_ones) as home:
            outcome.judge(twice(home, expected, options, rng, outcome))
    return outcome


def twice(
    home: Path,
    expected: Files,
    options: Sequence[tuple[str, ...]],
    rng: random.Random,
    outcome: Outcome,
) -> str | None:
    """Start a build with each of the options, in any order; return what is wrong."""
    builds = []
    for given in rng.sample(options, len(options)):
        builds.append((given, Build(home, *given)))
        time.sleep(rng.choice((0, rng.uniform(0, 3))))
    for given, build in builds:
        line = build.refusal()
        if "--wait" not in given and line and "another build is writing to" in line:
            outcome.refused += 1
            outcome.seen["one refused"] += 1
        elif build.wait() != 0:
            return f"{' '.join(given)}: {build.failure()}"
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
    expected = contents(reference)
    for number in range(cases):
        system.mkdir(f"data-{number}")
        outcome.judge(twice_at(f"s3://data-{number}", expected, system, rng))
    server.stop()
    return outcome


def twice_at(url: str, expected: Files, system: object, rng: random.Random) -> str | None:
    """Start two builds at a URL that has the large shards; return what is wrong."""
    for name, content in expected.items():
        if not small_ones(name):
            (RemotePath(url) / VERSION / name).write_bytes(content)
    builds = []
    for _ in range(2):
        builds.append(Build(url))
        time.sleep(rng.choice((0, rng.uniform(0, 3))))
    for build in builds:
        if build.wait():
            return build.failure()
    top = f"{url.removeprefix('s3://')}/{VERSION}/"
    system.invalidate_cache()  # type: ignore[attr-defined]
    names = system.find(top)  # type: ignore[attr-defined]
    files = {name.removeprefix(top): RemotePath(f"s3://{name}").read_bytes() for name in names}
    return difference(files, expected)


# Altered


def flip_bytes(
    reference: Path, folder: Path, flips: int, rng: random.Random, *, build_every: int = 10
) -> Outcome:
    """Alter one byte of one file at a time: verify must name it, a build mend or refuse."""
    outcome = Outcome(ALTERED)
    expected = contents(reference)
    shards, limits = ([n for n in expected if n.startswith(d)] for d in ("shards/", "limits/"))
    kinds = [shards, shards, limits, [store.MANIFEST]]
    if report := verify_files(VERSION, root=reference).problems:
        raise RuntimeError(f"the reference is not in order: {report[0]}")
    with begun(folder, expected, lambda name: False) as home:
        for number in range(flips):
            name = rng.choice(rng.choice(kinds))
            at, content = rng.randrange(len(expected[name])), bytearray(expected[name])
            content[at] ^= rng.randrange(1, 256)
            (home / VERSION / name).write_bytes(content)
            problem = unnoticed(home, name, outcome)
            if problem is None and number % build_every == 0:
                problem = unmended(home, name, expected, outcome)
            outcome.judge(problem and f"{name}, byte {at} is {content[at]}: {problem}")
            (home / VERSION / name).write_bytes(expected[name])
    return outcome


def unnoticed(home: Path, name: str, outcome: Outcome) -> str | None:
    """Return how ``verify`` fails to name an altered file."""
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


def unmended(home: Path, name: str, expected: Files, outcome: Outcome) -> str | None:
    """Return how a build over an altered file neither mends it nor refuses it by its name."""
    build = Build(home)
    if build.wait() == 0:
        outcome.seen["build: mended"] += 1
        return difference(contents(home), expected)
    if name not in (build.refusal() or ""):
        return f"a build over it: {build.failure()}"
    outcome.refused += 1
    outcome.seen["build: refused"] += 1
    (home / VERSION / name).unlink()  # as the line says
    return finish(home, expected)


def claim(data: dict) -> str:
    """Return what came of all cases together."""
    cases = {row["fault"]: row["cases"] for row in data["rows"]}
    altered = cases.pop(ALTERED)
    wrong = sum(len(row["wrong"]) for row in data["rows"])
    return (
        f"{sum(cases.values())} disturbed builds and {altered} altered files: "
        f"{wrong or 'none'} left a wrong dataset that no command names."
    )


def table(data: dict) -> str:
    """Return one row per fault."""
    rows = []
    for row in data["rows"]:
        seen = ", ".join(f"{count} {what}" for what, count in sorted(row["seen"].items()))
        counts = [row[name] for name in ("cases", "refused", "same")] + [len(row["wrong"])]
        rows.append([row["fault"], *counts, row["skipped"] or seen])
    headers = ["fault", "cases", "refused in one line", "then as it should be", "wrong", "where"]
    return f"{data['version']}, seed {data['seed']}:\n\n{markdown.table(headers, rows, 'l')}"
