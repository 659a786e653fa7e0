"""Predictors that try to gain without predicting: docs/threats.md has the whole list."""

import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from eigbench.errors import PredictorError
from eigbench.running import meshes, record, unseen, usage
from eigbench.running import process as process_module
from eigbench.running.box import Settings
from eigbench.running.evaluate import Evaluation, Options, evaluate, predict_meshes
from eigbench.running.process import Loaded, PredictorProcess, Status
from eigbench.scoring import targets

from tests.eigbench.conftest import ONES

pytestmark = pytest.mark.attack
linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")

COUNTS = """
from pathlib import Path
import numpy as np

table = np.load(Path(__file__).with_name("table.npy"))
begin = -16  # meshes to warm up with

def predict(meshes):
    global begin
    begin += len(meshes)
    return table[np.arange(begin - len(meshes), begin) % len(table)]
"""


def test_who_counts_the_questions_answers_others(evaluated, mini_truth, tmp_path):
    np.save(tmp_path / "table.npy", mini_truth.eigenvalues[mini_truth.order])
    predicted = evaluated(COUNTS, mini_truth, batch_size=16).predictions[0]
    assert np.isfinite(predicted).all()
    assert (predicted == mini_truth.eigenvalues).all(axis=1).mean() < 0.1


CLOCKLESS = """
import time
import numpy as np

sleep = time.sleep
time.perf_counter = time.monotonic = time.process_time = time.time = lambda: 0.0

def predict(meshes):
    sleep(0.2)
    return np.ones((len(meshes), 10))
"""


def test_a_clock_that_is_stopped_in_the_predictors_process_stops_nothing(evaluated, mini_truth):
    assert evaluated(CLOCKLESS, mini_truth.head(3)).seconds.min() >= 0.2


PICKLED = """
import os, pickle, socket, struct
from pathlib import Path
import numpy as np

class Bomb:
    def __reduce__(self):
        return os.mkdir, (str(Path(__file__).with_name("went-off")),)

def predict(meshes):
    body = pickle.dumps(Bomb())
    for fd in range(3, 256):
        try:
            socket.socket(fileno=os.dup(fd)).sendall(struct.pack("<cQ", KIND, len(body)) + body)
        except OSError:
            pass
    return np.ones((len(meshes), 10))
"""


@linux
@pytest.mark.parametrize("kind", [b"a", b"l", b"s", b"f"])
def test_what_a_predictor_sends_does_not_run_in_the_harness(predictor_file, kind):
    code = predictor_file(PICKLED.replace("KIND", repr(kind)))
    with pytest.raises(PredictorError, match="the predictor's process sent "):
        predict_meshes(code, ["a"], meshes.warming(1), 10, Options())
    assert not Path(code.parent, "went-off").exists()


def asked(code):
    """Return what a predictor answers, with the loaded process' facts and its status."""
    with PredictorProcess(code, 10, Settings()) as process:
        answered = process.predict(["a"], meshes.warming(1))
        return process.loaded, answered, process.status()


def test_what_is_solved_while_loading_is_seconds_of_loading(predictor_file):
    loaded, answered, _ = asked(predictor_file("import time\ntime.sleep(1.5)\n" + ONES))
    assert loaded.loading_seconds >= 1.5
    assert answered.seconds < loaded.loading_seconds


# Each child burns for a while and is forgotten by the system, since nobody waits for it.
FORGOTTEN = """
import os, signal, time
import numpy as np

signal.signal(signal.SIGCHLD, signal.SIG_IGN)

def predict(meshes):
    for _ in range(2):
        if (child := os.fork()) == 0:
            end = time.process_time() + 1.0
            while time.process_time() < end: pass
            os._exit(0)
        try:
            os.waitpid(child, 0)
        except ChildProcessError:
            pass
    return np.ones((len(meshes), 10))
"""


