"""The error bound of a spectrum, against exact arithmetic."""

import dataclasses
import math

import mpmath
import numpy as np
import pytest
import trimesh

from evidence.operators import square
from evidence.thin_meshes import BITS, K, exact_matrices, judge, thin, within
from synthnet import spectrum
from synthnet.errors import CertificateError
from synthnet.spectrum import delaunay, rounding
from synthnet.types import Mesh
from tests.spectrum.meshes import rectangle, side_by_side, sphere

pytestmark = pytest.mark.filterwarnings("ignore:rounding on thin")  # these meshes are to show it


@pytest.mark.parametrize("kind", ["needles", "caps", "bent", "row"])
@pytest.mark.parametrize(
    "aspect",
    [0.3, 1e-3, 1e-6, *(pytest.param(10.0**-e, marks=pytest.mark.slow) for e in (1, 2, 4, 5, 7))],
)
def test_exact_eigenvalues_are_within_the_bound(aspect, kind):
    mesh = thin(aspect, kind, seed=round(-100 * np.log10(aspect)))
    if (kind, aspect) == ("row", 1e-7):  # one thin row beside wide ones: the count cannot be proved
        for sharp in (False, True):
            with pytest.raises(CertificateError, match="rounding moves the shift"):
                spectrum.compute(mesh, K, sharp=sharp)
        return
    outcome = judge(mesh)
    wrong = ("plain outside", "sharp outside", "plain loose")
    assert [name for name in wrong if outcome[name]] == []


@pytest.mark.parametrize("mass", ["lumped", "mean"])
@pytest.mark.parametrize("sharp", [False, True], ids=["matrices", "sharp"])
@pytest.mark.parametrize("thin", [1e-3, 1e-7])
def test_bounds_of_other_masses_hold_beside_a_tiny_angle(thin, mass, sharp):
    """Of its two long edges, the area is wrong by rounding over the sine of that angle."""
    corners = [[0, 0, 0], [1 / 3, thin / 7, thin / 3], [1, 0.5, 0.6], [thin, thin / 3, thin / 9]]
    vertices = np.array(corners) + np.array([0.1, 0.2, 0.3])
    mesh = Mesh(vertices, np.array([[0, 3, 2], [0, 1, 3], [1, 2, 3]]))
    result = spectrum.compute(mesh, 3, operator=spectrum.Operator(mass=mass), sharp=sharp)
    bound = result.certificate.error_bound
    with mpmath.workprec(BITS):
        stiffness, consistent = exact_matrices(mesh)
        lumped = np.diag(consistent.sum(axis=1))
        matrices = stiffness, lumped if mass == "lumped" else (lumped + consistent) / 2
        for i in range(3):
            assert within(matrices, i + 1, result.eigenvalues[i], bound[i])


@pytest.mark.parametrize(("aspect", "gain"), [(1e-5, 5), (0.3, 1)])
def test_sharp_eigenvalues_are_nearer_on_thin_triangles_and_the_same_on_others(aspect, gain):
    gains = []
    for seed in range(6):  # how much a single mesh gains depends on the processor's rounding
        mesh = thin(aspect, "needles", seed=seed)
        plain, sharp = spectrum.compute(mesh, K), spectrum.compute(mesh, K, sharp=True)
        bounds = plain.certificate.error_bound, sharp.certificate.error_bound
        assert (bounds[1] <= bounds[0]).all()
        gains.append(bounds[0][0] / bounds[1][0])
        off = np.abs(plain.eigenvalues - sharp.eigenvalues)
        assert (off <= bounds[0] + bounds[1]).all()
        assert sharp.trivial == 0
        assert sharp.eigenvectors.shape == plain.eigenvectors.shape
    assert len(gains) == 6
    assert np.exp(np.log(gains).mean()) > gain


def test_the_residual_alone_does_not_see_the_rounding_of_a_thin_strip():
    mesh = thin(1e-5, "needles", seed=0)
    result = spectrum.compute(mesh, K)
    bound = result.certificate.error_bound
    assert (bound / result.eigenvalues).max() > 20 * result.certificate.residual


PAIRS = [(0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0)]  # corners, then sides


