"""Bad predictors through the command line: one clear line, exit 2, nothing half-done is left."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from eigbench.commands.predict import CHANGED, answers
from eigbench.errors import PredictorError
from eigbench.results import predictions
from eigbench.running import evaluate as running
from eigbench.running import machine
from eigbench.running.process import PredictorProcess

from tests.eigbench.conftest import WEYL_TO_CHANGE

LIMIT, BATCH = 30, 10
PRELUDE = "import os, signal, sys, time" + WEYL_TO_CHANGE


@pytest.fixture
def evaluate(eigbench, predictor_file, mini_home, tmp_path):
    """Return a function that evaluates code and returns exit code, stdout and stderr."""

    def run(code, *more, path=None):
        path = path or predictor_file(PRELUDE + code)
        where = ["--dataset", "1.0-mini", "--root", mini_home, "--out", tmp_path / "out.json"]
        size = ["--limit", LIMIT, "--batch-size", BATCH, "--no-reference"]
        return eigbench("evaluate", path, *where, *size, *more)

    return run


@pytest.fixture(scope="module")
def ids(mini_truth):
    """Ids of what is asked."""
    return set(mini_truth.head(LIMIT).ids)


@pytest.fixture
def fails(evaluate, tmp_path):
    """Return a function that evaluates what must fail with a message, and returns stderr."""

    def run(code, message, *more, path=None):
        status, out, err = evaluate(code, *more, path=path)
        assert (status, out) == (2, "")
        assert "Traceback" not in err
        assert "Warning" not in err
        (line,) = (line for line in err.splitlines() if line.startswith("eigbench: "))
        assert message in line
        assert not (tmp_path / "out.json").exists()
        assert not (tmp_path / "out.parquet").exists()
        return err

    return run


def named(err):
    """Ids that a message names as the first of a batch."""
    (names,) = re.findall(r"that begins with ([\w/-]+(?:, [\w/-]+)*)", err)
    return set(names.split(", "))


def batches_kept(folder):
    return sorted(path.name for path in folder.glob(".out.json.parts/seed-0/*.npz"))


AT_LOADING = {
    "is interrupted by itself at import": (
        "raise KeyboardInterrupt",
        "failed to load: KeyboardInterrupt (my_model.py:11: raise KeyboardInterrupt)",
    ),
    "leaves a generator that there is not": (
        "raise GeneratorExit",
        "failed to load: GeneratorExit (my_model.py:11: raise GeneratorExit)",
    ),
    "is interrupted in load": (
        "def load(device, seed): raise KeyboardInterrupt",
        "failed to load: KeyboardInterrupt (my_model.py:11: in load: def load(device, seed):",
    ),
    "dies at import": ("os._exit(3)", "died while loading (exit code 3"),
    "needs a package": (
        "import no_such_thing\ndef predict(meshes): pass",
        "needs the package no_such_thing, which is not installed: pip install it",
    ),
}
AT_A_BATCH = {
    "wrong shape": ("def predict(meshes): return weyl(meshes)[:, :9]", "9), it must be ("),
    "writes to vertices": (
        "def predict(meshes):\n    meshes[0].vertices = meshes[0].vertices + 1\n"
        "    return weyl(meshes)",
        "vertices + 1); meshes are read-only: copy what you change",
    ),
    "adds to a mesh": (
        "def predict(meshes):\n    meshes[0].cache = 1\n    return weyl(meshes)",
        "cache = 1); meshes are read-only: copy what you change",
    ),
    "writes to an array": (
        "def predict(meshes):\n    meshes[0].vertices[:] -= 1\n    return weyl(meshes)",
        "read-only (my_model.py:12: in predict: meshes[0].vertices[:] -= 1); meshes are read-only: "
        "copy what you change",
    ),
    "makes arrays writable": (
        "def predict(meshes):\n    v = meshes[0].vertices\n    v.flags.writeable = True\n"
        "    v *= 2\n    return weyl(meshes)",
        "cannot set WRITEABLE flag to True",
    ),
    "replaces a mesh": (
        "def predict(meshes):\n    meshes[0] = None\n    return weyl(meshes)",
        "'tuple' object does not support item assignment",
    ),
    "writes past NumPy": (
        "import ctypes\ndef predict(meshes):\n"
        "    ctypes.memset(meshes[0].vertices.ctypes.data, 0, 8)\n    return weyl(meshes)",
        "exit code -11",
    ),
    "writes to the harness's socket": (
        "def predict(meshes):\n    for fd in range(3, 256):\n"
        "        try: os.write(fd, b'a' + b'\\xff' * 8)\n        except OSError: pass\n"
        "    return weyl(meshes)",
        "the predictor's process sent a frame of",
    ),
    "raises": ("def predict(meshes): raise KeyError('a\\nb')", "KeyError: "),
    "is interrupted by itself": (
        "def predict(meshes): raise KeyboardInterrupt",
        "the predictor failed: KeyboardInterrupt (my_model.py:11: in predict",
    ),
    "raises what cannot be said": (
        "class Silent(Exception):\n    def __str__(self): raise KeyError\n"
        "def predict(meshes): raise Silent",
        "the predictor failed: Silent: its message cannot be read: KeyError",
    ),
    "raises what is no Exception": (
        "class Odd(BaseException): pass\ndef predict(meshes): raise Odd('a')",
        "the predictor failed: Odd: a (my_model.py:12: in predict: def predict(meshes): raise",
    ),
    "raises what is no Exception and cannot be said": (
        "class Odd(BaseException):\n    def __str__(self): raise Odd\n"
        "def predict(meshes): raise Odd",
        "the predictor failed: Odd: its message cannot be read: Odd (my_model.py:13: in predict",
    ),
    "raises the harness's error, which cannot be said": (
        "from eigbench.errors import PredictorError\nclass Mine(PredictorError):\n"
        "    def __str__(self): raise KeyError\ndef predict(meshes): raise Mine",
        "Mine: its message cannot be read: KeyError",
    ),
    "raises at length": (
        "def predict(meshes): raise ValueError('x' * 6_000_000)",
        "ValueError: " + "x" * 500 + " … (my_model.py:11: in predict",
    ),
    "exits": ("def predict(meshes): sys.exit(0)", "SystemExit: 0"),
    "fails in a function of its own": (
        "def predict(meshes):\n    return [helper(m) for m in meshes]\n"
        "def helper(mesh):\n    return mesh.points",
        "no attribute 'points' (my_model.py:14: in helper: return mesh.points), on meshes",
    ),
    "fails in a library": (
        "def predict(meshes):\n    return np.linalg.inv(meshes[0].vertices)",
        "square (my_model.py:12: in predict: return np.linalg.inv(meshes[0].vertices)), on",
    ),
    "out of memory": ("def predict(meshes): raise MemoryError", "MemoryError"),
    "dies": ("def predict(meshes): os._exit(1)", "exit code 1"),
    "is killed": (
        "def predict(meshes): os.kill(os.getpid(), signal.SIGKILL)",
        "exit code -9; -9 is often lack of memory",
    ),
    "needs a package later": (
        "def predict(meshes):\n    import no_such_thing",
        "No module named 'no_such_thing'",
    ),
}
CASES = AT_LOADING | AT_A_BATCH
# One of each kind: a wrong answer, a changed input, an exception, a dead process, a bad file.
QUICK = {
    *("wrong shape", "writes past NumPy", "writes to the harness's socket"),
    *("fails in a library", "is killed", "needs a package"),
    *("raises at length", "is interrupted by itself at import", "raises what is no Exception"),
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow) for name in CASES],
)
def test_bad_predictor_is_refused_on_one_line(name, fails, tmp_path):
    err = fails(*CASES[name])
    assert ("on meshes to warm up with" in err) == (name in AT_A_BATCH)
    assert list(tmp_path.glob(".out.json.parts*")) == []


def test_missing_predictor_is_refused(fails, tmp_path):
    fails("", "there is no file", path=tmp_path / "none.py")


def test_predictor_that_hangs_is_ended(fails):
    hangs = "def predict(meshes): time.sleep(60)"
    err = fails(hangs, "took more than 4 s", "--time-limit", "4")
    assert "on meshes to warm up with" in err


def test_predictor_never_gets_more_meshes_than_the_batch_size(evaluate):
    _, _, err = evaluate("def predict(meshes): raise ValueError(f'{len(meshes)} given')")
    assert "ValueError: 10 given" in err


FAILS_IN_BATCH_2 = """
calls = 0

