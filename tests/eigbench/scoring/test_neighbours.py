"""How near tested shapes are to those of training, on spectra made by hand."""

from dataclasses import replace

import numpy as np
import pytest
from eigbench.scoring import neighbours, targets


@pytest.fixture
def split(monkeypatch, made_truth):
    """Return a function that makes labels of a test and of the training sets it asks for."""

    def split(tested, trainings, trained):
        def load(version, part, protocol):
            if part == "train":
                rows = trained[protocol]
                return made_truth([f"t-{i}" for i in range(len(rows))], ["a"] * len(rows), rows)
            names = [f"s-{i}" for i in range(len(tested))]
            made = made_truth(names, ["a"] * len(tested), tested)
            return replace(made, trainings=np.array([f"made/{name}" for name in trainings]))

        monkeypatch.setattr(neighbours.truth, "load", load)
        monkeypatch.setattr(targets, "_limits_of", lambda labels: None)
        neighbours.distances.cache_clear()

    yield split
    neighbours.distances.cache_clear()


def test_a_shape_of_another_size_is_the_same_shape(split):
    split([[1.0, 2.0, 4.0]], ["grouped"], {"grouped": [[9.0, 9.0, 9.0], [3.0, 6.0, 12.0]]})
    np.testing.assert_allclose(neighbours.distances("made", "grouped"), [0], atol=1e-15)


def test_distance_is_the_largest_relative_difference(split):
    split([[1.0, 1.0, 1.0]], ["grouped"], {"grouped": [[1.0, 1.0, 1.03]]})
    apart = np.log(1.03) * np.array([-1, -1, 2]) / 3
    (distance,) = neighbours.distances("made", "grouped")
    assert distance == pytest.approx(np.abs(apart).max())


def test_each_shape_is_compared_with_the_training_it_asks_for(split):
    trained = {"x": [[1.0, 2.0]], "y": [[1.0, 1.0]]}
    split([[1.0, 1.0], [1.0, 1.0]], ["x", "y"], trained)
    first, second = neighbours.distances("made", "family")
    assert first == pytest.approx(np.log(2) / 2)
    assert second == 0


def test_copies_of_a_shape_count_once(mini_truth):
    assert len(neighbours.distances("1.0-mini", "grouped")) == len(set(mini_truth.shapes.tolist()))
