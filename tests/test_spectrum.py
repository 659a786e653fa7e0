from typing import Any

import lapy
import numpy as np
import pytest
from scipy import linalg, sparse
from scipy.sparse.linalg import ArpackNoConvergence

from synthnet import geometry, recipe, spectrum
from synthnet.errors import SpectrumError
from synthnet.families import FAMILIES, draw_shape
from synthnet.types import Mesh

TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def drawn(family: str, index: int) -> Mesh:
    spec = draw_shape(recipe.load("1.0"), family, index)
    return FAMILIES[family].generate(spec.parameters).stored()


def sphere(resolution: int) -> Mesh:
    return FAMILIES["sphere"].generate({"radius": 1.0, "resolution": resolution})


def box(subdivisions: int) -> Mesh:
    size = {"width": 1.0, "height": 0.6, "depth": 1.7}
    return FAMILIES["rectangular_prism"].generate({**size, "subdivisions": subdivisions})


def rectangle(columns: int, rows: int, width: float = 1.0, height: float = 0.7) -> Mesh:
    """Flat grid of columns × rows cells, each cut along the same diagonal."""
    x, y = np.meshgrid(np.linspace(0, width, columns + 1), np.linspace(0, height, rows + 1))
    vertices = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = np.stack([corner, corner + 1, corner + columns + 2], axis=1)
    above = np.stack([corner, corner + columns + 2, corner + columns + 1], axis=1)
    return Mesh(vertices, np.concatenate([below, above]))


def rectangle_eigenvalues(count: int, width: float = 1.0, height: float = 0.7) -> np.ndarray:
    modes = np.arange(count + 1)
    values = np.pi**2 * ((modes[:, None] / width) ** 2 + (modes / height) ** 2)
    return np.sort(values.ravel())[1 : count + 1]


def order_of_convergence(sizes: list[int], errors: list[float]) -> float:
    return float(-np.polyfit(np.log(sizes), np.log(errors), 1)[0])


def loose_vertex(mesh: Mesh) -> Mesh:
    return Mesh(np.vstack([mesh.vertices, [9.0, 9.0, 9.0]]), mesh.faces)


# --- matrices -------------------------------------------------------------------------


def test_matrices_of_one_right_triangle() -> None:
    # Legs 1, area 1/2; gradients (-1,-1), (1,0), (0,1).
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    stiffness, mass = spectrum.fem_matrices(mesh)
    expected = [[1, -0.5, -0.5], [-0.5, 0.5, 0], [-0.5, 0, 0.5]]
    np.testing.assert_allclose(stiffness.toarray(), expected, atol=1e-15)
    np.testing.assert_allclose(mass.toarray() * 24, [[2, 1, 1], [1, 2, 1], [1, 1, 2]])


@pytest.mark.parametrize("family", FAMILIES)
def test_matrices_are_those_of_lapy(family: str) -> None:
    mesh = drawn(family, 5)
    stiffness, mass = spectrum.fem_matrices(mesh)
    solver = lapy.Solver(lapy.TriaMesh(mesh.vertices.astype(np.float64), mesh.faces))
    for ours, theirs in ((stiffness, solver.stiffness), (mass, solver.mass)):
        assert abs(ours - theirs).max() <= 1e-12 * abs(theirs).max()


@pytest.mark.parametrize("family", FAMILIES)
def test_constants_and_areas(family: str) -> None:
    mesh = drawn(family, 5)
    stiffness, mass = spectrum.fem_matrices(mesh)
    rows = np.abs(stiffness @ np.ones(len(mesh.vertices)))
    assert rows.max() <= 1e-12 * abs(stiffness).max()
    assert mass.sum() == pytest.approx(geometry.area(mesh), rel=1e-12)
    for matrix in (stiffness, mass):
        assert abs(matrix - matrix.T).max() <= 1e-14 * abs(matrix).max()
        assert matrix.dtype == np.float64


