"""The sandbox: what a predictor in it cannot reach, and what it answers there all the same."""

import contextlib
import hashlib
import importlib.util
import os
import platform
import py_compile
import socket
import subprocess
import sys
from functools import cache
from pathlib import Path
from subprocess import PIPE

import numpy as np
import pyarrow.parquet as pq
import pytest
from eigbench.errors import PredictorError
from eigbench.running import box, calls, landlock, meshes
from eigbench.running.process import PredictorProcess
from eigbench.scoring import targets, truth

import synthnet
from synthnet import kernels
from synthnet.store import pins

BASELINES = Path(__file__).parents[3] / "baselines"
KINDS = [
    pytest.param(
        box.BUBBLEWRAP,
        marks=pytest.mark.skipif(
            box.available() != box.BUBBLEWRAP, reason="bubblewrap is not installed, or may not"
        ),
    ),
    pytest.param(
        box.LANDLOCK,
        marks=pytest.mark.skipif(landlock.version() == 0, reason="the kernel has no Landlock"),
    ),
]
LANDLOCK = box.Settings(sandbox=box.LANDLOCK)
PROBE = """
import ctypes, os, socket, tempfile
from pathlib import Path
import numpy as np
import synthnet

PACKAGE = Path(synthnet.__file__).parent

def attempt(): {attempt}

def predict(meshes):
    {call}
    return np.ones((len(meshes), 10))
"""
ATTEMPTS = {
    "labels of a dataset": ("open(r'{secret}')", "read {secret}"),
    "the names of a home": ("os.listdir(r'{secret.parent}')", "read {secret.parent}"),
    "pinned labels": (
        "open(PACKAGE / 'recipe' / 'versions' / '1.0.lock.parquet')",
        "1.0.lock.parquet",
    ),
    "a file beside it that is none of its own": ("open('notes.txt')", "notes.txt"),
    "a link of its own": ("open('my_model.link')", "my_model.link"),
    "another's socket": ("socket.create_connection(('127.0.0.1', {port}))", "connect"),
    "its own code": ("open(__file__, 'w')", "write"),
    "a file elsewhere": ("open(r'{secret.parent}/left', 'w')", "write {secret.parent}/left"),
    "a file at the top": ("open('/left', 'w')", "write /left"),
    "a file that is moved elsewhere": (
        "os.rename(tempfile.mkstemp()[1], r'{secret.parent}/left')",
        "write {secret.parent}/left",
    ),
    "a link elsewhere": (
        "os.symlink('labels.csv', r'{secret.parent}/left')",
        "write {secret.parent}/left",
    ),
    "labels by a hard link": (
        "os.link(r'{secret}', tempfile.mkdtemp() + '/labels')",
        "read {secret}",
    ),
}


@pytest.fixture(params=KINDS)
def kind(request):
    """Each sandbox that works here."""
    return request.param


def warmed(file, sandbox, **more):
    """Run a predictor in a sandbox until it is warm, and return its report."""
    with PredictorProcess(file, 10, box.Settings(sandbox=sandbox, **more)) as process:
        process.warm_up(1)
        return process.status()


@pytest.fixture
def secret(tmp_path_factory):
    """A file that no predictor may read, in a directory that stands for a home."""
    path = tmp_path_factory.mktemp("home") / "labels.csv"
    path.write_text("1,2,3")
    return path


@pytest.fixture
def listening():
    """The port of a socket on this machine to which somebody may connect."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.fixture
def asked(predictor_file, secret, listening, monkeypatch):
    """Return a function that runs an attempt, caught or not, and returns the sandbox's report."""

    def ask(attempt, kind, *, caught=False, readable=()):
        call = "attempt()"
        if caught:
            call = "\n    ".join(("try:", "    attempt()", "except OSError:", "    pass"))
        code = attempt.format(secret=secret, port=listening)
        file = predictor_file(PROBE.format(attempt=code, call=call))
        file.with_name("notes.txt").write_text("of another")
        link = file.with_name("my_model.link")
        link.unlink(missing_ok=True)
        if link.name in attempt:
            link.symlink_to(secret)
        monkeypatch.chdir(file.parent)
        return warmed(file, kind, readable=readable)

    return ask


