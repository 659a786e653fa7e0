"""Scores on a sealed set: those of its labels in few digits, and only with the set of the seal."""

import hashlib
import json
import shutil
import stat
from datetime import UTC, datetime

import numpy as np
import pytest
from eigbench import results
from eigbench.board.ranking import RANKED_BY
from eigbench.commands import queries
from eigbench.results import predictions
from eigbench.scoring import scores, targets, truth

from synthnet import store
from synthnet.verify import seal
from tests.conftest import only_line


@pytest.fixture(scope="module")
def sealed_truth(sealed_set):
    return truth.of_dataset(store.open_dataset(sealed_set.seal.dataset, sealed_set.home))


@pytest.fixture
def answers(sealed_truth, tmp_path):
    """A file of predictions, each off by a part of its own."""
    rng = np.random.default_rng(0)
    predicted = sealed_truth.eigenvalues * rng.uniform(0.8, 1.2, sealed_truth.eigenvalues.shape)
    predictions.write(tmp_path / "answers.parquet", sealed_truth, np.sort(predicted)[None])
    return tmp_path / "answers.parquet"


@pytest.fixture
def where(sealed_set):
    """The options that name the sealed set."""
    return ["--sealed", sealed_set.published, "--root", sealed_set.home]


@pytest.fixture
def directory(sealed_set):
    return sealed_set.home / sealed_set.seal.dataset


@pytest.fixture
def score(eigbench, where, answers):
    """Return a function that scores the answers: exit code, stdout and stderr."""
    return lambda *more: eigbench("score", answers, *where, *more)


@pytest.fixture
def entry(eigbench, where, weyl, tmp_path):
    """The result of a predictor that was evaluated on the sealed set."""
    out = tmp_path / "entry.json"
    code, _, err = eigbench("evaluate", weyl.code, *where, "--no-reference", "--out", out)
    assert code == 0, err
    return out


def test_score_is_that_of_the_labels(score, sealed_truth, sealed_set, answers):
    code, out, err = score("--json")
    assert (code, err) == (0, "")
    printed = json.loads(out)
    values = predictions.read(answers, sealed_truth)
    assert printed["scores"] == json.loads(json.dumps(scores.of_targets(sealed_truth, values)))
    assert printed["scores"]["mesh"]["overall"][RANKED_BY]["mean"] > 0.01
    whole = scores.score(targets.at(sealed_truth, "mesh"), values)["overall"][RANKED_BY]["mean"]
    assert printed["scores"]["mesh"]["overall"][RANKED_BY]["mean"] == float(f"{whole:.3g}") != whole
    assert printed["dataset"]["version"] == sealed_set.seal.dataset
    assert printed["dataset"]["recipe_digest"] == sealed_set.seal.recipe_digest
    assert printed["dataset"]["shapes"] == sum(sealed_set.seal.kept.values())


def test_score_is_the_same_by_the_name_of_the_set(eigbench, score, sealed_set, answers):
    where = ["--dataset", sealed_set.seal.dataset, "--root", sealed_set.home, "--json"]
    assert eigbench("score", answers, *where) == score("--json")


def test_predictor_of_a_sealed_set_is_trained_on_the_version_it_was_drawn_from(sealed_truth):
    assert set(sealed_truth.trainings) == {"1.0/grouped"}


def test_set_that_is_not_here_is_one_line(score, sealed_set, tmp_path):
    line = only_line(*score("--root", tmp_path))
    assert f"the sealed set {sealed_set.seal.dataset} is not in {tmp_path}" in line
    assert "make it with its salt, by `synthnet seal` or `synthnet verify --sealed`" in line


def test_seal_of_other_meshes_is_refused(score, sealed_set, tmp_path):
    content = json.loads(sealed_set.published.read_text())
    del content["sha256"]
    content["meshes"] = "0" * 64
    digest = hashlib.sha256(json.dumps(content).encode()).hexdigest()
    path = tmp_path / "seal.json"
    path.write_text(json.dumps({**content, "sha256": digest}, indent=1) + "\n")
    line = only_line(*score("--sealed", path))
    assert "is not the set that was sealed: seal: its meshes is 000000000000…" in line