def test_stiffness_measures_the_gradient_of_a_linear_function() -> None:
    mesh = rectangle(3, 5)
    stiffness, mass = spectrum.fem_matrices(mesh)
    f = mesh.vertices @ [3.0, 4.0, 0.0] + 1
    assert f @ stiffness @ f == pytest.approx(5**2 * 0.7, rel=1e-13)
    # The integral of x² over [0, 1] × [0, 0.7].
    x = mesh.vertices[:, 0]
    assert x @ mass @ x == pytest.approx(0.7 / 3, rel=1e-13)


# --- eigenvalues ----------------------------------------------------------------------


@pytest.mark.parametrize("index", [0, 11, 23])
@pytest.mark.parametrize("family", FAMILIES)
def test_labels_are_those_of_lapy(family: str, index: int) -> None:
    mesh = drawn(family, index)
    found = spectrum.compute(mesh)
    solver = lapy.Solver(lapy.TriaMesh(mesh.vertices.astype(np.float64), mesh.faces))
    start = np.random.default_rng(1).random(len(mesh.vertices)) - 0.5
    expected, _ = solver.eigs(11, v0=start)
    np.testing.assert_allclose(found.eigenvalues, expected[1:], rtol=1e-8)
    assert found.eigenvalues.dtype == np.float64
    assert abs(found.trivial) < 1e-8 * found.eigenvalues[0]
    assert found.residual < 1e-8
    assert (np.diff(found.eigenvalues) >= 0).all()


def test_sphere_converges_to_l_times_l_plus_one_with_order_two() -> None:
    exact = np.repeat([2.0, 6.0, 12.0], [3, 5, 2])
    sizes = [10, 20, 40, 80]
    errors = [np.abs(spectrum.compute(sphere(n)).eigenvalues / exact - 1) for n in sizes]
    assert errors[-1].max() < 2e-3
    for error in np.transpose(errors):
        assert order_of_convergence(sizes, error) == pytest.approx(2, abs=0.1)


def test_rectangle_converges_to_the_neumann_spectrum_from_above() -> None:
    exact = rectangle_eigenvalues(10)
    sizes = [8, 16, 32, 64]
    found = [spectrum.compute(rectangle(n, n)).eigenvalues for n in sizes]
    errors = [values / exact - 1 for values in found]
    assert (np.array(errors) > 0).all()  # Ritz values are upper bounds
    assert errors[-1].max() < 0.015
    for error in np.transpose(errors):
        assert order_of_convergence(sizes, error) == pytest.approx(2, abs=0.1)


def test_subdividing_a_polyhedron_lowers_every_eigenvalue() -> None:
    found = [spectrum.compute(box(times)).eigenvalues for times in (1, 2, 3, 4)]
    assert (np.diff(found, axis=0) < 0).all()  # the spaces of functions are nested


@pytest.mark.parametrize("scale", [1e-3, 0.5, 3.0, 1e4])
def test_eigenvalues_scale_by_the_inverse_square(scale: float) -> None:
    mesh = box(3)
    scaled = spectrum.compute(Mesh(mesh.vertices * scale, mesh.faces))
    expected = spectrum.compute(mesh).eigenvalues / scale**2
    np.testing.assert_allclose(scaled.eigenvalues, expected, rtol=1e-10)


def test_eigenvalues_are_invariant_under_isometry_and_numbering() -> None:
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
        found = spectrum.compute(copy).eigenvalues
        np.testing.assert_allclose(found, expected, rtol=1e-9, err_msg=name)


@pytest.mark.parametrize("mesh", [sphere(4), sphere(20), box(4)], ids=["26", "762", "1538"])
def test_eigenpairs_solve_the_equation(mesh: Mesh) -> None:
    found = spectrum.compute(mesh, k=6)
    stiffness, mass = spectrum.fem_matrices(mesh)
    vectors, values = found.eigenvectors, found.eigenvalues
    assert vectors.shape == (len(mesh.vertices), 6)
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(6), atol=1e-12)
    np.testing.assert_allclose(
        vectors.T @ stiffness @ vectors, np.diag(values), atol=1e-11 * values[-1]
    )
    np.testing.assert_allclose(mass.sum(axis=0) @ vectors, 0, atol=1e-10)
    defect = np.linalg.norm(stiffness @ vectors - mass @ vectors * values, axis=0)
    relative = defect / np.linalg.norm(mass @ vectors, axis=0) / values
    assert relative.max() <= found.residual * (1 + 1e-6) < 1e-10
    assert abs(found.trivial) < 1e-11


