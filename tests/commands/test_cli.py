"""Tests of the command line: what it prints, its exit codes, one line where it fails."""

import dataclasses
import json
import re
import subprocess
import sys
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from synthnet import processes, recipe, store
from synthnet.build.versions import build
from synthnet.build.workers import cores
from synthnet.recipe.plan import plan_shards
from synthnet.terminal import WRONG_INPUT
from synthnet.verify.checks import CHECKS
from tests.conftest import only_line

VERSION = "1.0-mini"
READERS = (["info"], ["verify"], ["croissant"], ["show", "torus-00000"])  # of what is built


@pytest.fixture
def mini(run, mini_home):
    """Return a function that runs a command on 1.0-mini: exit code, stdout and stderr."""
    return lambda *words: run(*words, "--version", VERSION, "--out", mini_home)


@pytest.fixture
def of_mini(printed, mini_home):
    """Return a function that runs a command on 1.0-mini, which must succeed: its stdout."""
    return lambda *words: printed(*words, "--version", VERSION, "--out", mini_home)


def test_help_survives_a_percent_sign(printed, monkeypatch):
    monkeypatch.setenv("SYNTHNET_HOME", "/disk at 100%full")
    assert "100%full" in "".join(printed("build", "--help").split("\n"))


def test_module_is_the_command(command, run, mini_home, monkeypatch):
    monkeypatch.setenv("SYNTHNET_HOME", str(mini_home))
    done = command("versions", SYNTHNET_HOME=str(mini_home))
    assert (done.returncode, done.stdout, done.stderr) == run("versions")
    assert "1.0-mini        335  yes" in done.stdout
    assert done.stdout.endswith(f"\nin {mini_home}\n")


def test_default_place_is_the_variable(run, mini, mini_home, monkeypatch):
    monkeypatch.setenv("SYNTHNET_HOME", str(mini_home))
    assert run("info", "--version", VERSION) == mini("info")


# An interrupt


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (["build", VERSION], True),
        (["import", "scans", "--name", "scans"], True),
        (["verify", VERSION], False),
        (["spectrum", "a.ply"], False),
    ],
)
def test_an_interrupt_names_shards_where_a_command_makes_them(words, kept, run, monkeypatch):
    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr("synthnet.terminal._check_working_directory", interrupted)
    shards = "; finished shards are kept, run the same command to go on" if kept else ""
    assert run(*words) == (130, "", f"synthnet: interrupted{shards}\n")


def test_bars_that_were_never_begun_leave_no_line(run, tmp_path):
    missing = tmp_path / "scans"
    line = f"synthnet: there is no file or directory {missing}\n"
    assert run("import", missing, "--name", "scans") == (2, "", line)


# Where it prints to


@pytest.fixture
def shell(environment):
    """Return a function that runs the command in a shell: exit code, stdout and stderr."""
    buffered = {name: value for name, value in environment.items() if name != "PYTHONUNBUFFERED"}

    def run(line, **more):
        command = f'set -o pipefail; synthnet() {{ {sys.executable} -m synthnet "$@"; }}; {line}'
        done = subprocess.run(
            ["bash", "-c", command], env=buffered | more, capture_output=True, check=False
        )
        return done.returncode, done.stdout.decode("latin-1"), done.stderr.decode()

    return run


@pytest.mark.parametrize("words", ["versions", "versions --help"])
def test_a_full_disk_is_one_line_and_a_closed_pipe_none(words, shell):
    line = f"synthnet{' versions' if '--help' in words else ''}: standard output: No space left"
    assert shell(f"synthnet {words} >/dev/full") == (2, "", f"{line} on device\n")
    assert shell(f"synthnet {words} | true") == (0, "", "")


def test_what_a_closed_stream_would_have_had_goes_nowhere(shell):
    assert shell("synthnet versions --json >&-") == (0, "", "")
    assert shell("synthnet info nothing 2>&-") == (2, "", "")
    code, table, err = shell("synthnet spectrum nothing.obj 2>&-")
    assert (code, err) == (2, "")
    assert "cannot be opened" not in table