@pytest.mark.parametrize("what", ATTEMPTS)
def test_outside_the_box_each_attempt_succeeds(asked, what):
    """The two tests below can fail: nothing else refuses these."""
    if what == "a file at the top" and not os.access("/", os.W_OK):
        pytest.skip("only root may write there")
    if what == "a link of its own":  # that it has read it is seen when its sources are
        with pytest.raises(PredictorError, match=r"my_model\.link is reached by a symbolic link"):
            asked(ATTEMPTS[what][0], box.NONE)
        return
    assert asked(ATTEMPTS[what][0], box.NONE).refused == ()
    if what == "a file at the top":
        Path("/left").unlink()


@pytest.mark.attack
@pytest.mark.parametrize("what", ATTEMPTS)
def test_in_the_box_each_attempt_fails_and_is_reported(asked, secret, kind, what):
    attempt, report = ATTEMPTS[what]
    hints = {
        "a file beside it that is none of its own": "does not show notes.txt: name it my_model.not",
        "a link of its own": "shows no symbolic link: put what .*my_model.link leads",
    }
    with pytest.raises(PredictorError, match=hints.get(what, "shows the predictor's")):
        asked(attempt, kind)
    refused = asked(attempt, kind, caught=True).refused
    assert refused
    assert all(report.format(secret=secret) in message for message in refused)
    assert not secret.with_name("left").exists()


def test_what_the_user_shows_can_be_read_and_is_a_source(asked, secret, kind):
    status = asked("open(r'{secret}').read()", kind, readable=[secret])
    assert status.refused == ()
    assert sorted(status.sources) == ["labels.csv", "my_model.py"]


ALLOWED = {
    "a folder in a temporary one": (
        "import shutil, tempfile\n    where = tempfile.mkdtemp()\n"
        "    Path(where, 'below').mkdir()\n    Path(where, 'a.npy').touch()\n"
        "    shutil.rmtree(where)"
    ),
    "a socket of its own": (
        "at = os.path.join(os.environ['TMPDIR'], 'socket')\n"
        "    own = socket.socket(socket.AF_UNIX)\n    own.bind(at)\n    own.listen()\n"
        "    socket.socket(socket.AF_UNIX).connect(at)"
    ),
}


@pytest.mark.parametrize("what", ALLOWED)
def test_what_it_does_in_its_own_directory_is_no_refusal(predictor_file, what):
    code = PROBE.format(attempt="pass", call=ALLOWED[what])
    kind = box.available()  # Landlock gives no sockets at all
    if kind != box.BUBBLEWRAP:
        pytest.skip("bubblewrap is not installed, or may not")
    assert warmed(predictor_file(code), kind).refused == ()


def test_a_name_with_dots_and_a_folder_of_that_name_are_its_own(predictor_file, kind):
    code = "import numpy as np\nfrom pathlib import Path\n"
    code += "w = np.load(Path(__file__).with_name('gcn_v1.2') / 'below' / 'weights.npy')\n"
    code += "def predict(meshes): return np.ones((len(meshes), 10)) * w"
    path = predictor_file(code, "gcn_v1.2.py")
    weights = path.with_suffix("") / "below" / "weights.npy"
    weights.parent.mkdir(parents=True)
    np.save(weights, np.ones(10))
    assert set(warmed(path, kind).sources) == {"gcn_v1.2.py", "gcn_v1.2/below/weights.npy"}


def test_a_module_in_a_folder_that_is_no_package_is_named_as_the_cause(predictor_file, kind):
    path = predictor_file("import sys\nsys.path.insert(0, 'lib')\nimport helper")
    (path.parent / "lib").mkdir()
    (path.parent / "lib" / "helper.py").write_text("x = 1")
    with pytest.raises(PredictorError, match=r"does not show lib/: make a package"):
        warmed(path, kind)


