"""The two targets: what they are, what counts as exact, and what their bars make a tie."""

import json

import numpy as np
import pytest
from eigbench.board import ranking
from eigbench.errors import EigbenchError
from eigbench.scoring import scores, targets, truth

from synthnet.families.limits import Limit


@pytest.fixture
def pin(monkeypatch, mini_truth):
    """Return a function that pins limits for 1.0-mini: a share of the labels, and their bar."""

    def pin(share, bar, shapes=None):
        labels = dict(zip(mini_truth.shapes.tolist(), mini_truth.eigenvalues, strict=True))
        limits = {
            name: Limit(share * labels[name], bar * share * labels[name])
            for name in labels
            if shapes is None or name in shapes
        }
        monkeypatch.setattr(targets, "_pinned", lambda version: limits)

    return pin


@pytest.fixture(scope="module")
def two(make_row, mini_truth):
    """Predictors that are 2 and 8 % off the labels on every shape."""
    g = mini_truth.eigenvalues
    return [make_row(f"Off by {share}", g * (1 + share)) for share in (0.02, 0.08)]


def test_surface_of_a_sphere_has_its_closed_form_and_the_mesh_has_not(mini_truth):
    surface = targets.at(mini_truth, "surface")
    i = mini_truth.families.tolist().index("split_sphere")
    form = [2.0] * 3 + [6.0] * 5 + [12.0] * 2
    scale = surface.eigenvalues[i, 0] / 2
    np.testing.assert_allclose(surface.eigenvalues[i], np.array(form) * scale, rtol=1e-8)
    assert np.abs(mini_truth.eigenvalues[i] / scale - form).max() > 1e-4
    assert surface.ids == mini_truth.ids
    assert (surface.target, mini_truth.target) == ("surface", "mesh")
    assert surface.digest != mini_truth.digest


def test_instances_that_are_chosen_keep_their_bars(mini_truth):
    surface = targets.at(mini_truth, "surface")
    some = surface.take(surface.families == "torus")
    assert some.bars.shape == some.eigenvalues.shape
    np.testing.assert_array_equal(some.bars, surface.bars[surface.families == "torus"])


def test_an_unknown_target_is_refused(mini_truth):
    with pytest.raises(EigbenchError, match="target must be surface or mesh, got 'limit'"):
        targets.at(mini_truth, "limit")


def test_labels_of_meshes_do_not_follow_from_surfaces(mini_truth):
    with pytest.raises(EigbenchError, match="do not follow"):
        targets.at(targets.at(mini_truth, "surface"), "mesh")


def test_limits_that_lack_a_shape_are_refused(pin, mini_truth):
    names = sorted(set(mini_truth.shapes.tolist()))
    pin(1.0, 0.0, names[1:])
    message = f"of 1.0 lack 1 shapes of 1.0-mini, the first {names[0]}: pin them anew"
    with pytest.raises(EigbenchError, match=message):
        targets.at(mini_truth, "surface")


def test_what_is_no_version_or_an_import_has_no_surface(pin, made_truth):
    pin(1.0, 0.0)
    assert targets.at(made_truth(["a-0"], ["a"], [[1.0, 2.0]]), "surface") is None
    assert targets.at(truth.load("2.0", "test", "imported/real-28"), "surface") is None


def test_an_answer_within_the_bar_is_exact_and_one_beyond_it_is_not(pin, mini_truth):
    pin(0.9, 1e-4)
    surface = targets.at(mini_truth, "surface")
    assert scores.score(surface, surface.eigenvalues[None] * (1 + 0.9e-4))["exact"] == 1
    half = np.where(np.arange(306)[:, None] < 153, 1 + 0.9e-4, 1 + 1.1e-4)
    scored = scores.score(surface, (surface.eigenvalues * half)[None])
    assert scored["exact"] == 0.5
    assert scored["overall"]["rpd"]["mean"] == pytest.approx(10 * 1.1e-4 / 2.00011 / 2, rel=1e-6)
    assert scored["per_index"][3]["mean"] == pytest.approx(0.55e-4, rel=1e-6)


def test_rounding_is_no_error_of_the_mesh_but_a_missed_digit_is(mini_truth):
    g = mini_truth.eigenvalues[None]
    assert scores.score(mini_truth, g * (1 + 5e-10))["exact"] == 1
    assert scores.score(mini_truth, g * (1 + 5e-10))["overall"]["l1"]["mean"] == 0
    assert scores.score(mini_truth, g * (1 + 2e-9))["exact"] == 0


