"""The predictor's process: what it can see, what the clock sees, what is recorded of it."""

import errno
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from eigbench.errors import Died, OverTime, PredictorError
from eigbench.running import box, frames, machine, meshes, record, reference, worker
from eigbench.running.box import Settings
from eigbench.running.evaluate import Evaluation, Options, evaluate, predict_meshes
from eigbench.running.process import Loaded, PredictorProcess, Status
from eigbench.running.usage import own_directory
from eigbench.scoring import physics

from synthnet.kernels import processor
from synthnet.types import Mesh
from tests.eigbench.conftest import LAZY, ONES

SPY = """
import gc, re, sys
import numpy as np

ID = re.compile(r"[a-z]+(_[a-z]+)*-[0-9]{{5}}")
LABELS = set(map(float.fromhex, "{labels}".split()))

def strings_and_numbers():
    frame = sys._getframe()
    while frame is not None:
        yield from (value for value in frame.f_locals.values())
        frame = frame.f_back
    for thing in gc.get_objects():
        if type(thing) in (dict, list, tuple, set) and thing is not LABELS:
            yield from gc.get_referents(thing)

def predict(meshes):
    for thing in strings_and_numbers():
        thing = list(thing.values()) if type(thing) is dict else thing
        for value in thing if type(thing) in (list, tuple) else [thing]:
            if type(value) is str and ID.fullmatch(value.partition("/")[0]):
                raise ValueError(f"found the id {{value}}")
            if type(value) is float and value in LABELS:
                raise ValueError(f"found the label {{value}}")
            if type(value) is np.ndarray and value.dtype == float and value.size < 10**6:
                if LABELS & set(value.ravel()[:100].tolist()):
                    raise ValueError("found an array of labels")
    return np.ones((len(meshes), 10))
"""


@pytest.fixture
def peer(predictor_file, monkeypatch):
    """Return a function that puts code in the place of LaPy."""

    def put(code):
        path = predictor_file(code, "peer.py")
        monkeypatch.setattr("eigbench.running.evaluate.REFERENCE_FILE", path)

    return put


@pytest.mark.attack
def test_neither_ids_nor_labels_are_in_the_memory_of_the_predictors_process(evaluated, mini_truth):
    labels = mini_truth.head(30)
    code = SPY.format(labels=" ".join(map(float.hex, labels.eigenvalues[:, 1].tolist())))
    assert evaluated(code, labels, batch_size=10).predictions.shape == (1, 30, 10)


@pytest.mark.parametrize(
    ("planted", "message"),
    [
        pytest.param("", None, marks=pytest.mark.slow),
        ("kept = ['cone-00042/3']", "found the id cone-00042/3"),
        pytest.param("kept = [1.25]", "found the label 1.25", marks=pytest.mark.slow),
        ("kept = {'array': np.array([2.0, 1.25])}", "found an array of labels"),
    ],
)
def test_the_spy_finds_what_is_there(evaluated, mini_truth, planted, message):
    """The test above can fail: the same search finds what is planted."""
    code = SPY.format(labels=(1.25).hex()).replace("def predict", f"{planted}\n\ndef predict")
    with pytest.raises(PredictorError, match=message) if message else nullcontext():
        evaluated(code, mini_truth.head(30))


SIZES = """
from pathlib import Path
import numpy as np

def predict(meshes):
    sizes = [len(m.vertices) for m in meshes]
    with Path(__file__).with_suffix(".seen").open("a") as seen:
        print(*sizes, file=seen)
    return np.repeat(np.array(sizes, float)[:, None], 10, axis=1)
"""