def exact_quadratic(mesh):
    """Matrices of λᵢ² and 2 λᵢ λⱼ on flat triangles, in numbers of mpmath's precision."""
    points = np.array([[mpmath.mpf(float(x)) for x in row] for row in mesh.vertices])
    unknowns = {}
    rows = []
    for face in mesh.faces.tolist():
        names = [tuple(sorted((face[a], face[b]))) for a, b in PAIRS]
        rows.append([unknowns.setdefault(name, len(unknowns)) for name in names])
    slopes = np.zeros((6, 3, 3), dtype=int)  # of each function by each λ: factors of the three λ
    for number, (a, b) in enumerate(PAIRS):
        slopes[number, a, b] += 2
        if a != b:
            slopes[number, b, a] += 2
    fourth = np.zeros((6, 6), dtype=int)  # 720 / 2 times the integrals of products over |T|
    for i, j in np.ndindex(6, 6):
        powers = np.bincount([*PAIRS[i], *PAIRS[j]], minlength=3)
        fourth[i, j] = math.prod(map(math.factorial, powers)) * (1 + (i > 2)) * (1 + (j > 2))
    n = len(unknowns)
    stiffness, mass = (np.array([[mpmath.mpf(0)] * n for _ in range(n)]) for _ in range(2))
    for face, row in zip(mesh.faces.tolist(), rows, strict=True):
        edges = np.roll(points[face], 1, axis=0) - np.roll(points[face], -1, axis=0)
        dots = edges @ edges.T
        area = mpmath.sqrt(dots[0, 0] * dots[1, 1] - dots[0, 1] ** 2) / 2
        second = np.ones((3, 3), dtype=int) + np.eye(3, dtype=int)
        energies = np.einsum("ika,ab,jlb->ijkl", slopes, second, slopes).reshape(6, 6, 9)
        stiffness[np.ix_(row, row)] += energies.astype(object) @ dots.ravel() / (48 * area)
        mass[np.ix_(row, row)] += fourth.astype(object) * area / 360
    return stiffness, mass


@pytest.mark.parametrize("kind", ["needles", "caps", "row"])
@pytest.mark.parametrize(
    "aspect",
    [1e-4, *(pytest.param(a, marks=pytest.mark.slow) for a in (0.3, 1e-2, 1e-5, 1e-6, 1e-8))],
)
@pytest.mark.parametrize("elements", ["quadratic", "delaunay"])
def test_bounds_of_other_elements_hold(aspect, kind, elements):
    """Intrinsic triangles of a strip in a plane are triangles of its points."""
    mesh = thin(aspect, kind, seed=round(-100 * np.log10(aspect)))
    operator = spectrum.Operator(elements=elements)
    if (kind, aspect) == ("row", 1e-8):
        with pytest.raises(CertificateError, match="rounding moves the shift"):
            spectrum.compute(mesh, K, operator=operator)
        return
    result = spectrum.compute(mesh, K, operator=operator)
    bound = result.certificate.error_bound
    with mpmath.workprec(BITS):
        if elements == "quadratic":
            matrices = exact_quadratic(mesh)
        else:
            matrices = exact_matrices(Mesh(mesh.vertices, delaunay.triangulate(mesh)[0]))
        for i, (value, off) in enumerate(zip(result.eigenvalues, bound, strict=True), start=1):
            assert within(matrices, i, value, off)
    assert aspect < 1e-5 or (bound < 0.02 * result.eigenvalues).all()


@pytest.mark.parametrize("elements", ["quadratic", "curved", "delaunay"])
def test_what_rounding_has_spoilt_is_said_of_other_elements_too(elements):
    mesh = thin(1e-8, "needles", seed=1)
    with pytest.warns(RuntimeWarning, match=r"may have moved λ1 = .*: remesh, some triangles"):
        spectrum.compute(mesh, K, operator=spectrum.Operator(elements=elements))


@pytest.mark.parametrize("elements", ["quadratic", "curved", "delaunay", "tufted"])
@pytest.mark.parametrize("boundary", ["neumann", "dirichlet"])
def test_on_an_ordinary_mesh_the_bounds_of_other_elements_are_rounding(elements, boundary):
    operator = spectrum.Operator(boundary=boundary, elements=elements)
    result = spectrum.compute(square(16), operator=operator)
    assert (result.certificate.error_bound / result.eigenvalues).max() < 1e-9


def test_on_an_ordinary_mesh_the_bound_is_rounding():
    result = spectrum.compute(sphere(40))
    bound = result.certificate.error_bound
    assert bound.shape == (10,)
    assert (bound / result.eigenvalues).max() < 1e-11


def test_so_many_that_they_are_bounded_in_blocks_have_a_bound_as_sharp():
    result = spectrum.compute(square(40), 150)
    bound = result.certificate.error_bound
    assert (bound / result.eigenvalues).max() < 2e-12  # 7e-12 by vectors taken as Ritz vectors