def test_a_character_that_the_terminal_has_not_is_escaped(shell):
    code, table, err = shell("synthnet spectrum nothing.obj", PYTHONIOENCODING="latin-1")
    assert (code, err.count("there is no file")) == (2, 1)
    assert "\\u03bb1" in table


# One line and exit code 2


@pytest.mark.parametrize("arguments", [["build"], *READERS])
def test_unknown_version(arguments, run, tmp_path):
    line = only_line(*run(*arguments, "--version", "3.0", "--out", tmp_path))
    assert "unknown version '3.0': choose one of 1.0, 1.0-mini, 1.0-small, 2.0" in line


@pytest.mark.parametrize("arguments", READERS)
def test_version_that_is_not_built(arguments, run, tmp_path):
    line = only_line(*run(*arguments, "--version", VERSION, "--out", tmp_path))
    assert f"no finished dataset in {tmp_path / VERSION}: run `synthnet build 1.0-mini" in line


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ([], "the following arguments are required: COMMAND"),
        (["frobnicate"], "invalid choice: 'frobnicate'"),
        (["bild"], "did you mean build? (`synthnet --help` shows how)"),
        (["build", "1.0-mni"], "`synthnet versions` lists them); did you mean 1.0-mini?"),
        (["info", "1.0", "--dataset", "2.0"], "two datasets are named, 1.0 and 2.0: name one"),
        (
            ["info", "--verison", "1.0"],
            "--verison; did you mean --version? (`synthnet info --help`",
        ),
        (["show", "tours-00001", "--dataset", VERSION], "and a number; did you mean torus?"),
        (["show", "torus-5", "--dataset", VERSION], "lists them; did you mean torus-00005?"),
        (["show", "torus-00005/3", "--dataset", VERSION], "did you mean torus-00005?"),
        (
            ["show", "--datset", VERSION],
            "--datset; did you mean --dataset? (`synthnet show --help`",
        ),
        (["--verison"], "--verison; did you mean --version? (`synthnet --help`"),
        (
            ["--traceback", "build", VERSION],
            "--traceback; it is an option of commands: put it after",
        ),
        (["gallery", "tours", "--dataset", VERSION], "inverted_cone; did you mean torus?"),
        (["build", "--workers", "two"], "argument --workers: invalid int value: 'two'"),
        (["build", "--workers", "0"], "argument --workers: must be at least 1, got 0"),
        (["build", "--workers", "999999"], f"workers must be at most {16 * cores()}, 16 a core"),
        (["build", "--frobnicate"], "unrecognized arguments: --frobnicate"),
        (["show"], "the following arguments are required: ID"),
        (
            ["show", "torus-99999", "--dataset", VERSION],
            "no shape 'torus-99999' in 1.0-mini: `synthnet info 1.0-mini --ids`",
        ),
        (["verify", VERSION, "--sample", "-1"], "--sample: must be at least 0, got -1"),
        (["verify", VERSION, "--seed", "-1"], "--seed: must be at least 0, got -1"),
        (
            ["gallery", "star", "--dataset", VERSION],
            "1.0-mini has no family 'star': choose one of rectangular_prism, cone",
        ),
        (["gallery", "blob", "--dataset", VERSION], "; it is in 2.0: --dataset 2.0"),
        (["gallery", VERSION], f"{VERSION} is a version, and no family: add --dataset before it"),
        (["gallery", "torus", "--count", "0"], "argument --count: must be at least 1, got 0"),
        (["gallery", "--count", "3"], "--count is for the shapes of one family: name the family"),
        (["gallery", "torus", "--png", "a.jpg"], "the picture's name must end in .png, got a.jpg"),
    ],
)
def test_wrong_arguments(arguments, expected, run, mini_home, monkeypatch):
    monkeypatch.setenv("SYNTHNET_HOME", str(mini_home))
    assert expected in only_line(*run(*arguments))


@pytest.mark.parametrize("named", [[VERSION], ["--dataset", VERSION], ["--version", VERSION]])
def test_a_dataset_is_named_by_a_word_or_an_option(named, printed, mini_home):
    out = printed("info", *named, "--out", mini_home, "--json")
    assert json.loads(out)["version"] == VERSION


