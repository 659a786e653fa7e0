"""Measurements: how sides are timed, and that a small measurement runs from the command."""

import argparse
import json
import os
from inspect import Parameter, signature
from itertools import count

import pytest

from evidence import build_memory, installation, measurements, numbers, thin_meshes, timing
from evidence.__main__ import main, parser
from evidence.measurements import FILES, MEASUREMENTS, add_options


def test_sides_are_called_in_turn_and_medians_are_returned():
    called = []
    ticks = iter([0, 1, 1, 3, 3, 13, 13, 14, 14, 16, 16, 20])  # 1, 2; 10, 1; 2, 4
    timed = timing.in_turn(
        {"a": lambda: called.append("a") or len(called), "b": lambda: called.append("b")},
        3,
        clock=lambda: next(ticks),
    )
    assert called == ["a", "b", "b", "a", "a", "b"]
    assert timed["a"] == (1, 5)
    assert timed["b"] == (4, None)
    assert next(ticks, None) is None


def test_the_last_side_can_begin():
    called = []
    sides = {name: lambda name=name: called.append(name) for name in "ab"}
    timing.in_turn(sides, backwards=True, clock=count().__next__)
    assert called == ["b", "a"]


def test_a_new_process_has_its_environment_and_this_one_keeps_its_own():
    assert (
        timing.in_new_process(os.getenv, "EVIDENCE_TEST", environment={"EVIDENCE_TEST": "1"}) == "1"
    )
    assert "EVIDENCE_TEST" not in os.environ
    assert timing.in_new_process(os.getpid) != os.getpid()


def test_a_measurement_writes_its_numbers_and_the_machine(tmp_path, capsys):
    path = tmp_path / "solver.json"
    small = ["--shapes", "2", "--spheres", "1", "--repeats", "1"]
    assert main(["measure", "solver", *small, "--out", str(path)]) == 0
    assert "split spheres alone" in capsys.readouterr().out
    written = json.loads(path.read_text())
    assert [row["number"] for row in written["rows"][-2:]] == [2, 1]
    assert written["machine"]["packages"]["numpy"]
    assert MEASUREMENTS["solver"].table(written).count("\n") == len(written["rows"]) + 1


@pytest.mark.parametrize("name", ["ratios", pytest.param("two-numbers", marks=pytest.mark.slow)])
def test_numbers_that_follow_from_committed_files_are_those_that_are_written(name):
    written = numbers.read(name)
    del written["machine"]
    measured = json.loads(json.dumps(MEASUREMENTS[name].measure()))
    assert list(measured) == list(written)
    one, other = (flattened(numbers) for numbers in (measured, written))
    assert [key for key, _ in one] == [key for key, _ in other]
    for (key, value), (_, expected) in zip(one, other, strict=True):
        assert value == expected or value == pytest.approx(expected, rel=1e-3), key


def flattened(value, key=""):
    """Return the leaves of lists and dicts of lists and dicts, and the keys that lead there."""
    if not isinstance(value, dict | list):
        return [(key, value)]
    items = value.items() if isinstance(value, dict) else enumerate(value)
    return [leaf for name, part in items for leaf in flattened(part, f"{key}/{name}")]


def test_a_measurement_with_fewer_options_does_not_replace_one_with_more(monkeypatch, tmp_path):
    monkeypatch.setattr(measurements, "DATA", tmp_path)
    monkeypatch.setattr(numbers, "DATA", tmp_path)
    whole = {"rows": [{"largest difference": 0.0}] * 2, "figure2": {"s": 1.0}}
    lacking = [{**whole, "rows": whole["rows"][:1]}, {**whole, "figure2": None}]
    results = iter([whole, whole, *lacking])
    monkeypatch.setattr(MEASUREMENTS["solver"], "measure", lambda: next(results))
    assert main(["measure", "solver"]) == main(["measure", "solver"]) == 0
    file, partial = (tmp_path / f"solver{suffix}.json" for suffix in ("", ".partial"))
    kept = file.read_bytes()
    assert not partial.exists()
    for less in lacking:
        assert main(["measure", "solver"]) == 1
        assert file.read_bytes() == kept
        assert json.loads(partial.read_text()).items() >= less.items()