def test_certificates_are_compared_without_the_bound():
    proof = spectrum.compute(thin(0.3, "needles", seed=0), K).certificate
    assert dataclasses.replace(proof, error_bound=None) == proof


def test_equal_components_have_bounds_though_the_last_of_the_label_is_in_a_cluster():
    twice = side_by_side(sphere(14), sphere(14))
    for sharp in (False, True):
        bound = spectrum.compute(twice, sharp=sharp).certificate.error_bound
        assert bound.max() < 1e-10


@pytest.mark.parametrize(
    ("along", "across", "width", "k"),
    [(6, 2, 1e-7, 10), (30, 2, 3e-8, 58), (30, 2, 5e-7, 58), (60, 3, 1e-6, 200)],
)
def test_small_eigenvalues_are_kept_beside_those_across_a_strip(along, across, width, k):
    """Without waves across it, a strip as thin as this is a line of linear elements."""
    result = spectrum.compute(rectangle(along, across, height=width), k, sharp=True)
    values, bound = result.eigenvalues, result.certificate.error_bound
    assert values[-1] > 1e12 * values[0]
    turn = np.pi * np.arange(1, along) / along
    line = 12 * along**2 * np.sin(turn / 2) ** 2 / (2 + np.cos(turn))
    np.testing.assert_allclose(values[: along - 1], line, rtol=1e-10)  # but for width squared
    assert (bound <= 1e-11 * values).all()


@pytest.mark.parametrize("sharp", [False, True], ids=["matrices", "sharp"])
def test_the_bounds_of_small_eigenvalues_beside_large_ones_hold(sharp):
    mesh = rectangle(6, 2, height=1e-7)
    result = spectrum.compute(mesh, 10, sharp=sharp)
    bound = result.certificate.error_bound
    with mpmath.workprec(BITS):
        matrices = exact_matrices(mesh)
        for i in range(10):
            assert within(matrices, i + 1, result.eigenvalues[i], bound[i])


def test_components_of_very_different_size_have_the_eigenvalues_they_have_alone():
    ball = trimesh.creation.icosphere(subdivisions=0)
    vertices, faces = ball.vertices, np.array(ball.faces)
    alone = spectrum.compute(Mesh(vertices, faces), 11, sharp=True).eigenvalues  # all of them
    sizes = 2.0 ** -np.arange(0, 28, 4)  # powers of 2, so that nothing else is rounded
    balls = side_by_side(*(Mesh(vertices * size, faces) for size in sizes), apart=0.0)
    result = spectrum.compute(balls, 77, sharp=True)
    expected = np.sort((alone / sizes[:, None] ** 2).ravel())
    assert expected[-1] > 1e14 * expected[0]
    np.testing.assert_allclose(result.eigenvalues, expected, rtol=1e-12)
    assert (result.certificate.error_bound <= 1e-9 * result.eigenvalues).all()


def test_labels_that_were_right_at_once_are_not_computed_anew(monkeypatch):
    monkeypatch.setattr(rounding, "_graded", None)
    for mesh in (sphere(14), thin(1e-3, "needles", seed=0), rectangle(30, 2, height=1e-2)):
        spectrum.compute(mesh, 10, sharp=True)


def test_where_the_second_solver_fails_the_first_answer_stays(monkeypatch):
    def fails(gram, heavy):
        raise np.linalg.LinAlgError

    mesh = rectangle(6, 2, height=1e-7)
    new = spectrum.compute(mesh, 10, sharp=True)
    monkeypatch.setattr(rounding, "_graded", fails)
    old = spectrum.compute(mesh, 10, sharp=True)
    off = np.abs(old.eigenvalues - new.eigenvalues)
    assert off[0] > new.certificate.error_bound[0]
    assert (off <= old.certificate.error_bound).all()


@pytest.mark.parametrize(
    ("aspect", "sharp", "repair", "advice"),
    [
        (1e-8, False, False, "sharp=True computes it"),
        (1e-8, False, True, "sharp=True computes it"),
        (10**-9.5, True, False, "remesh"),
    ],
)
def test_a_large_bound_comes_with_a_warning_and_advice(aspect, sharp, repair, advice):
    mesh = thin(aspect, "needles", seed=0)
    expected = rf"rounding on thin triangles may have moved λ1 = .*: {advice}"
    with pytest.warns(RuntimeWarning, match=expected) as warned:
        spectrum.compute(mesh, K, sharp=sharp, repair=repair)
    assert [warning.filename for warning in warned] == [__file__]
