"""Boundary conditions, mass matrices and elements, against closed forms and dense solvers."""

from itertools import product

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evidence import numbers
from evidence.operators import CELLS, SHAPES, problems, row, square
from evidence.thin_meshes import BITS, count_below, exact_matrices, thin
from synthnet import spectrum
from synthnet.families.atlas import Atlas
from synthnet.families.elements import assemble as assemble_on_atlas
from synthnet.spectrum import Operator, components
from synthnet.spectrum.operators import MASSES, as_sparse, discretise
from synthnet.spectrum.solve import smallest
from synthnet.types import Mesh
from tests.spectrum.meshes import dense, side_by_side, sphere

WRITTEN = numbers.read("operators")["rows"]  # what docs/spectrum.md says
CHOICES = [(elements, mass) for elements, masses in MASSES.items() for mass in masses]


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize(("elements", "mass"), CHOICES)
def test_errors_fall_at_the_order_of_the_elements(name, elements, mass):
    measured = row(name, elements, mass, CELLS)
    assert problems({"rows": [measured]}) == []
    of = {"shape": name, "elements": elements, "mass": mass}
    (written,) = (row for row in WRITTEN if of.items() <= row.items())
    np.testing.assert_allclose(measured["errors"], written["errors"], rtol=1e-3)


@pytest.mark.parametrize(("elements", "mass"), CHOICES)
@pytest.mark.parametrize("boundary", ["neumann", "dirichlet", "mask"])
def test_none_is_missed_and_vectors_are_orthonormal(elements, mass, boundary):
    mesh = square(9)
    held = mesh.vertices[:, 0] == 0 if boundary == "mask" else boundary
    operator = Operator(held, mass, elements)
    result = spectrum.compute(mesh, 15, operator=operator)
    values = dense(mesh, operator)
    zeros = int(boundary == "neumann")
    np.testing.assert_allclose(result.eigenvalues, values[zeros : zeros + 15], rtol=1e-9)
    shift = result.certificate.shift
    assert result.certificate.count == np.count_nonzero(values < shift)
    assert spectrum.count_below(mesh, shift, operator=operator) == [result.certificate.count]
    assert np.isnan(result.trivial) == (boundary != "neumann")
    if boundary != "neumann":
        on = mesh.vertices[:, 0] == 0
        assert (result.eigenvectors[on] == 0).all()
    if not operator.on_edges:
        discrete = discretise(mesh, operator)
        matrix = as_sparse(discrete.matrices)[1]
        free = slice(None) if discrete.free is None else discrete.free
        vectors = result.eigenvectors[free]
        np.testing.assert_allclose(vectors.T @ (matrix @ vectors), np.eye(15), atol=1e-8)


@given(st.integers(0, 2**32), st.sampled_from(CHOICES), st.booleans())
@settings(max_examples=40, deadline=None)
def test_random_discs_with_random_masks(seed, choice, several):
    rng = np.random.default_rng(seed)
    mesh = square(int(rng.integers(3, 9)))
    mesh = Mesh(mesh.vertices + rng.uniform(-0.02, 0.02, mesh.vertices.shape), mesh.faces)
    if several:
        mesh = side_by_side(mesh, sphere(9))
    held = rng.random(len(mesh.vertices)) < rng.choice([0.0, 0.1, 0.5])
    held[mesh.faces[0]] = False
    elements, mass = choice
    operator = Operator(held, mass, elements)
    discrete = discretise(mesh, operator)
    count, numbers = components.components(discrete.matrices)
    zeros = int(components.unheld(discrete.matrices, numbers).sum())
    values = dense(mesh, operator)
    k = min(8, len(values) - zeros)
    result = spectrum.compute(mesh, k, operator=operator)
    assert result.components == count
    assert np.count_nonzero(values < 1e-9 * values[-1]) == zeros
    np.testing.assert_allclose(result.eigenvalues, values[zeros : zeros + k], rtol=1e-7)