@pytest.mark.parametrize(("number", "by_it"), [(13, True), (101, True), (9, False), (28, False)])
def test_only_an_error_that_it_may_have_made_is_put_down_to_it(number, by_it, predictor_file, kind):
    with pytest.raises(PredictorError) as caught:
        warmed(predictor_file(f"raise OSError({number}, 'no')"), kind)
    assert f"[Errno {number}] no" in str(caught.value)
    assert ("the sandbox shows the predictor's own files" in str(caught.value)) is by_it


def test_a_dataset_is_not_built_in_it(predictor_file, kind):
    code = "from synthnet import load_dataset\nload_dataset('1.0-mini', 'train')"
    with pytest.raises(PredictorError, match=r"no meshes of 1.0-mini, and builds none"):
        warmed(predictor_file(code), kind)


@pytest.mark.attack
def test_it_has_a_directory_of_its_own_that_is_gone_afterwards(asked, kind, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code = "Path(os.environ['TMPDIR'], 'mine').write_text(str(Path.home()))"
    assert asked(code, kind).refused == ()
    assert not list(tmp_path.glob("eigbench-*"))


def test_the_folder_of_a_process_that_was_killed_is_swept_and_no_other(
    predictor_file, tmp_path, monkeypatch
):
    path, code = predictor_file("def predict(meshes): pass"), tmp_path / "holds.py"
    code.write_text(
        "import sys\nfrom pathlib import Path\nfrom eigbench.running import box\n"
        "made = box.Box(Path(sys.argv[1]), '1.0/grouped', box.Settings(sandbox='landlock'))\n"
        "closed = made.private / 'closed' / 'in'\nclosed.mkdir(parents=True)\n"
        "closed.parent.chmod(0)\nprint(made.folder, flush=True)\nsys.stdin.read()"
    )
    temporary, other = tmp_path / "tmp", tmp_path / "tmp" / f"{box.FOLDER}file"
    temporary.mkdir()
    other.write_text("no folder")
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    command, pipes = [sys.executable, code, path], {"stdin": PIPE, "stdout": PIPE}
    with subprocess.Popen(command, **pipes, text=True) as holder:
        folder = Path(holder.stdout.readline().strip())
        assert folder.parent == temporary
        box.sweep()
        assert folder.is_dir()
        holder.kill()
    assert folder.is_dir()
    box.Box(path, "1.0/grouped", LANDLOCK).close()
    assert list(temporary.iterdir()) == [other]


COMPILES = """
import numpy as np
from synthnet.kernels import kernel

@kernel
def twice(x):
    return 2 * x

def predict(meshes):
    return np.full((len(meshes), 10), twice(1.0))
"""


def test_that_it_compiles_is_said_once_and_how_long_that_is_kept(
    predictor_file, kind, monkeypatch, tmp_path, capfd
):
    meshes.warming(1)  # what this process compiles for itself
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))  # where it is noted that it was said
    monkeypatch.setenv(kernels.SAID, "a-test")
    line = kernels.COMPILING.format(how="kept as long as the sandbox is there")
    for said in (f"{line}\n", ""):
        warmed(predictor_file(COMPILES), kind)
        assert capfd.readouterr().err == said


def test_folders_of_modules_that_are_not_in_it_are_not_looked_for(asked, secret, kind, monkeypatch):
    """`python -m eigbench` puts the working directory there, and the predictor may be elsewhere."""
    monkeypatch.syspath_prepend(secret.parent)
    search = "__import__('importlib.metadata').metadata.version('numpy')"
    assert asked(search, kind).refused == ()


@pytest.mark.attack
def test_it_inherits_no_secret_from_the_environment(asked, kind, monkeypatch):
    monkeypatch.setenv("MY_TOKEN", "secret")
    with pytest.raises(PredictorError, match="KeyError: 'MY_TOKEN'"):
        asked("os.environ['MY_TOKEN']", kind)


@pytest.mark.attack
def test_processes_outside_are_out_of_reach(asked, kind):
    """Neither their memory and files nor their lives: by signal 0, which only asks."""
    for attempt in (
        f"os.listdir('/proc/{os.getpid()}/root')",
        f"open('/proc/{os.getpid()}/environ').read()",
        f"os.kill({os.getpid()}, 0)",
    ):
        if "kill" in attempt and kind == box.LANDLOCK and landlock.version() < 6:
            continue
        with pytest.raises(PredictorError, match=r"(Permission|FileNotFound|ProcessLookup)Error"):
            asked(attempt, kind)


