import dataclasses
from typing import ClassVar

import lapy
import numpy as np
import pytest
from scipy import linalg

from synthnet import spectrum
from synthnet.errors import CertificateError, SpectrumError
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.families.primitives import convex_hull
from synthnet.mesh import geometry
from synthnet.mesh.open3d import subdivide
from synthnet.spectrum import certificate, fem, reference, rounding, search, solve
from synthnet.spectrum.lanczos import Lanczos, RitzPairs
from synthnet.spectrum.ldl import Factor, factorise
from synthnet.spectrum.ordering import find_ordering
from synthnet.types import Mesh
from tests.spectrum import meshes
from tests.spectrum.meshes import reference_eigenvalues, sphere, tetrahedron


def drawn(family, index):
    return meshes.drawn(family, index).stored()


def box(subdivisions):
    size = {"width": 1.0, "height": 0.6, "depth": 1.7}
    return FAMILIES["rectangular_prism"].generate({**size, "subdivisions": subdivisions})


def rectangle(columns, rows):
    return meshes.rectangle(columns, rows, height=0.7)


def reference_matrices(mesh):
    return reference.matrices(mesh.vertices, mesh.faces)


# --- matrices -------------------------------------------------------------------------


def test_matrices_of_one_right_triangle():
    # Legs 1, area 1/2; gradients (-1,-1), (1,0), (0,1).
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    stiffness, mass = spectrum.fem_matrices(mesh)
    expected = [[1, -0.5, -0.5], [-0.5, 0.5, 0], [-0.5, 0, 0.5]]
    np.testing.assert_allclose(stiffness.toarray(), expected, atol=1e-15)
    np.testing.assert_allclose(mass.toarray() * 24, [[2, 1, 1], [1, 2, 1], [1, 1, 2]])


@pytest.mark.parametrize("family", PRIMITIVES)
def test_constants_and_areas(family):
    mesh = drawn(family, 5)
    stiffness, mass = spectrum.fem_matrices(mesh)
    rows = np.abs(stiffness @ np.ones(len(mesh.vertices)))
    assert rows.max() <= 1e-12 * abs(stiffness).max()
    assert mass.sum() == pytest.approx(geometry.area(mesh), rel=1e-12)
    for matrix in (stiffness, mass):
        assert abs(matrix - matrix.T).max() <= 1e-14 * abs(matrix).max()
        assert matrix.dtype == np.float64


def test_stiffness_measures_the_gradient_of_a_linear_function():
    mesh = rectangle(3, 5)
    stiffness, mass = spectrum.fem_matrices(mesh)
    f = mesh.vertices @ [3.0, 4.0, 0.0] + 1
    assert f @ stiffness @ f == pytest.approx(5**2 * 0.7, rel=1e-13)
    # The integral of x² over [0, 1] × [0, 0.7].
    x = mesh.vertices[:, 0]
    assert x @ mass @ x == pytest.approx(0.7 / 3, rel=1e-13)


# --- eigenvalues ----------------------------------------------------------------------


@pytest.mark.parametrize("index", [0, *(pytest.param(i, marks=pytest.mark.slow) for i in (11, 23))])
@pytest.mark.parametrize("family", PRIMITIVES)
def test_labels_are_those_of_lapy(family, index):
    mesh = drawn(family, index)
    result = spectrum.compute(mesh)
    solver = lapy.Solver(lapy.TriaMesh(mesh.vertices.astype(np.float64), mesh.faces))
    start = np.random.default_rng(1).random(len(mesh.vertices)) - 0.5
    expected, _ = solver.eigs(11, v0=start)
    np.testing.assert_allclose(result.eigenvalues, expected[1:], rtol=1e-8)
    assert result.eigenvalues.dtype == np.float64
    assert abs(result.trivial) < 1e-8 * result.eigenvalues[0]
    assert result.certificate.residual <= 1e-7
    assert (np.diff(result.eigenvalues) >= 0).all()


def fast(mesh):
    return spectrum.compute(mesh).eigenvalues


def slow(mesh):
    return reference.eigenpairs(*reference_matrices(mesh), 11)[0][1:]


@pytest.mark.parametrize("solver", [fast, slow])
def test_sphere_converges_to_l_times_l_plus_one_with_order_two(solver):
    exact = np.repeat([2.0, 6.0, 12.0], [3, 5, 2])
    sizes = [10, 20, 40, 80]
    errors = [np.abs(solver(sphere(n)) / exact - 1) for n in sizes]
    assert errors[-1].max() < 2e-3
    np.testing.assert_allclose(order_of_convergence(sizes, errors), 2, atol=0.1)