@pytest.mark.parametrize("mass", ["consistent", "mean", "lumped"])
@pytest.mark.parametrize("aspect", [0.3, 1e-4])
@pytest.mark.parametrize("held", [False, True], ids=["neumann", "held"])
def test_exact_eigenvalues_are_within_the_bound(mass, aspect, held):
    mesh = thin(aspect, "needles", seed=1)
    mask = np.zeros(len(mesh.vertices), dtype=bool)
    mask[mesh.faces[0, 0]] = held
    operator = Operator(mask, mass)
    result = spectrum.compute(mesh, 4, operator=operator)
    bound = result.certificate.error_bound
    free = np.flatnonzero(~mask)
    with mpmath.workprec(BITS):
        stiffness, consistent = exact_matrices(mesh)
        share = operator.share
        matrices = stiffness, share * consistent + (1 - share) * np.diag(consistent.sum(axis=1))
        matrices = [matrix[np.ix_(free, free)] for matrix in matrices]
        zeros = int(not held)
        for i, (value, off) in enumerate(zip(result.eigenvalues, bound, strict=True), start=zeros):
            value, off = mpmath.mpf(value), mpmath.mpf(off)
            assert count_below(*matrices, value - off) <= i < count_below(*matrices, value + off)


def test_quadratic_elements_are_those_of_the_atlas_of_flat_triangles():
    mesh = sphere(12)
    corners = mesh.vertices[mesh.faces]
    charts = np.zeros(len(corners), dtype=np.int64)
    atlas = Atlas(corners, charts, lambda _, points: points)
    other = spectrum.of_matrices(assemble_on_atlas(atlas, atlas.uniform(1), degree=2), 8)
    mine = spectrum.compute(mesh, 8, operator=Operator(elements="quadratic"))
    np.testing.assert_allclose(mine.eigenvalues, other.eigenvalues, rtol=1e-9)


def test_tufted_is_the_lumped_cotangent_operator_of_a_delaunay_surface():
    mesh = sphere(20)
    tufted = spectrum.compute(mesh, operator=Operator(elements="tufted"))
    plain = spectrum.compute(mesh, operator=Operator(mass="lumped"))
    np.testing.assert_allclose(tufted.eigenvalues, plain.eigenvalues, rtol=1e-3)


def test_tufted_takes_what_is_no_manifold_and_flat_triangles_without_a_word():
    page = square(8)
    spine = np.flatnonzero(page.vertices[:, 0] == 0)
    book = [page.vertices]
    faces = [page.faces]
    for angle in (2.0, 4.0):
        turned = page.vertices @ [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [0, 0, 1]]
        number = np.arange(len(turned)) + sum(map(len, book))
        number[spine] = spine
        book.append(turned)
        faces.append(number[page.faces])
    joined = np.concatenate(faces)
    used, renumbered = np.unique(joined, return_inverse=True)
    mesh = Mesh(np.concatenate(book)[used], renumbered.reshape(-1, 3))
    result = spectrum.compute(mesh, 5, operator=Operator(elements="tufted"))  # warnings are errors
    # Across the spine, pages agree in value: even modes cos(iπx), odd ones sin((i + ½)πx), twice
    rates = [(i * np.pi) ** 2 for i in range(3)] + 2 * [((i + 0.5) * np.pi) ** 2 for i in range(3)]
    exact = np.sort([rate + (j * np.pi) ** 2 for rate, j in product(rates, range(3))])
    np.testing.assert_allclose(result.eigenvalues, exact[1:6], rtol=0.06)
    with pytest.warns(UserWarning, match="edges have more than two faces"):
        spectrum.compute(mesh, 5)
    corners = np.array([[0.0, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0]])
    flat = Mesh(corners, np.array([[0, 1, 2], [0, 2, 3], [2, 1, 3]]))
    assert spectrum.compute(flat, 2, operator=Operator(elements="tufted")).eigenvalues[0] > 0
    with pytest.raises(ValueError, match="1 of 3 faces have no area"):
        spectrum.compute(flat, 2)


def test_a_component_that_is_not_held_keeps_its_zero():
    mesh = side_by_side(square(10), sphere(12))
    operator = Operator("dirichlet")
    result = spectrum.compute(mesh, 10, operator=operator)
    values = dense(mesh, operator)
    assert result.components == 2
    np.testing.assert_allclose(result.eigenvalues, values[1:11], rtol=1e-8)
    assert result.certificate.count == np.count_nonzero(values < result.certificate.shift)


