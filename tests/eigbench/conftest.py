"""Predictors written to files, the command line in this process, one whole evaluation."""

import contextlib
import copy
import hashlib
import io
import itertools
import json
import os
import shutil
import subprocess
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import filelock
import numpy as np
import pytest
from eigbench import results
from eigbench.commands import cli
from eigbench.results import predictions, submission
from eigbench.running import evaluate as running
from eigbench.running import meshes
from eigbench.scaling import results as scaling_results
from eigbench.scaling import surfaces
from eigbench.scoring import scores, truth
from eigbench.scoring.truth import Truth

from synthnet import store
from synthnet.store.files import sha256
from tests.conftest import called

ONES = """
import numpy as np

def predict(meshes): return np.ones((len(meshes), 10))
"""
WEYL = """
import numpy as np

def predict(meshes):
    spectra = []
    for mesh in meshes:
        a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
        spectra.append(4 * np.pi * np.arange(1, 11) / area)
    return np.array(spectra)
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
WEYL_TO_CHANGE = WEYL.replace("def predict", "def weyl")  # for code that predicts something else


@dataclass(frozen=True)
class Evaluated:
    """A predictor that was evaluated, and what that left behind."""

    code: Path
    out: Path
    predictions: Path
    result: dict[str, Any]


def git(folder, *command, day="2026-01-02"):
    """Run git in a folder as somebody, on a day; return what it prints."""
    name = ["-c", "user.name=Somebody", "-c", "user.email=somebody@example.org"]
    dates = {f"GIT_{who}_DATE": f"{day}T12:00:00Z" for who in ("AUTHOR", "COMMITTER")}
    done = subprocess.run(
        ["git", "-C", folder, *name, *command],
        env={**os.environ, **dates},
        check=True,
        capture_output=True,
        text=True,
    )
    return done.stdout.strip()


def changed(row, part, **new):
    """Return a row with other values in a part of its result."""
    return replace(row, result={**row.result, part: {**row.result.get(part, {}), **new}})


@pytest.fixture(scope="session")
def mini_truth():
    return truth.load("1.0-mini")


@pytest.fixture(scope="session")
def mini_meshes(mini_home, mini_truth):
    """The meshes of the test split of 1.0-mini. Read only."""
    return meshes.read(store.open_dataset("1.0-mini", mini_home), mini_truth.ids)


@pytest.fixture
def predictor_file(tmp_path):
    """Return a function that writes a predictor's code to a file."""

    def write(code, name="my_model.py"):
        path = tmp_path / name
        path.write_text(code)
        return path

    return write


@pytest.fixture
def evaluated(predictor_file, mini_meshes, tmp_path):
    """Return a function that evaluates code on some of the test split of 1.0-mini, with options."""

    def evaluate(code, labels, **options):
        options = running.Options(**options)
        return running.evaluate(
            predictor_file(code), labels, mini_meshes, options, tmp_path / "parts"
        )

    return evaluate


@pytest.fixture
def eigbench(capfd):
    """Return a function that runs the command line: exit code, stdout and stderr.

    The descriptors are captured, so that what a predictor's process writes is seen too.
    """

    return partial(called, cli.main, capfd)


@pytest.fixture
def printed(eigbench):
    """Return a function that runs what must succeed, and returns what it prints to stdout."""

    def run(*arguments):
        code, out, err = eigbench(*arguments)
        assert code == 0, err
        return out

    return run


@pytest.fixture
def refused(eigbench):
    """Return a function that runs what must be refused, and returns what it says on stderr."""

    def run(*arguments):
        code, out, err = eigbench(*arguments)
        assert (code, out) == (2, "")
        return err

    return run


@pytest.fixture(scope="session")
def weyl(mini_home):
    """The area-scaled Weyl law on the whole test split of 1.0-mini. Read only."""
    location = mini_home.parent / "weyl"  # the processes of one run share it, as they do 1.0-mini
    code, out = location / "weyl.py", location / "result.json"
    with filelock.FileLock(location.with_suffix(".lock")):
        if not out.exists():
            location.mkdir(exist_ok=True)
            code.write_text("META = {'name': 'Weyl', 'kind': 'trivial'}\n" + WEYL)
            options = ["--dataset", "1.0-mini", "--root", str(mini_home), "--out", str(out)]
            options += ["--batch-size", "10"]
            silent = io.StringIO()
            with (
                contextlib.redirect_stdout(silent),
                contextlib.redirect_stderr(silent),
                pytest.MonkeyPatch.context() as patch,
            ):
                patch.setattr(running, "REFERENCE", 10)  # LaPy is timed on 20 meshes, not 200
                assert cli.main(["evaluate", str(code), *options]) == 0
    return Evaluated(code, out, location / "result.parquet", json.loads(out.read_text()))


