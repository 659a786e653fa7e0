"""The error bound of a spectrum, against exact arithmetic."""

import dataclasses

import mpmath
import numpy as np
import pytest

from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.types import Mesh

BITS = 200
ALONG, ACROSS, K = 7, 3, 4
LOOSE = 100  # times the true error: the bound is no larger, unless both are rounding of doubles


def thin(aspect: float, kind: str, seed: int) -> Mesh:
    """A thin strip, turned in space: of needles, of caps, bent, or with a row of thin triangles."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, ALONG), np.linspace(0, 1, ACROSS), indexing="ij")
    points = np.stack([x.ravel(), aspect * y.ravel(), np.zeros(x.size)], axis=1)
    points[1:, 0] += rng.random(x.size - 1) * 0.3 / ALONG
    if kind == "bent":
        points[:, 2] = 0.1 * np.sin(3 * points[:, 0])
    if kind == "caps":
        points[:, 1] += 0.3 * aspect * rng.random(x.size)
    if kind == "row":
        points[:, 1] /= aspect
        points[ACROSS : 2 * ACROSS, 0] = points[:ACROSS, 0] + aspect * (0.5 + rng.random(ACROSS))
    corner = (np.arange(ALONG - 1)[:, None] * ACROSS + np.arange(ACROSS - 1)).ravel()
    below = np.stack([corner, corner + ACROSS, corner + ACROSS + 1], axis=1)
    above = np.stack([corner, corner + ACROSS + 1, corner + 1], axis=1)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    return Mesh(points @ turn.T, np.concatenate([below, above]))


def exact_matrices(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and mass of linear elements in numbers of 200 bits."""
    points = [[mpmath.mpf(float(x)) for x in row] for row in mesh.vertices]
    n = len(points)
    stiffness, mass = (np.array([[mpmath.mpf(0)] * n for _ in range(n)]) for _ in range(2))
    for face in mesh.faces.tolist():
        corners = np.array([points[i] for i in face])
        edges = np.roll(corners, 1, axis=0) - np.roll(corners, -1, axis=0)
        dots = edges @ edges.T
        area = mpmath.sqrt(dots[0, 0] * dots[1, 1] - dots[0, 1] ** 2) / 2
        stiffness[np.ix_(face, face)] += dots / (4 * area)
        mass[np.ix_(face, face)] += area * np.array([[2, 1, 1], [1, 2, 1], [1, 1, 2]]) / 12
    return stiffness, mass


def count_below(stiffness: np.ndarray, mass: np.ndarray, shift: float) -> int:
    """By the law of inertia, in numbers of 200 bits."""
    rest, negative = stiffness - mpmath.mpf(shift) * mass, 0
    while len(rest):
        negative += rest[0, 0] < 0
        rest = rest[1:, 1:] - np.outer(rest[1:, 0], rest[0, 1:] / rest[0, 0])
    return negative


@pytest.mark.parametrize("kind", ["needles", "caps", "bent", "row"])
@pytest.mark.parametrize(
    "aspect",
    [0.3, 1e-3, 1e-6, *(pytest.param(10.0**-e, marks=pytest.mark.slow) for e in (1, 2, 4, 5, 7))],
)
def test_exact_eigenvalues_are_within_the_bound(kind: str, aspect: float) -> None:
    mesh = thin(aspect, kind, seed=round(-100 * np.log10(aspect)))
    found = spectrum.compute(mesh, K)
    bound = found.certificate.error_bound
    assert bound is not None
    with mpmath.workprec(BITS):
        matrices = exact_matrices(mesh)
        for i, (value, off) in enumerate(zip(found.eigenvalues, bound, strict=True), start=1):
            assert count_below(*matrices, value - off) <= i
            assert count_below(*matrices, value + off) > i
        worst = int(np.argmax(bound / found.eigenvalues))
        value, near = found.eigenvalues[worst], bound[worst] / LOOSE
        if near * LOOSE > 1e-11 * value:
            within = [count_below(*matrices, value + d) for d in (-near, near)]
            assert not within[0] <= worst + 1 < within[1]


def test_the_residual_alone_does_not_see_the_rounding_of_a_thin_strip() -> None:
    mesh = thin(1e-5, "needles", seed=0)
    found = spectrum.compute(mesh, K)
    bound = found.certificate.error_bound
    assert bound is not None
    assert (bound / found.eigenvalues).max() > 20 * found.certificate.residual


def test_on_an_ordinary_mesh_the_bound_is_rounding() -> None:
    sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 40})
    found = spectrum.compute(sphere)
    bound = found.certificate.error_bound
    assert bound is not None
    assert bound.shape == (10,)
    assert (bound / found.eigenvalues).max() < 1e-11


def test_certificates_are_compared_without_the_bound() -> None:
    proof = spectrum.compute(thin(0.3, "needles", seed=0), K).certificate
    assert dataclasses.replace(proof, error_bound=None) == proof