def predict(meshes):  # the first call is the warm-up
    global calls
    calls += 1
    if calls == 3 and not os.path.exists(__file__ + ".mended"):
        {how}
    return weyl(meshes)
"""
HOWS = {
    "raises": ("raise RuntimeError('no luck')", "RuntimeError: no luck"),
    "dies": ("os._exit(1)", "died on the batch of 9 that begins with "),
    "answers wrongly": ("return weyl(meshes)[:5]", "has shape (5, 10), it must be (9, 10)"),
}


@pytest.mark.parametrize(
    "how",
    ["raises", *(pytest.param(h, marks=pytest.mark.slow) for h in ("dies", "answers wrongly"))],
)
def test_what_was_computed_before_a_failure_is_kept_and_resumed(
    how, evaluate, fails, ids, tmp_path
):
    code, message = HOWS[how]
    path = tmp_path / "fails.py"
    path.write_text(PRELUDE + FAILS_IN_BATCH_2.format(how=code))
    err = fails("", message, path=path)
    assert len(named(err) & ids) == 3
    assert "--resume goes on from the last good batch" in err
    assert batches_kept(tmp_path) == ["000000.npz"]

    first = tmp_path / ".out.json.parts/seed-0/000000.npz"
    kept = first.stat().st_mtime_ns
    with np.load(first) as part:
        assert len(set(part["instances"].tolist())) == BATCH
    again = evaluate("", "--resume", path=path)  # call 3 is batch 3 now
    assert again[0] == 2
    assert batches_kept(tmp_path) == ["000000.npz", "000001.npz"]
    assert first.stat().st_mtime_ns == kept

    if how != "raises":
        return
    first.write_bytes(first.read_bytes()[:200])  # a damaged part is asked again
    (tmp_path / "fails.py.mended").touch()
    assert evaluate("", "--resume", path=path)[0] == 0
    resumed = (tmp_path / "out.parquet").read_bytes()
    result = json.loads((tmp_path / "out.json").read_text())
    assert result["partial"] is True
    assert result["dataset"]["instances"] == LIMIT
    assert list(tmp_path.glob(".out.json.parts*")) == []

    assert evaluate("", path=path)[0] == 0
    assert (tmp_path / "out.parquet").read_bytes() == resumed
    whole = json.loads((tmp_path / "out.json").read_text())
    assert whole["scores"] == result["scores"]
    assert whole["predictions"] == result["predictions"]


def test_what_no_resume_goes_on_from_has_no_such_hint(
    predictor_file, mini_truth, mini_meshes, tmp_path
):
    path = predictor_file(PRELUDE + FAILS_IN_BATCH_2.format(how=HOWS["raises"][0]))
    options = running.Options(batch_size=BATCH)
    with pytest.raises(PredictorError, match=r"RuntimeError: no luck(?!.*--resume)"):
        answers(path, mini_truth.head(LIMIT), mini_meshes, options, tmp_path / "parts")
    assert list((tmp_path / "parts").glob("*/*.npz"))


def test_what_an_earlier_run_has_written_is_no_part_of_a_predictor(
    evaluate, predictor_file, tmp_path
):
    """Its sources are the same, and it finds nothing of what it answered."""
    looks = """