def test_the_same_mesh_gives_the_same_bytes() -> None:
    mesh = drawn("torus", 0)
    first = spectrum.compute(mesh)
    second = spectrum.compute(mesh)
    assert first.eigenvalues.tobytes() == second.eigenvalues.tobytes()
    assert first.eigenvectors.tobytes() == second.eigenvectors.tobytes()
    assert (first.trivial, first.residual) == (second.trivial, second.residual)


@pytest.mark.parametrize("shift", [-0.1, -1.0, -30.0])
def test_eigenvalues_do_not_hang_on_the_shift(shift: float) -> None:
    mesh = drawn("tetrahedron", 1)
    found = spectrum.compute(mesh, shift=shift).eigenvalues
    np.testing.assert_allclose(found, spectrum.compute(mesh).eigenvalues, rtol=1e-9)


def test_the_shift_is_in_units_of_one_over_area(monkeypatch: pytest.MonkeyPatch) -> None:
    sigmas = []

    def record(*arguments: Any, sigma: float, **options: Any) -> None:
        sigmas.append((sigma, options["tol"]))
        raise ArpackNoConvergence("stop", [], [])

    monkeypatch.setattr(spectrum, "eigsh", record)
    with pytest.raises(SpectrumError):
        spectrum.compute(rectangle(9, 9, width=2.0, height=5.0), shift=-3.0, tolerance=1e-4)
    assert sigmas == [(pytest.approx(-0.3, rel=1e-12), 1e-4)]


# --- the two solvers ------------------------------------------------------------------


def test_dense_and_sparse_solver_agree() -> None:
    mesh = sphere(4)
    stiffness, mass = spectrum.fem_matrices(mesh)
    dense, _ = spectrum._dense(stiffness, mass, 6)
    lanczos, _ = spectrum._shift_invert(stiffness, mass, 6, -1 / geometry.area(mesh), 0.0)
    np.testing.assert_allclose(dense[1:], np.sort(lanczos)[1:], rtol=1e-11)
    np.testing.assert_array_equal(spectrum.compute(mesh, k=5).eigenvalues, dense[1:])


@pytest.mark.parametrize("mesh", [box(3), drawn("split_cone", 1), rectangle(17, 13)])
def test_no_eigenvalue_is_missed(mesh: Mesh) -> None:
    stiffness, mass = spectrum.fem_matrices(mesh)
    everything = linalg.eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True)
    found = spectrum.compute(mesh, k=25).eigenvalues
    np.testing.assert_allclose(found, everything[1:26], rtol=1e-9)


