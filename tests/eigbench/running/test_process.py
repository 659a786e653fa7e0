"""The predictor's process: what it can see, what the clock sees, what is recorded of it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from eigbench.errors import PredictorError
from eigbench.running import meshes, record, reference, worker
from eigbench.running.evaluate import Evaluation, Options, evaluate, predict_meshes
from eigbench.running.worker import Loaded, Status
from eigbench.scoring import physics

from synthnet import store
from synthnet.kernels import processor

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


@pytest.fixture(scope="module")
def source(mini_home, mini_truth):
    """The meshes of the test split."""
    return meshes.read(store.open_dataset("1.0-mini", mini_home), mini_truth.ids)


@pytest.fixture
def run(predictor_file, source, tmp_path):
    """Return a function that evaluates code on some of the test split, with options."""

    def evaluated(code, wanted, **options):
        path = predictor_file(code)
        return evaluate(path, wanted, source, Options(**options), tmp_path / "parts")

    return evaluated


@pytest.fixture
def peer(predictor_file, monkeypatch):
    """Return a function that puts code in the place of LaPy."""

    def put(code):
        path = predictor_file(code, "peer.py")
        monkeypatch.setattr("eigbench.running.evaluate.REFERENCE_FILE", path)

    return put


def test_neither_ids_nor_labels_are_in_the_memory_of_the_predictors_process(run, mini_truth):
    wanted = mini_truth.head(30)
    code = SPY.format(labels=" ".join(map(float.hex, wanted.eigenvalues[:, 1].tolist())))
    assert run(code, wanted, batch_size=10).predictions.shape == (1, 30, 10)


@pytest.mark.parametrize(
    ("planted", "told"),
    [
        pytest.param("", None, marks=pytest.mark.slow),
        ("kept = ['cone-00042/3']", "found the id cone-00042/3"),
        pytest.param("kept = [1.25]", "found the label 1.25", marks=pytest.mark.slow),
        ("kept = {'array': np.array([2.0, 1.25])}", "found an array of labels"),
    ],
)
def test_the_spy_finds_what_is_there(run, mini_truth, planted, told):
    """The test above can fail: the same search finds what is planted."""
    code = SPY.format(labels=(1.25).hex()).replace("def predict", f"{planted}\n\ndef predict")
    if told is None:
        run(code, mini_truth.head(30))
    else:
        with pytest.raises(PredictorError, match=told):
            run(code, mini_truth.head(30))


def test_meshes_come_in_an_order_that_tells_neither_shape_nor_family(run, mini_truth, source):
    assert sorted(mini_truth.order) == list(range(len(mini_truth.ids)))
    for names, share in ((mini_truth.shapes, 0.1), (mini_truth.families, 0.35)):
        ordered = names[mini_truth.order]
        assert np.mean(ordered[1:] == ordered[:-1]) < share
    code = (
        "import numpy as np\n\ndef predict(meshes):\n    sizes = [len(m.vertices) for m in meshes]"
    )
    code += "\n    return np.repeat(np.array(sizes, float)[:, None], 10, axis=1)\n"
    found = run(code, mini_truth)
    expected = [len(source.shapes[shape].vertices) for shape in mini_truth.shapes.tolist()]
    np.testing.assert_array_equal(found.predictions[0, :, 0], expected)  # in the truth's order


SLEEPER = """
import time
import numpy as np

def predict(meshes):
    time.sleep(0.01)
    return np.ones((len(meshes), 10))
"""
LAZY = """
import time
import numpy as np

class Answer:
    def __init__(self, count): self.count = count
    def __array__(self, dtype=None, copy=None):
        time.sleep(0.3)
        return np.ones((self.count, 10))