@pytest.fixture
def forgets():
    """What is read of the pins handed over is not kept for other tests."""
    targets._pinned.cache_clear()
    yield
    targets._pinned.cache_clear()


@pytest.mark.attack
@pytest.mark.usefixtures("forgets")
def test_the_labels_that_are_handed_over_are_those_of_the_training(tmp_path, monkeypatch):
    training = "2.0/family/pretzel"
    box.hand_over(training, tmp_path)
    whole = {split: truth.load("2.0", split, "family/pretzel") for split in ("train", "validation")}
    handed = pq.read_table(tmp_path / pins.labels_file("2.0"))["id"].to_pylist()
    assert set(handed) == {id for labels in whole.values() for id in labels.shapes.tolist()}
    assert set(handed) == set(pq.read_table(tmp_path / pins.limits_file("2.0"))["id"].to_pylist())
    monkeypatch.setenv(pins.VARIABLE, str(tmp_path))
    for split, labels in whole.items():
        there = truth.load("2.0", split, "family/pretzel")
        assert there.digest == labels.digest
        surfaces = [pins.read_limits("2.0")[id].eigenvalues for id in there.shapes[:5]]
        assert np.array_equal(surfaces, targets.at(labels, "surface").eigenvalues[:5])
    with pytest.raises(Exception, match="has nothing in the split test"):
        truth.load("2.0", "test", "family/pretzel")


NO_SOCKET = """
import socket
import numpy as np

def predict(meshes):
    for family, kind in ((socket.AF_UNIX, socket.SOCK_STREAM), (socket.AF_INET, socket.SOCK_DGRAM)):
        try:
            socket.socket(family, kind)
        except PermissionError:
            continue
        raise RuntimeError("a socket")
    socket.socketpair()
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
@pytest.mark.skipif(landlock.version() == 0, reason="the kernel has no Landlock")
def test_landlock_goes_with_no_socket_at_all(predictor_file):
    """Landlock itself does not see sockets that lie in files, or packets of UDP."""
    warmed(predictor_file(NO_SOCKET), box.LANDLOCK)


KEEPS = """
import ctypes, errno
import numpy as np

libc = ctypes.CDLL(None, use_errno=True)

def failure(call, *arguments):
    return errno.errorcode.get(ctypes.get_errno()) if call(*arguments) < 0 else "done"

def predict(meshes):
    found = {{failure(libc.syscall, number, 0, 0, 0, 0, 0) for number in {numbers}}}
    found |= {{failure(libc.shmget, 4711, 64, 0o1600), failure(libc.msgget, 4711, 0o1600)}}
    if found != {{"EACCES"}}:
        raise RuntimeError(f"not refused: {{found}}")
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
def test_a_predictor_leaves_nothing_in_the_kernel_for_the_next(predictor_file, kind):
    """Memory, queues and keys that are shared by their number would outlive its process."""
    warmed(predictor_file(KEEPS.format(numbers=calls.KEEPING[platform.machine()])), kind)


def test_packages_of_a_rows_own_are_found_in_the_box_only(predictor_file, tmp_path, kind):
    """What Python runs by itself when it starts would run before Landlock holds it."""
    packages, left = tmp_path / "packages", tmp_path / "left"
    packages.mkdir()
    (packages / "sitecustomize.py").write_text(f"open({str(left)!r}, 'w')")
    (packages / "of_its_own.py").write_text("NUMBER = 2.5")
    code = "import numpy as np\nimport of_its_own\ndef predict(meshes):\n"
    code += "    return np.full((len(meshes), 10), of_its_own.NUMBER)\n"
    warmed(predictor_file(code), kind, packages=packages)
    assert not left.exists()