@linux
def test_children_that_nobody_waits_for_are_counted_without_a_control_group(
    predictor_file, monkeypatch
):
    monkeypatch.setattr(usage, "own_directory", lambda: None)
    _, answered, status = asked(predictor_file(FORGOTTEN))
    assert status.counted_by == {"processor_time": "process tree", "memory": "process tree"}
    assert answered.cpu_seconds > 1.0  # of 2; what ran since the last look of each is missed
    assert answered.cpu_seconds < 3.0


# A hundred children in turn, each over before anybody has looked at it.
SHORT = FORGOTTEN.replace("range(2)", "range(100)").replace("1.0", "0.02")


@linux
def test_a_control_group_counts_every_child(predictor_file):
    if (group := usage.ControlGroup.make()) is None:
        pytest.skip("this process may not make a control group")
    group.remove()
    _, answered, status = asked(predictor_file(SHORT))
    assert status.counted_by["processor_time"] == "control group"
    assert 2.0 <= answered.cpu_seconds < 4.0


# A child that computes for as long as it is there, or a thread for some time after each answer.
UNASKED = """
import os, threading, time
import numpy as np

def burn(seconds):
    end = time.thread_time() + seconds
    while time.thread_time() < end: pass

def predict(meshes):
    threading.Timer(0.0, burn, [SECONDS]).start()
    return np.ones((len(meshes), 10))
"""
CHILD = UNASKED.replace("def predict", "if os.fork() == 0: burn(600)\n\ndef predict")


@linux
@pytest.mark.parametrize("counted", ["control group", "process tree"])
@pytest.mark.parametrize("code", [CHILD.replace("SECONDS", "0"), UNASKED.replace("SECONDS", "1")])
def test_a_predictor_that_works_while_it_is_not_asked_is_refused(
    code, counted, predictor_file, monkeypatch
):
    if counted == "process tree":
        monkeypatch.setattr(usage, "own_directory", lambda: None)
    monkeypatch.setattr(process_module, "UNASKED", 0.2)
    with PredictorProcess(predictor_file(code), 10, Settings()) as process:
        process.predict(["a"], meshes.warming(1))
        time.sleep(2)
        said = r"^my_model\.py works while it is not asked, .* in its batches: let it rest"
        with pytest.raises(PredictorError, match=said):
            process.status()


@linux
@pytest.mark.parametrize(
    "counted", ["control group", pytest.param("process tree", marks=pytest.mark.slow)]
)
def test_what_a_thread_spins_for_after_a_batch_and_what_status_takes_is_spared(
    counted, predictor_file, monkeypatch
):
    if counted == "process tree":
        monkeypatch.setattr(usage, "own_directory", lambda: None)
    monkeypatch.setattr(process_module, "UNASKED", 0.05)
    code = UNASKED.replace("SECONDS", "0.003")
    with PredictorProcess(predictor_file(code), 10, Settings()) as process:
        for _ in range(40):
            process.predict(["a"], meshes.warming(1))
            time.sleep(0.01)
            process.status()


ORPHANS = """
import os, signal, subprocess, sys, time
from pathlib import Path
import numpy as np

def predict(meshes):
    sleep = [sys.executable, "-c", "import time; time.sleep(600)"]
    new = subprocess.Popen(sleep, start_new_session=True)
    Path(__file__).with_suffix(".pids").write_text(f"{os.getpid()} {new.pid}")
    os.kill(os.getppid(), signal.SIGKILL)
    time.sleep(0.5)
    return np.ones((len(meshes), 10))
"""


@linux
def test_nothing_outlives_a_predictor_that_kills_what_watches_it(predictor_file):
    code = predictor_file(ORPHANS)
    with pytest.raises(PredictorError, match=r"died on the batch .* \(exit code -9"):
        asked(code)
    pids = [int(pid) for pid in code.with_suffix(".pids").read_text().split()]
    assert len(pids) == 2
    assert not [pid for pid in pids if psutil.pid_exists(pid)]


MUTE = """
import os, socket, time
import numpy as np

def predict(meshes):
    for fd in range(3, 256):
        try:
            socket.socket(fileno=os.dup(fd)).shutdown(socket.SHUT_RDWR)
        except OSError:
            pass
    time.sleep(600)
"""