@pytest.mark.attack
def test_meshes_come_in_an_order_drawn_anew_and_copies_of_shapes_come_last(
    predictor_file, mini_truth, mini_meshes, tmp_path
):
    code = predictor_file(SIZES)
    expected = [len(mini_meshes.shapes[shape].vertices) for shape in mini_truth.shapes.tolist()]
    orders = []
    for run in range(2):
        options = Options(batch_size=20)
        result = evaluate(code, mini_truth, mini_meshes, options, tmp_path / f"parts-{run}")
        np.testing.assert_array_equal(result.predictions[0, :, 0], expected)  # in the truth's order
        assert result.sizes.tolist() == [20, 14, *[20] * 13, 12]
        assert result.new.tolist() == [True] * 2 + [False] * 14
        _, *batches = code.with_suffix(".seen").read_text().splitlines()  # the first warms up
        code.with_suffix(".seen").unlink()
        orders.append(batches)
        new = sorted(size for batch in batches[:2] for size in batch.split())
        assert new == sorted(str(len(mesh.vertices)) for mesh in mini_meshes.shapes.values())
    assert orders[0] != orders[1]


SLEEPER = """
import time
import numpy as np

def predict(meshes):
    time.sleep(0.01)
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
def test_work_that_is_put_off_until_the_answer_is_read_is_timed(evaluated, mini_truth):
    assert evaluated(LAZY, mini_truth.head(10)).seconds.min() >= 0.3


def test_error_while_the_answer_is_read_is_the_predictors(predictor_file):
    code = predictor_file(LAZY.replace("time.sleep(0.3)", "raise RuntimeError('CUDA error')"))
    message = r"CUDA error \(my_model\.py:\d+: in __array__: raise RuntimeError.*\), on"
    with pytest.raises(PredictorError, match=message):
        predict_meshes(code, *physics.questions(), 10, Options())


COUNTED = {"processor_time": "control group", "memory": "process tree"}


def test_cost_is_of_the_batches_and_says_how_many_cores_were_used():
    evaluation = Evaluation(
        predictions=np.ones((1, 30, 10)),
        seconds=np.array([0.1, 0.3, 0.2]),
        cpu_seconds=np.array([0.2, 0.6, 0.4]),
        sizes=np.array([10, 10, 10]),
        new=np.array([True, True, True]),
        reference_seconds=np.array([1.0, np.nan, 2.0]),
        asked=[(0, np.arange(i, i + 10)) for i in (0, 10, 20)],
        opening=np.array([True, False, False]),
        loaded=Loaded({}, None, False, False, "NVIDIA A100"),
        status=Status(2**20, {}, COUNTED),
    )
    cost = record.cost(evaluation, Options(device="cuda", batch_size=10))
    assert cost["ms_per_mesh"] == pytest.approx(20)
    assert cost["ms_per_mesh_quartiles"] == pytest.approx([15, 25])
    assert cost["ms_per_mesh_mean"] == pytest.approx(20)
    assert cost["cores_used"] == pytest.approx(2)
    assert cost["peak_memory_mb"] == 1
    assert cost["counted_by"] == COUNTED
    assert cost["hardware"].startswith("NVIDIA A100, ")
    assert "NVIDIA" not in machine.hardware()
    assert cost["reference"] == {
        "solver": reference.META["name"],
        "meshes": 20,
        "ms_per_mesh": pytest.approx(150),
        "ratio": pytest.approx(10),  # 3 s of LaPy, 0.3 s of the predictor
    }


@pytest.mark.parametrize(
    ("size", "batches", "timed"),
    [
        (200, [34, 200, 72], [True, False, False]),
        (10, [10, 10, 10, 4] + [10] * 27 + [2], [True, False, True, True] + [False] * 28),
    ],
)
def test_lapy_is_timed_on_the_batches_of_the_first_and_last_meshes(
    evaluated, peer, mini_truth, monkeypatch, size, batches, timed
):
    monkeypatch.setattr("eigbench.running.evaluate.REFERENCE", 8)
    peer(SLEEPER)
    evaluation = evaluated(SLEEPER, mini_truth, batch_size=size, reference=True)
    assert evaluation.sizes.tolist() == batches
    assert np.isfinite(evaluation.reference_seconds).tolist() == timed
    assert np.nanmin(evaluation.reference_seconds) >= 0.01


STUCK = """
import os, time
from pathlib import Path
import numpy as np