@pytest.mark.attack
def test_what_was_compiled_beside_a_package_is_not_run(predictor_file, kind):
    file = predictor_file(
        "import numpy as np\nimport package\ndef predict(meshes):\n"
        "    return np.full((len(meshes), 10), package.VALUE)\n"
    )
    package = file.with_name("package")
    package.mkdir()
    source, other = package / "__init__.py", package / "other.py"
    source.write_text("VALUE = 1.0\n")
    other.write_text("raise RuntimeError('compiled elsewhere')\n")
    compiled = importlib.util.cache_from_source(str(source))
    unchecked = py_compile.PycInvalidationMode.UNCHECKED_HASH
    py_compile.compile(str(other), compiled, invalidation_mode=unchecked)
    other.unlink()
    with pytest.raises(PredictorError, match="compiled elsewhere"):
        PredictorProcess(file, 10, box.Settings()).__enter__()
    warmed(file, kind)


@pytest.mark.parametrize("make", [os.mkfifo, lambda path: Path(path).symlink_to("/dev/zero")])
def test_a_file_beside_the_code_that_never_ends_is_not_read(predictor_file, make):
    file = predictor_file("def predict(meshes): ...")
    make(file.with_name("zz.py"))
    box.Box(file, "2.0/grouped", LANDLOCK).close()


def test_a_folder_that_a_process_has_closed_is_removed(predictor_file):
    file = predictor_file("def predict(meshes): ...")
    made = box.Box(file, "2.0/grouped", LANDLOCK)
    closed = made.private / "closed"
    closed.mkdir()
    (closed / "left").touch()
    closed.chmod(0)
    made.close()
    assert not made.folder.exists()


@pytest.mark.parametrize(
    ("parameters", "asks"), [("device, seed", False), ("device, seed, training", True)]
)
def test_labels_are_handed_over_to_a_predictor_that_asks_for_a_training(
    predictor_file, monkeypatch, parameters, asks
):
    monkeypatch.setattr(box, "hand_over", lambda training, folder: (folder / training).touch())
    file = predictor_file(f'META = {{"training_data": "none"}}\ndef load({parameters}): ...')
    with contextlib.closing(box.Box(file, "labels-of-a-training", LANDLOCK)) as made:
        assert (made.folder / "labels" / "labels-of-a-training").exists() == asks


@pytest.mark.attack
def test_kernels_are_copied_as_the_code_is_now_and_where_it_lies(
    predictor_file, tmp_path, monkeypatch
):
    room = Path(synthnet.__path__[0]) / "spectrum"
    now = f"fem.f_{kernels.stamp(room)}-1.py311.nbi"
    here = f"spectrum_{hashlib.sha1(str(room).encode()).hexdigest()}"  # as Numba names it
    for folder in (here, "spectrum_1"):  # and of another checkout with the same code
        (tmp_path / "kernels" / folder).mkdir(parents=True)
        for name in (now, "fem.f_0123456789ab-1.py311.nbi", "fem.g-1.py311.nbi"):
            (tmp_path / "kernels" / folder / name).touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    file = predictor_file("def predict(meshes): ...")
    with contextlib.closing(box.Box(file, "2.0/grouped", LANDLOCK)) as made:
        copied = [path.relative_to(made.private) for path in made.private.rglob("*.nbi")]
    assert copied == [Path("numba", here, now)]


@cache
def answers(name, sandbox):
    with PredictorProcess(BASELINES / f"{name}.py", 10, box.Settings(sandbox=sandbox)) as process:
        answered = process.predict(list("abcdefgh"), meshes.warming(8))
        assert process.status().refused == ()
        return answered.values.tobytes(), process.status().sources


@pytest.mark.slow
@pytest.mark.parametrize("name", ["weyl", "mean", "kriging", "ritz_mlp"])
def test_baselines_answer_the_same_to_the_bit(kind, name):
    assert answers(name, kind) == answers(name, box.NONE)


def test_who_requires_a_sandbox_where_none_works_is_told_what_to_do(monkeypatch):
    monkeypatch.setattr(box, "available", lambda: box.NONE)
    assert box.chosen("auto") == box.chosen("none") == box.NONE
    with pytest.raises(PredictorError, match="no sandbox works here: install bubblewrap"):
        box.chosen("required")
