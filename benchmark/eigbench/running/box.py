"""The sandbox: what a predictor's process can reach, and how the system holds it to that.

It is a list of what is shown; all else is not there. Shown, to be read alone: the interpreter and
its packages, the predictor's own files, what the user names, and the labels of the training that is
asked for. It may write to a directory of its own, which is removed with it. There is no network.
Hidden are datasets, the pinned labels of other shapes, boards, the home and the working directory.

bubblewrap (https://github.com/containers/bubblewrap) holds it to the list where that is installed
and may make namespaces, else :mod:`eigbench.running.landlock`.
"""

import contextlib
import fcntl
import functools
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import synthnet
from eigbench.errors import PredictorError
from eigbench.results.sources import is_output
from eigbench.running import landlock, predictor, supervisor
from eigbench.scoring import truth
from synthnet import kernels, store
from synthnet.store import pins

ROOTS = (Path(synthnet.__path__[0]), Path(__file__).parents[1])  # synthnet and eigbench
FOLDER = "eigbench-boxed-"  # how the names of sandboxes' folders begin
TIME_LIMIT = 3600.0  # seconds
BUBBLEWRAP, LANDLOCK, NONE = "bubblewrap", "landlock", "none"
ISOLATED = (
    *("--unshare-all", "--die-with-parent", "--cap-drop", "ALL"),
    *("--proc", "/proc", "--dev", "/dev"),
)
SYSTEM = (
    *("/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/libx32", "/etc/alternatives"),
    *("/etc/ld.so.cache", "/etc/ld.so.conf", "/etc/ld.so.conf.d", "/etc/localtime"),
    *("/etc/group", "/etc/nsswitch.conf", "/etc/passwd", "/sys/devices/system"),
)
DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom")
PACKAGES = ("site-packages", "dist-packages")  # names of directories that libraries lie in
KEPT = (  # variables, or beginnings of their names, that the process inherits
    *("PATH", "LANG", "LC_", "TZ", "LD_LIBRARY_PATH", "PYTHON", "NUMBA_", "SYNTHNET_COMPILING"),
    supervisor.PACKAGES,
    *("OMP_", "OPENBLAS_", "MKL_", "KMP_", "CUDA_", "NVIDIA_", "TORCH_", "COVERAGE_"),
)
ASKS = re.compile(rb"\btraining\b")  # in the code of a predictor whose `load` takes it
NOISE = ("/dev", "/etc", "/proc", "/run", "/sys", "/usr", "/var")  # where libraries look round


@dataclass(frozen=True, slots=True)
class Rule:
    """A path with all below it is shown or hidden; a later rule overrules an earlier one."""

    path: Path
    shown: bool = True


@functools.cache
def available() -> str:
    """Return the best sandbox that works here: ``bubblewrap``, ``landlock``, or ``none``."""
    if sys.platform != "linux":
        return NONE
    command = ["bwrap", *ISOLATED, "--ro-bind", "/", "/", "--", "true"]
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        subprocess.run(command, capture_output=True, check=True, timeout=30)
        return BUBBLEWRAP
    return LANDLOCK if landlock.version() else NONE


def chosen(sandbox: str) -> str:
    """Return the sandbox of a run.

    What is asked for is ``auto`` for the best that there is, ``required`` for that or an error, or
    ``none``.

    Raises
    ------
    PredictorError
        If one is required and none works here.
    """
    if sandbox == NONE:
        return NONE
    if sandbox == "required" and available() == NONE:
        raise PredictorError(
            "no sandbox works here: install bubblewrap (apt-get install bubblewrap), or use Linux "
            "5.13 or newer, or a container that may make namespaces; --no-sandbox runs without"
        )
    return available()


@dataclass(frozen=True, slots=True)
class Settings:
    """How a predictor's process is run."""

    #: Handed to the predictor; one beginning with ``cuda`` has the sandbox show the system's.
    device: str = "cpu"
    threads: int = 1  #: of BLAS and OpenMP
    time_limit: float = TIME_LIMIT  #: most seconds for loading and for a batch
    #: Most GiB that the process may have in memory (resident, where Linux tells).
    memory_limit: float | None = None
    sandbox: str = NONE  #: what holds it; ``none`` lets it do what its user may
    #: Files and directories that the sandbox shows besides the predictor's own.
    readable: Sequence[Path] = ()
    packages: Path | None = None  #: a directory of packages that come before the others