@pytest.mark.slow
def test_a_dataset_that_is_there_is_guessed_too(run, tmp_path, tiny):
    build(dataclasses.replace(tiny, version="scans"), root=tmp_path, workers=1)
    assert only_line(*run("info", "scnas", "--out", tmp_path)).endswith("; did you mean scans?")


def test_traceback_shows_where_an_error_was_raised(run):
    line = only_line(*run("info", "1.0-mni"))
    code, out, err = run("info", "1.0-mni", "--traceback")
    assert (code, out) == (WRONG_INPUT, "")
    assert err.startswith("Traceback (most recent call last):\n")
    assert "finding.py" in err
    assert err.endswith(f"\n{line}\n")


@pytest.mark.parametrize("arguments", [["build"], *READERS])
def test_place_that_is_no_directory(arguments, run, tmp_path):
    (tmp_path / "file").write_text("no directory")
    location = tmp_path / "file" / "home"
    line = only_line(*run(*arguments, "--version", VERSION, "--out", location))
    assert str(location) in line


def test_place_that_cannot_be_written(run):
    if not Path("/proc/self").exists():
        pytest.skip("needs a place that even root cannot write to")
    line = only_line(*run("build", "--version", VERSION, "--out", "/proc/synthnet"))
    assert "cannot write to /proc/synthnet/1.0-mini" in line
    assert "choose another directory with --out or $SYNTHNET_HOME" in line


def test_damaged_manifest(run, mini_copy):
    path = mini_copy / VERSION / "manifest.json"
    path.write_text(path.read_text()[:-100])
    for arguments in (["build"], ["info"], ["verify"], ["show", "torus-00000"]):
        line = only_line(*run(*arguments, "--version", VERSION, "--out", mini_copy))
        assert f"{path} is damaged" in line
        assert "remove it and run `synthnet build` again" in line


def test_damaged_shard(run, mini_copy):
    path = mini_copy / VERSION / "shards" / "torus-0000.parquet"
    path.write_bytes(path.read_bytes()[:-100])
    line = only_line(*run("show", "torus-00000", "--version", VERSION, "--out", mini_copy))
    assert f"{path} is damaged" in line


def test_failure_has_no_traceback_in_a_process_of_its_own(command, tmp_path):
    (tmp_path / "file").write_text("no directory")
    done = command("build", "--version", VERSION, "--out", tmp_path / "file" / "home")
    line = only_line(done.returncode, done.stdout, done.stderr)
    assert re.search("cannot write to .*: choose another directory with --out", line)


# For people


def test_second_build_says_so(of_mini, mini_home):
    first, second = of_mini("build").splitlines()
    assert first == f"1.0-mini is built already in {mini_home / VERSION}: nothing to do"
    assert "`synthnet verify` checks what is in them" in second


def test_info_has_a_table_of_the_families(mini):
    code, out, err = mini("info")
    assert (code, err) == (0, "")
    lines = out.splitlines()
    assert lines[0].split() == ["family", "drawn", "rejected", "kept", "vertices", "faces"]
    # Open3D's torus has a vertex for each of 30 x 20 steps and two triangles for each
    assert ["torus", "40", "0", "40", "24,000", "48,000"] in [line.split() for line in lines]
    (total,) = (line for line in lines if line.startswith("all "))
    assert total.split()[:4] == ["all", "335", "0", "335"]
    planned = [s.split for plan in plan_shards(recipe.load(VERSION)) for s in plan.shapes]
    numbers = ", ".join(f"{n} {planned.count(n)}" for n in ("train", "validation", "test"))
    assert f"splits     {numbers}" in lines
    failing = "57 of them (17.0%) have a PSNR of 20 dB or less against their limit"
    assert f"limits     of 335 labels; {failing}" in lines


def test_info_lists_the_ids(of_mini):
    ids = [s.spec.id for plan in plan_shards(recipe.load(VERSION)) for s in plan.shapes]
    assert of_mini("info", "--ids").splitlines() == ids
    assert len(ids) == 335