@pytest.mark.parametrize("several", [False, True])
def test_the_smallest_have_a_zero_only_of_what_is_not_held(several):
    mesh, operator = square(4), Operator("dirichlet")
    mesh = side_by_side(mesh, sphere(12)) if several else mesh
    matrices = discretise(mesh, operator).matrices
    values, vectors = smallest(matrices, 8)
    np.testing.assert_allclose(values, dense(mesh, operator)[:8], rtol=1e-8, atol=1e-10)
    assert np.count_nonzero(values == 0) == int(several)
    mass = as_sparse(matrices)[1]
    np.testing.assert_allclose(vectors.T @ (mass @ vectors), np.eye(8), atol=1e-8)


@pytest.mark.parametrize(("elements", "mass"), CHOICES)
def test_certify_judges_the_operator_that_is_named(elements, mass):
    mesh, operator = square(9), Operator("dirichlet", mass, elements)
    pairs = spectrum.compute(mesh, 6, operator=operator)
    assert spectrum.certify(mesh, pairs.eigenvalues, operator=operator).certified
    assert spectrum.certify(mesh, np.delete(pairs.eigenvalues, 0), operator=operator).missed == (1,)
    assert not spectrum.certify(mesh, pairs.eigenvalues).certified
    if operator.on_edges:
        with pytest.raises(ValueError, match=f"say too little of {elements} elements"):
            spectrum.certify(mesh, pairs.eigenvalues, pairs.eigenvectors, operator=operator)
    else:
        verdict = spectrum.certify(
            mesh, pairs.eigenvalues, pairs.eigenvectors, tolerance=1e-4, operator=operator
        )
        assert verdict.certified
        assert verdict.factorisations == 1


@pytest.mark.parametrize(
    ("names", "line"),
    [
        ({"boundary": "robin"}, "no boundary condition 'robin': 'neumann', 'dirichlet', or a mask"),
        ({"mass": ["lumped"]}, r"no mass \['lumped'\]: 'consistent', 'mean', 'lumped'"),
        ({"elements": ["linear"]}, r"no elements \['linear'\]: 'linear', 'quadratic'"),
        ({"mass": "diagonal"}, "no mass 'diagonal': 'consistent', 'mean', 'lumped'"),
        ({"elements": "cubic"}, "no elements 'cubic': 'linear', 'quadratic', 'curved', 'delaunay'"),
        ({"elements": "quadratic", "mass": "lumped"}, "quadratic elements have no lumped mass"),
        ({"elements": "tufted", "mass": "mean"}, "tufted elements have no mean mass: lumped only"),
    ],
)
def test_an_operator_that_there_is_not_is_one_line(names, line):
    with pytest.raises(ValueError, match=line):
        Operator(**names)


def test_a_mask_that_holds_nothing_is_the_free_boundary():
    mesh = square(6)
    free = spectrum.compute(mesh, 3)
    masked = spectrum.compute(mesh, 3, operator=Operator(np.zeros(len(mesh.vertices), bool)))
    np.testing.assert_array_equal(masked.eigenvalues, free.eigenvalues)
    assert masked.trivial == free.trivial
    assert masked.certificate == free.certificate


def test_a_mask_is_of_the_vertices_that_are_solved_for():
    """Repairs may give vertices other numbers, so none is made beside a mask."""
    mesh = square(4)
    mask = mesh.vertices[:, 0] == 0
    loose = Mesh(np.vstack([[[9.0, 9, 9]], mesh.vertices]), mesh.faces + 1)
    held = Operator(np.append(False, mask))
    for call, wanted in ((spectrum.compute, 2), (spectrum.certify, [1.0, 2.0])):
        with pytest.raises(ValueError, match=r"was repaired \(1 loose vertices\), and a mask"):
            call(loose, wanted, operator=held, repair=True)
    kept = spectrum.compute(mesh, 2, operator=Operator(mask), repair=True)
    np.testing.assert_array_equal(
        kept.eigenvalues, spectrum.compute(mesh, 2, operator=Operator(mask)).eigenvalues
    )


