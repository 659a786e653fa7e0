import errno
import math
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import torch
from eigbench.scoring import losses
from rich.console import Console

import baselines.gcn
from baselines.gcn import train, weights
from baselines.gcn.configs import CONFIGS, MODERN, PAPER, SCALE_FREE, TrainConfig
from baselines.gcn.data import Shapes, encoder
from baselines.gcn.model import GCN, GCNConfig
from baselines.gcn.objective import LOSSES, eigenvalues, predict
from baselines.gcn.predictor import Row, title
from baselines.gcn.run import CHECKPOINT, LOG, Run, TrainingError, random_isometries, random_signs
from synthnet.errors import BuildError
from synthnet.types import Mesh

ROOT = Path(baselines.gcn.__file__).parent.parent.parent
QUIET = Console(quiet=True)


@pytest.fixture(scope="session")
def shapes(samples):
    def encode(config):
        splits = np.array(["validation", "test"] + ["train"] * (len(samples) - 2))
        return Shapes(
            [encoder(config)(sample.mesh) for sample in samples],
            torch.from_numpy(np.array([s.eigenvalues for s in samples], np.float32)),
            torch.from_numpy(np.array([s.isometries for s in samples], np.float32)),
            splits,
            np.repeat(splits[:, None], 9, axis=1),
            "tiny",
            "digest",
        )

    return encode


@pytest.fixture
def make(shapes, tmp_path):
    """Return a function that begins a run and takes some steps."""

    def run(config, out=tmp_path, seed=0, steps=0):
        cpu = torch.device("cpu")
        encoded = shapes(config.model)
        begun = Run(config, encoded, protocol="grouped", seed=seed, out=out, device=cpu)
        advance(begun, steps)
        return begun

    return run


def advance(run, steps):
    for _ in range(steps):
        run.step()


@pytest.fixture
def row(make):
    """The row of a run that took no step."""
    run = make(STORED)
    run.finish()
    return Row(run.out / "weights.safetensors")


SMALL = {"epochs": 2, "batch_size": 6}
STORED = replace(PAPER["table2-alg-virtual"], **SMALL)
RANDOM = replace(MODERN, epochs=9, batch_size=3)
AVERAGED = replace(SCALE_FREE["table2-alg-virtual-scale-free"], epochs=9, batch_size=3)


def flattened(*networks):
    return torch.cat([p.detach().flatten() for network in networks for p in network.parameters()])


def flat(run):
    return flattened(run.model, run.averaged)


# Configurations


def test_the_papers_schedules():
    assert len(PAPER) > 3
    for name, config in PAPER.items():
        first = name.startswith("table1")
        assert (config.learning_rate, config.epochs, config.batch_size) == (
            (1e-3, 200, 32) if first else (1e-4, 400, 16)
        )
        assert (config.optimiser, config.momentum, config.weight_decay) == ("sgd", 0.9, 1e-5)
        assert (config.schedule, config.isometries, config.clip) == ("constant", "stored", 0)


def test_every_row_of_the_papers_tables():
    assert {name: c.loss for name, c in PAPER.items() if name.startswith("table1")} == {
        "table1-polar": "polar",
        "table1-rpd": "rpd",
        "table1-l1": "l1",
    }
    networks = [c.model for name, c in PAPER.items() if not name.startswith("table1")]
    rows = {(m.encoding, m.virtual_node, m.blocks) for m in networks}
    table2 = {("none", True), ("A", False), ("A", True), ("ALG", False), ("ALG", True)}
    table3 = {("A", virtual, blocks) for virtual in (False, True) for blocks in (4, 5)}
    assert rows == {(*row, 3) for row in table2} | table3
    assert len(networks) == len(rows)


@pytest.mark.parametrize("name", CONFIGS)
def test_a_configuration_survives_its_record(name):
    record = {"config": weights.describe(CONFIGS[name])}
    assert weights.config_of(record) == CONFIGS[name]


def test_names_of_rows_differ():
    assert len({title(config) for config in CONFIGS.values()}) == len(CONFIGS)


# Steps


