"""The noise floor: its numbers by hand, ties below it, the page and compare."""

import json
from pathlib import Path

import numpy as np
import pytest
from eigbench.board import leaderboard, ranking
from eigbench.errors import EigbenchError
from eigbench.results import submission
from eigbench.scoring import noise
from eigbench.scoring.metrics import METRICS

from synthnet.store import pins


@pytest.fixture
def pin(monkeypatch, mini_truth):
    """Return a function that pins one relative error for all labels of 1.0-mini, or none."""

    def pin(relative, shapes=None):
        names = set(mini_truth.shapes.tolist()) if shapes is None else shapes
        errors = {name: np.full(10, relative, dtype=np.float32) for name in names}
        monkeypatch.setattr(noise, "_pinned", lambda version: errors)

    return pin


@pytest.fixture
def unpinned(monkeypatch):
    monkeypatch.setattr(noise, "_pinned", lambda version: None)


@pytest.fixture(scope="module")
def two(make_submission, mini_truth):
    """Predictors that are 2 and 8 % off on every shape."""
    g = mini_truth.eigenvalues
    paths = [make_submission(f"Off by {share}", g * (1 + share)) for share in (0.02, 0.08)]
    return [(path, submission.read(path)) for path in paths]


# Numbers


def test_floor_is_the_score_of_labels_that_are_a_tenth_too_large(pin, mini_truth):
    pin(0.1)  # the surface has 0.9 of each label
    g = mini_truth.eigenvalues
    expected = {
        "invlap": np.sqrt(10) * 0.1,
        "rpd": 10 * 0.1 / 1.9,
        "polar": 0.1 / 1.9,
        "l1": 0.1 * g.sum(axis=1).mean(),
        "l2": 0.1 * np.sqrt((g**2).sum(axis=1)).mean(),
    }
    for key, value in expected.items():
        assert noise.floor(mini_truth, key) == pytest.approx(value, rel=1e-5), key


def test_floor_of_a_share_is_what_the_labels_lack_of_all(pin, made_truth, monkeypatch):
    truth = made_truth(
        ["a-0", "b-0", "b-1", "b-2"], ["a", "b", "b", "b"], np.tile([1.0, 2], (4, 1))
    )
    errors = {"a-0": [0.4, 0.4], **{f"b-{i}": [0.001, 0.001] for i in range(3)}}
    monkeypatch.setattr(noise.recipe, "available", lambda: ["made"])
    monkeypatch.setattr(noise.recipe, "load", lambda version: type("R", (), {"base": "made"}))
    monkeypatch.setattr(
        noise, "_pinned", lambda version: {k: np.array(v) for k, v in errors.items()}
    )
    assert noise.floor(truth, "psnr20") == pytest.approx(0.25)
    assert noise.floor(truth.take(truth.families == "b"), "psnr20") == 0
    np.testing.assert_allclose(noise.surface_eigenvalues(truth)[0], [0.6, 1.2])


def test_labels_that_are_exact_have_no_noise(pin, mini_truth):
    pin(0.0)
    floors = {key: noise.floor(mini_truth, key) for key in METRICS}
    assert floors.pop("psnr") is None  # a perfect score is infinite
    np.testing.assert_allclose(list(floors.values()), 0, atol=1e-12)


@pytest.mark.usefixtures("unpinned")
def test_a_version_without_estimates_has_no_floor(mini_truth):
    assert {noise.floor(mini_truth, key) for key in METRICS} == {None}


def test_a_dataset_that_is_no_version_has_no_floor(pin, made_truth):
    pin(0.1)
    truth = made_truth(["a-0"], ["a"], [[1.0, 2.0]])
    assert noise.floor(truth, "rpd") is None


def test_estimates_that_lack_a_shape_are_refused(pin, mini_truth):
    names = sorted(set(mini_truth.shapes.tolist()))
    pin(0.1, names[1:])
    message = f"of 1.0 lack 1 shapes of 1.0-mini, the first {names[0]}: pin them anew"
    with pytest.raises(EigbenchError, match=message):
        noise.floor(mini_truth, "rpd")