calls = 0

def predict(meshes):  # the first call is the warm-up
    global calls
    calls += 1
    if calls == 3:
        Path(__file__).with_suffix(".pid").write_text(str(os.getpid()))
        time.sleep(600)
    return np.ones((len(meshes), 10))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize(
    "number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)]
)
def test_a_signal_ends_an_evaluation_and_the_predictors_process(
    number, predictor_file, mini_home, environment
):
    code = predictor_file(STUCK)
    options = ["--dataset", "1.0-mini", "--limit", "30", "--batch-size", "10", "--no-reference"]
    options += ["--no-sandbox"]  # it writes its number beside itself
    process = subprocess.Popen(
        [sys.executable, "-m", "eigbench", "evaluate", code, *options, "--out", "out.json"],
        cwd=code.parent,
        env={**environment, "SYNTHNET_HOME": str(mini_home)},
        # A shell's background job ignores Ctrl-C, and its children would too
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        stderr=subprocess.PIPE,
        text=True,
    )
    pid = code.with_suffix(".pid")
    end = time.monotonic() + 120
    while not (pid.exists() and pid.read_text()):
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    message = "eigbench: interrupted; finished work is kept, --resume continues from it"
    assert err.splitlines()[-1] == message
    assert len([*code.parent.glob(".out.json.parts/*/*.npz")]) == 1
    assert not Path("/proc", pid.read_text()).exists()


def test_lapys_time_is_kept_with_an_interrupted_run(evaluated, peer, mini_truth, tmp_path):
    peer(SLEEPER)
    fails = SLEEPER.replace("time.sleep(0.01)", "assert len(meshes) != 200")
    with pytest.raises(PredictorError):
        evaluated(fails, mini_truth, reference=True)
    left = next((tmp_path / "parts").rglob("*.npz")).stat().st_mtime_ns
    with pytest.raises(PredictorError):
        evaluated(fails, mini_truth, reference=True, resume=True)
    kept = list((tmp_path / "parts").rglob("*.npz"))
    assert [path.stat().st_mtime_ns for path in kept] == [left]
    with np.load(kept[0]) as part:
        assert part["reference_seconds"] >= 0.01


def test_reference_answers_the_labels(mini_truth, mini_meshes):
    ids = mini_truth.ids[:3]
    answers = reference.predict([mini_meshes.mesh(id) for id in ids])
    assert answers == pytest.approx(mini_truth.eigenvalues[:3], rel=1e-8)


def test_without_reference_there_is_no_ratio(evaluated, mini_truth):
    assert record.cost(evaluated(SLEEPER, mini_truth.head(5)), Options())["reference"] is None


def test_hardware_names_the_kind_of_processor():
    assert f"({processor().rpartition('-')[0]}), {os.cpu_count()} cores" in machine.hardware()


def test_cpu_has_no_accelerator():
    assert worker._accelerator("cpu") == ""


def test_a_device_of_no_framework_that_the_predictor_loads_is_refused(evaluated, mini_truth):
    line = r"--device gpu: the predictor has loaded none of torch, jax, .* on the cpu: leave it out"
    with pytest.raises(PredictorError, match=line):
        evaluated(ONES, mini_truth.head(5), device="gpu")


def test_device_that_is_not_there_is_refused():
    torch = pytest.importorskip("torch")
    if torch.cuda.is_available():
        assert worker._accelerator("cuda")
    else:
        with pytest.raises(PredictorError, match="--device cuda: PyTorch sees no CUDA device"):
            worker._accelerator("cuda")