def test_wrong_numbers_are_named_and_nothing_is_written_on_request(monkeypatch, capsys):
    def measure():
        return {"rows": [{"meshes": "torus", "largest difference": 1e-3}]}

    monkeypatch.setattr(MEASUREMENTS["solver"], "measure", measure)
    monkeypatch.setattr(numbers, "write", None)
    assert main(["measure", "solver", "--out", "-"]) == 1
    assert capsys.readouterr().err == "WRONG: torus: eigenvalues differ by 1e-03\n"


@pytest.mark.parametrize("name", ["faults", "missed"])
def test_a_part_does_not_take_the_place_of_the_whole(name, monkeypatch, capsys):
    monkeypatch.setattr(MEASUREMENTS[name], "measure", lambda *, only=(): {"rows": []})
    monkeypatch.setattr(numbers, "write", None)
    assert main(["measure", name, "--only", "some"]) == 2
    assert "--only measures a part: give --out FILE" in capsys.readouterr().err
    assert main(["measure", name, "--only", "some", "--out", "-"]) == 0


@pytest.mark.parametrize(("here", "scales"), [(True, [1, 4]), (False, [1])])
def test_rows_are_kept_if_this_machine_measured_them(here, scales, monkeypatch):
    old = {"families": "all", "share": 1.0, "scale": 4}
    stored = {"rows": [old], "machine": numbers.machine() if here else {"hardware": "another"}}
    monkeypatch.setattr(numbers, "read", lambda name: stored)
    monkeypatch.setattr(build_memory, "in_new_process", lambda *_: {"scale": 1})
    assert [row["scale"] for row in build_memory.measure(scale=(1,))["rows"]] == scales


def test_another_seed_makes_other_strips(monkeypatch):
    seeds = []
    monkeypatch.setattr(thin_meshes, "thin", lambda aspect, kind, seed: seeds.append(seed))
    monkeypatch.setattr(thin_meshes, "judge", lambda mesh: None)
    for seed in (0, 1):
        thin_meshes.measure(cases=8, seed=seed)
    assert seeds == [*range(16)]


def test_numbers_are_written_as_they_are(tmp_path):
    data = {"rows": [{"name": "a [1,  2]", "list": [1.5, 2.0]}], "none": []}
    numbers.write(tmp_path / "a.json", data)
    text = (tmp_path / "a.json").read_text()
    written = json.loads(text)
    assert {name: written[name] for name in data} == data
    assert '"list": [1.5, 2.0]' in text


@pytest.mark.parametrize("name", MEASUREMENTS)
def test_every_measurement_has_its_options(name):
    needed = {"limits": ["1.0"], "shapes": ["2.0"], "multilevel": ["real-28"]}
    needed |= {"packages": ["meshes"]}
    options = vars(parser().parse_args(["measure", name, *needed.get(name, ())]))
    assert options["out"] is None
    FILES.get(name, name).format_map(options)
    parameters = signature(MEASUREMENTS[name].measure).parameters
    for key, parameter in parameters.items():
        assert parameter.default in (Parameter.empty, options[key])


def test_parameters_become_options():
    def measure(*, source, scale=(1, 4), only=(), all=False):
        """Take one option of each kind."""

    command = argparse.ArgumentParser()
    add_options(command, measure)
    assert vars(command.parse_args(["a"])) == {
        "source": "a",
        "scale": (1, 4),
        "only": (),
        "all": False,
    }
    given = command.parse_args(["a", "--scale", "2", "--only", "b", "c", "--all"])
    assert (given.scale, given.only, given.all) == ([2], ["b", "c"], True)


def test_an_installation_that_replaces_torch_is_wrong():
    kept = {"torch": "CPU", "before": "2.13.0+cpu", "after": "2.13.0+cpu", "bytes": 2_940_000_000}
    replaced = {"torch": "CUDA", "before": "2.4.0", "after": "2.13.0", "bytes": 7_000_000_000}
    data = {"extras": "all", "rows": [kept, replaced]}
    assert installation.problems(data) == ["torch 2.4.0 became 2.13.0"]
    assert installation.sizes(data) == "2.9 GB with a CPU torch, 7.0 GB with a CUDA torch"