@pytest.fixture
def weyl_copy(weyl, tmp_path):
    """A copy of its result, which a test may change, with its predictions beside it."""
    out = tmp_path / "result.json"
    shutil.copy(weyl.out, out)
    shutil.copy(weyl.predictions, out.with_suffix(".parquet"))
    return out


@pytest.fixture(scope="session")
def make_submission(weyl, mini_truth, tmp_path_factory):
    """Return a function that makes a result and predictions of its own name and answers."""

    def make(name, values, labels=mini_truth, **model):
        location = tmp_path_factory.mktemp("made")
        out, kept = location / "result.json", location / "result.parquet"
        values = np.asarray(values, dtype=np.float64)
        values = values if values.ndim == 3 else values[None]
        predictions.write(kept, labels, values)
        result = copy.deepcopy(weyl.result)
        result["model"].update({"name": name, **model})
        result["dataset"] = results.dataset_facts(labels)
        if reference := result["cost"].get("reference"):  # LaPy is timed on some of the meshes
            reference["meshes"] = min(reference["meshes"], len(labels.ids))
        result["predictions"] = {"sha256": sha256(kept), "seeds": len(values)}
        result["scores"] = scores.of_targets(labels, values)
        results.write(out, result)
        return out

    return make


@pytest.fixture(scope="session")
def make_row(make_submission):
    """Return a function that makes a submission of its own name and answers, and reads it."""
    return lambda *given, **model: submission.read(make_submission(*given, **model))


@pytest.fixture(scope="session")
def of_protocol(make_submission):
    """Return a function that makes a submission on 2.0-mini, off the labels by a factor."""

    def make(name, protocol, factor, **model):
        labels = truth.load("2.0-mini", "test", protocol)
        return make_submission(name, labels.eigenvalues * factor, labels, **model)

    return make


@pytest.fixture(scope="session")
def held_out_submissions(of_protocol):
    """A solver; a model that is 1 % off, 5 % where genus was held out; one run i.i.d. only."""
    trained = {"kind": "learned", "training_data": "the training split"}
    return [
        of_protocol("Solver", "grouped", 1.001, kind="classical", training_data="none"),
        of_protocol("Model", "grouped", 1.01, **trained),
        of_protocol("Lazy", "grouped", 1.02, **trained),
        of_protocol("Model", "genus", 1.05, **trained),
    ]


@pytest.fixture
def made_truth():
    """Return a function that makes a truth of given shapes, families and labels."""

    def make(shapes, families, eigenvalues):
        seen = {}
        ids = []
        for shape in shapes:
            seen[shape] = seen.get(shape, -1) + 1
            ids.append(f"{shape}/{seen[shape]}")
        return Truth(
            "made",
            "test",
            "grouped",
            tuple(ids),
            np.array(shapes),
            np.array(shapes),
            np.array(families),
            np.full(len(ids), "made/grouped"),
            np.array(eigenvalues, dtype=np.float64),
            "0" * 64,
        )

    return make


@pytest.fixture(scope="session")
def make_scaled(tmp_path_factory):
    """Return a function that makes a result of the scaling track.

    For each size a time, and a factor of the labels, or of another spectrum of the pinned meshes;
    None where it took too long.
    """

    def make(name, sizes, hardware="this machine", of="label"):
        meshes = []
        for (size, (seconds, factor)), surface in itertools.product(
            sizes.items(), surfaces.SURFACES
        ):
            expected = surfaces.pinned(surface, size)
            answered = factor is not None
            meshes.append(
                {
                    "surface": surface,
                    "size": size,
                    "digest": expected.pin.digest,
                    "outcome": "answered" if answered else "over time",
                    "detail": "",
                    "time_limit": 600,
                    "memory_limit_gib": 16,
                    "eigenvalues": (factor * getattr(expected, of)).tolist() if answered else None,
                    "seconds": [seconds] if answered else [],
                    "cpu_seconds": [seconds] if answered else [],
                    "peak_memory_mb": 100.0 if answered else None,
                    "reference_seconds": None,
                }
            )
        result = {
            "scaling_version": scaling_results.VERSION,
            "model": {
                "name": name,
                "kind": "classical",
                "code": "a.py",
                "sources": {"a.py": hashlib.sha256(name.encode()).hexdigest()},
                "parameters": None,
            },
            "cost": {"threads": 1, "device": "cpu", "hardware": hardware},
            "meshes": meshes,
            "environment": {"python": "3.13"},
        }
        path = tmp_path_factory.mktemp("scaled") / f"{name}.json"
        results.write(path, result, scaling_results.validate)
        return scaling_results.read(path)

    return make