def test_a_value_that_is_not_finite_is_never_exact(mini_truth):
    g = mini_truth.eigenvalues.copy()
    g[3, 4] = np.nan
    scored = scores.score(mini_truth, g[None])
    assert scored["exact"] == pytest.approx(305 / 306)
    assert scored["overall"]["rpd"]["mean"] is None


def test_floor_is_what_bars_of_a_tenth_lose(pin, mini_truth):
    pin(1.0, 0.1)
    surface = targets.at(mini_truth, "surface")
    g = mini_truth.eigenvalues
    expected = {
        "invlap": np.sqrt(10) * 0.1 / 1.1,
        "rpd": 10 * 0.1 / 2.1,
        "polar": 0.1 / 2.1,
        "l1": 0.1 * g.sum(axis=1).mean(),
        "l2": 0.1 * np.sqrt((g**2).sum(axis=1)).mean(),
    }
    for key, value in expected.items():
        assert targets.floor(surface, key) == pytest.approx(value, rel=1e-5), key
    assert targets.floor(surface, "psnr") is None


# Ties


@pytest.mark.parametrize(("bar", "verdict"), [(0.02, "a"), (0.04, "tie")])
def test_a_difference_that_the_bars_could_make_is_a_tie(pin, two, bar, verdict):
    pin(0.9, bar)  # so that both answers are far beyond the bars
    a, b = (row.at("surface") for row in two)
    difference = ranking.difference(a, b, "rpd")
    first, second = (1.02 / 0.9 - 1, 1.08 / 0.9 - 1)
    apart = 10 * (second / (2 + second) - first / (2 + first))
    assert difference.b - difference.a == pytest.approx(apart)
    assert difference.high < 0  # the interval alone would tell them apart
    assert difference.floor == pytest.approx(10 * bar / (2 + bar))
    assert (2 * difference.floor > apart) == (verdict == "tie")
    assert difference.verdict == verdict
    assert difference.why == ("floor" if verdict == "tie" else "")
    assert ranking.difference(b, a, "rpd").verdict == {"a": "b", "tie": "tie"}[verdict]
    ranks = [row.ranks for row in ranking.ranked([b, a])]
    assert ranks == ([(1, 2), (1, 2)] if verdict == "tie" else [(1, 1), (2, 2)])


def test_what_is_not_finite_loses_whatever_the_floor(pin, two, make_row, mini_truth):
    values = mini_truth.eigenvalues.copy()
    values[7, 3] = np.nan
    bad = make_row("Bad", values)
    pin(0.9, 0.5)
    assert ranking.difference(bad.at("surface"), two[1].at("surface"), "rpd").verdict == "b"


# Shown


def test_compare_is_at_the_target_that_is_asked_for(printed, pin, make_submission, mini_truth):
    pin(0.9, 0.0)
    g = mini_truth.eigenvalues
    paths = [make_submission(f"Off by {share}", g * (1 + share)) for share in (0.02, 0.08)]
    out = printed("compare", *paths, "--target", "surface")
    assert "both against the surface" in out
    line = next(line for line in out.splitlines() if line.startswith("RPD "))
    assert line.split()[1] == f"{10 * (1.02 / 0.9 - 1) / (1.02 / 0.9 + 1):.4f}"
    assert json.loads(printed("compare", *paths, "--json"))["target"] == "surface"
    comparison = json.loads(printed("compare", *paths, "--target", "mesh", "--json"))
    assert comparison["target"] == "mesh"
    assert comparison["overall"]["rpd"]["a"] == pytest.approx(10 * 0.02 / 2.02)
    assert comparison["overall"]["psnr"]["floor"] is None


def test_score_has_both_targets_or_the_one_that_is_asked_for(printed, refused, two, monkeypatch):
    arguments = ["score", two[0].predictions_path, "--dataset", "1.0-mini"]
    both = json.loads(printed(*arguments, "--json"))["scores"]
    assert both == json.loads(json.dumps(two[0].result["scores"]))
    alone = json.loads(printed(*arguments, "--target", "surface", "--json"))["scores"]
    assert alone == {"surface": both["surface"]}
    out = printed(*arguments)
    assert out.index("Against the surface") < out.index("Against the mesh")
    monkeypatch.setattr(targets, "_pinned", lambda version: None)
    err = refused(*arguments, "--target", "surface")
    assert "the surfaces' spectra of 1.0-mini, grouped, are not known: give --target mesh" in err
    assert "Against the surface: not known for this dataset" in printed(*arguments)
