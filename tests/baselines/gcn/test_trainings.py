"""One network, several trainings: the share of the meshes, the protocols, the file of weights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from eigbench import errors
from eigbench.commands import cli
from eigbench.running import predictor
from eigbench.scoring import truth

import baselines.gcn
from baselines.gcn import trainings, weights
from baselines.gcn.configs import CONFIGS
from baselines.gcn.model import GCN
from baselines.gcn.sampled import Sampled, is_taken, load
from baselines.train_scale_free import TRAINED
from synthnet import recipe
from synthnet.errors import RecipeError
from synthnet.recipe.plan import plan_shards

CONFIG = CONFIGS["modern"]
VERSION = "2.0-mini"
BASELINES = Path(baselines.gcn.__file__).parent.parent


@pytest.fixture(scope="module")
def sampled():
    """All shapes of 2.0-mini, without their graphs."""
    planned = [shape for plan in plan_shards(recipe.load(VERSION)) for shape in plan.shapes]
    return Sampled(
        graphs=[],
        y=torch.zeros(0),
        isometries=torch.zeros(0),
        splits=np.array([shape.split for shape in planned]),
        paper_splits=np.array([shape.paper_splits for shape in planned]),
        version=VERSION,
        digest="",
        ids=tuple(shape.spec.id for shape in planned),
    )


@pytest.mark.parametrize(
    "protocol", ["grouped", "resolution", "genus", "boundary", "family/dented_cone"]
)
@pytest.mark.parametrize("split", ["train", "validation"])
def test_a_training_uses_what_its_protocol_leaves(sampled, split, protocol):
    instances = sampled.instances(split, protocol)
    ids = {f"{sampled.ids[shape]}/{instance}" for shape, instance in instances.tolist()}
    assert ids == set(truth.load(VERSION, split, protocol).ids)


def test_a_protocol_that_is_not_there(sampled):
    with pytest.raises(RecipeError, match=r"protocol of 2\.0-mini must be one of .*'mine'"):
        sampled.instances("train", "mine")


def test_meshes_of_every_size_cost_about_the_same():
    ids = [f"blob-{i:05d}" for i in range(4000)]
    for n in (500, 1000, 4000, 20_000):
        taken = sum(is_taken(id, n, 1000) for id in ids)
        share = min(1, 1000 / n)
        assert abs(taken - len(ids) * share) <= 4 * np.sqrt(len(ids) * share * (1 - share))


def test_a_share_is_loaded_without_the_test_split(mini_home):
    shapes = load("1.0-mini", CONFIG.model, 600, root=str(mini_home))
    assert set(shapes.splits) == {"train", "validation"}
    sizes = [len(graph.features) for graph in shapes.graphs]
    assert len(sizes) == len(shapes.ids) == len(shapes.y) == len(shapes.isometries)
    for id, n in zip(shapes.ids, sizes, strict=True):
        assert is_taken(id, n, 600)
    toruses = [id for id in shapes.ids if id.startswith("torus")]
    assert len(toruses) == 36  # of 40, each of 600 vertices: a tenth is for the test


def run_of(path, seed, protocol, **changes):
    torch.manual_seed(seed)
    record = {
        "config": weights.describe(replace(CONFIG, **changes)),
        "version": "2.0",
        "protocol": protocol,
        "seed": 0,
        "minutes": 1.0 + seed,
        "steps": 700 + 400 * seed,
        "converged": True,
        "sessions": [{"device": "CPU", "processes": 1, "threads": 2, "minutes": 1.0}],
        "log": [],
        "losses": [],
    }
    weights.save_model(path, GCN(CONFIG.model), record)
    return path


@pytest.fixture
def gathered(tmp_path):
    runs = {
        f"2.0/{protocol}": run_of(tmp_path / f"{seed}.safetensors", seed, protocol)
        for seed, protocol in enumerate(("grouped", "genus"))
    }
    trainings.gather(tmp_path / "row.safetensors", runs, vertices=1000)
    return tmp_path / "row.py", runs


def test_each_training_answers_with_its_own_weights(gathered, meshes):
    file, runs = gathered
    answers = []
    for training, own in runs.items():
        row = trainings.load_row(str(file), "cpu", 0, training)
        model, _ = weights.load_model(own)
        for mine, expected in zip(row.parameters(), model.parameters(), strict=True):
            assert torch.equal(mine, expected)
        answers.append(row.predict(meshes))
    assert not np.allclose(*answers)


def test_meta_of_several_trainings(gathered):
    meta = trainings.meta(str(gathered[0]), "Mine")
    assert meta["name"] == "Mine"
    assert meta["training_data"].startswith("synthNet 2.0 train, what the protocol leaves of it")
    assert meta["training_cost"] == (
        "1 to 2 min each of 2 trainings: 700 to 1,100 steps of 16 meshes, until they had converged"
    )
    assert meta["hardware"] == "CPU, 1 × 2 threads"


def test_two_training_sets_of_the_same_meshes_are_one_training(gathered, tmp_path):
    _, runs = gathered
    more = {**runs, "2.0/twin": runs["2.0/genus"]}
    trainings.gather(tmp_path / "more.safetensors", more, vertices=1000)
    meta = trainings.meta(str(tmp_path / "more.py"), "Mine")
    assert "of 2 trainings" in meta["training_cost"]


def test_what_was_not_trained_is_one_line(gathered):
    file = str(gathered[0])
    line = r"no weights trained on 1\.0/grouped, only on 2\.0/grouped, 2\.0/genus$"
    with pytest.raises(weights.WeightsError, match=line):
        trainings.load_row(file, "cpu", 0, "1.0/grouped")
    with pytest.raises(weights.WeightsError, match="trained with seed 0 alone, not 1"):
        trainings.load_row(file, "cpu", 1, "2.0/genus")


def test_runs_of_two_configurations_are_refused(tmp_path):
    runs = {
        "2.0/grouped": run_of(tmp_path / "a.safetensors", 0, "grouped"),
        "2.0/genus": run_of(tmp_path / "b.safetensors", 1, "genus", epochs=3),
    }
    with pytest.raises(weights.WeightsError, match="of several configurations"):
        trainings.gather(tmp_path / "row.safetensors", runs)
    assert not (tmp_path / "row.safetensors").exists()


@pytest.mark.parametrize("protocol", TRAINED)
def test_the_row_of_the_board_answers_for_each_training(protocol, meshes):
    row = predictor.load(BASELINES / "gcn_scale_free.py", training=f"2.0/{protocol}")
    answers = row.predict(meshes)
    assert answers.shape == (len(meshes), 10)
    assert (answers > 0).all()
    assert row.parameters == 199_306


@pytest.mark.slow
def test_the_row_of_the_board_can_be_checked(capsys):
    # The check asks for the training of 1.0, as it does of every predictor. The network's
    # eigenvalues do not all ascend, as the board says too: that is a finding, so the code is 1.
    assert cli.main(["check", str(BASELINES / "gcn_scale_free.py")]) == 1
    out = capsys.readouterr().out
    assert "gcn_scale_free.py: loads and answers in shape" in out
    assert "\n  answers that do not ascend" in out


def test_the_row_of_the_board_names_its_trainings():
    with pytest.raises(errors.PredictorError) as caught:
        predictor.load(BASELINES / "gcn_scale_free.py", training="1.0/paper")
    assert "no weights trained on 2.0/paper, only on 2.0/grouped" in str(caught.value)
    trained = ", ".join(f"2.0/{protocol}" for protocol in TRAINED)
    assert f"only on {trained} (" in str(caught.value)
