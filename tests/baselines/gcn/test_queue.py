"""The queue that trains the rows of the paper's tables: what is left, what is done, and its end."""

import filelock
import pytest

from baselines.gcn import queue, weights
from tests.baselines.gcn.conftest import set_apart

# What ends their training
BY_RULE, BY_CLOCK = queue.Training("table1-rpd-scale-free"), queue.Training("table1-rpd")


def test_a_configuration_that_is_not_in_the_queue_is_refused(capsys):
    with pytest.raises(SystemExit) as ended:
        queue.main(["--only", "table3-a-5-virtual"])  # as the paper says: only Table 1 is to be run
    assert ended.value.code == 2
    assert "'table3-a-5-virtual-scale-free'" in capsys.readouterr().err


@pytest.fixture
def ran(monkeypatch, tmp_path):
    """The commands that a queue would run; what they would leave is as each test says."""
    commands = []
    monkeypatch.setattr(queue, "run", lambda command, expected=(0,): commands.append([*command]))
    set_apart(monkeypatch, tmp_path)
    return commands


@pytest.fixture
def out(tmp_path):
    """The folder of a run whose end is a rule."""
    return queue.folder(BY_RULE, tmp_path / "runs")


def trained(path, **record):
    """Write a file of a training's record."""
    known = {"steps": 50, "of": 100, "minutes": 1.0, "converged": False, "log": []}
    path.parent.mkdir(parents=True, exist_ok=True)
    weights.write(path, {}, {**known, **record})


def test_weights_that_were_trained_and_never_scored_are_scored(ran, out, tmp_path, capsys):
    for name in (queue.CHECKPOINT, queue.WEIGHTS):
        trained(out / name, converged=True)
    options = ["--run", "--runs", str(tmp_path / "runs"), "--only", BY_RULE.config]
    assert queue.main(options) == 1  # nothing is written here in eigbench's place
    assert "grouped, seed 0: eigbench has written no result of this seed" in capsys.readouterr().err
    assert "reproduction.py:table1_rpd_scale_free" in ran[0][2]
    assert ran[0][ran[0].index("--seeds") + 1] == "1"
    assert BY_RULE.weights().read_bytes() == (out / queue.WEIGHTS).read_bytes()


def test_a_training_killed_before_it_wrote_its_weights_goes_on_to_do_so(out):
    trained(out / queue.CHECKPOINT, converged=True)
    assert queue.left(BY_RULE, out) > 0
    trained(out / queue.WEIGHTS, steps=40)  # of an earlier session
    assert queue.left(BY_RULE, out) > 0
    trained(out / queue.WEIGHTS, steps=50)
    assert queue.left(BY_RULE, out) == 0


def test_what_was_scored_before_it_had_converged_is_not_finished(ran, monkeypatch):
    monkeypatch.setattr(queue.Training, "scored", lambda training: True)
    assert not BY_RULE.finished()  # there are no weights
    for record, expected in (
        ({"minutes": 200.0}, (False, True)),
        ({"converged": True}, (True, True)),
        ({"steps": 100}, (True, True)),
        ({}, (False, False)),
    ):
        for training in (BY_RULE, BY_CLOCK):
            trained(training.weights(), **record)
        assert (BY_RULE.finished(), BY_CLOCK.finished()) == expected


def test_what_has_begun_on_one_machine_goes_on_on_another(ran, tmp_path):
    def go_on(runs):
        options = ["--keep", "--minutes", "60", "--only", BY_CLOCK.config, "--runs", str(runs)]
        code = queue.main(["--run", *options])
        return code, queue.folder(BY_CLOCK, runs) / queue.CHECKPOINT

    one, other = tmp_path / "one", tmp_path / "other"
    trained(queue.folder(BY_CLOCK, one) / queue.CHECKPOINT, minutes=3.0)
    code, checkpoint = go_on(one)
    assert code == 0
    assert BY_CLOCK.unfinished().read_bytes() == checkpoint.read_bytes()
    code, copied = go_on(other)
    assert code == 0
    assert copied.read_bytes() == checkpoint.read_bytes()
    assert ran[-1][-1] == "--resume"
    assert ran[-1][ran[-1].index("--dtype") + 1] == "float32"  # as the paper's
    for name in (queue.CHECKPOINT, queue.WEIGHTS):
        trained(copied.parent / name, minutes=180.0)
    assert go_on(other)[0] == 1  # nothing is scored here
    assert not BY_CLOCK.unfinished().exists()
    assert BY_CLOCK.weights().read_bytes() == (copied.parent / queue.WEIGHTS).read_bytes()


def test_time_left_is_that_of_the_clock_or_of_the_rule(tmp_path):
    for training, expected in ((BY_RULE, float("inf")), (BY_CLOCK, 179.0)):
        out = queue.folder(training, tmp_path)
        assert queue.left(training, out) in (float("inf"), 180.0)
        trained(out / queue.CHECKPOINT)
        assert queue.left(training, out) == expected


def test_a_training_whose_time_is_spent_to_the_hundredth_has_ended(tmp_path, monkeypatch):
    monkeypatch.setattr(queue, "LONGEST", 0.01 + 0.05)
    assert queue.LONGEST > 0.06  # by a rounding, for which nobody should wait
    out = queue.folder(BY_CLOCK, tmp_path)
    for name in (queue.CHECKPOINT, queue.WEIGHTS):
        trained(out / name, minutes=0.06)
    assert queue.left(BY_CLOCK, out) == 0


def test_a_second_queue_is_refused(ran, tmp_path, capsys):
    with filelock.FileLock(tmp_path / ".lock"):
        assert queue.main(["--run", "--runs", str(tmp_path)]) == 2
    assert "another queue is at work" in capsys.readouterr().err
    assert ran == []


def test_a_queue_without_time_trains_nothing(ran, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        queue.main(["--run", "--minutes", "nan"])
    assert "--minutes: must be above 0, got nan" in capsys.readouterr().err
    assert queue.main(["--run", "--minutes", "1e-9", "--runs", str(tmp_path)]) == 0
    assert "the time is up; --run goes on" in capsys.readouterr().out
    assert ran == []


def test_the_queue_begins_with_the_papers_best_row_and_ends_with_second_seeds():
    every = queue.trainings()
    assert str(every[0]) == "table2-alg-virtual-long, grouped, seed 0"
    assert len(set(every)) == len(every) == 13 + 5 + 3 + 12 + 5
    assert [training.seed for training in every] == sorted(training.seed for training in every)
    assert len({training.weights() for training in every}) == len(every)