def test_the_pinned_estimates_are_those_of_the_pinned_labels():
    found = pins.read_errors("1.0")
    if found is None:
        pytest.skip("1.0 has no pinned error estimates yet")
    assert list(found) == list(pins.read("1.0"))
    errors = np.stack(list(found.values()))
    assert errors.shape == (16549, 10)
    assert np.isfinite(errors).all()
    assert (errors < 1).all()  # the extrapolated spectra are positive


# Ties


@pytest.mark.parametrize(("relative", "verdict"), [(0.05, "a"), (0.07, "tie")])
def test_a_difference_below_the_floor_is_a_tie(pin, two, relative, verdict):
    (_, a), (_, b) = two
    pin(relative)
    difference = ranking.difference(a, b, "rpd")
    apart = 10 * (0.08 / 2.08 - 0.02 / 2.02)  # 0.2856, the same for every shape
    assert difference.b - difference.a == pytest.approx(apart)
    assert difference.high < 0  # the interval alone would tell them apart
    assert difference.floor == pytest.approx(10 * relative / (2 - relative), rel=1e-5)
    assert (difference.floor > apart) == (verdict == "tie")
    assert difference.verdict == verdict
    assert ranking.difference(b, a, "rpd").verdict == {"a": "b", "tie": "tie"}[verdict]


def test_rows_within_the_floor_of_the_best_share_its_rank(pin, two, make_submission, mini_truth):
    far = submission.read(make_submission("Far", mini_truth.eigenvalues * 1.12))
    rows = [far, *(one for _, one in two)]
    pin(0.05)  # 0.256: the second is 0.286 from the first, the third 0.187 from the second
    assert [(r.rank, r.group) for r in ranking.ranked(rows)] == [(1, 1), (2, 2), (2, 2)]
    pin(0.07)  # 0.363: the third is 0.468 from the first
    assert [(r.rank, r.group) for r in ranking.ranked(rows)] == [(1, 2), (1, 2), (3, 1)]
    pin(0.1)  # 0.526
    assert [(r.rank, r.group) for r in ranking.ranked(rows)] == [(1, 3)] * 3


def test_what_is_not_finite_loses_whatever_the_floor(pin, two, make_submission, mini_truth):
    values = mini_truth.eigenvalues.copy()
    values[7, 3] = np.nan
    bad = submission.read(make_submission("Bad", values))
    pin(0.5)
    assert ranking.difference(bad, two[1][1], "rpd").verdict == "b"


# Shown


def page_of(rows):
    return leaderboard.generate(rows, [])[Path(leaderboard.PAGE)]


def test_page_says_the_floor_of_each_metric(pin, two):
    pin(0.07)
    page = page_of([one for _, one in two])
    (line,) = (line for line in page.splitlines() if line.startswith("**Noise floor**"))
    assert "InvLap 0.2214, RPD 0.3627, PolarLoss 0.0363, PSNR>20 " in line
    assert "| 1= | Off by 0.02 |" in page
    assert "| 1= | Off by 0.08 |" in page


@pytest.mark.usefixtures("unpinned")
def test_page_says_that_the_floor_is_not_computed(two):
    page = page_of([one for _, one in two])
    assert "**Noise floor**: not computed." in page
    assert "| 2 | Off by 0.08 |" in page


def found_rows(out, start):
    (line,) = (line for line in out.splitlines() if line.startswith(f"{start} "))
    return line.split()


def test_compare_shows_the_floor(eigbench, pin, two):
    pin(0.07)
    paths = [path for path, _ in two]
    code, out, _ = eigbench("compare", *paths)
    assert code == 0
    line = next(line for line in out.splitlines() if line.startswith("RPD "))
    assert line.split()[-3] == "0.3627"
    assert line.split()[-2:] == ["tie", "(floor)"]
    (line,) = (line for line in out.splitlines() if line.startswith("PSNR "))
    assert line.split()[-4:] == ["none", "A", "is", "better"]
    assert found_rows(out, "Torus")[-2:] == ["tie", "(floor)"]
    found = json.loads(eigbench("compare", *paths, "--json")[1])
    assert found["overall"]["rpd"]["floor"] == pytest.approx(0.3627, abs=1e-4)
    assert found["overall"]["psnr"]["floor"] is None
    assert found["families"]["torus"]["verdict"] == "tie"