@pytest.mark.parametrize(
    "config",
    [pytest.param(STORED, marks=pytest.mark.slow), RANDOM, AVERAGED],
    ids=["stored", "random", "averaged"],
)
def test_a_resumed_run_ends_with_the_same_weights(config, make, tmp_path):
    whole = make(config, tmp_path / "whole")
    (tmp_path / "whole").mkdir()
    advance(whole, whole.total)
    (tmp_path / "parts").mkdir()
    for stop in (1, whole.total // 2, whole.total):
        part = make(config, tmp_path / "parts")
        if stop > 1:
            part.resume()
        advance(part, stop - part.progressed.steps)
        part.save()
    assert torch.equal(flat(whole), flat(part))
    logs = [
        [{k: v for k, v in row.items() if k != "minutes"} for row in run.progressed.log]
        for run in (whole, part)
    ]
    assert logs[0] == logs[1]
    assert sum("validation_rpd" in row for row in logs[0]) == config.epochs


def logged(run):
    """The steps that a run's log has, and those of them that were scored."""
    log = run.progressed.log
    assert run.validated() == log[-1]
    return [row["steps"] for row in log], [r["steps"] for r in log if "validation_rpd" in r]


def test_log_has_every_tenth_step_and_scores_of_every_epoch(make):
    run = make(STORED)
    advance(run, 2 * run.per_epoch)
    steps, scored = logged(run)
    assert scored == [run.per_epoch, 2 * run.per_epoch]
    assert steps == sorted({*range(10, 2 * run.per_epoch + 1, 10), *scored})


@pytest.mark.parametrize("config", [STORED, RANDOM])
def test_last_bias_is_the_mean_training_spectrum(config, make):
    run = make(config)
    shapes = sorted(set(run.instances[:, 0].tolist()))
    with torch.no_grad():
        run.model.head[-1].weight.zero_()
    predictions = predict(run.model, [run.shapes.graphs[i] for i in shapes])
    y = run.shapes.y[shapes]
    if config.model.scale_free:
        areas = torch.cat([run.shapes.graphs[i].areas for i in shapes])[:, None]
        predictions, y = predictions * areas, y * areas
    assert predictions == pytest.approx(y.log().mean(dim=0).exp().expand_as(predictions), rel=1e-2)


def test_rpd_has_no_gradient_where_an_output_is_negative():
    p = torch.tensor([[-1.0, 1.0]], requires_grad=True)
    losses.rpd_loss(p, torch.tensor([[2.0, 2.0]])).backward()
    assert p.grad is not None
    assert p.grad[0, 0].abs() < 1e-8 < p.grad[0, 1].abs()


def test_long_log_is_thinned(make, monkeypatch):
    monkeypatch.setattr(baselines.gcn.run, "ROWS", 3)
    run = make(replace(STORED, epochs=4))
    advance(run, 4 * run.per_epoch)
    steps, scored = logged(run)
    assert steps == sorted(steps)
    assert scored == [run.per_epoch * epoch for epoch in (1, 2, 3, 4)]
    assert 1 <= len(steps) - len(scored) <= 3


def test_seeds_differ(make):
    first, same, other = (flat(make(STORED, seed=seed, steps=1)) for seed in (0, 0, 1))
    assert torch.equal(first, same)
    assert not torch.equal(first, other)


def test_an_epoch_is_every_instance_once(make):
    run = make(STORED)
    seen = []
    for step in range(run.per_epoch):
        shapes, isometries = run.batch(step)
        for shape, isometry in zip(shapes, isometries, strict=True):
            stored = run.shapes.isometries[shape]
            (instance,) = torch.nonzero((stored == isometry).all(dim=(1, 2))).flatten().tolist()
            seen.append((shape, instance))
    assert sorted(seen) == [tuple(pair) for pair in run.instances.tolist()]
    assert len(seen) == 72


@pytest.mark.parametrize(
    "name", ["rpd", *(pytest.param(n, marks=pytest.mark.slow) for n in LOSSES if n != "rpd")]
)
def test_training_lowers_the_loss(name, make):
    run = make(replace(RANDOM, loss=name, epochs=60, batch_size=6, schedule="constant"))
    advance(run, run.total)
    losses = [row["loss"] for row in run.progressed.log]
    assert np.mean(losses[-5:]) < 0.8 * losses[0]


def test_one_cycle_rises_and_falls_to_nothing(make):
    run = make(replace(RANDOM, epochs=50))
    rates = [run.rate(step) for step in range(run.total)]
    top = rates.index(max(rates))
    assert max(rates) == pytest.approx(RANDOM.learning_rate)
    assert rates[: top + 1] == sorted(rates[: top + 1])
    assert rates[top:] == sorted(rates[top:], reverse=True)
    assert rates[-1] < 0.01 * RANDOM.learning_rate


def test_a_trapezoid_rises_stays_falls_and_stays(make):
    run = make(AVERAGED)
    rates = [run.rate(step) for step in (0, 299, 2500, 3750, 5000, 50_000)]
    assert rates == pytest.approx([1e-3 / 300, 1e-3, 1e-3, 5.01e-4, 2e-6, 2e-6])


def test_large_meshes_are_drawn_less_often(make):
    run = make(replace(AVERAGED, vertices=20, batch_size=1))
    trained = run.instances[:, 0].tolist()
    sizes = np.array([len(run.shapes.graphs[i].features) for i in trained])
    shares = np.minimum(1, 20 / sizes)
    assert min(shares) < 0.5 * max(shares)
    assert run.per_epoch == int(shares.sum())
    counts = np.zeros(len(run.shapes.graphs))
    for step in range(4000):
        shapes, isometries = run.batch(step)
        counts[shapes] += 1
        assert torch.equal(isometries.abs(), torch.eye(3)[None])
    np.testing.assert_allclose(counts[trained] / 4000, shares / shares.sum(), rtol=0.2)


def test_the_average_is_of_the_last_steps(make):
    run = make(AVERAGED)
    weights = []
    for _ in range(12):
        run.step()
        weights.append(next(run.model.parameters()).detach().clone())
    share = np.array([10 / (9 + t) for t in range(1, 13)])
    left = np.append(np.cumprod((1 - share)[::-1])[::-1][1:], 1.0)
    expected = sum(w * float(s * rest) for w, s, rest in zip(weights, share, left, strict=True))
    torch.testing.assert_close(next(run.averaged.parameters()).detach(), expected)


@pytest.mark.parametrize(
    ("rpd", "expected"),
    [
        ([0.5, 0.4, 0.3, 0.297], True),  # the last quarter gains 1 %
        ([0.5, 0.4, 0.3, 0.29], False),  # 3 %
        ([0.5, 0.4, 0.3, 0.35], True),  # or nothing
    ],
)
def test_a_run_has_converged_when_its_last_quarter_gains_little(make, rpd, expected):
    run = make(AVERAGED)
    run.progressed.log = [
        {"steps": 3400 * (i + 1), "validation_rpd": value} for i, value in enumerate(rpd)
    ]
    assert run.converged() == expected
    run.progressed.log = [{**row, "steps": row["steps"] / 4} for row in run.progressed.log]
    assert not run.converged()  # too short a run says nothing


def test_random_isometries_are_orthogonal_and_of_both_kinds():
    drawn = random_isometries(64, torch.Generator().manual_seed(0))
    torch.testing.assert_close(drawn @ drawn.mT, torch.eye(3).expand(64, 3, 3), atol=1e-5, rtol=0)
    signs = torch.linalg.det(drawn).round()
    assert set(signs.tolist()) == {-1.0, 1.0}
    assert abs(drawn.mean()) < 0.1


def test_signs_are_of_all_eight_kinds():
    drawn = random_signs(64, torch.Generator().manual_seed(0))
    assert torch.equal(drawn.abs(), torch.eye(3).expand(64, 3, 3))
    assert len({tuple(torch.diagonal(signs).tolist()) for signs in drawn}) == 8


def test_time_is_up(make, tmp_path):
    run = make(STORED)
    assert train.loop(run, 1e-9, QUIET) == "time is up"
    run.save()
    again = make(STORED)
    again.resume()
    assert train.loop(again, None, QUIET) == "done"
    assert again.progressed.steps == again.total
    again.save()
    _, *rows = (tmp_path / LOG).read_text().splitlines()
    assert sum(not row.endswith(",") for row in rows) == STORED.epochs


def test_training_ends_when_the_run_has_converged(make):
    run = make(AVERAGED, steps=1)
    run.progressed.log = [{"steps": n, "validation_rpd": 0.3} for n in (9000, 13_400)]
    assert train.loop(run, None, QUIET) == "converged"
    assert run.progressed.steps == 1


# Files


@pytest.mark.parametrize("config", [RANDOM, AVERAGED], ids=["last", "averaged"])
def test_weights_are_what_is_scored(config, make, meshes, tmp_path):
    run = make(config, steps=12)
    run.finish()
    row = Row(tmp_path / "weights.safetensors")
    assert row.record["steps"] == 12
    assert row.model.config == config.model
    answers = row.predict(meshes)
    assert answers.shape == (len(meshes), 10)
    assert torch.equal(flattened(row), flattened(run.averaged).half().float())


@pytest.mark.parametrize("name", ["table3-a-5-virtual", "table2-alg"])
def test_weights_of_the_largest_network_are_below_2_mb(name, tmp_path):
    path = tmp_path / "w.safetensors"
    weights.save_model(path, GCN(CONFIGS[name].model), {"config": weights.describe(CONFIGS[name])})
    assert path.stat().st_size < 2e6


def test_a_checkpoint_of_another_run_is_refused_and_kept(make, tmp_path):
    make(STORED).save()
    before = (tmp_path / CHECKPOINT).read_bytes()
    other = replace(STORED, model=replace(STORED.model, blocks=4))
    with pytest.raises(TrainingError, match=r"another run: its config is model blocks 3, not 4"):
        make(other).resume()
    with pytest.raises(TrainingError, match="its seed is 0, not 1"):
        make(STORED, seed=1).resume()
    half = make(STORED)
    half.dtype = torch.bfloat16
    with pytest.raises(TrainingError, match="its dtype is 'float32', not 'bfloat16'"):
        half.resume()
    assert (tmp_path / CHECKPOINT).read_bytes() == before


@pytest.mark.parametrize("lost", ["steps", "optimiser"])
def test_a_checkpoint_that_lacks_something(lost, make, tmp_path):
    run = make(RANDOM, steps=1)
    run.save()
    tensors, record = weights.read(tmp_path / CHECKPOINT)
    kept = {name: t for name, t in tensors.items() if not name.startswith(f"{lost}.3.")}
    weights.write(tmp_path / CHECKPOINT, kept, {k: v for k, v in record.items() if k != lost})
    with pytest.raises(weights.WeightsError, match=r"is damaged: it lacks (a part|'steps')"):
        make(RANDOM).resume()


def test_a_run_keeps_what_each_session_ran_on(make):
    for count in (1, 2, 3):
        run = make(STORED)
        run.threads = count
        if count > 1:
            run.resume()
        run.step()
        run.save()
    assert [session["threads"] for session in run.record()["sessions"]] == [1, 2, 3]


def test_a_loss_that_is_no_number_stops_before_the_step(make, tmp_path):
    run = make(STORED)
    run.save()
    kept, before = (tmp_path / CHECKPOINT).read_bytes(), flat(run)
    run.shapes.y.fill_(float("nan"))
    with pytest.raises(TrainingError, match="the loss is nan at step 0: the last checkpoint"):
        run.step()
    assert torch.equal(flat(run), before)
    assert (tmp_path / CHECKPOINT).read_bytes() == kept


def test_weights_too_large_for_half_precision(make, tmp_path):
    run = make(STORED)
    with torch.no_grad():
        run.model.head[0].weight[0, 0] = 1e6
    with pytest.raises(weights.WeightsError, match="training has diverged"):
        run.finish()
    assert not (tmp_path / "weights.safetensors").exists()


def test_a_full_disk_is_one_line(make, monkeypatch):
    run = make(STORED)
    full = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(Path, "write_bytes", Mock(side_effect=full))
    with pytest.raises(BuildError, match=r"no space left for .*checkpoint\.safetensors"):
        run.save()


def test_no_meshes_have_no_eigenvalues(row):
    assert row.predict([]).shape == (0, 10)


@pytest.mark.parametrize("name", ["loss", "optimiser", "schedule", "isometries"])
def test_unknown_words_of_a_configuration(name):
    with pytest.raises(ValueError, match=f"{name} must be one of .*, got 'other'"):
        TrainConfig(**{name: "other"})


def test_weights_of_another_model(tmp_path):
    path = tmp_path / "w.safetensors"
    weights.save_model(path, GCN(GCNConfig("A")), {"config": weights.describe(CONFIGS["modern"])})
    with pytest.raises(weights.WeightsError, match="is of another model"):
        weights.load_model(path)


@pytest.mark.parametrize("content", [b"", b"no weights", b"\x08" + bytes(7) + b"{}      "])
def test_missing_and_damaged_weights(content, tmp_path):
    path = tmp_path / "w.safetensors"
    with pytest.raises(weights.WeightsError, match="there is no file"):
        weights.load_model(path)
    path.write_bytes(content)
    with pytest.raises(weights.WeightsError, match="is damaged, or no file of this program"):
        weights.load_model(path)


# The scale-free network


def test_a_scale_free_network_obeys_scaling(make, meshes):
    run = make(RANDOM, steps=1)
    run.finish()
    row = Row(run.out / "weights.safetensors")
    doubled = [Mesh(2.0 * mesh.vertices.astype(np.float64), mesh.faces) for mesh in meshes]
    np.testing.assert_allclose(row.predict(doubled), row.predict(meshes) / 4, rtol=1e-4)


def test_outputs_of_zero_are_weyls_law():
    values = eigenvalues(torch.zeros(1, 10), torch.tensor([2.0]), GCNConfig(scale_free=True))
    assert values[0].tolist() == pytest.approx([2 * math.pi * i for i in range(1, 11)])


# Bad meshes


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (Mesh(np.eye(3), np.array([[0, 1, 2]])), "mesh 0 has 3 vertices: 10 eigenvalues"),
        (Mesh(np.random.default_rng(0).normal(size=(12, 3)), np.zeros((0, 3), int)), "no faces"),
        (Mesh(np.full((12, 3), np.nan), np.array([[0, 1, 2]])), "mesh 0: vertex 0 is .*finite"),
        (Mesh(np.eye(12, 3), np.array([[0, 1, 1]])), "mesh 0: face 0 has no area"),
    ],
    ids=["one triangle", "no faces", "nan", "no area"],
)
def test_bad_meshes(mesh, message, row):
    with pytest.raises(ValueError, match=message):
        row.predict([mesh])


