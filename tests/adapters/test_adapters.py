"""Adapters give the numbers of the library whose names they have, or of the solver behind them."""

import lapy
import numpy as np
import pytest
import torch
import trimesh
from scipy import sparse
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from torch_geometric.data import Batch, Data

from evidence.operators import square
from synthnet.adapters.diffusionnet import compute_operators
from synthnet.adapters.geomfum import CertifiedEigsh
from synthnet.adapters.lapy import Solver
from synthnet.adapters.pyg import AddMeshSpectrum
from synthnet.adapters.sklearn import ShapeDNA
from synthnet.spectrum import compute, spectra

TORUS = trimesh.creation.torus(2.0, 0.7, major_sections=24, minor_sections=12)
BOX = trimesh.creation.box((1.0, 1.3, 1.9)).subdivide().subdivide().subdivide()
HALVES = trimesh.util.concatenate([TORUS, BOX.copy().apply_translation([9, 0, 0])])


def tria(mesh):
    return lapy.TriaMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def data(mesh):
    return Data(pos=torch.tensor(mesh.vertices), face=torch.tensor(mesh.faces).T)


def assert_eigenpairs(values, vectors, stiffness, mass):
    np.testing.assert_allclose(vectors.T @ (mass @ vectors), np.eye(len(values)), atol=1e-9)
    assert np.abs(stiffness @ vectors - mass @ vectors * values).max() < 1e-6


@pytest.mark.parametrize("lump", [False, True])
@pytest.mark.parametrize("mesh", [TORUS, BOX, HALVES], ids=["torus", "box", "two components"])
def test_the_solver_gives_the_numbers_of_lapy(mesh, lump):
    ours, theirs = Solver(tria(mesh), lump=lump), lapy.Solver(tria(mesh), lump=lump)
    assert abs(ours.stiffness - theirs.stiffness).max() < 1e-12
    assert abs(ours.mass - theirs.mass).max() < 1e-12
    values, vectors = ours.eigs(k=12)
    np.testing.assert_allclose(values, theirs.eigs(k=12)[0], rtol=1e-8, atol=1e-8)
    assert_eigenpairs(values, vectors, theirs.stiffness, theirs.mass)


@pytest.mark.parametrize("k", [1, 2, 3])
def test_the_zeros_of_components_are_the_first(k):
    values, vectors = Solver(tria(HALVES)).eigs(k)
    assert vectors.shape == (len(HALVES.vertices), k)
    assert np.count_nonzero(values) == max(0, k - 2)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        ({"sigma": 3.0}, ValueError, "only the smallest"),
        ({"which": "SM"}, ValueError, "only the smallest"),
        ({"mode": "buckling"}, ValueError, "only the smallest"),
        ({"k": 0}, ValueError, "k must be from 1 to 288"),
        ({"tol": 1e-3}, TypeError, "no parameter tol"),
    ],
)
def test_what_the_solver_does_not_do_is_one_line(given, error, message):
    with pytest.raises(error, match=message):
        Solver(tria(TORUS)).eigs(**given)


def test_anisotropic_elements_are_refused():
    with pytest.raises(ValueError, match=r"use lapy\.Solver"):
        Solver(tria(TORUS), aniso=1.0)


def test_the_transform_adds_a_row_a_mesh_and_vectors_a_vertex():
    add = AddMeshSpectrum(4, eigenvectors=True)
    batch = Batch.from_data_list([add(data(TORUS)), add(data(BOX))])
    expected = [compute(TORUS, 4), compute(BOX, 4)]
    np.testing.assert_array_equal(batch.eigenvalues, [result.eigenvalues for result in expected])
    np.testing.assert_array_equal(
        batch.eigenvectors, np.vstack([result.eigenvectors for result in expected])
    )
    assert repr(add) == "AddMeshSpectrum(4, eigenvectors=True)"


def test_the_transform_keeps_the_dtype_and_adds_no_vectors_unasked():
    given = data(TORUS)
    given.pos = given.pos.float()
    done = AddMeshSpectrum(3)(given)
    assert done.eigenvalues.dtype == torch.float32
    assert "eigenvectors" not in done
    assert "eigenvalues" not in given  # a transform leaves what it is given as it is


def test_the_transform_of_whole_coordinates_has_the_default_dtype():
    whole = Data(pos=(1000 * data(TORUS).pos).round().long(), face=data(TORUS).face)
    done = AddMeshSpectrum(3, eigenvectors=True)(whole)
    assert done.eigenvalues.dtype == done.eigenvectors.dtype == torch.float32
    expected = compute(whole, 3).eigenvalues
    np.testing.assert_allclose(done.eigenvalues[0], expected, rtol=1e-6)