def test_show_says_what_a_shape_is(of_mini, mini_home):
    out = of_mini("show", "torus-00000")
    lines = {line.split("  ")[0]: line.split() for line in out.splitlines()}
    assert lines["vertices"][-1] == "600"
    assert lines["faces"][-1] == "1,200"
    assert lines["euler characteristic"][-1] == "0"
    assert lines["closed"][-1] == "yes"
    assert "tubular_resolution 20" in out
    sample = store.open_dataset(VERSION, mini_home).find("torus-00000")
    rows = out.splitlines()
    values = rows[rows.index("eigenvalues (1/length²)") + 1].split()
    assert [float(v) for v in values] == pytest.approx(sample.eigenvalues.tolist(), rel=1e-5)


@pytest.mark.parametrize(
    ("options", "height"),  # a first row of 3.9 inches, rows of 2.15, a key of 0.3, at 150 dots
    [
        (["--eigenfunctions", "0"], 585),
        pytest.param([], 952, marks=pytest.mark.slow),
        pytest.param(["--eigenfunctions", "6", "--edges"], 1275, marks=pytest.mark.slow),
    ],
)
def test_show_draws_a_picture(options, height, mini, tmp_path):
    path = tmp_path / "a.PNG"
    code, out, err = mini("show", "torus-00000", "--png", path, *options)
    assert (code, err) == (0, "")
    assert out.endswith(f"picture: {path}\n")
    assert path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
    pixels = matplotlib.image.imread(path)[..., :3]
    assert pixels.shape == (height, 1350, 3)
    for half in (pixels[:585, :675], pixels[:585, 675:]):  # the surface and the bars
        assert 0.02 < np.mean((half < 0.95).any(axis=2)) < 0.9
        assert len(np.unique((half * 255).astype(int).reshape(-1, 3), axis=0)) > 50


@pytest.mark.parametrize(
    ("suffix", "options", "expected"),
    [
        ("png", ["--eigenfunctions", 600], "k must be between 1 and 599 for 600 vertices, got 600"),
        ("jpg", [], "the picture's name must end in .png, got {path}"),
    ],
)
def test_picture_that_cannot_be_drawn(suffix, options, expected, mini, tmp_path):
    path = tmp_path / f"a.{suffix}"
    line = only_line(*mini("show", "torus-00000", "--png", path, *options))
    assert expected.format(path=path) in line
    assert not path.exists()