def predict(meshes): return Answer(len(meshes))
"""


def test_work_that_is_put_off_until_the_answer_is_read_is_timed(run, mini_truth):
    assert run(LAZY, mini_truth.head(10)).seconds.min() >= 0.3


def test_error_while_the_answer_is_read_is_the_predictors(predictor_file):
    code = LAZY.replace("time.sleep(0.3)", "raise RuntimeError('CUDA error')")
    ids, probes = physics.questions()
    with pytest.raises(
        PredictorError,
        match=r"CUDA error \(my_model\.py:\d+: in __array__: raise RuntimeError.*\), on",
    ):
        predict_meshes(predictor_file(code), ids, probes, 10, Options())


def test_cost_is_of_the_batches_and_says_how_many_cores_were_used():
    evaluation = Evaluation(
        predictions=np.ones((1, 30, 10)),
        seconds=np.array([0.1, 0.3, 0.2]),
        cpu_seconds=np.array([0.2, 0.6, 0.4]),
        sizes=np.array([10, 10, 10]),
        reference_seconds=np.array([1.0, np.nan, 2.0]),
        loaded=Loaded({}, None, False, False, "NVIDIA A100"),
        status=Status(2**20, {}),
    )
    cost = record.cost(evaluation, Options(device="cuda", batch_size=10))
    assert cost["ms_per_mesh"] == pytest.approx(20)
    assert cost["ms_per_mesh_quartiles"] == pytest.approx([15, 25])
    assert cost["ms_per_mesh_mean"] == pytest.approx(20)
    assert cost["cores_used"] == pytest.approx(2)
    assert cost["peak_memory_mb"] == 1
    assert cost["hardware"].startswith("NVIDIA A100, ")
    assert "NVIDIA" not in record.hardware()
    assert cost["reference"] == {
        "solver": reference.META["name"],
        "meshes": 20,
        "ms_per_mesh": pytest.approx(150),
        "ratio": pytest.approx(10),  # 3 s of LaPy, 0.3 s of the predictor
    }


@pytest.mark.parametrize(
    ("size", "batches", "timed"),
    [(200, [200, 106], [True, True]), (30, [30] * 10 + [6], [True] * 4 + [False] * 2 + [True] * 5)],
)
def test_lapy_is_timed_on_the_batches_of_the_first_and_last_meshes(
    run, peer, mini_truth, size, batches, timed
):
    peer(SLEEPER)
    found = run(SLEEPER, mini_truth, batch_size=size, reference=True)
    assert found.sizes.tolist() == batches
    assert np.isfinite(found.reference_seconds).tolist() == timed
    assert np.nanmin(found.reference_seconds) >= 0.01


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
    told = "eigbench: interrupted; finished work is kept, --resume continues from it"
    assert err.splitlines()[-1] == told
    assert len([*code.parent.glob(".out.json.parts/*/*.npz")]) == 1
    assert not Path("/proc", pid.read_text()).exists()


def test_lapys_time_is_kept_with_an_interrupted_run(run, peer, mini_truth, tmp_path):
    peer(SLEEPER)
    fails = SLEEPER.replace("time.sleep(0.01)", "assert len(meshes) != 106")
    with pytest.raises(PredictorError):
        run(fails, mini_truth, reference=True)
    left = next((tmp_path / "parts").rglob("*.npz")).stat().st_mtime_ns
    with pytest.raises(PredictorError):
        run(fails, mini_truth, reference=True, resume=True)
    kept = list((tmp_path / "parts").rglob("*.npz"))
    assert [path.stat().st_mtime_ns for path in kept] == [left]
    with np.load(kept[0]) as part:
        assert part["reference_seconds"] >= 0.01


def test_reference_answers_the_labels(mini_truth, source):
    ids = mini_truth.ids[:3]
    found = reference.predict([source.mesh(id) for id in ids])
    assert found == pytest.approx(mini_truth.eigenvalues[:3], rel=1e-8)


def test_without_reference_there_is_no_ratio(run, mini_truth):
    assert record.cost(run(SLEEPER, mini_truth.head(5)), Options())["reference"] is None


def test_hardware_names_the_kind_of_processor() -> None:
    assert f"({processor().rpartition('-')[0]}), {os.cpu_count()} cores" in record.hardware()


def test_cpu_has_no_accelerator():
    assert worker._accelerator("cpu") == ""


def test_device_that_is_not_there_is_refused():
    torch = pytest.importorskip("torch")
    if torch.cuda.is_available():
        assert worker._accelerator("cuda")
    else:
        with pytest.raises(PredictorError, match="--device cuda: PyTorch sees no CUDA device"):
            worker._accelerator("cuda")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_peak_memory_is_of_the_predictors_process_alone(run, mini_truth):
    ballast = np.ones(2**27)  # 1 GiB in this process
    code = "import numpy as np\ndef predict(meshes): return np.ones((len(meshes), 10))\n"
    assert run(code, mini_truth.head(10)).status.peak_bytes < ballast.nbytes / 2


def test_failure_of_lapy_is_not_laid_on_the_predictor(run, peer, mini_truth):
    peer("def predict(meshes): raise ValueError('no')")
    with pytest.raises(PredictorError, match=r"^LaPy, timed beside .* ValueError: no.*--no-ref"):
        run(SLEEPER, mini_truth.head(5), reference=True)


def test_cpu_time_is_finer_than_a_clock_tick():
    seen = {worker._cpu_seconds() for _ in range(1000)}
    assert len(seen) > 100
    assert max(seen) - min(seen) < 1