@pytest.mark.parametrize(
    ("operator", "line"),
    [
        ("dirichlet", r"such as Operator\(boundary='dirichlet'\), got 'dirichlet'"),
        ("lumped", r"such as Operator\(mass='lumped'\), got 'lumped'"),
        ("tufted", r"such as Operator\(elements='tufted'\), got 'tufted'"),
        ("robin", r'such as Operator\(boundary="dirichlet"\), got \'robin\''),
        (None, r'such as Operator\(boundary="dirichlet"\), got NoneType'),
        (np.ones(9, bool), r'such as Operator\(boundary="dirichlet"\), got ndarray'),
    ],
)
def test_what_is_no_operator_is_one_line(operator, line):
    for solve, asked, options in (
        (spectrum.compute, 5, {}),
        (spectrum.compute, 5, {"sharp": True}),
        (spectrum.count_below, 5, {}),
        (spectrum.certify, [1.0], {}),
        (spectrum.certify, [1.0], {"repair": True}),
    ):
        with pytest.raises(ValueError, match=f"operator must be an Operator, {line}"):
            solve(square(2), asked, operator=operator, **options)


@pytest.mark.parametrize(
    ("mesh", "boundary", "line"),
    [
        (sphere(9), "dirichlet", "the mesh is closed: it has no boundary"),
        (square(2), np.ones(9, bool), "every unknown is held at zero"),
        (square(2), np.ones(9), r"must be bool of shape \(9,\), got float64 of \(9,\)"),
        (square(2), np.ones(8, bool), r"must be bool of shape \(9,\), got bool of \(8,\)"),
        (square(3), "dirichlet", "k must be between 1 and 4 for 4 free vertices, got 5"),
    ],
)
def test_a_boundary_that_does_not_fit_is_one_line(mesh, boundary, line):
    with pytest.raises(ValueError, match=line):
        spectrum.compute(mesh, 5, operator=Operator(boundary))


@pytest.mark.parametrize(
    ("operator", "line"),
    [
        (Operator(), "k must be between 1 and 8 for 9 vertices, got 50"),
        (Operator(elements="delaunay"), "k must be between 1 and 8 for 9 vertices, got 50"),
        (Operator(elements="quadratic"), "k must be between 1 and 24 for 25 unknowns, got 50"),
        (Operator("dirichlet", elements="quadratic"), "1 and 9 for 9 free unknowns, got 50"),
    ],
)
def test_more_eigenvalues_than_unknowns_are_one_line(operator, line):
    with pytest.raises(ValueError, match=line):
        spectrum.compute(square(2), 50, operator=operator)


def test_only_linear_elements_are_sharp():
    with pytest.raises(ValueError, match="sharp is for linear elements, not tufted ones"):
        spectrum.compute(square(3), 5, sharp=True, operator=Operator(elements="tufted"))


def test_repair_names_what_it_did_and_gives_the_mesh_of_the_vectors():
    ball = sphere(12)
    corners = ball.vertices[ball.faces].reshape(-1, 3)
    soup = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    result = spectrum.compute(soup, 8, repair=True)
    assert result.repairs == {"merged vertices": len(soup.vertices) - len(ball.vertices)}
    assert result.eigenvectors.shape == (len(result.mesh.vertices), 8)
    plain = spectrum.compute(ball, 8)
    np.testing.assert_allclose(result.eigenvalues, plain.eigenvalues, rtol=1e-6)
    assert not plain.repairs
    assert plain.mesh is None
    with pytest.raises(ValueError, match=r"k must be between 1 and .*, got 500"):
        spectrum.compute(sphere(3), 500, repair=True)


def test_a_repaired_mesh_has_as_many_eigenvalues_as_the_same_mesh_had_before():
    mesh, quadratic = sphere(3), Operator(elements="quadratic")
    n = len(mesh.vertices)
    values = spectrum.compute(mesh, n - 1, repair=True).eigenvalues
    assert spectrum.certify(mesh, [0.0, *values], repair=True).certified
    assert len(spectrum.compute(mesh, n + 1, operator=quadratic, repair=True).eigenvalues) == n + 1