@pytest.mark.parametrize(
    ("columns", "rows", "k", "solver"),
    [
        (7, 4, 10, "dense"),  # 40 vertices
        (6, 5, 10, "sparse"),  # 42
        (6, 5, 19, "sparse"),  # 42 > 2 · 20 + 1
        (6, 5, 20, "dense"),  # 42 ≤ 2 · 21 + 1
    ],
)
def test_small_meshes_go_to_the_dense_solver(
    columns: int, rows: int, k: int, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def fail(name: str) -> Any:
        def solve(*arguments: Any) -> None:
            asked.append(name)
            raise SpectrumError(name)

        return solve

    monkeypatch.setattr(spectrum, "_dense", fail("dense"))
    monkeypatch.setattr(spectrum, "_shift_invert", fail("sparse"))
    with pytest.raises(SpectrumError, match=solver):
        spectrum.compute(rectangle(columns, rows), k)
    assert asked == [solver]


def test_all_eigenvalues_of_a_tetrahedron() -> None:
    # Regular, edge 2 sqrt 2, face |T| = 2 sqrt 3. All angles are 60°, so
    # A_ij = -cot 60° = -1/sqrt 3 and A_ii = 3/sqrt 3; B_ij = |T|/6 and B_ii = 3 |T|/6.
    # On vectors of mean zero, A is 4/sqrt 3 and B is |T|/3 = 2/sqrt 3.
    vertices = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    found = spectrum.compute(Mesh(vertices, TETRAHEDRON), k=3)
    np.testing.assert_allclose(found.eigenvalues, 2, rtol=1e-14)


# --- errors ---------------------------------------------------------------------------


@pytest.mark.parametrize("k", [-1, 0, 4])
def test_k_out_of_range_is_refused(k: int) -> None:
    mesh = Mesh(np.vstack([np.zeros(3), np.eye(3)]), TETRAHEDRON)
    with pytest.raises(ValueError, match=f"k must be between 1 and 3 for 4 vertices, got {k}"):
        spectrum.compute(mesh, k)


@pytest.mark.parametrize("shift", [0.0, 1.0, np.nan])
def test_a_shift_that_is_not_negative_is_refused(shift: float) -> None:
    with pytest.raises(ValueError, match=f"shift must be negative, got {shift}"):
        spectrum.compute(sphere(4), shift=shift)


@pytest.mark.parametrize("bad", [[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
def test_a_face_without_area_is_refused(bad: list[float]) -> None:
    mesh = Mesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], bad]), TETRAHEDRON)
    count = "3" if np.isnan(bad[0]) else "2"
    with pytest.raises(ValueError, match=f"{count} of 4 faces have no area: remove them first"):
        spectrum.compute(mesh, k=1)


def test_lanczos_that_does_not_converge_is_a_spectrum_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def give_up(*arguments: Any, **options: Any) -> None:
        raise ArpackNoConvergence("No convergence (9 iterations)", np.zeros(0), np.zeros((0, 0)))

    monkeypatch.setattr(spectrum, "eigsh", give_up)
    with pytest.raises(SpectrumError, match=r"Lanczos iteration failed: .*No convergence") as error:
        spectrum.compute(sphere(10))
    assert isinstance(error.value.__cause__, ArpackNoConvergence)


def test_a_failed_factorisation_is_a_spectrum_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def singular(*arguments: Any, **options: Any) -> None:
        raise RuntimeError("Factor is exactly singular")

    monkeypatch.setattr(spectrum, "splu", singular)
    with pytest.raises(SpectrumError, match="factorisation failed: Factor is exactly singular"):
        spectrum.compute(sphere(10))


@pytest.mark.parametrize("resolution", [4, 10])
def test_a_vertex_without_a_face_is_refused(resolution: int) -> None:
    with pytest.raises(ValueError, match=r"^1 vertices belong to no triangle: remove them first$"):
        spectrum.compute(loose_vertex(sphere(resolution)))


def test_relative_residual_is_measured_against_the_larger_of_lambda_and_lambda_1() -> None:
    stiffness, mass = sparse.csc_matrix(np.diag([0.0, 2, 4])), sparse.csc_matrix(3 * np.eye(3))

    def residual(*values: float) -> float:
        return spectrum._relative_residual(stiffness, mass, np.array(values), np.eye(3))

    assert residual(0, 2 / 3, 4 / 3) == pytest.approx(0, abs=1e-15)
    assert residual(1, 2 / 3, 4 / 3) == pytest.approx(1)  # |0 - 3| over 1 · 3
    assert residual(1 / 3, 2 / 3, 4 / 3) == pytest.approx(1 / 2)  # |0 - 1| over 2/3 · 3
    assert residual(0, 2 / 3, 2) == pytest.approx(1 / 3)  # |4 - 6| over 2 · 3
    assert np.isnan(residual(0, np.nan, 1))
    assert not np.isfinite(residual(0, 0, 1))