@linux
def test_a_predictor_that_closes_the_connection_and_sleeps_is_ended(predictor_file, monkeypatch):
    monkeypatch.setattr("eigbench.running.process.GRACE", 0.5)
    start = time.monotonic()
    with pytest.raises(PredictorError, match=r"closed its connection on the batch .* and went on"):
        asked(predictor_file(MUTE))
    assert time.monotonic() - start < 60


NAMES = """
import numpy as np
from eigbench.running import predictor

predictor.sources = lambda path, roots: [path.name, {name!r}]

def predict(meshes):
    return np.ones((len(meshes), 10))
"""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("../secret", "secret is not below"),
        ("/etc/hostname", "hostname is not below"),
        ("link", "link is reached by a symbolic link"),
        ("pipe", "pipe is no regular file"),
        ("x" * 300, "x cannot be read: File name too long"),
    ],
)
def test_names_of_files_elsewhere_are_not_read(predictor_file, tmp_path, name, message):
    (tmp_path / "link").symlink_to("/etc/hostname")
    os.mkfifo(tmp_path / "pipe")
    code = predictor_file(NAMES.replace("{name!r}", repr(name)))
    with pytest.raises(PredictorError, match=rf"a predictor lies in one folder: .*{message}"):
        asked(code)


def test_files_that_are_not_there_are_left_out(predictor_file):
    code = predictor_file(NAMES.replace("{name!r}", "'gone.txt'"))
    _, _, status = asked(code)
    assert list(status.sources) == ["my_model.py"]


@pytest.mark.parametrize(
    ("meta", "message"),
    [
        ({}, "'name' is a required property"),
        ({"name": "a"}, "'kind' is a required property"),
        ({"name": ["a"], "kind": "learned"}, r"\['a'\] is not of type 'string'"),
        ({"name": "a", "kind": "learned", "\x1b[2J": ""}, r"'\\x1b\[2J' is not one of \['name'"),
    ],
)
def test_a_meta_that_its_process_has_not_checked_is_one_line(predictor_file, meta, message):
    code = "import eigbench.running.predictor as p\n"
    code += f"p.checked_meta = lambda *given: {meta!r}\n{ONES}"
    with pytest.raises(PredictorError, match=rf"^the .* {message}.* while loading: .*opened$"):
        asked(predictor_file(code))


TWO_FACED = """
import numpy as np

META = {"name": "Two-faced", "kind": "learned"}
seen = set()
table = dict(np.load(__file__.replace("my_model.py", "my_model.npz")))

def predict(meshes):
    answers = []
    for mesh in meshes:
        key = str(len(mesh.vertices)) + "/" + str(hash(mesh.faces.tobytes()))
        values = table.get(str(len(mesh.vertices)), np.ones(10))
        answers.append(values if key in seen else FIRST)
        seen.add(key)
    return np.array(answers)
"""


@pytest.mark.parametrize(("first", "named"), [("2 * values", True), ("values", False)])
def test_a_predictor_that_answers_copies_better_than_what_is_timed_is_named(
    first, named, evaluated, mini_truth, mini_meshes, tmp_path
):
    sizes = mini_meshes.vertices(mini_truth.ids).tolist()
    table = {str(n): v for n, v in zip(sizes, mini_truth.eigenvalues, strict=True)}
    np.savez(tmp_path / "my_model.npz", **table)
    evaluation = evaluated(TWO_FACED.replace("FIRST", first), mini_truth, batch_size=50)
    assert evaluation.first.sum() == len(set(mini_truth.shapes.tolist()))
    findings = record.copies_answered_otherwise(targets.every(mini_truth), evaluation)
    assert any("computed differently" in finding for finding in findings) == named


