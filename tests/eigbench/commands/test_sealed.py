"""Scores on a sealed set: the very numbers of its labels, and only with the set of the seal."""

import hashlib
import json
import shutil

import numpy as np
import pytest
from eigbench import results
from eigbench.board.ranking import RANKED_BY
from eigbench.results import predictions
from eigbench.scoring import scores, truth

from synthnet import store
from synthnet.verify import seal


@pytest.fixture(scope="module")
def sealed_truth(sealed_set):
    return truth.of_dataset(store.open_dataset(sealed_set.seal.dataset, sealed_set.home))


@pytest.fixture
def answers(sealed_truth, tmp_path):
    """A file of predictions, each off by a part of its own."""
    rng = np.random.default_rng(0)
    found = sealed_truth.eigenvalues * rng.uniform(0.8, 1.2, sealed_truth.eigenvalues.shape)
    predictions.write(tmp_path / "answers.parquet", sealed_truth, found[None])
    return tmp_path / "answers.parquet"


@pytest.fixture
def score(eigbench, sealed_set, answers):
    def run(*more, published=sealed_set.published, root=sealed_set.home):
        return eigbench("score", answers, "--sealed", published, "--root", root, *more)

    return run


def only_line(code, out, err):
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    return err


def test_score_is_that_of_the_labels(score, sealed_truth, sealed_set, answers):
    code, out, err = score("--json")
    assert (code, err) == (0, "")
    said = json.loads(out)
    values = predictions.read(answers, sealed_truth)
    assert said["scores"] == json.loads(json.dumps(scores.of_targets(sealed_truth, values)))
    assert said["scores"]["mesh"]["overall"][RANKED_BY]["mean"] > 0.01
    assert said["dataset"]["version"] == sealed_set.seal.dataset
    assert said["dataset"]["recipe_digest"] == sealed_set.seal.recipe_digest
    assert said["dataset"]["shapes"] == sum(sealed_set.seal.kept.values())


def test_score_is_the_same_by_the_name_of_the_set(eigbench, score, sealed_set, answers):
    where = ["--dataset", sealed_set.seal.dataset, "--root", sealed_set.home, "--json"]
    assert eigbench("score", answers, *where) == score("--json")


def test_predictor_of_a_sealed_set_is_trained_on_the_version_it_was_drawn_from(sealed_truth):
    assert set(sealed_truth.trainings) == {"1.0/grouped"}


def test_set_that_is_not_here_is_one_line(score, sealed_set, tmp_path):
    line = only_line(*score(root=tmp_path))
    assert f"the sealed set {sealed_set.seal.dataset} is not in {tmp_path}" in line
    assert "make it with its salt, by `synthnet seal` or `synthnet verify --sealed`" in line


def test_seal_that_is_not_here_is_one_line(score, tmp_path):
    assert "there is no seal " in only_line(*score(published=tmp_path / "seal.json"))


def test_seal_of_other_meshes_is_refused(score, sealed_set, tmp_path):
    content = json.loads(sealed_set.published.read_text())
    del content["sha256"]
    content["meshes"] = "0" * 64
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    path = tmp_path / "seal.json"
    path.write_text(json.dumps({**content, "sha256": digest}, indent=1) + "\n")
    line = only_line(*score(published=path))
    assert "is not the set that was sealed: seal: its meshes is 000000000000…" in line


def test_labels_that_were_changed_are_refused(score, sealed_set, tmp_path):
    shutil.copytree(sealed_set.home, tmp_path / "home")
    name = sealed_set.seal.dataset
    dataset = store.open_dataset(name, tmp_path / "home")
    record = dataset.manifest.shards[0]
    samples = list(store.read_samples(dataset.directory / record.file))
    samples[0].eigenvalues[:] *= 2
    digest = dataset.manifest.recipe_digest
    family = record.family
    path = dataset.directory / record.file
    store.write_shard(path, samples, [], family=family, recipe_digest=digest)
    assert "is damaged: remove it and seal again" in only_line(*score(root=tmp_path / "home"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--dataset", "1.0"], "not allowed with argument --sealed"),
        (["--split", "train"], "has nothing in the split train"),
    ],
)
def test_what_a_sealed_set_has_not(score, more, message):
    assert message in only_line(*score(*more))


def test_predictions_of_the_version_are_not_of_the_set(eigbench, sealed_set, weyl):
    where = ["--sealed", sealed_set.published, "--root", sealed_set.home]
    assert " lacks " in only_line(*eigbench("score", weyl.predictions, *where))


def test_evaluate_runs_a_predictor_on_the_set_and_no_board_takes_it(
    eigbench, sealed_set, weyl, tmp_path
):
    out = tmp_path / "entry.json"
    where = ["--sealed", sealed_set.published, "--root", sealed_set.home]
    code, _, err = eigbench("evaluate", weyl.code, *where, "--no-reference", "--out", out)
    assert code == 0, err
    result = results.read(out)
    assert result["dataset"]["version"] == sealed_set.seal.dataset
    code, said, _ = eigbench("score", out.with_suffix(".parquet"), *where, "--json")
    assert code == 0
    assert json.loads(said)["scores"] == result["scores"]
    line = only_line(*eigbench("submit", out, "--board", tmp_path / "board"))
    assert f"is of the sealed set {sealed_set.seal.dataset}, which cannot be on a board" in line
    directory = sealed_set.home / sealed_set.seal.dataset
    code, said, _ = eigbench("compare", out, out, "--dataset", directory)
    assert code == 0
    assert "tie" in said


def test_nothing_that_is_published_of_a_score_tells_a_label(score, sealed_truth):
    said = score("--json")[1]
    labels = [repr(value)[:10] for value in sealed_truth.eigenvalues.ravel().tolist()]
    told = [*sealed_truth.shapes.tolist(), *sealed_truth.groups.tolist(), *labels]
    assert [one for one in set(told) if one in said] == []


def test_seal_is_checked_before_a_predictor_is_run(eigbench, sealed_set, predictor_file, tmp_path):
    code = predictor_file("raise SystemExit('was run')")
    where = ["--sealed", sealed_set.published, "--root", tmp_path, "--out", tmp_path / "r.json"]
    assert "the sealed set " in only_line(*eigbench("evaluate", code, *where))
    assert seal.read(sealed_set.published) == sealed_set.seal