class Box:
    """What one process of a predictor gets: a folder of its own, its rules and its command.

    Its folder is made at once and removed by :meth:`close`.

    Parameters
    ----------
    file : Path
        The predictor's file.
    training : str
        What it may be trained on: labels of the training and validation shapes are shown.
    settings : Settings
        With the sandbox ``bubblewrap`` or ``landlock``.
    """

    def __init__(self, file: Path, training: str, settings: Settings) -> None:
        self.kind = settings.sandbox
        self.accelerated = settings.device.startswith("cuda")
        self.directory = predictor.split(file)[0].resolve().parent
        sweep()
        self.folder, self._lock = _made()
        try:
            self.private = self.folder / "private"
            self.private.mkdir()
            own = list(_own(predictor.split(file)[0].resolve()))
            self._copy_kernels([rule.path for rule in own if rule.path.is_dir()])
            if kernels.flag().exists():
                kernels.flag(self.private).touch()
            handed = self.folder / "labels"
            handed.mkdir()
            if any(ASKS.search(path.read_bytes()) for path in _code(own)):
                hand_over(training, handed)
            self.rules = [
                *_libraries(),
                *own,
                *(Rule(path.resolve()) for path in settings.readable),
                *([] if settings.packages is None else [Rule(settings.packages.resolve())]),
                Rule(handed),
            ]
        except BaseException:
            self.close()
            raise
        self.labels = handed

    def close(self) -> None:
        """Remove the folder and what the process has left in it."""
        if os.path.lexists(kernels.flag(self.private)):  # the next one need not say it again
            with contextlib.suppress(OSError):
                kernels.flag().touch()
        _remove(self.folder)
        os.close(self._lock)

    def command(self, start: Sequence[str]) -> list[str]:
        """Return the command that runs another one, ``start``, in the sandbox."""
        if self.kind == BUBBLEWRAP:
            where = ["--chdir", str(self.directory)]
            return ["bwrap", *self._mounts(), *where, "--", *start, supervisor.HELD]
        note = self.folder / "landlock.json"
        note.write_text(json.dumps(self._grants()))
        return [*start, str(note)]

    def environment(self, inherited: Mapping[str, str]) -> dict[str, str]:
        """Return the variables of the process: of the inherited ones those that it needs.

        Of the directories with modules, those that are not in the sandbox go: a look into one would
        be reported as an attempt of the predictor.
        """
        kept = {name: text for name, text in inherited.items() if name.startswith(KEPT)}
        modules = inherited.get("PYTHONPATH", "").split(os.pathsep)
        there = (path for path in modules if self.shows(Path(path)) or self._on_the_way(path))
        inside = str(self.private)
        return {
            **kept,
            "PYTHONPATH": os.pathsep.join(there),
            "HOME": inside,
            "TMPDIR": inside,
            "NUMBA_CACHE_DIR": f"{inside}/numba",
            kernels.HOW: "kept as long as the sandbox is there",
            "PYTHONDONTWRITEBYTECODE": "1",
            pins.VARIABLE: str(self.labels),
        }

    def shows(self, path: Path) -> bool:
        """Whether a path can be read in the sandbox."""
        shown = path.is_relative_to(self.private)
        for rule in self.rules:
            if path.is_relative_to(rule.path):
                shown = rule.shown
        return shown

    def refused(self, attempts: Sequence[str]) -> list[str]:
        """Return those of a predictor's attempts that the sandbox has refused.

        They are ``read PATH``, ``write PATH`` or ``connect HOST``, as its process saw them begin.
        """
        refusals = []
        for attempt in attempts:
            what, _, where = attempt.partition(" ")
            path = Path(os.path.normpath(where))
            if what == "read":
                way = self._on_the_way(path) or path in self.private.parents
                hidden = not way and not self.shows(path)
                bad = hidden and not _noise(path) and os.path.lexists(path)
            elif what == "write":
                bad = not path.is_relative_to(self.private) and not _noise(path)
            else:  # a socket in its own folder is its own
                bad = not path.is_relative_to(self.private)
            if bad and attempt not in refusals:
                refusals.append(attempt)
        return refusals

    def _on_the_way(self, path: Path | str) -> bool:
        """Whether a path leads to something that a rule is about."""
        return any(rule.path.is_relative_to(path) for rule in self.rules)

    def _copy_kernels(self, packages: Sequence[Path]) -> None:
        """Copy the kernels that are compiled already: a copy, since it loads machine code."""
        rooms = itertools.chain(ROOTS[0].glob("*/"), [self.directory], packages)
        for path in kernels.compiled(rooms):
            copy = self.private / "numba" / path.relative_to(kernels.folder())
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, copy)

    def _mounts(self) -> list[str]:
        """Return bubblewrap's arguments for the rules, in their order."""
        mounts = list(ISOLATED)
        if self.accelerated:
            mounts += ["--dev-bind", "/dev", "/dev", "--tmpfs", "/dev/shm"]
            mounts += ["--ro-bind", "/sys", "/sys"]
        mounts += ["--bind", str(self.private), str(self.private)]
        for rule in self.rules:
            path = str(rule.path)
            if not rule.shown:
                mounts += ["--tmpfs", path]
            elif rule.path.is_symlink():
                mounts += ["--symlink", str(rule.path.readlink()), path]
            else:
                mounts += ["--ro-bind", path, path]
        hidden = (str(rule.path) for rule in self.rules if not rule.shown)
        for path in (*hidden, "/"):
            mounts += ["--remount-ro", path]
        return mounts

    def _grants(self) -> dict[str, str | list[str]]:
        """Return Landlock's rules: it can only grant, so what holds a hidden path is split."""
        granted = [*_granted(self.rules), Path("/proc")]
        packages = [root.parent for root in ROOTS]
        split = [rule.path.parent for rule in self.rules if not rule.shown]
        writable = [self.private, *map(Path, DEVICES)]
        if self.accelerated:
            granted.append(Path("/sys"))
            writable += Path("/dev").glob("nvidia*")
        return {
            "directory": str(self.directory),
            "shown": [str(path) for path in granted],
            "listed": [str(path) for path in (self.directory, *packages, *split)],
            "writable": [str(path) for path in writable],
        }