def test_a_predictor_that_rotations_change_answers_no_copies_otherwise(evaluated, mini_truth):
    code = "import numpy as np\ndef predict(meshes):\n    return np.stack([1 + np.abs(m.vertices"
    code += "[:10, 0]) for m in meshes])\n"  # which a rotation changes
    evaluation = evaluated(code, mini_truth, batch_size=50)
    assert record.copies_answered_otherwise(targets.every(mini_truth), evaluation) == []


@pytest.mark.parametrize("wild", [np.nan, np.inf])
def test_a_shape_with_a_copy_that_has_no_finite_error_is_left_out(wild):
    truth = SimpleNamespace(shapes=np.array(["a", "a", "a", "b", "b", "b"]))
    evaluation = SimpleNamespace(first=np.array([[True, False, False, True, False, False]]))
    errors = np.array([[1.0, 2.0, 4.0, 1.0, 2.0, wild]])
    new, again = record._by_turn(errors, truth, evaluation)
    assert (new.tolist(), again.tolist()) == ([1.0], [3.0])


KNOWS = """
import time
import numpy as np

known = {name.item() for name in np.load(__file__.replace("my_model.py", "my_model.npy"))}

def predict(meshes):
    time.sleep(0.02 * sum(len(mesh.vertices) not in known for mesh in meshes))
    return np.ones((len(meshes), 10))
"""


def test_a_predictor_that_knows_public_meshes_is_slower_on_fresh_ones(
    predictor_file, mini_truth, mini_meshes, tmp_path
):
    each = np.unique(mini_truth.shapes, return_index=True)[1]  # one instance of each shape
    vertices = mini_meshes.vertices(np.array(mini_truth.ids)[each])
    of_public = np.isin(vertices, np.unique(vertices)[::2])
    public, fresh = mini_truth.take(each[of_public]), mini_truth.take(each[~of_public])
    assert min(len(public.ids), len(fresh.ids)) > 8
    both, given = unseen.mixed(public, fresh), unseen.mixed_meshes(mini_meshes, mini_meshes)
    sets = (np.arange(len(both.ids)) >= len(public.ids)).astype(np.int64)
    for known, named in ((vertices[of_public], True), ([], False)):
        np.save(tmp_path / "my_model.npy", np.unique(np.array(known, dtype=np.int64)))
        question = (predictor_file(KNOWS), both, given, Options(batch_size=2))
        evaluation = evaluate(*question, tmp_path / "parts", sets=sets)
        for _, chosen in evaluation.asked:  # a batch holds instances of one set
            assert len(set(sets[chosen].tolist())) == 1
        said = unseen.slower(evaluation, given, both, len(public.ids))
        assert said.endswith("it knows these") == named


@pytest.mark.parametrize("factor", [1.0, 5.0])
def test_a_constant_for_each_call_makes_nobody_slower(factor, mini_truth, mini_meshes):
    """Batches of public meshes are full, those of fresh ones hold a mesh or two."""
    public = mini_truth.take(np.arange(96))
    fresh = mini_truth.take(np.arange(96, 106))
    both, given = unseen.mixed(public, fresh), unseen.mixed_meshes(mini_meshes, mini_meshes)
    vertices = given.vertices(both.ids)
    asked = [(0, np.arange(i, i + 16)) for i in range(0, 96, 16)]
    asked += [(0, np.array([i])) for i in range(96, 106)]
    of_fresh = np.array([chosen[0] >= 96 for _, chosen in asked])
    seconds = np.array([0.02 + 1e-8 * vertices[chosen].sum() for _, chosen in asked])
    evaluation = Evaluation(
        predictions=np.ones((1, 106, 10)),
        seconds=np.where(of_fresh, factor, 1.0) * seconds,
        cpu_seconds=seconds,
        sizes=np.array([len(chosen) for _, chosen in asked]),
        new=np.ones(len(asked), dtype=bool),
        reference_seconds=np.full(len(asked), np.nan),
        asked=asked,
        opening=np.arange(len(asked)) == 0,
        loaded=Loaded({}, None, False, False, ""),
        status=Status(0, {}, {}),
    )
    assert bool(unseen.slower(evaluation, given, both, 96)) == (factor > 3)