@pytest.mark.parametrize("solver", [fast, slow])
def test_rectangle_converges_to_the_neumann_spectrum_from_above(solver):
    # On [0, 1] × [0, 0.7] the eigenvalues are π² (i² + (j / 0.7)²), with i and j from 0.
    modes = np.arange(11)
    exact = np.sort((np.pi**2 * (modes[:, None] ** 2 + (modes / 0.7) ** 2)).ravel())[1:11]
    sizes = [8, 16, 32, 64]
    errors = [solver(rectangle(n, n)) / exact - 1 for n in sizes]
    assert (np.array(errors) > 0).all()  # Ritz values are upper bounds
    assert errors[-1].max() < 0.015
    np.testing.assert_allclose(order_of_convergence(sizes, errors), 2, atol=0.1)


def order_of_convergence(sizes, errors):
    return -np.polyfit(np.log(sizes), np.log(errors), 1)[0]


def test_subdividing_a_polyhedron_lowers_every_eigenvalue():
    spectra = [spectrum.compute(box(times)).eigenvalues for times in (1, 2, 3, 4)]
    assert (np.diff(spectra, axis=0) < 0).all()  # the spaces of functions are nested


@pytest.mark.parametrize("scale", [1e-3, 0.5, 3.0, 1e4])
def test_eigenvalues_scale_by_the_inverse_square(scale):
    mesh = box(3)
    scaled = spectrum.compute(Mesh(mesh.vertices * scale, mesh.faces))
    expected = spectrum.compute(mesh).eigenvalues / scale**2
    np.testing.assert_allclose(scaled.eigenvalues, expected, rtol=1e-10)


def test_eigenvalues_are_invariant_under_isometry_and_numbering():
    mesh = drawn("conical_frustum", 2)
    rng = np.random.default_rng(0)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    expected = spectrum.compute(mesh).eigenvalues
    vertices = mesh.vertices.astype(np.float64)
    permutation = rng.permutation(len(vertices))
    number = np.argsort(permutation)  # the new number of each old vertex
    copies = {
        "rotation": Mesh(vertices @ rotation.T, mesh.faces),
        "reflection": Mesh(vertices * [1, -1, 1], mesh.faces[:, ::-1]),
        "translation": Mesh(vertices + np.array([1, -2, 3]), mesh.faces),
        "vertex permutation": Mesh(vertices[permutation], number[mesh.faces]),
        "face permutation": Mesh(vertices, np.roll(rng.permutation(mesh.faces), 1, axis=1)),
    }
    for name, copy in copies.items():
        values = spectrum.compute(copy).eigenvalues
        np.testing.assert_allclose(values, expected, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("mesh", [sphere(4), sphere(20), box(4)], ids=["26", "762", "1538"])
def test_eigenpairs_solve_the_equation(mesh):
    result = spectrum.compute(mesh, k=6)
    stiffness, mass = spectrum.fem_matrices(mesh)
    vectors, values = result.eigenvectors, result.eigenvalues
    assert vectors.shape == (len(mesh.vertices), 6)
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(
        vectors.T @ stiffness @ vectors, np.diag(values), atol=1e-11 * values[-1]
    )
    np.testing.assert_allclose(mass.sum(axis=0) @ vectors, 0, atol=1e-10)
    defect = np.linalg.norm(stiffness @ vectors - mass @ vectors * values, axis=0)
    relative = defect / np.linalg.norm(mass @ vectors, axis=0) / values
    assert relative.max() <= result.certificate.residual * (1 + 1e-6) <= 1e-7
    assert abs(result.trivial) < 1e-11


def test_the_same_mesh_gives_the_same_bytes():
    mesh = drawn("torus", 0)
    first = spectrum.compute(mesh)
    second = spectrum.compute(mesh)
    assert first.eigenvalues.tobytes() == second.eigenvalues.tobytes()
    assert first.eigenvectors.tobytes() == second.eigenvectors.tobytes()
    assert (first.trivial, first.certificate) == (second.trivial, second.certificate)


# --- the two solvers ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mesh", "k"),
    [
        *((mesh, 25) for mesh in (box(3), drawn("split_cone", 1), rectangle(17, 13))),
        # Many eigenvalues of small meshes
        *((rectangle(8, 4), 15), (rectangle(8, 4), 19), (rectangle(7, 6), 25)),
        *((rectangle(9, 9), 47), (rectangle(16, 3), 10)),
    ],
)
def test_no_eigenvalue_is_missed(mesh, k):
    everything = reference_eigenvalues(mesh)
    values = spectrum.compute(mesh, k).eigenvalues
    np.testing.assert_allclose(values, everything[1 : k + 1], rtol=1e-9)