from pathlib import Path
def predict(meshes):
    for name in ("my_model.json", "my_model.parquet", "my_model.log"):
        try:
            Path(__file__).with_name(name).read_bytes()
        except OSError:
            continue
        raise RuntimeError(f"{name} is there")
    return weyl(meshes)
"""
    path = predictor_file(PRELUDE + looks)
    out, kept = tmp_path / "my_model.json", tmp_path / "my_model.parquet"
    sources = []
    for _ in range(2):
        (tmp_path / "my_model.log").write_text("what the run before has printed")
        code, _, err = evaluate("", "--out", out, "--predictions", kept, path=path)
        assert code == 0, err
        sources.append(json.loads(out.read_text())["model"]["sources"])
    assert list(sources[0]) == ["my_model.py"]
    assert sources[0] == sources[1]


@pytest.mark.parametrize(
    "changed",
    ["fails.py", *(pytest.param(n, marks=pytest.mark.slow) for n in ("sibling.py", "fails.npz"))],
)
def test_changed_code_sibling_or_weights_start_anew(evaluate, tmp_path, changed):
    path = tmp_path / "fails.py"
    (tmp_path / "sibling.py").write_text("x = 1\n")
    (tmp_path / "fails.npz").write_bytes(b"weights")
    code = "import sibling\n" + PRELUDE + FAILS_IN_BATCH_2.format(how="raise RuntimeError")
    path.write_text(f'"""1.0"""\n{code}')  # which its code may read
    assert evaluate("", path=path)[0] == 2
    assert "starting anew" not in evaluate("", "--resume", path=path)[2]
    (tmp_path / changed).write_text(f'"""2.0"""\n{code}' if changed == path.name else "x = 2\n")
    again = evaluate("", "--resume", path=path)
    assert again[0] == 2
    assert f"{CHANGED}: starting anew" in again[2]
    assert batches_kept(tmp_path) == ["000000.npz"]


@pytest.fixture
def interrupted(evaluate, tmp_path):
    """Return a function that evaluates what fails in batch 2, until ``fails.py.mended`` is there.

    It takes a second to load until then.
    """
    path = tmp_path / "fails.py"
    slow = "time.sleep(0 if os.path.exists(__file__ + '.mended') else 1)\n"
    path.write_text(PRELUDE + slow + FAILS_IN_BATCH_2.format(how="raise RuntimeError"))
    return lambda *more: evaluate("", *more, path=path)


@pytest.mark.parametrize(
    ("fact", "other"),
    [
        ("hardware", "another machine"),
        pytest.param("environment", {"torch": "0"}, marks=pytest.mark.slow),
    ],
)
def test_another_machine_or_package_starts_anew(interrupted, monkeypatch, tmp_path, fact, other):
    assert interrupted()[0] == 2
    monkeypatch.setattr(machine, fact, lambda *_: other)
    again = interrupted("--resume")
    assert again[0] == 2
    assert f"{CHANGED}: starting anew" in again[2]
    assert batches_kept(tmp_path) == ["000000.npz"]


def test_answers_of_another_accelerator_are_not_gone_on_from(interrupted, tmp_path):
    assert interrupted()[0] == 2
    note = tmp_path / ".out.json.parts" / "seed-0" / "begun.json"
    facts = json.loads(note.read_text())
    facts["loaded"]["accelerator"] = "NVIDIA A100"
    note.write_text(json.dumps(facts))
    code, _, err = interrupted("--resume")
    said = "has answers of NVIDIA A100, here is none: go on there, or leave --resume out"
    assert (code, err.splitlines()[-1].partition(".parts ")[2]) == (2, said)
    assert batches_kept(tmp_path) == ["000000.npz"]


def test_what_an_interrupted_process_has_cost_and_tried_is_kept(interrupted, monkeypatch, tmp_path):
    mended, read = tmp_path / "fails.py.mended", PredictorProcess.status

    def status(process):
        if mended.exists():
            return replace(read(process), peak_bytes=2**30, refused=("read /a", "read /b"))
        tried = ("read /a", "read /late") if batches_kept(tmp_path) else ("read /a",)
        return replace(read(process), peak_bytes=2**31, refused=tried)

    monkeypatch.setattr(PredictorProcess, "status", status)
    monkeypatch.setattr(running, "NOTED", 0.0)
    assert interrupted()[0] == 2
    mended.touch()
    code, _, err = interrupted("--resume")
    assert code == 0
    assert "the sandbox refused what the predictor tried: read /a, read /late, read /b\n" in err
    cost = json.loads((tmp_path / "out.json").read_text())["cost"]
    assert cost["peak_memory_mb"] == 2048
    assert cost["loading_seconds"] > 1


def test_resume_does_not_clear_what_works_unasked(fails, predictor_file, monkeypatch, tmp_path):
    predict = PredictorProcess.predict

    def works(process, *given):
        answered = predict(process, *given)
        process._unasked = 1e9
        return answered

    monkeypatch.setattr(PredictorProcess, "predict", works)
    path = predictor_file(PRELUDE + "def predict(meshes): return weyl(meshes)")
    for _ in range(2):
        assert "--resume" not in fails("", "works while it is not asked", "--resume", path=path)
        assert not list(tmp_path.glob(".out.json.parts*"))


def test_several_seeds_need_a_predictor_that_takes_one(evaluate, fails, tmp_path):
    message = "takes no seed: define load(device, seed), or leave --seeds"
    fails("def predict(meshes): return weyl(meshes)", message, "--seeds", "2")
    code = """