@pytest.mark.parametrize(("count", "there"), [(1, "cuda:0"), (4, "cuda:0 to cuda:3")])
def test_a_device_of_a_number_that_is_not_there_is_refused(monkeypatch, count, there):
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)
    monkeypatch.setattr(torch.cuda, "get_device_name", lambda device: f"the name of {device}")
    last = f"cuda:{count - 1}"
    assert worker._accelerator(last) == f"the name of {last}"
    assert worker._accelerator("cuda") == "the name of cuda"
    with pytest.raises(PredictorError, match=rf"^--device cuda:9: PyTorch sees {there} here$"):
        worker._accelerator("cuda:9")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_peak_memory_is_of_the_predictors_process_alone(evaluated, mini_truth):
    ballast = np.ones(2**27)  # 1 GiB in this process
    assert evaluated(ONES, mini_truth.head(10)).status.peak_bytes < ballast.nbytes / 2


def test_failure_of_lapy_is_not_laid_on_the_predictor(evaluated, peer, mini_truth):
    peer("def predict(meshes): raise ValueError('no')")
    with pytest.raises(PredictorError, match=r"^LaPy, timed beside .* ValueError: no.*--no-ref"):
        evaluated(SLEEPER, mini_truth.head(5), reference=True)


def test_cpu_time_is_finer_than_a_clock_tick(predictor_file):
    with PredictorProcess(predictor_file(ONES), 10, Settings()) as process:
        mesh = meshes.warming(1)
        seen = {process.predict(["a"], mesh).cpu_seconds for _ in range(20)}
    assert len(seen) > 10
    assert max(seen) < 1


HELPED = """
import multiprocessing, time
import numpy as np

def burn(both_hold):
    kept = np.ones(2**25)
    both_hold.wait()
    end = time.process_time() + 0.5
    while time.process_time() < end: pass
    both_hold.wait()

def predict(meshes):
    if len(meshes) == 1:
        fork = multiprocessing.get_context("fork")
        both_hold = fork.Barrier(2)
        helper = fork.Process(target=burn, args=(both_hold,))
        helper.start()
        burn(both_hold)
        helper.join()
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
@pytest.mark.skipif(sys.platform != "linux", reason="its processes end in another order elsewhere")
def test_time_and_memory_of_helpers_count(predictor_file):
    with PredictorProcess(predictor_file(HELPED), 10, Settings()) as process:
        answered = process.predict(["a"], meshes.warming(1))
        assert answered.cpu_seconds > 0.9
        assert process.status().peak_bytes > 2 * 2**28


LEFT_BEHIND = """
import os, subprocess, sys
from pathlib import Path
import numpy as np

code = "import os, time; os.setsid(); time.sleep(600)"
started = subprocess.Popen([sys.executable, "-c", code], start_new_session=True)
Path(__file__).with_suffix(".pid").write_text(str(started.pid))

def predict(meshes):
    END
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
@pytest.mark.parametrize("end", ["pass", "os._exit(1)"])
def test_nothing_that_a_predictor_starts_outlives_it(predictor_file, end):
    code = predictor_file(LEFT_BEHIND.replace("END", end))
    ends = pytest.raises(PredictorError, match="exit code 1") if end != "pass" else nullcontext()
    with ends:
        predict_meshes(code, ["a"], meshes.warming(1), 10, Options())
    assert not Path("/proc", code.with_suffix(".pid").read_text(), "status").exists()


REMEMBERS = """
import time
import numpy as np

seen = set()

def predict(meshes):
    for mesh in meshes:
        if (known := hash(mesh.faces.tobytes())) not in seen:
            time.sleep(0.01)
        seen.add(known)
    return np.ones((len(meshes), 10))
"""