@pytest.mark.parametrize(
    ("columns", "rows", "k", "solver"),
    [
        (7, 7, 3, "dense"),  # 64 vertices
        (10, 5, 10, "dense"),  # 66 = 6 · 11
        (12, 4, 3, "searched"),  # 65
        (16, 3, 10, "searched"),  # 68
        (16, 3, 11, "dense"),  # 68 ≤ 6 · 12
    ],
)
def test_small_meshes_go_to_the_dense_solver(columns, rows, k, solver, monkeypatch):
    asked = []

    def fail(name):
        def failing(*arguments):
            asked.append(name)
            raise SpectrumError(name)

        return failing

    monkeypatch.setattr(solve, "_dense", fail("dense"))
    monkeypatch.setattr(solve, "search", fail("searched"))
    with pytest.raises(SpectrumError, match=solver):
        spectrum.compute(rectangle(columns, rows), k)
    # By the stronger setting too, and a search with a shift that is placed by counts
    assert asked == [solver] * (2 if solver == "dense" else 3)


@pytest.mark.parametrize("mesh", [rectangle(8, 5), box(3), sphere(20), drawn("torus", 3)])
def test_both_settings_and_the_dense_solver_agree(mesh):
    expected = reference_eigenvalues(mesh)[1:11]
    matrices = spectrum.discretise(mesh).matrices
    ordering = find_ordering(matrices.indptr, matrices.indices)
    for setting in (solve.NORMAL, solve.STRONGER):
        candidate, certified = solve._certified(matrices, ordering, 10, setting)
        np.testing.assert_allclose(candidate.values[:10], expected, rtol=1e-9)
        assert certified.residual <= setting.residual


@pytest.mark.parametrize(("k", "lean"), [(8, False), (8, True), (30, False), (30, True)])
@pytest.mark.parametrize("boundary", ["neumann", "dirichlet"])
def test_what_is_done_piece_by_piece_for_many_pairs_and_large_meshes_agrees(
    k, lean, boundary, monkeypatch
):
    mesh = rectangle(24, 18)
    whole = spectrum.compute(mesh, k, operator=spectrum.Operator(boundary))
    for module in (fem, rounding):
        monkeypatch.setattr(module, "PIECE", 50)
    monkeypatch.setattr(fem, "FINE", 100)
    monkeypatch.setattr(solve, "LARGE_FROM", 0 if lean else 10**9)
    found = spectrum.compute(mesh, k, operator=spectrum.Operator(boundary))
    np.testing.assert_allclose(found.eigenvalues, whole.eigenvalues, rtol=1e-11)
    np.testing.assert_allclose(  # the rectangle has no equal eigenvalues
        np.abs(found.eigenvectors), np.abs(whole.eigenvectors), atol=1e-5
    )
    mass = spectrum.fem_matrices(mesh)[1]
    products = found.eigenvectors.T @ mass @ found.eigenvectors
    np.testing.assert_allclose(products, np.eye(k), atol=1e-12)
    bounds = (found.certificate.error_bound, whole.certificate.error_bound)
    assert (bounds[0] <= 10 * bounds[1]).all()
    assert (bounds[1] <= 10 * bounds[0]).all()


def test_what_is_no_mesh_is_refused():
    with pytest.raises(
        ValueError,
        match=r"this is numpy\.ndarray, no mesh: give a mesh of .*compute\(\(vertices, faces\)\)",
    ):
        spectrum.compute(np.zeros((4, 3)), np.zeros((4, 3)))


@pytest.mark.parametrize("k", [1, 2, 3])
def test_few_eigenvalues_are_the_first(k):
    mesh = rectangle(17, 13)
    result = spectrum.compute(mesh, k)
    np.testing.assert_allclose(
        result.eigenvalues, spectrum.compute(mesh).eigenvalues[:k], rtol=1e-9
    )
    assert result.eigenvectors.shape == (len(mesh.vertices), k)