class Shaken:
    def __init__(self, seed): self.seed = seed
    def predict(self, meshes): return weyl(meshes) * (1 + self.seed)
def load(device, seed): return Shaken(seed)
"""
    assert evaluate(code, "--seeds", "2")[0] == 0
    result = json.loads((tmp_path / "out.json").read_text())
    assert result["predictions"]["seeds"] == 2
    assert result["scores"]["mesh"]["overall"]["l1"]["seed_std"] > 0


# --- scored as it is -------------------------------------------------------------------


def test_one_answer_that_is_not_finite_is_scored_and_makes_every_mean_none(
    evaluate, mini_truth, tmp_path
):
    code, out, err = evaluate(
        "def predict(meshes):\n    p = weyl(meshes)\n    p[0, 3] = np.nan\n    return p", "--json"
    )
    result = json.loads(out)
    assert code == 2
    assert "Warning" not in err
    assert "the predictions of 4 of 30 instances are not finite, first ids: " in err
    scores = result["scores"]["mesh"]
    for key in ("invlap", "rpd", "polar", "l1", "l2"):
        assert [scores["overall"][key][name] for name in ("mean", "low", "median")] == [None] * 3
    assert scores["per_index"][3]["mean"] is None
    assert scores["per_index"][2]["mean"] is not None
    assert sum(family["count"] for family in scores["families"].values()) == LIMIT
    kept = predictions.read(tmp_path / "out.parquet", mini_truth.head(LIMIT))[0]
    assert np.isnan(kept).sum() == 4  # batches: 19 shapes, and 11 copies of some


def test_infinite_answers_are_scored_and_shown_as_not_finite_without_a_warning(evaluate):
    code, out, err = evaluate("def predict(meshes): return np.full((len(meshes), 10), np.inf)")
    assert code == 2
    assert "Warning" not in err
    assert "the predictions of 30 of 30 instances are not finite" in err
    assert "∞/NaN" in out
    assert "not finite" in out


def test_negative_answers_are_scored_and_counted(evaluate):
    code, out, err = evaluate("def predict(meshes): return -weyl(meshes)", "--json")
    result = json.loads(out)
    assert code == 2
    assert "the predictions of 30 of 30 instances are not positive, first ids: " in err
    assert result["scores"]["mesh"]["overall"]["rpd"]["mean"] == pytest.approx(10)
    assert result["physics"]["positive"] == 0
    assert result["physics"]["ascending"] == 0


def test_what_a_predictor_prints_does_not_reach_the_json(evaluate):
    code, out, err = evaluate(
        "print('at import')\n"
        "def predict(meshes):\n"
        "    print('in predict')\n"
        "    os.system('echo from a child')\n"
        "    sys.stdout.write('{')\n"
        "    return weyl(meshes)",
        "--json",
    )
    assert code == 0
    assert json.loads(out)["model"]["name"] == "my_model"
    assert "in predict" in err
    assert "from a child" in err