def test_shape_dna_is_a_step_of_a_pipeline():
    larger = TORUS.copy().apply_scale(3.0)
    rows = make_pipeline(clone(ShapeDNA(k=5))).fit_transform([TORUS, larger, BOX])
    np.testing.assert_allclose(rows[0], compute(TORUS, 5).eigenvalues * TORUS.area, rtol=1e-12)
    np.testing.assert_allclose(rows[0], rows[1], rtol=1e-9)
    scaled = make_pipeline(ShapeDNA(k=5), StandardScaler()).fit_transform([TORUS, larger, BOX])
    np.testing.assert_allclose(scaled.mean(axis=0), 0, atol=1e-12)


def test_shape_dna_takes_every_normalisation_and_names_its_columns():
    values = compute(TORUS, 3).eigenvalues
    for normalisation, expected in {
        "none": values,
        "volume": values * abs(TORUS.volume) ** (2 / 3),
        "first": values / values[0],
    }.items():
        step = ShapeDNA(3, normalisation)
        np.testing.assert_allclose(step.transform([TORUS])[0], expected, rtol=1e-12)
    (row,) = ShapeDNA(3, "none", reweighted=True).transform([TORUS])
    np.testing.assert_allclose(row, values / [1, 2, 3], rtol=1e-12)
    assert list(ShapeDNA(2).get_feature_names_out()) == ["lambda1", "lambda2"]
    assert ShapeDNA(4).transform([]).shape == (0, 4)


@pytest.mark.parametrize("offset", [0.0, 1e6, 1e8])
@pytest.mark.parametrize("turn", [1, -1])
def test_shape_dna_by_volume_hangs_neither_on_the_place_nor_on_inside_out(offset, turn):
    there = TORUS.vertices + np.array([offset, offset, 0])
    (row,) = ShapeDNA(3, "volume").transform([(there, TORUS.faces[:, ::turn])])
    expected = compute(TORUS, 3).eigenvalues * TORUS.volume ** (2 / 3)
    np.testing.assert_allclose(row, expected, rtol=1e-6)


def test_shape_dna_by_volume_refuses_an_open_surface():
    with pytest.raises(ValueError, match="3 edges have not two faces: only a closed surface"):
        ShapeDNA(3, "volume").transform([(TORUS.vertices, TORUS.faces[1:])])


def test_adapters_repair_where_that_is_asked_for():
    corners = TORUS.triangles.reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    soup = trimesh.Trimesh(corners, faces, process=False)
    expected = compute(TORUS, 5).eigenvalues
    solver = Solver(tria(soup), repair=True)
    assert solver.repairs == {"merged vertices": len(soup.vertices) - len(TORUS.vertices)}
    values, vectors = solver.eigs(6)
    np.testing.assert_allclose(values[1:], expected, rtol=1e-8)
    assert vectors.shape == (len(solver.mesh.vertices), 6)
    (row,) = ShapeDNA(5, repair=True).transform([soup])
    np.testing.assert_allclose(row, expected * TORUS.area, rtol=1e-8)
    added = AddMeshSpectrum(5, repair=True)(data(soup))
    np.testing.assert_allclose(added.eigenvalues[0], expected, rtol=1e-8)
    (result,) = spectra([soup], 5, repair=True)
    np.testing.assert_allclose(result.eigenvalues, expected, rtol=1e-8)
    for solve in (
        lambda: Solver(tria(soup)).eigs(6)[0],
        lambda: AddMeshSpectrum(5)(data(soup)).eigenvalues[0],
    ):
        with pytest.warns(UserWarning, match="^no two of the 576 faces share a vertex"):
            unasked = solve()
        assert not np.allclose(unasked[-5:], expected, rtol=1e-2)
    with pytest.raises(ValueError, match="not at the vertices of the data: repair it first"):
        AddMeshSpectrum(5, eigenvectors=True, repair=True)


# DiffusionNet's operators: matrices and eigenvalues against LaPy's with a lumped mass, frames and
# gradients against their definitions, written here vertex by vertex.

OPERATORS = ("frames", "massvec", "L", "evals", "evecs", "gradX", "gradY")


def operators(mesh, k=8, dtype=torch.float64, **options):
    vertices, faces = torch.tensor(mesh.vertices, dtype=dtype), torch.tensor(mesh.faces)
    return dict(zip(OPERATORS, compute_operators(vertices, faces, k, **options), strict=True))