def test_all_eigenvalues_of_a_tetrahedron():
    # Its edge is 2 sqrt 2, its face |T| = 2 sqrt 3. All angles are 60°, so
    # A_ij = -cot 60° = -1/sqrt 3 and A_ii = 3/sqrt 3; B_ij = |T|/6 and B_ii = 3 |T|/6.
    # On vectors of mean zero, A is 4/sqrt 3 and B is |T|/3 = 2/sqrt 3.
    result = spectrum.compute(tetrahedron(), k=3)
    np.testing.assert_allclose(result.eigenvalues, 2, rtol=1e-14)


# --- errors ---------------------------------------------------------------------------


def set_all(monkeypatch, **changes):
    """Let every search be the usual one but for these settings."""
    setting = dataclasses.replace(solve.NORMAL, **changes)
    for name in ("NORMAL", "STRONGER", "PLACED"):
        monkeypatch.setattr(solve, name, setting)


def test_lanczos_that_does_not_converge_is_a_spectrum_error(monkeypatch):
    set_all(monkeypatch, residual=1e-300, excused=0.0, vectors=1)
    with pytest.raises(SpectrumError, match=r"^no convergence in 81 Lanczos vectors$"):
        spectrum.compute(sphere(10))


@pytest.mark.parametrize("height", [1e-8, 1e-9])
def test_a_search_that_fails_by_thin_triangles_says_so(height):
    with pytest.raises(SpectrumError, match=r": some triangles are too thin, .* edge: remesh$"):
        spectrum.compute(meshes.rectangle(39, 3, height=height), 3)


def test_a_residual_that_rounding_keeps_from_falling_is_accepted_up_to_a_limit(monkeypatch):
    expected = spectrum.compute(sphere(10))
    for excused in (1e-12, 2e-14):  # rounding ends at some 5e-14
        set_all(monkeypatch, residual=1e-14, excused=excused)
        if excused == 1e-12:
            accepted = spectrum.compute(sphere(10))
            assert 1e-14 < accepted.certificate.residual <= 1e-12
            np.testing.assert_allclose(accepted.eigenvalues, expected.eigenvalues, rtol=1e-12)
        else:
            with pytest.raises(SpectrumError, match=r"^no convergence in \d+ Lanczos vectors$"):
                spectrum.compute(sphere(10))


def test_a_broken_factorisation_is_a_spectrum_error(monkeypatch):
    def broken(*arguments, **options):
        return Factor(np.array([1.0, np.inf]), np.zeros(0), np.nan)

    monkeypatch.setattr(search, "factorise", broken)
    monkeypatch.setattr(certificate, "factorise", broken)
    with pytest.raises(SpectrumError, match=r"^a pivot of A - \S+ B is zero$"):
        spectrum.compute(sphere(10))
    with pytest.raises(SpectrumError, match=r"^a pivot of A - 3 B is zero$"):
        spectrum.count_below(sphere(10), 3.0)


# --- the certificate ------------------------------------------------------------------


@pytest.mark.parametrize(
    "family",
    [
        pytest.param(name, marks=[] if name in ("torus", "split_cone") else pytest.mark.slow)
        for name in PRIMITIVES
    ],
)
def test_a_certificate_holds_against_all_eigenvalues(family):
    mesh = drawn(family, 3 if family != "sphere" else 20)
    result = spectrum.compute(mesh)
    proof = result.certificate
    stiffness, mass = reference_matrices(mesh)
    if len(mesh.vertices) > 3000:  # by ARPACK: the dense solver would take minutes
        values, _ = reference.eigenpairs(stiffness, mass, proof.count + 3)
    else:
        values = reference.all_eigenvalues(stiffness, mass)
    assert reference.count_below(stiffness, mass, proof.shift) == proof.count
    assert np.count_nonzero(values < proof.shift) == proof.count >= 11
    gap = values[proof.count] - values[proof.count - 1]
    assert gap > solve.NORMAL.gap * proof.shift / 2
    assert abs(values - proof.shift).min() > gap / 4
    assert spectrum.count_below(mesh, proof.shift) == [proof.count]
    assert abs(result.eigenvalues / values[1:11] - 1).max() <= proof.residual <= 1e-7


def test_the_residual_bounds_the_error_of_a_vector_that_is_no_eigenvector():
    mesh = drawn("cylinder", 3)
    matrices = spectrum.discretise(mesh).matrices
    stiffness, mass = (matrix.toarray() for matrix in spectrum.fem_matrices(mesh))
    values, vectors = linalg.eigh(stiffness, mass)
    rng = np.random.default_rng(0)
    for size in (1e-6, 1e-3, 0.1):
        x = vectors[:, 5] + size * vectors @ rng.normal(size=len(values))
        x /= np.sqrt(x @ mass @ x)
        value = np.array([x @ stiffness @ x])
        bound = certificate.largest_residual(
            matrices, (stiffness @ x - value * (mass @ x))[None], value
        )
        assert np.abs(values / value - 1).min() <= bound


