"""The sentences that answer whether a network is faster than finite elements."""

import pytest
from eigbench import results

from evidence import ROOT
from evidence.gcn import NEAREST
from evidence.paper_speed import answer, errors_on_board, nearest, sentences

REPORTED = [
    ["GCN, a batch of 200 meshes", "NVIDIA A100", "0.11"],
    ["GCN, a batch of 200 meshes", "AMD EPYC 9654", "1.0"],
    ["LaPy, one mesh", "AMD EPYC", "2.5"],
]
BATCHES = [
    {"what": "GCN, encoding included, 200 meshes", "where": "cpu, 1 thread", "seconds": 2.0},
    {"what": "GCN, encoding included, 200 meshes", "where": "cpu, 2 threads", "seconds": 1.5},
    {"what": "LaPy, 200 meshes", "where": "cpu, 1 thread", "seconds": 12.0},
    {"what": "LaPy, 200 meshes", "where": "cpu, 2 threads", "seconds": 11.0},
    {"what": "our certified solver, 200 meshes", "where": "cpu, 1 thread", "seconds": 3.0},
]
ERRORS = {"GCN far": 0.9, "GCN near": 0.31, "LaPy": 0.28, "LaPy with CHOLMOD": 0.28}


def cost(ratio, peer):
    """The cost of a row, whose intervals are a tenth to each side."""
    wide = [{"ratio": r, "low": 0.9 * r, "high": 1.1 * r} for r in (ratio, peer)]
    return {"reference": wide[0], "peers": {"LaPy with CHOLMOD": wide[1]}, "batch_size": 3}


COSTS = {"GCN far": cost(9, 9), "GCN near": cost(2, 1), "synthNet, certified": cost(3, 1.5)}


def test_the_nearest_network_is_set_beside_the_solvers():
    paper, speed, error, batches = sentences(REPORTED, ERRORS, COSTS, BATCHES)
    assert "1.0 s for 200 meshes by its network and 2.5 s for one by LaPy" in paper
    assert "in batches of 3 meshes of 1.0, a network of" in speed
    assert "is 2 × (1.8–2.2) as fast as LaPy and 1 × (0.9–1.1) as fast as LaPy with" in speed
    assert speed.endswith("; the certified solver is 3 × (2.7–3.3) as fast as LaPy.")
    assert error.endswith("RPD to the surface is 0.3100, that of the solvers 0.2800.")
    assert "are 6 × and 4 × as fast as LaPy. The network is *GCN near*." in batches


def test_the_network_that_is_timed_in_batches_is_the_nearest_on_the_board():
    models = [
        results.load(path)["model"]
        for path in (ROOT / "benchmark" / "results" / "1.0-test-grouped").glob("*.json")
    ]
    name = nearest(errors_on_board())
    (code,) = (model["code"] for model in models if model["name"] == name)
    assert code == f"reproduction.py:{NEAREST.replace('-', '_')}"


@pytest.mark.parametrize(
    ("network", "expected"),
    [
        ((2.0, 2.5), "It is faster than LaPy, and about as fast as our certified solver."),
        ((3.0, 3.5), "It is faster than LaPy, and faster than our certified solver."),
        ((0.9, 1.1), "It is about as fast as LaPy, and slower than our certified solver."),
        ((0.5, 0.7), "It is slower than LaPy, and slower than our certified solver."),
    ],
)
def test_the_answer_follows_from_the_intervals(network, expected):
    low, high = network
    assert answer({"low": low, "high": high}, {"low": 2.4, "high": 2.6}) == expected


def test_solvers_that_differ_each_have_their_error():
    *_, error, _ = sentences(REPORTED, {**ERRORS, "LaPy with CHOLMOD": 0.29}, COSTS, BATCHES)
    assert error.endswith("that of the solvers 0.2800 and 0.2900.")