def sweep() -> None:
    """Remove the folders of sandboxes whose process has gone without closing them (``kill -9``).

    Each process holds a lock on its folders, which the kernel gives back when it ends.
    """
    for folder in Path(tempfile.gettempdir()).glob(f"{FOLDER}*"):
        try:
            lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
        except OSError:  # another user's, or gone by now
            continue
        try:
            if os.fstat(lock).st_uid == os.getuid():
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                _remove(folder)
        except OSError:  # its process still runs
            pass
        finally:
            os.close(lock)


def _made() -> tuple[Path, int]:
    """Make a folder that only this process removes; return it, and a descriptor that holds it.

    It has its name once it is held: before, another process might sweep it.
    """
    unheld = Path(tempfile.mkdtemp(prefix="eigbench-new-"))
    lock = os.open(unheld, os.O_RDONLY | os.O_DIRECTORY)
    with contextlib.suppress(OSError):  # a file system without locks, where none is swept
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    folder = unheld.with_name(FOLDER + unheld.name.rpartition("-")[2])
    return unheld.rename(folder), lock


def _remove(folder: Path) -> None:
    """Remove a folder, with those in it that a predictor has closed."""
    for above, names, _ in os.walk(folder):
        for path in (Path(above, name) for name in names):
            if not path.is_symlink():
                path.chmod(0o700)
    shutil.rmtree(folder, ignore_errors=True)


def hand_over(training: str, folder: Path) -> None:
    """Write the pinned labels of the shapes that a training and its validation use, no others.

    :func:`synthnet.store.pins.read` finds them in the folder that ``SYNTHNET_PINS`` names. Of a
    training that has no pinned labels nothing is written.
    """
    for name, content in _handed(training).items():
        (folder / name).write_bytes(content)