def test_eigenvalues_below_a_shift_are_counted():
    mesh = rectangle(11, 9)
    values = reference_eigenvalues(mesh)
    counts = [1, 2, 11, 40, len(values) - 1]
    shifts = [(values[count - 1] + values[count]) / 2 for count in counts]
    assert spectrum.count_below(mesh, -1.0, *shifts, 2 * values[-1]) == [0, *counts, len(values)]


class Careless(Lanczos):
    """Loses one of the first pair of equal eigenvalues, as an iterative solver may."""

    lost: ClassVar[list[float]] = []

    def ritz(self):
        pairs = super().ritz()
        equal = np.flatnonzero(np.diff(pairs.values) < 1e-3 * pairs.values[1:])
        return self.without(pairs, equal[:1])

    def without(self, pairs, places):
        self.lost.extend(pairs.values[places])
        keep = np.setdiff1d(np.arange(len(pairs.values)), places)
        return RitzPairs(
            pairs.values[keep], pairs.errors[keep], pairs.inside[:, keep], pairs.outside[:, keep]
        )


class Blind(Careless):
    """Never shows the first of these eigenvalues again once one copy of it is known."""

    def ritz(self):
        pairs = super().ritz()
        if self.first == 1:
            return pairs
        return self.without(
            pairs, np.flatnonzero(abs(pairs.values - self.lost[0]) < 1e-3 * self.lost[0])
        )


PAIRS = {"torus": drawn("torus", 0), "sphere": sphere(20), "cylinder": drawn("cylinder", 1)}
each_with_pairs = pytest.mark.parametrize("mesh", PAIRS.values(), ids=PAIRS)


@each_with_pairs
def test_a_missed_eigenvalue_of_a_pair_is_caught_and_found(mesh, monkeypatch):
    expected = spectrum.compute(mesh)
    monkeypatch.setattr(Careless, "lost", [])
    monkeypatch.setattr(search, "Lanczos", Careless)
    result = spectrum.compute(mesh)
    assert Careless.lost  # something was dropped
    np.testing.assert_allclose(result.eigenvalues, expected.eigenvalues, rtol=1e-9)
    assert result.certificate.count >= expected.certificate.count


@each_with_pairs
def test_a_setting_that_misses_one_is_followed_by_the_stronger(mesh, monkeypatch):
    expected = spectrum.compute(mesh)
    monkeypatch.setattr(Careless, "lost", [])

    def blind_at_first(*arguments, **options):
        return (Lanczos if options["strict"] else Blind)(*arguments, **options)

    certified, tried = solve._certified, []

    def noted(matrices, ordering, k, setting):
        tried.append(setting)
        return certified(matrices, ordering, k, setting)

    monkeypatch.setattr(solve, "_certified", noted)
    monkeypatch.setattr(search, "Lanczos", blind_at_first)
    result = spectrum.compute(mesh)
    assert Careless.lost
    assert tried == [solve.NORMAL, solve.STRONGER]  # no third attempt
    np.testing.assert_allclose(result.eigenvalues, expected.eigenvalues, rtol=1e-9)


@pytest.mark.slow
@each_with_pairs
def test_a_solver_that_always_misses_one_of_a_pair_gives_no_label(mesh, monkeypatch):
    monkeypatch.setattr(Careless, "lost", [])
    monkeypatch.setattr(search, "Lanczos", Blind)
    with pytest.raises(SpectrumError, match=r"\d+ eigenvalues are below|^no convergence"):
        spectrum.compute(mesh)


def icosahedron():
    golden = (1 + 5**0.5) / 2
    corners = [[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)]
    points = np.array([np.roll(corner, shift) for corner in corners for shift in range(3)])
    return convex_hull(points.astype(np.float64))


def octahedron():
    return convex_hull(np.concatenate([np.eye(3), -np.eye(3)]))