@pytest.mark.parametrize("mesh", [TORUS, BOX, HALVES], ids=["torus", "box", "two components"])
def test_diffusionnets_matrices_and_pairs_are_those_of_lapy_with_a_lumped_mass(mesh):
    ours, theirs = operators(mesh), lapy.Solver(tria(mesh), lump=True)
    np.testing.assert_allclose(ours["L"].to_dense(), theirs.stiffness.toarray(), atol=1e-12)
    np.testing.assert_allclose(ours["massvec"], theirs.mass.diagonal(), rtol=1e-12)
    values, vectors = ours["evals"].numpy(), ours["evecs"].numpy()
    np.testing.assert_allclose(values, theirs.eigs(k=8)[0], rtol=1e-8, atol=1e-8)
    assert_eigenpairs(values, vectors, theirs.stiffness, theirs.mass)


def test_a_frame_is_two_tangents_and_the_mean_normal():
    frames = operators(TORUS)["frames"].numpy()
    cosines = []
    for i, (x, y, normal) in enumerate(frames):
        mean = TORUS.face_normals[(TORUS.faces == i).any(axis=1)].mean(axis=0)
        np.testing.assert_allclose(normal, mean / np.linalg.norm(mean), atol=1e-9)
        near = np.eye(3)[0 if abs(normal[0]) < 0.9 else 1]
        np.testing.assert_allclose(np.cross(x, near) @ normal, 0, atol=1e-12)
        np.testing.assert_allclose(np.cross(normal, x), y, atol=1e-12)
        assert x @ near > 0
        cosines.append(abs(normal[0]))
    gram = frames @ frames.transpose(0, 2, 1)
    np.testing.assert_allclose(gram, [np.eye(3)] * len(frames), atol=1e-9)
    assert min(cosines) < 0.9 < max(cosines)


def test_a_gradient_is_the_regularised_fit_to_the_differences_along_edges():
    small = TORUS.copy().apply_scale(0.02)  # edges so short that the constant counts
    ours = operators(small)
    function = np.random.default_rng(0).normal(size=len(small.vertices))
    gradients = np.stack(
        [(ours[name] @ torch.tensor(function)).numpy() for name in ("gradX", "gradY")]
    )
    far = 0.0
    for i, (x, y, _) in enumerate(ours["frames"].numpy()):
        others = small.vertex_neighbors[i]
        edges = (small.vertices[others] - small.vertices[i]) @ np.stack([x, y], axis=1)
        differences = function[others] - function[i]
        rows = np.vstack([edges, np.sqrt(1e-5) * np.eye(2)])  # Tikhonov's form of the constant
        fit = np.linalg.lstsq(rows, np.append(differences, [0, 0]))[0]
        np.testing.assert_allclose(gradients[:, i], fit, rtol=1e-8, atol=1e-8)
        far = max(far, np.abs(np.linalg.lstsq(edges, differences)[0] - fit).max())
    assert far > 1  # without the constant it would be another gradient


def test_a_linear_function_on_a_plane_has_a_constant_gradient():
    plane = square(6)
    flat = 100 * plane.vertices
    flat[:, :2] += np.random.default_rng(1).uniform(-4, 4, size=(49, 2))
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])[:3, :3]
    ours = operators(trimesh.Trimesh(flat @ turn.T, plane.faces, process=False))
    slope = np.array([0.3, -1.1, 0.0])
    function = torch.tensor(flat @ slope)
    x, y, _ = ours["frames"][0].numpy()
    np.testing.assert_allclose(ours["gradX"] @ function, np.full(49, x @ turn @ slope), atol=1e-6)
    np.testing.assert_allclose(ours["gradY"] @ function, np.full(49, y @ turn @ slope), atol=1e-6)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_operators_have_the_shapes_and_the_dtype_of_diffusionnets(dtype):
    computed = operators(BOX, 5, dtype)
    n = len(BOX.vertices)
    assert {name: tuple(operator.shape) for name, operator in computed.items()} == {
        "frames": (n, 3, 3),
        "massvec": (n,),
        "L": (n, n),
        "evals": (5,),
        "evecs": (n, 5),
        "gradX": (n, n),
        "gradY": (n, n),
    }
    assert {operator.dtype for operator in computed.values()} == {dtype}
    pattern = computed["L"].indices()
    for name, operator in computed.items():
        assert operator.is_sparse == (name in ("L", "gradX", "gradY"))
        assert not operator.is_sparse or torch.equal(operator.coalesce().indices(), pattern)
    none = operators(BOX, 0, dtype)
    assert (none["evals"].shape, none["evecs"].shape) == ((0,), (n, 0))


def test_given_normals_are_taken():
    tilted = torch.tensor(TORUS.vertex_normals)
    assert torch.equal(operators(TORUS, normals=tilted)["frames"][:, 2], tilted)
    with pytest.raises(ValueError, match="normals must be 288 vectors of length one"):
        operators(TORUS, normals=2 * tilted)