def test_labels_that_were_changed_are_refused(score, sealed_set, tmp_path):
    shutil.copytree(sealed_set.home, tmp_path / "home")
    dataset = store.open_dataset(sealed_set.seal.dataset, tmp_path / "home")
    record = dataset.manifest.shards[0]
    samples = list(store.read_samples(dataset.directory / record.file))
    samples[0].eigenvalues[:] *= 2
    facts = {"family": record.family, "recipe_digest": dataset.manifest.recipe_digest}
    store.write_shard(dataset.directory / record.file, samples, [], **facts)
    assert "is damaged: remove it and seal again" in only_line(*score("--root", tmp_path / "home"))


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--dataset", "1.0", "not allowed with argument --sealed"),
        ("--split", "train", "has nothing in the split train"),
        ("--sealed", "none.json", "there is no seal "),
    ],
)
def test_what_is_no_sealed_set_or_not_in_it_is_one_line(score, option, value, message):
    assert message in only_line(*score(option, value))


def test_predictions_of_the_version_are_not_of_the_set(eigbench, sealed_set, where, weyl):
    line = only_line(*eigbench("score", weyl.predictions, *where))
    assert f"it is of 1.0-mini, test, grouped, not of {sealed_set.seal.dataset}, test" in line


def test_evaluate_runs_a_predictor_on_the_set_and_no_board_takes_it(
    eigbench, printed, sealed_set, where, directory, entry, tmp_path
):
    result = results.read(entry)
    assert result["dataset"]["version"] == sealed_set.seal.dataset
    scored = json.loads(printed("score", entry.with_suffix(".parquet"), *where, "--json"))
    assert scored["scores"] == result["scores"]
    line = only_line(*eigbench("submit", entry, "--board", tmp_path / "board"))
    assert f"is of the sealed set {sealed_set.seal.dataset}, which cannot be on a board" in line
    assert "tie" in printed("compare", entry, entry, "--dataset", directory)


@pytest.mark.attack
def test_a_result_that_lies_is_not_told_the_truth(eigbench, directory, entry):
    """The true number would be a query of the set that nobody has noted."""
    result = json.loads(entry.read_text())
    result["scores"]["mesh"]["overall"]["rpd"]["high"] *= 1.5
    entry.write_text(json.dumps(result))
    line = only_line(*eigbench("compare", entry, entry, "--dataset", directory))
    assert line.endswith(f"{entry}: its scores are not those of its predictions")


def fractions(value):
    if isinstance(value, dict | list):
        inner = value.values() if isinstance(value, dict) else value
        return [number for part in inner for number in fractions(part)]
    return [value] if isinstance(value, float) else []


@pytest.mark.attack
def test_no_score_has_more_than_three_digits(printed, score, directory, entry):
    compared = json.loads(printed("compare", entry, entry, "--dataset", directory, "--json"))
    scored = [
        json.loads(score("--json")[1])["scores"],
        json.loads(entry.read_text())["scores"],
        compared["overall"],
        compared["families"],
    ]
    for numbers in map(fractions, scored):
        assert len(numbers) > 10
        assert [x for x in numbers if float(f"{x:.3g}") != x] == []


@pytest.mark.attack
def test_every_score_is_noted_before_it_is_told(score, sealed_set, answers, tmp_path):
    dataset = store.open_dataset(sealed_set.seal.dataset, sealed_set.home)
    log = queries.log_of(dataset)
    log.unlink(missing_ok=True)
    assert score()[0] == 0
    first = log.read_text()
    assert score("--json")[0] == 0
    assert log.read_text().startswith(first)
    assert stat.S_IMODE(log.stat().st_mode) == 0o600
    entries = [json.loads(line) for line in log.read_text().splitlines()]
    assert [set(entry) for entry in entries] == [{"time", "command", "model", "predictions"}] * 2
    assert entries[0]["model"] == answers.name
    assert entries[0]["predictions"] == hashlib.sha256(answers.read_bytes()).hexdigest()
    assert datetime.fromisoformat(entries[0]["time"]) <= datetime.now(UTC)
    log.unlink()
    log.symlink_to(tmp_path / "elsewhere")
    line = only_line(*score())
    assert f"cannot note the query in {log} (" in line
    assert "no score of a sealed set is shown without" in line
    log.unlink()
    assert "1.0-mini" not in store.there(sealed_set.home)  # the log is no dataset
    assert score("--root", tmp_path)[0] == 2
    assert not log.exists()


