import dataclasses
import os
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import filelock
import hypothesis
import pytest

import synthnet
from synthnet import kernels, recipe, terminal
from synthnet.build.label import make_sample
from synthnet.commands import cli
from synthnet.recipe import FamilyRecipe, Recipe, plan, splits
from synthnet.recipe.drawing import draw_shapes
from synthnet.store import files
from synthnet.types import Sample
from synthnet.verify import seal

hypothesis.settings.register_profile("synthnet", derandomize=True, deadline=None)
hypothesis.settings.load_profile("synthnet")

os.environ[kernels.SAID] = ""  # tests compare what commands print, whatever the cache holds


# --- the recipe and the draw of version 1.0 -------------------------------------------


@pytest.fixture(scope="session")
def recipe_1_0():
    return recipe.load("1.0")


@pytest.fixture(scope="session")
def limits(recipe_1_0):
    return recipe_1_0.filters


@pytest.fixture(scope="session")
def specs(recipe_1_0):
    return draw_shapes(recipe_1_0)


@pytest.fixture(scope="session", autouse=True)
def recipes_are_drawn_once():
    """Let a plan take the shapes of a recipe, and their splits, that this process has drawn.

    Drawing the 16,550 shapes of 1.0 takes seconds, and every verification does it.
    """
    drawn = {}
    split = {}
    paper = splits.paper

    def draw_once(version):
        if version.digest not in drawn:
            drawn[version.digest] = draw_shapes(version)
        return drawn[version.digest]

    def split_once(specs, *settings):
        digest = next((digest for digest, known in drawn.items() if known is specs), None)
        if digest is None:
            return paper(specs, *settings)
        key = digest, repr(settings)
        if key not in split:
            split[key] = paper(specs, *settings)
        return split[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "draw_shapes", draw_once)
        patch.setattr(splits, "paper", split_once)
        yield


# --- a built dataset, the command line and processes (store, build, verify, cli, hf) --


def _environment(**more):
    path = [str(Path(synthnet.__file__).parent.parent), os.environ.get("PYTHONPATH", "")]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, path)), **more}


@pytest.fixture(scope="session")
def environment():
    """Environment in which `python -m synthnet` is this very checkout."""
    return _environment()


@pytest.fixture(scope="session")
def command():
    """Return a function that runs `python -m synthnet` to its end in a new process."""

    def run(*arguments, **more):
        return subprocess.run(
            [sys.executable, "-m", "synthnet", *map(str, arguments)],
            env=_environment(**more),
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@pytest.fixture(scope="session")
def build(command):
    """Return a function that builds a version by two workers.

    Or copies it, where ``SYNTHNET_TEST_HOME`` names a directory in which this very checkout has
    built it: `.ci/run` does so first of all.
    """
    ready = os.environ.get("SYNTHNET_TEST_HOME")

    def make(version, home):
        if ready:
            unpacked = shutil.ignore_patterns("processed")
            shutil.copytree(Path(ready, version), home / version, ignore=unpacked)
        else:
            done = command("build", "--version", version, "--out", home, "--workers", "2")
            assert done.returncode == 0, done.stderr

    return make


@pytest.fixture(scope="session")
def mini_home(tmp_path_factory, build):
    """Directory with 1.0-mini, made once. Read only: copy it to damage it."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # the directory that the processes of one run share
    home = base / "mini"
    with filelock.FileLock(base / "mini.lock"):
        if not (home / "1.0-mini" / "manifest.json").exists():
            build("1.0-mini", home)
    return home


@pytest.fixture(scope="session")
def unpacking_home(mini_home, tmp_path_factory):
    """Directory with a copy of 1.0-mini beside which PyG and datasets may put their files."""
    home = tmp_path_factory.mktemp("unpacking") / "home"
    shutil.copytree(mini_home, home)
    return home


@pytest.fixture
def mini_copy(mini_home, tmp_path):
    """Directory with a copy of 1.0-mini that a test may damage."""
    shutil.copytree(mini_home, tmp_path / "copy")
    return tmp_path / "copy"


@pytest.fixture(scope="session")
def tiny(recipe_1_0):
    """A recipe of ten small shapes that keeps the families' real parameters."""
    least = {
        "torus": {"radial_resolution": 8, "tubular_resolution": 6},
        "tetrahedron": {"subdivisions": 2},
        "split_cone": {"resolution_a": 5, "resolution_b": 6, "split_a": 2, "split_b": 3},
        "sphere": {"resolution": 5},
    }
    counts = dict(zip(least, (4, 2, 3, 1), strict=True))
    families = {
        name: FamilyRecipe(counts[name], {**recipe_1_0.families[name].parameters, **small})
        for name, small in least.items()
    }
    return dataclasses.replace(recipe_1_0, version="tiny", families=families)


@pytest.fixture(scope="session")
def tiny_samples(tiny):
    """The samples of the tiny recipe by family."""
    made = {name: [] for name in tiny.families}
    for shard in plan.plan_shards(tiny):
        for shape in shard.shapes:
            sample = make_sample(shape, tiny)
            assert isinstance(sample, Sample), sample
            made[shard.family].append(sample)
    return made


# --- a sealed set (seal, cli, eigbench) -----------------------------------------------


@dataclasses.dataclass(frozen=True)
class SealedSet:
    """A sealed set that was built: recipe, home, salt's file, the published file and that read."""

    recipe: Recipe
    home: Path
    salt: Path
    published: Path
    seal: seal.Seal


@pytest.fixture(scope="session")
def sealed_set(tmp_path_factory):
    """One shape of each family of 1.0-mini, sealed by one worker. Read only."""
    location = tmp_path_factory.mktemp("sealed")
    salt, published, home = location / "salt.txt", location / "seal.json", location / "home"
    files.write_secret(salt, seal.salt_text(bytes(7 * byte % 256 for byte in range(32))))
    version = seal.sealed_recipe("1.0-mini", seal.read_salt(salt), share=0.01, beacon="round 7")
    made, _ = seal.make(version, root=home, workers=1)
    seal.write(published, made)
    return SealedSet(version, home, salt, published, made)


# --- command lines --------------------------------------------------------------------


def called(main, captured, *arguments):
    """Run a command line in this process; anything but an exit code fails the test."""
    captured.readouterr()
    try:
        code = main([str(argument) for argument in arguments])
    except SystemExit as stop:
        code = stop.code
    assert isinstance(code, int)
    return code, *captured.readouterr()


def only_line(code, out, err):
    """Return the one line on stderr of a command that could not do it."""
    line = err.removesuffix("\n")
    assert (code, out, line.count("\n")) == (2, "", 0), err
    assert line.startswith(("synthnet", "eigbench"))
    return line


@pytest.fixture
def run(capsys, monkeypatch):
    """Return a function that runs a command of synthnet: exit code, stdout and stderr."""
    monkeypatch.setattr(terminal, "LOGGED", 3600)  # a kernel that is compiled takes some seconds
    return partial(called, cli.main, capsys)


@pytest.fixture
def printed(run):
    """Return a function that runs a command of synthnet, which must succeed: its stdout."""

    def command(*words):
        code, out, _ = run(*words)
        assert code == 0
        return out

    return command