@pytest.mark.parametrize("k", [10, 20])
@pytest.mark.parametrize("times", [2, 3, pytest.param(4, marks=pytest.mark.slow)])
@pytest.mark.parametrize("solid", [icosahedron, octahedron, tetrahedron])
def test_eigenvalues_of_symmetric_meshes_have_all_their_copies(solid, times, k):
    # Irreducible representations of these groups have up to five dimensions, so eigenvalues
    # have up to five copies, equal to rounding.
    mesh = subdivide(solid(), times)
    expected = reference_eigenvalues(mesh)[1 : k + 1]
    result = spectrum.compute(mesh, k)
    np.testing.assert_allclose(result.eigenvalues, expected, rtol=1e-9)


TWO_PAIRS = certificate.Candidate(np.array([1.0, 2.0]), np.eye(2), 1e-9, (2.0, 3.0))


def test_a_residual_that_does_not_prove_the_count_is_refused():
    pairs = dataclasses.replace(TWO_PAIRS, residual=0.2)  # 2 (1 + 0.2 √2) > 2.5
    counted = Factor(np.array([-1.0, -1, -1, 1]), np.zeros(0), 0.0)
    with pytest.raises(CertificateError, match=r"^an eigenvalue of residual 0.2 may be above 2.5$"):
        certificate.certify(pairs, counted)
    fine = dataclasses.replace(pairs, residual=0.1)
    assert certificate.certify(fine, counted).count == 3


def test_a_residual_next_to_zero_reaches_as_far_as_what_it_is_relative_to():
    pairs = dataclasses.replace(TWO_PAIRS, residual=0.2, floor=1.9)
    counted = Factor(np.array([-1.0, -1, -1, 1]), np.zeros(0), 0.0)
    low = dataclasses.replace(pairs, values=np.array([0.01, 0.02]), gap=(0.02, 1.0))
    assert low.reach == pytest.approx(0.2 * np.sqrt(2) * 1.9)  # past the shift, 0.51
    with pytest.raises(CertificateError, match=r"^an eigenvalue of residual 0.2 may be above 0.51"):
        certificate.certify(low, counted)


def test_a_count_that_rounding_decides_is_refused(monkeypatch):
    def vague(*arguments, **options):
        return dataclasses.replace(factorise(*arguments, **options), uncertainty=1.0)

    monkeypatch.setattr(certificate, "factorise", vague)
    with pytest.raises(CertificateError, match=r"^rounding moves the shift \S+ of the count by 1,"):
        spectrum.compute(sphere(10))


def test_rounding_may_move_a_count_by_a_hundredth_of_the_way_out_of_its_gap():
    counted = Factor(np.array([-1.0, -1, -1, 1]), np.zeros(0), 0.0049)
    assert certificate.certify(TWO_PAIRS, counted).count == 3
    with pytest.raises(CertificateError, match=r"by 0.0051, .* 1/100 of half the gap from 2 to 3$"):
        certificate.certify(TWO_PAIRS, dataclasses.replace(counted, uncertainty=0.0051))


@pytest.mark.parametrize("negative", [2, 4])
def test_a_count_that_is_not_that_of_the_pairs_is_refused(negative):
    counted = Factor(np.array([-1.0] * negative + [1.0]), np.zeros(0), 0.0)
    message = rf"^{negative} eigenvalues are below 2.5, but 3 were found$"
    with pytest.raises(CertificateError, match=message):
        certificate.certify(TWO_PAIRS, counted)


BALL = sphere(10)


def test_edges_of_many_faces_are_said():
    faces = np.concatenate([BALL.faces, [[0, 5, 40]], [[0, 40, 5]]])
    tied = Mesh(BALL.vertices.astype(np.float64), faces)
    many = int((geometry.MeshFacts(tied).edge_valences > 2).sum())
    assert many > 0
    with pytest.warns(UserWarning, match=rf"^{many} edges? ha(s|ve) more than two faces"):
        spectrum.compute(tied)


def test_triangles_whose_corners_are_apart_warn():
    """As an STL file has them: each is a component, with the spectrum of a flat triangle."""
    mesh = Mesh(BALL.vertices.astype(np.float64), BALL.faces)
    apart = Mesh(mesh.vertices[mesh.faces.ravel()], np.arange(mesh.faces.size).reshape(-1, 3))
    with pytest.warns(UserWarning, match=f"^no two of the {len(mesh.faces)} faces share a vertex"):
        found = spectrum.compute(apart, 3)
    assert found.components == len(mesh.faces)
    joined = spectrum.compute(apart, 3, repair=True)
    np.testing.assert_allclose(
        joined.eigenvalues, spectrum.compute(mesh, 3).eigenvalues, rtol=1e-12
    )