LOOKS = """
import gc, json, os, sys
from pathlib import Path

META = {"name": "A spy", "kind": "trivial", "training_data": "none"}
MARK = "it sees what is in its process"

def predict(meshes):
    seen = [repr(sys.argv), repr(dict(os.environ)), os.getcwd()]
    for pid in ("self", str(os.getppid())):
        seen.append(Path("/proc", pid, "cmdline").read_text())
        for file in Path("/proc", pid, "fd").iterdir():
            try:
                seen.append(os.readlink(file))
            except OSError:
                pass
    for found in gc.get_objects():
        if found is not seen and isinstance(found, (dict, list, tuple)):
            for value in list(found.values() if isinstance(found, dict) else found):
                if isinstance(value, (str, bytes, int)):
                    seen.append(str(value)[:10000])
    NOTES.write_text(json.dumps(seen))
    return [[1.0] * 10 for _ in meshes]
"""


@pytest.mark.attack
def test_the_seed_is_nowhere_in_the_predictors_process(
    eigbench, sealed_set, predictor_file, tmp_path, monkeypatch
):
    """An attempt to write it into a score finds nothing to write: meshes alone are sent."""
    notes = tmp_path / "notes.json"
    code = predictor_file(LOOKS.replace("NOTES", f"Path({str(notes)!r})"))
    monkeypatch.setenv("SYNTHNET_HOME", str(sealed_set.home))
    where = ["--sealed", sealed_set.published, "--out", tmp_path / "entry.json"]
    code, _, err = eigbench("evaluate", code, *where, "--no-reference", "--no-sandbox")
    assert code == 0, err
    seen = "\n".join(json.loads(notes.read_text()))
    assert "it sees what is in its process" in seen
    dataset = store.open_dataset(sealed_set.seal.dataset, sealed_set.home)
    recipe = seal.recipe_of(dataset)
    secrets = [str(recipe.seed), f"{recipe.seed:x}", seal.read_salt(sealed_set.salt).hex()]
    secrets += [sealed_set.seal.commitment, sealed_set.seal.dataset, str(sealed_set.home)]
    secrets += [sample.spec.id for sample in dataset.samples()]
    assert [secret for secret in secrets if secret in seen] == []


@pytest.mark.attack
def test_nothing_that_is_published_of_a_score_tells_a_label(score, sealed_truth):
    code, printed, err = score("--json")
    assert code == 0, err
    assert '"rpd"' in printed
    labels = [repr(value)[:10] for value in sealed_truth.eigenvalues.ravel().tolist()]
    secrets = [*sealed_truth.shapes.tolist(), *sealed_truth.groups.tolist(), *labels]
    assert [secret for secret in set(secrets) if secret in printed] == []


def test_seal_is_checked_before_a_predictor_is_run(eigbench, sealed_set, predictor_file, tmp_path):
    code = predictor_file("raise SystemExit('was run')")
    where = ["--sealed", sealed_set.published, "--root", tmp_path, "--out", tmp_path / "r.json"]
    assert "the sealed set " in only_line(*eigbench("evaluate", code, *where))
    assert seal.read(sealed_set.published) == sealed_set.seal


TRAINED = """
import numpy as np

class Trained:
    def __init__(self, training):
        self.answer = float(sum(training.encode()))

    def predict(self, meshes):
        return np.full((len(meshes), 10), self.answer)

def load(device, seed, training):
    return Trained(training)
"""


@pytest.mark.slow
def test_a_sealed_set_has_the_protocols_of_its_version(eigbench, predictor_file, tmp_path):
    """Each family of the set is asked of a predictor that has not been trained on it."""
    home, published, out = tmp_path / "home", tmp_path / "seal.json", tmp_path / "out.json"
    version = seal.sealed_recipe("2.0-mini", bytes(range(32)), share=0.01)
    made, _ = seal.make(version, root=home)
    seal.write(published, made)
    how = ["--sealed", published, "--root", home, "--protocol", "family"]
    code = predictor_file(TRAINED)
    status, _, err = eigbench("evaluate", code, *how, "--no-reference", "--out", out)
    assert status == 0, err
    labels = truth.of_dataset(store.open_dataset(made.dataset, home), "test", "family")
    answers = predictions.read(out.with_suffix(".parquet"), labels)
    names = [f"2.0/family/{family}" for family in labels.families]
    assert len(set(names)) == 25
    np.testing.assert_array_equal(answers[0, :, 0], [sum(name.encode()) for name in names])
    kept = out.with_suffix(".parquet")
    assert eigbench("score", kept, *how)[0] == 0
    status, _, err = eigbench("score", kept, *how[:4])
    assert (status, "--protocol say what was predicted" in err) == (2, True)
