"""Predictors that try to gain without predicting: docs/threats.md has the whole list."""

import sys
from pathlib import Path

import numpy as np
import pytest
from eigbench.errors import PredictorError
from eigbench.running import meshes
from eigbench.running.evaluate import Options, evaluate, predict_meshes

from synthnet import store

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


def test_who_counts_the_questions_answers_others(predictor_file, mini_truth, mini_home, tmp_path):
    np.save(tmp_path / "table.npy", mini_truth.eigenvalues[mini_truth.order])
    source = meshes.read(store.open_dataset("1.0-mini", mini_home), mini_truth.ids)
    question = (predictor_file(COUNTS), mini_truth, source, Options(batch_size=16))
    found = evaluate(*question, tmp_path / "parts").predictions[0]
    assert np.isfinite(found).all()
    assert (found == mini_truth.eigenvalues).all(axis=1).mean() < 0.1


CLOCKLESS = """
import time
import numpy as np

sleep = time.sleep
time.perf_counter = time.monotonic = time.process_time = time.time = lambda: 0.0

def predict(meshes):
    sleep(0.2)
    return np.ones((len(meshes), 10))
"""


def test_a_clock_that_is_stopped_in_the_predictors_process_stops_nothing(
    predictor_file, mini_truth, mini_home, tmp_path
):
    wanted = mini_truth.head(3)
    source = meshes.read(store.open_dataset("1.0-mini", mini_home), wanted.ids)
    found = evaluate(predictor_file(CLOCKLESS), wanted, source, Options(), tmp_path / "parts")
    assert found.seconds.min() >= 0.2


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


@pytest.mark.skipif(sys.platform != "linux", reason="its descriptors are found by their numbers")
@pytest.mark.parametrize("kind", [b"a", b"l", b"s", b"f"])
def test_what_a_predictor_sends_does_not_run_in_the_harness(predictor_file, kind):
    code = predictor_file(PICKLED.replace("KIND", repr(kind)))
    with pytest.raises(PredictorError, match="the predictor's process sent "):
        predict_meshes(code, ["a"], meshes.warming(1), 10, Options())
    assert not Path(code.parent, "went-off").exists()