@pytest.mark.attack
def test_what_a_predictor_remembers_of_a_shape_is_no_speed(evaluated, mini_truth):
    cost = record.cost(evaluated(REMEMBERS, mini_truth, batch_size=20), Options(batch_size=20))
    assert cost["ms_per_mesh_mean"] > 5  # every new shape costs that
    assert cost["copies_ratio"] < 0.2
    (finding,) = record.findings({**cost, "cores_used": 1.0})
    assert "the predictor remembers shapes" in finding
    assert record.findings({**cost, "copies_ratio": 0.9, "cores_used": 1.0}) == []
    (finding,) = record.findings({**cost, "copies_ratio": None, "cores_used": 1.9})
    assert finding.startswith("1.9 cores were used with --threads 1")


@pytest.mark.attack
def test_a_frame_that_is_too_long_is_refused_before_it_is_read():
    own, other = socket.socketpair()
    with frames.Channel(own) as channel, other:
        other.sendall(frames.HEADER.pack(b"a", 2**40))
        with pytest.raises(frames.FrameError, match=r"a frame of 1,099,511,627,776 bytes"):
            channel.receive(100, lambda: None)


def test_a_long_frame_waits_for_a_slow_reader():
    own, other = socket.socketpair()
    body, steps = bytes(range(256)) * 2**14, []
    with (
        frames.Channel(own) as sender,
        frames.Channel(other) as taker,
        ThreadPoolExecutor() as pool,
    ):
        taker.send(frames.LOADED, b"{}")
        assert sender.receive(100, lambda: None)[0] == frames.LOADED
        sent = pool.submit(sender.send, frames.MESHES, body, None, lambda: steps.append("waits"))
        time.sleep(4 * frames.STEP)
        assert taker.receive(len(body))[:2] == (frames.MESHES, body)
        sent.result()
    assert steps


@pytest.mark.attack
def test_who_reads_no_frame_is_over_time(predictor_file):
    with PredictorProcess(predictor_file(ONES), 10, Settings()) as process:
        process.time_limit = 0.5
        for child in process._tree.children(recursive=True):
            child.suspend()
        with pytest.raises(OverTime, match=r"took more than 0\.5 s at the end: raise --time-limit"):
            process._send(frames.MESHES, bytes(2**22), "at the end")


def loaded(**changes):
    """What a predictor's process says when it has loaded, with changes."""
    meta = {"name": "a", "kind": "learned"}
    facts = {"meta": meta, "parameters": 10**15, "seeded": True, "trained": True, "accelerator": ""}
    return json.dumps({**facts, **changes}).encode()


def test_facts_of_their_form_are_taken():
    assert frames.facts(frames.LOADED, loaded()) == json.loads(loaded())


@pytest.mark.attack
@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (frames.LOADED, b"{}"),
        (frames.LOADED, loaded(parameters=-1)),
        (frames.LOADED, loaded(parameters=10**16)),
        (frames.LOADED, loaded(accelerator="a\n")),
        (frames.LOADED, loaded(meta={"name": "a"})),
        (frames.SOURCES, b'{"files": ["a\\ud800.py"], "attempts": []}'),
        (frames.SOURCES, b'{"files": ["a.py", "b\\u0000.py"], "attempts": []}'),
        (frames.SOURCES, b'{"files": ["a.py\\n"], "attempts": []}'),
        (frames.SOURCES, b'["a.py"]'),
        (frames.SOURCES, b"\xff"),
        (frames.FAILED, b"[" * 100_000),
        (frames.FAILED, b'{"message": 3, "traceback": ""}'),
    ],
)
def test_facts_of_another_form_are_refused(kind, body):
    with pytest.raises(frames.FrameError, match="facts"):
        frames.facts(kind, body)


@pytest.mark.attack
def test_a_frame_brings_read_only_meshes_as_they_are():
    given = [*meshes.warming(3), Mesh(np.eye(3), np.empty((0, 3), dtype=np.int64))]
    own, other = socket.socketpair()
    body, file = frames.packed(given)
    with frames.Channel(own) as sender, frames.Channel(other) as taker, file:
        with pytest.raises(PermissionError):
            os.pwrite(file.fileno(), b"1", 0)
        sender.send(frames.MESHES, body, file)
        kind, came, descriptor = taker.receive()
    assert kind == frames.MESHES
    received = frames.unpacked(came, descriptor)
    assert isinstance(received, tuple)
    for mesh, expected in zip(received, given, strict=True):
        np.testing.assert_array_equal(mesh.vertices, expected.vertices)
        np.testing.assert_array_equal(mesh.faces, expected.faces)
        assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float64, np.int64)
        assert not mesh.vertices.flags.writeable
        assert not mesh.faces.flags.writeable