def test_gallery_of_a_family(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["gallery", "torus", "--version", VERSION, "--out", tmp_path, "--count", "7"]
    code, out, err = run(*arguments)
    assert (code, out, err) == (0, "picture: gallery-1.0-mini-torus.png\n", "")
    pixels = matplotlib.image.imread(tmp_path / "gallery-1.0-mini-torus.png")
    assert pixels.shape[1] == 1350
    code, out, _ = run(*arguments, "--json", "--png", tmp_path / "other.png")
    printed = json.loads(out)
    assert printed["picture"] == str(tmp_path / "other.png")
    assert len(printed["ids"]) == 7
    assert printed["ids"] == sorted(printed["ids"])


def test_no_folder_is_made_for_a_family_that_there_is_not(run, tmp_path):
    only_line(*run("gallery", "tours", "--version", VERSION, "--png", tmp_path / "new" / "a.png"))
    assert list(tmp_path.iterdir()) == []


def test_gallery_of_all_families(printed, tmp_path):
    path = tmp_path / "all.png"
    out = printed("gallery", "--version", VERSION, "--png", path, "--json")
    families = [id.rpartition("-")[0] for id in json.loads(out)["ids"]]
    assert families == list(recipe.load(VERSION).families)
    assert path.exists()


def test_folder_of_a_picture_is_made(mini, tmp_path):
    path = tmp_path / "not" / "there" / "a.png"
    assert mini("show", "torus-00000", "--png", path, "--eigenfunctions", 0)[0] == 0
    assert path.is_file()
    (tmp_path / "file").write_text("no directory")
    line = only_line(*mini("show", "torus-00000", "--png", tmp_path / "file" / "a.png"))
    assert f"cannot write to {tmp_path / 'file'} (" in line
    assert line.endswith("choose another place for a.png")


# For programs


def test_json_of_versions(run, mini_home):
    code, out, err = run("versions", "--out", mini_home, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out) == [
        {"version": "1.0", "shapes": 16550, "built": False},
        {"version": "1.0-mini", "shapes": 335, "built": True},
        {"version": "1.0-small", "shapes": 1655, "built": False},
        {"version": "2.0", "shapes": 9930, "built": False},
        {"version": "2.0-mini", "shapes": 387, "built": False},
        {"version": "2.1", "shapes": 14430, "built": False},
        {"version": "2.1-mini", "shapes": 507, "built": False},
    ]


def test_versions_passes_over_what_is_damaged(run, mini_copy):
    path = mini_copy / VERSION / "manifest.json"
    path.write_text(path.read_text()[:-100])
    code, out, err = run("versions", "--out", mini_copy, "--json")
    assert (code, err) == (0, "")
    rows = {row["version"]: row["built"] for row in json.loads(out)}
    assert rows == dict.fromkeys(recipe.available(), False)


@pytest.mark.slow
def test_versions_lists_what_else_is_there(run, tmp_path, tiny):
    build(dataclasses.replace(tiny, version="scans"), root=tmp_path, workers=1)
    (tmp_path / "notes").mkdir()  # no dataset
    (tmp_path / "web").mkdir()
    (tmp_path / "web" / "manifest.json").write_text('{"name": "of another program"}')
    (tmp_path / "a.txt").write_text("")
    (tmp_path / "other").symlink_to(tmp_path / "scans")  # not its name
    code, out, err = run("versions", "--out", tmp_path, "--json")
    assert (code, err) == (0, "")
    assert [row["version"] for row in json.loads(out)] == [*recipe.available(), "scans"]
    assert json.loads(out)[-1] == {"version": "scans", "shapes": tiny.count, "built": True}
    assert run("versions", "--out", tmp_path / "nowhere")[0] == 0


def test_versions_of_a_place_that_cannot_be_listed(run, tmp_path):
    (tmp_path / "file").write_text("")
    message = only_line(*run("versions", "--out", tmp_path / "file"))
    assert message == f"synthnet: cannot list {tmp_path / 'file'} (Not a directory)"


SUMMARY = {"version", "recipe_digest", "families", "bytes", "packages", "directory"}
FAMILY = {"family", "drawn", "rejected", "kept", "vertices", "faces"}


def test_json_of_info(mini, mini_home):
    code, out, err = mini("info", "--json")
    assert (code, err) == (0, "")
    printed = json.loads(out)
    manifest = store.open_dataset(VERSION, mini_home).manifest
    assert set(printed) == SUMMARY | {"limits"}
    assert printed["version"] == VERSION
    assert printed["recipe_digest"] == recipe.load(VERSION).digest
    assert printed["directory"] == str(mini_home / VERSION)
    assert printed["bytes"] == sum(
        p.stat().st_size for p in (mini_home / VERSION / "shards").iterdir()
    )
    assert [set(row) for row in printed["families"]] == [FAMILY] * 10
    assert {row["family"]: row["drawn"] for row in printed["families"]} == manifest.drawn
    assert sum(row["kept"] for row in printed["families"]) == manifest.rows


def test_json_of_build(of_mini):
    printed = json.loads(of_mini("build", "--json"))
    assert set(printed) == SUMMARY | {"wall_seconds", "nothing_to_do", "reused_shards"}
    assert [set(row) for row in printed["families"]] == [FAMILY | {"core_seconds"}] * 10
    assert printed["nothing_to_do"] is True


@pytest.mark.slow
def test_json_of_verify(mini):
    code, out, _ = mini("verify", "--sample", "2", "--json")
    printed = json.loads(out)
    assert code == (0 if printed["ok"] else 1)
    assert set(printed) == {"version", "ok", "checks"}
    assert [check["check"] for check in printed["checks"]] == list(CHECKS)
    assert [set(check) for check in printed["checks"]] == [{"check", "examined", "problems"}] * 10
    assert printed["checks"][-3] == {"check": "labels", "examined": 2, "problems": []}
    assert printed["checks"][-2] == {"check": "limits", "examined": 335, "problems": []}
    assert printed["checks"][-1] == {"check": "unpacked", "examined": 0, "problems": []}


def test_an_open_surface_has_no_volume(run, tmp_path):
    square = np.array([[x, y, 1.0] for x in range(5) for y in range(5)])
    corners = [5 * x + y for x in range(4) for y in range(4)]
    faces = [[i, i + 5, i + 6] for i in corners] + [[i, i + 6, i + 1] for i in corners]
    path = tmp_path / "square.off"
    rows = [["OFF"], [25, 32, 0], *square, *([3, *face] for face in faces)]
    path.write_text("".join(" ".join(map(str, row)) + "\n" for row in rows))
    assert run("import", path, "--name", "open", "--out", tmp_path, "--workers", 1)[0] == 0
    words = ["show", "square.off", "--dataset", "open", "--out", tmp_path]
    _, out, _ = run(*words, "--json")
    shown = json.loads(out)
    assert (shown["closed"], shown["volume"]) == (False, None)
    _, out, _ = run(*words)
    assert "volume" not in out


def test_json_of_show(mini, mini_home):
    code, out, err = mini("show", "torus-00000", "--json")
    assert (code, err) == (0, "")
    shown = json.loads(out)
    sample = store.open_dataset(VERSION, mini_home).find("torus-00000")
    assert shown["id"] == "torus-00000"
    assert shown["family"] == "torus"
    assert shown["parameters"] == dict(sample.spec.parameters)
    assert shown["eigenvalues"] == sample.eigenvalues.tolist()
    assert shown["split"] == sample.split
    assert (shown["vertices"], shown["faces"], shown["euler_characteristic"]) == (600, 1200, 0)
    assert shown["closed"] is True
    for key in ("area", "volume", "trivial", "least_relative_altitude"):
        assert isinstance(shown[key], float)
    assert shown["certificate"]["count"] >= 11
    assert shown["certificate"]["shift"] > shown["eigenvalues"][-1]


# What the machine refuses


def test_a_removed_working_directory_is_one_line(run, tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    remedy = "synthnet: the working directory was removed: change to another one\n"
    assert run("versions", "--out", tmp_path) == (2, "", remedy)


def test_a_lack_of_memory_is_one_line(run, tmp_path, monkeypatch):
    def too_much(root=None):
        raise MemoryError

    monkeypatch.setattr(store, "there", too_much)
    line = "synthnet: out of memory: close other programs, or take less at once\n"
    assert run("versions", "--out", tmp_path) == (2, "", line)
    monkeypatch.setattr(processes.resource, "getrlimit", lambda which: (2**30, 2**31))
    code, _, err = run("versions", "--out", tmp_path)
    assert code == 2
    assert err.startswith("synthnet: out of memory: a process may address 1.0 GiB here (`ulimit")


@pytest.mark.parametrize(
    ("program", "limit"), [("synthnet", 300_000), ("synthnet", 500_000), ("eigbench", 500_000)]
)
def test_a_limit_below_what_the_libraries_take_is_one_line(program, limit, environment):
    """Where the address space ends depends on the libraries: one line, wherever it does.

    Not of eigbench at 300,000 KB: where SciPy's own OpenBLAS finds no room for its buffers, it asks
    for them without end.
    """
    limited = f"ulimit -v {limit} && exec {sys.executable} -m {program} --help"
    done = subprocess.run(
        ["bash", "-c", limited],
        env={**environment, "OPENBLAS_NUM_THREADS": "1"},  # its threads have lines of their own
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    (line,) = [line for line in done.stderr.splitlines() if line.strip()]
    assert (done.returncode, done.stdout) == (2, "")
    assert line.startswith(f"{program}: a library cannot be loaded (")
    assert line.endswith("libraries that it loads count: raise that limit or lift it")


@pytest.mark.parametrize(
    ("limit", "error"),
    [(processes.resource.RLIM_INFINITY, OSError("no library")), (2**30, FileNotFoundError(2, ""))],
)
def test_an_error_that_no_limit_explains_is_raised(monkeypatch, limit, error):
    def main():
        raise error

    monkeypatch.setattr(processes.resource, "getrlimit", lambda which: (limit, limit))
    with pytest.raises(type(error)):
        processes.run("synthnet", main)
