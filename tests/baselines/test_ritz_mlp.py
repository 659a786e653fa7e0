"""baselines/ritz_mlp.py: its features, their invariance, and the committed weights."""

import itertools

import numpy as np
import pytest
from eigbench.errors import PredictorError
from eigbench.running import predictor
from eigbench.scoring.metrics import METRICS
from numpy.polynomial.legendre import legvander
from safetensors import safe_open

from evidence import BASELINES, baseline
from synthnet import store
from synthnet.families import FAMILIES
from synthnet.spectrum import fem_matrices
from synthnet.types import Mesh


@pytest.fixture(scope="module")
def features():
    return baseline("ritz_features")


@pytest.fixture(scope="module")
def ritz():
    return baseline("ritz")


@pytest.fixture(scope="module")
def samples(mini_home):
    """The test shapes of 1.0-mini."""
    stored = store.open_dataset("1.0-mini", mini_home)
    return [sample for sample in stored.samples() if sample.split == "test"]


@pytest.mark.slow
def test_ritz_values_are_those_of_the_plain_way(features, ritz, samples):
    assert len(samples) == 34
    for sample in samples:
        # In doubles: the plain way rounds its polynomials as the vertices are, here 1e-6 of a value
        mesh = Mesh(sample.mesh.vertices.astype(np.float64), sample.mesh.faces)
        area, numbers = features.features(mesh)
        expected = ritz.ritz_values(mesh, features.DEGREE)
        basis = ritz.polynomials(mesh.vertices, features.DEGREE)
        gram = np.linalg.eigvalsh(basis.T @ (fem_matrices(mesh)[1] @ basis))
        smallest = gram[gram > ritz.DEPENDENT * gram[-1]][0] / gram[-1]
        rounding = 1e-8 + min(10 * np.finfo(np.float64).eps / smallest, 1e-6)
        np.testing.assert_allclose(np.exp(numbers[:10]) / area, expected, rtol=rounding)
        assert (expected > sample.eigenvalues * (1 - 1e-9)).all()  # they bound the label from above


def test_basis_is_all_products_up_to_the_degree(features):
    x = np.random.default_rng(0).uniform(-1, 1, size=(5, 3))
    basis = np.zeros((5, 36))
    features.legendre(x, np.ones(3), 4, basis)
    p, q, r = (legvander(c, 4) for c in x.T)
    powers = itertools.product(range(5), repeat=3)
    expected = [p[:, i] * q[:, j] * r[:, k] for i, j, k in powers if i + j + k <= 4]
    np.testing.assert_allclose(basis[:, :35], np.stack(expected, axis=1), atol=1e-14)
    assert (basis[:, 35] == 0).all()


def test_moments_of_a_unit_cube_by_hand(features):
    cube = FAMILIES["rectangular_prism"].generate(
        {"width": 1.0, "height": 1.0, "depth": 1.0, "subdivisions": 2}
    )
    area, numbers = features.features(cube)
    named = dict(zip(features.NAMES, np.exp(numbers), strict=True))
    assert area == pytest.approx(6.0)
    assert named["log_volume"] == pytest.approx(1 / 6**1.5)
    # ∫x² about the centre: 2 faces at 1/2 give 1/4 each, 4 faces 1/12 each; over area²
    for axis in (1, 2, 3):
        assert named[f"log_inertia_{axis}"] == pytest.approx((2 / 4 + 4 / 12) / 36)
    assert named["log_farthest"] == pytest.approx(0.75 / 6)


@pytest.mark.parametrize("reflected", [False, True])
def test_no_isometry_scale_or_renumbering_changes_the_features(reflected, features, samples):
    rng = np.random.default_rng(int(reflected))
    assert len(samples) == 34
    for sample in samples:
        vertices = sample.mesh.vertices.astype(np.float64)
        matrix, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        matrix = matrix * np.sign(np.linalg.det(matrix)) * (-1 if reflected else 1)
        order = rng.permutation(len(vertices))
        there = 7.0 * vertices @ matrix.T + rng.normal(size=3)
        moved = Mesh(there[order], np.argsort(order)[sample.mesh.faces][:, ::-1])
        area, numbers = features.features(Mesh(vertices, sample.mesh.faces))
        other, moved_numbers = features.features(moved)
        assert other / area == pytest.approx(49, rel=1e-12)
        np.testing.assert_allclose(moved_numbers, numbers, atol=1e-6)


def test_weights_fit_their_features(features):
    with safe_open(BASELINES / "ritz_mlp.safetensors", framework="np") as file:
        assert file.metadata()["features"] == ",".join(features.NAMES)
        assert {name.split(".")[0] for name in file.keys()} == {"seed0", "seed1", "seed2"}  # noqa: SIM118


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_seed_is_a_good_predictor(seed, samples):
    row = predictor.load(BASELINES / "ritz_mlp.py", seed=seed)
    predicted = row.predict([sample.mesh for sample in samples])
    expected = np.array([sample.eigenvalues for sample in samples])
    assert METRICS["rpd"].function(predicted, expected).mean() < 0.05
    assert METRICS["psnr20"].function(predicted, expected).mean() == 1
    assert (np.diff(predicted, axis=1) >= 0).all()


def test_a_seed_without_weights():
    with pytest.raises(PredictorError, match="has the seeds 0 to 2, not 3"):
        predictor.load(BASELINES / "ritz_mlp.py", seed=3)


@pytest.mark.parametrize("training", ["1.0/grouped", "2.0/grouped"])
def test_weights_of_each_version_answer_and_no_meshes_are_no_answers(training):
    row = predictor.load(BASELINES / "ritz_mlp.py", training=training)
    assert row.trained
    assert row.predict([]).shape == (0, 10)


def test_numbers_are_kept_for_every_training_shape_of_2_0(features):
    ritz_mlp = baseline("ritz_mlp")
    numbers, logs = ritz_mlp.kept("2.0/boundary")
    assert (numbers.shape, logs.shape) == ((5733, len(features.NAMES)), (5733, 10))
    assert (numbers[:, 0] >= logs[:, 0] - 1e-5).all()  # Ritz values bound the label from above
    with pytest.raises(ValueError, match=r"ritz_mlp\.parquet lacks .* of 1\.0/paper: make it anew"):
        ritz_mlp.kept("1.0/paper")


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (np.zeros((0, 3), int), "the mesh has no faces"),
        (np.array([[0, 1, 1]]), "has area 0"),
        (np.array([[0, 1, 2]]), "polynomials have 2 values on the mesh, 10 are needed"),
    ],
)
def test_a_mesh_without_area_or_with_too_few_values(faces, message, features):
    with pytest.raises(ValueError, match=message):
        features.features(Mesh(np.eye(3), faces))