@pytest.mark.attack
def test_a_predictors_words_cannot_act_on_the_terminal(predictor_file):
    code = "def predict(meshes): raise ValueError('a\\x1b[2Jb\\u202e')"
    with pytest.raises(PredictorError, match=r"ValueError: a�\[2Jb�, on|raise"):
        predict_meshes(predictor_file(code), ["a"], meshes.warming(1), 10, Options())


@pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="files in memory are Linux's")
@pytest.mark.parametrize("refusals", [2, 1000])
def test_meshes_are_sealed_when_the_system_lets_go_of_their_memory(monkeypatch, refusals):
    """A busy machine may hold a page of the file for longer than the system waits."""
    left, seal = [OSError(errno.EBUSY, "busy")] * refusals, fcntl.fcntl

    def refuse(file, command, seals):
        if left:
            raise left.pop()
        return seal(file, command, seals)

    monkeypatch.setattr(frames.fcntl, "fcntl", refuse)
    if refusals > frames.SEALINGS:
        with pytest.raises(OSError, match="busy"):
            frames.packed(meshes.warming(1))
        return
    _, file = frames.packed(meshes.warming(1))
    with file, pytest.raises(PermissionError):
        os.write(file.fileno(), b"x")


@pytest.mark.parametrize("sandbox", [box.NONE, box.available()])
def test_a_process_that_cannot_start_leaves_nothing(predictor_file, monkeypatch, tmp_path, sandbox):
    real = subprocess.Popen

    def popen(*arguments, **options):
        if options.get("start_new_session"):  # no other process is started so
            raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))
        return real(*arguments, **options)

    def groups():
        root = own_directory()
        return [] if root is None else sorted(root.glob(f"eigbench-{os.getpid()}-*"))

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    before = groups()
    process = PredictorProcess(predictor_file(ONES), 10, Settings(sandbox=sandbox))
    monkeypatch.setattr("eigbench.running.process.subprocess.Popen", popen)
    with pytest.raises(PredictorError, match=r"cannot start the predictor's process: .*memory"):
        process.__enter__()
    assert list((tmp_path / "temporary").iterdir()) == []
    assert groups() == before


def test_a_process_that_ends_at_once_is_said_to_have_died(predictor_file, monkeypatch):
    real = subprocess.Popen

    def popen(command, **options):
        process = real([sys.executable, "-c", "import os; os._exit(3)"], **options)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        return process

    process = PredictorProcess(predictor_file(ONES), 10, Settings())
    monkeypatch.setattr("eigbench.running.process.subprocess.Popen", popen)
    with pytest.raises(Died, match=r"process died while loading \(exit code 3"):
        process.__enter__()


LISTS = """
import sys
from pathlib import Path

Path({path!r}).write_text(" ".join(name for name in sys.modules if "." not in name))

def predict(meshes): ...
"""


def test_a_predictors_process_has_loaded_no_package_that_its_file_has_not(predictor_file, tmp_path):
    listed = tmp_path / "modules.txt"
    code = predictor_file(LISTS.format(path=str(listed)))
    with PredictorProcess(code, 10, Settings(sandbox=box.NONE)):
        names = set(listed.read_text().split())
    assert {"numpy", "synthnet", "eigbench"} <= names
    heavy = {"llvmlite", "numba", "pandas", "pyarrow", "psutil", "rich", "scipy", "torch"}
    assert heavy & names == set()