# The command line


def refused(capsys, *arguments):
    assert train.main([str(a) for a in arguments]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    return lines[0]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--config", "table9"], "there is no configuration 'table9': choose one of table1-polar"),
        (["--epochs", "0"], "--epochs must be positive, got 0"),
        (["--max-minutes", "-1"], "--max-minutes must be positive, got -1.0"),
        (["--max-minutes", "nan"], "--max-minutes must be positive, got nan"),
        (["--seed", "-1"], "--seed must be 0 to 2**63 - 1, got -1"),
        (["--device", "tpu"], "--device must be cpu or cuda, got 'tpu'"),
        (["--resume"], "has no checkpoint: leave --resume out to begin"),
    ],
)
def test_bad_options_are_one_line(arguments, message, capsys, tmp_path):
    assert message in refused(capsys, "--config", "modern", "--out", tmp_path, *arguments)


def test_weights_without_a_checkpoint_are_kept(capsys, tmp_path):
    (tmp_path / "weights.safetensors").write_text("keep")
    assert "has weights.safetensors of another run: choose another --out" in refused(
        capsys, "--config", "modern", "--out", tmp_path
    )
    assert (tmp_path / "weights.safetensors").read_text() == "keep"


@pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without CUDA")
def test_cuda_that_is_not_there(capsys, tmp_path):
    arguments = ("--config", "modern", "--device", "cuda", "--out", tmp_path)
    assert "no CUDA device is available: use --device cpu" in refused(capsys, *arguments)