def test_what_has_no_operators_is_one_line():
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    with pytest.raises(ValueError, match="the faces around 3 vertices cancel"):
        compute_operators(points, torch.tensor([[0, 1, 2], [0, 2, 1]]), 1)
    with pytest.raises(ValueError, match="a point cloud: 3 vertices and no triangles"):
        compute_operators(points, torch.zeros((0, 3), dtype=torch.int64), 2)
    with pytest.raises(ValueError, match=r"verts must be a tensor .* got torch\.int64"):
        compute_operators(points.long(), torch.tensor([[0, 1, 2]]), 2)


# geomfum's eigensolver


def lumped(mesh):
    theirs = lapy.Solver(tria(mesh), lump=True)
    return theirs.stiffness, theirs.mass


@pytest.mark.filterwarnings("ignore:BackendImporter:ImportWarning")
@pytest.mark.parametrize("mesh", [TORUS, HALVES], ids=["torus", "two components"])
def test_the_eigensolver_gives_the_numbers_of_a_finder_of_geomfum(mesh):
    from geomfum.laplacian import LaplacianFinder, LaplacianSpectrumFinder
    from geomfum.shape import TriangleMesh

    shape = TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))
    options = {"spectrum_size": 9, "laplacian_finder": LaplacianFinder()}
    finders = [
        LaplacianSpectrumFinder(**options, eig_solver=solver)
        for solver in (CertifiedEigsh(9), None)
    ]
    ours, theirs = (finder(shape, as_basis=True) for finder in finders)
    np.testing.assert_allclose(ours.vals, theirs.vals, rtol=1e-8, atol=1e-8)
    assert_eigenpairs(ours.vals, ours.vecs, *shape.laplacian.find())
    finders[0].spectrum_size = 4
    four = finders[0](shape, as_basis=False)[0]
    np.testing.assert_allclose(four, ours.vals[:4], rtol=1e-9, atol=1e-12)


@pytest.mark.filterwarnings("ignore:Sparse (CSC tensor|invariant checks):UserWarning")
def test_the_eigensolver_returns_tensors_where_tensors_are_given():
    stiffness, mass = lumped(HALVES)
    tensors = [
        torch.sparse_csc_tensor(
            *map(torch.tensor, (matrix.indptr, matrix.indices, matrix.data)), matrix.shape
        )
        for matrix in (stiffness, mass)
    ]
    values, vectors = CertifiedEigsh(6)(tensors[0], M=tensors[1])
    for tensor, array in zip((values, vectors), CertifiedEigsh(6)(stiffness, M=mass), strict=True):
        assert isinstance(tensor, torch.Tensor)
        np.testing.assert_array_equal(tensor, array)


def test_matrices_that_are_no_laplacian_and_lumped_mass_are_one_line():
    stiffness, mass = lumped(TORUS)
    seventh = np.arange(288) == 7
    infinite = stiffness.copy()
    infinite.data[0] = np.inf
    not_finite = "matrix has entries that are NaN or inf"
    for matrix, masses, message in (
        (stiffness, lapy.Solver(tria(TORUS)).mass, "mass matrix is not diagonal"),
        (
            stiffness,
            sparse.diags(np.where(seventh, 0, mass.diagonal())),
            "1 vertices have no positive mass, the first is vertex 7",
        ),
        (stiffness, sparse.diags(np.where(seventh, np.nan, 1.0)), f"the mass {not_finite}"),
        (infinite, mass, f"the stiffness {not_finite}"),
        (stiffness + sparse.identity(288), mass, "rows do not add up to zero"),
        (stiffness.astype(np.float32), mass, "no Laplacian in float64"),
        (-stiffness, mass, "has 287 negative eigenvalues: give -A"),
        (stiffness, mass[:5, :5], r"of one size, got \(288, 288\) and \(5, 5\)"),
        (stiffness[:5], mass, r"must be square .* got \(5, 288\)"),
        (stiffness, None, "must be sparse ones of SciPy, .* got NoneType"),
        (torch.eye(3), torch.eye(3), r"layout sparse_csc, got torch\.strided"),
    ):
        with pytest.raises(ValueError, match=message):
            CertifiedEigsh(6)(matrix, M=masses)
    with pytest.raises(ValueError, match="k must be from 1 to 288"):
        CertifiedEigsh(289)(stiffness, M=mass)


def test_one_negative_eigenvalue_among_others_is_refused():
    stiffness, mass = lumped(TORUS)
    bump = np.zeros(288)
    bump[[3, 200]] = 1, -1
    heavy = sparse.csc_matrix(9 * np.outer(bump, bump))
    assert CertifiedEigsh(6)(stiffness + heavy, M=mass)[0][1] > 0
    with pytest.raises(ValueError, match="has 1 negative eigenvalue:"):
        CertifiedEigsh(6)(stiffness - heavy, M=mass)