@functools.lru_cache(maxsize=2)  # a run has several processes of one training
def _handed(training: str) -> dict[str, bytes]:
    version, _, protocol = training.partition("/")
    labels, limits = pins.read(version), pins.read_limits(version)
    if labels is None:
        return {}
    splits = (truth.load(version, split, protocol) for split in ("train", "validation"))
    used = {id for split in splits for id in split.shapes.tolist()}
    with tempfile.TemporaryDirectory() as made:
        mine = [labels[id] for id in labels if id in used]
        pins.write(Path(made, pins.labels_file(version)), mine)
        if limits is not None:
            known = {id: limits[id] for id in limits if id in used}
            pins.write_limits(Path(made, pins.limits_file(version)), known)
        return {path.name: path.read_bytes() for path in Path(made).iterdir()}


def _libraries() -> Iterator[Rule]:
    """Yield what every predictor may read: the system's libraries, Python and its packages."""
    prefixes = {sys.prefix, sys.exec_prefix, sys.base_prefix, sys.base_exec_prefix}
    prefixes |= {str(Path(prefix).resolve()) for prefix in prefixes}  # one may be a link
    folders = [
        *SYSTEM,
        *sorted(prefixes),
        *(folder for folder in sys.path if Path(folder).name in PACKAGES),
    ]
    done: list[Path] = []
    for path in map(Path, folders):
        if path.exists() and not any(path.is_relative_to(other) for other in done):
            done.append(path)
            yield Rule(path)
    home = store.home()
    if isinstance(home, Path) and home.is_dir() and any(home.is_relative_to(p) for p in done):
        yield Rule(home, shown=False)
    for root in ROOTS:
        if not any(root.is_relative_to(other) for other in done):
            yield Rule(root)
            # An editable installation's metadata lies beside the package, and libraries read it
            yield from (Rule(path) for path in sorted(root.parent.glob("*.egg-info")))
        for folder in sorted({path.parent for path in root.rglob("*.parquet")}):
            yield Rule(folder, shown=False)
            others = (path for path in sorted(folder.iterdir()) if path.suffix != ".parquet")
            yield from map(Rule, others)


def _own(file: Path) -> Iterator[Rule]:
    """Yield a predictor's own files, as docs/submit.md has them.

    In its directory: Python files, packages, and what has the name of one of these before a dot or
    as a directory. No link, since it may lead anywhere, and nothing that eigbench has
    written of an earlier run.
    """
    entries = sorted(entry for entry in file.parent.iterdir() if not entry.is_symlink())
    names = {entry.stem for entry in entries if entry.suffix == ".py" and entry.is_file()}
    names |= {entry.name for entry in entries if (entry / "__init__.py").is_file()}
    names -= set(predictor.NOT_THEIRS)
    beginnings = tuple(f"{name}." for name in names)
    for entry in entries:
        named = entry.name in names if entry.is_dir() else entry.name.startswith(beginnings)
        if named and not is_output(entry):
            yield Rule(entry)
            # What is compiled there may be of other code than the sources beside it.
            yield from (Rule(path, shown=False) for path in sorted(entry.rglob("__pycache__")))


def _code(own: Sequence[Rule]) -> Iterator[Path]:
    """Yield the Python files of a predictor's own files and packages."""
    for rule in own:
        paths = rule.path.rglob("*.py") if rule.path.is_dir() else [rule.path]
        yield from (path for path in paths if path.suffix == ".py" and kernels.is_source(path))


def _noise(path: Path) -> bool:
    return any(path.is_relative_to(folder) for folder in NOISE)


def _granted(rules: Sequence[Rule]) -> Iterator[Path]:
    """Yield paths that may be granted with all below them, so that nothing hidden is."""
    for rank, rule in enumerate(rules):
        if rule.shown:
            yield from _without(rule.path, [r.path for r in rules[rank + 1 :] if not r.shown])


def _without(path: Path, hidden: Sequence[Path]) -> Iterator[Path]:
    """Yield the largest paths below a path that hold nothing hidden."""
    below = [other for other in hidden if other.is_relative_to(path)]
    if not below:
        yield path
    elif path not in below:
        for child in sorted(path.iterdir()):
            yield from _without(child, below)