def test_memory_of_a_gpu_that_is_full(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(train, "train", Mock(side_effect=torch.OutOfMemoryError))
    message = refused(capsys, "--config", "modern", "--batch-size", 64, "--out", tmp_path)
    assert "does not hold a batch of 64: choose a smaller --batch-size" in message


def launch(home, *arguments, processes=1):
    start = ["-m", "torch.distributed.run", "--standalone", f"--nproc-per-node={processes}", "-m"]
    return subprocess.run(
        [sys.executable, *(start if processes > 1 else ["-m"]), "baselines.gcn.train"]
        + [str(a) for a in (*arguments, "--version", "1.0-mini", "--data", home, "--threads", 1)],
        cwd=ROOT,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
def test_two_processes_train_as_one_does(mini_home, tmp_path):
    parameters = []
    for processes in (1, 2):
        out = tmp_path / str(processes)
        options = ("--config", "table2-a", "--epochs", 1, "--batch-size", 500, "--out", out)
        done = launch(mini_home, *options, processes=processes)
        assert done.returncode == 0, done.stderr
        tensors, record = weights.read(out / CHECKPOINT)
        assert record["sessions"][0]["processes"] == processes
        assert record["steps"] > 1
        parameters.append(
            torch.cat([t.flatten() for n, t in tensors.items() if n.startswith("model.")])
        )
    torch.testing.assert_close(parameters[0], parameters[1], rtol=1e-4, atol=1e-6)


@pytest.mark.slow
def test_the_command_stops_and_goes_on(mini_home, tmp_path):
    options = ("--config", "modern", "--epochs", 1, "--batch-size", 100, "--out", tmp_path / "run")
    stopped = launch(mini_home, *options, "--max-minutes", 1e-6)
    assert stopped.returncode == 0, stopped.stderr
    assert re.search(r"^0 of 2 steps, .*; --resume goes on: ", stopped.stdout)
    twice = launch(mini_home, *options)
    assert twice.returncode == 2
    assert "has a checkpoint: add --resume to go on with it" in twice.stderr
    done = launch(mini_home, *options, "--resume")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("2 of 2 steps, ")
    assert Row(tmp_path / "run" / "weights.safetensors").record["version"] == "1.0-mini"
