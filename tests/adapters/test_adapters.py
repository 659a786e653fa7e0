"""Adapters give the numbers of the library whose names they have, or of the solver behind them."""

import lapy
import numpy as np
import pytest
import torch
import trimesh
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from torch_geometric.data import Batch, Data

from synthnet.adapters.lapy import Solver
from synthnet.adapters.pyg import AddMeshSpectrum
from synthnet.adapters.sklearn import ShapeDNA
from synthnet.spectrum import compute

TORUS = trimesh.creation.torus(2.0, 0.7, major_sections=24, minor_sections=12)
BOX = trimesh.creation.box((1.0, 1.3, 1.9)).subdivide().subdivide().subdivide()
HALVES = trimesh.util.concatenate([TORUS, BOX.copy().apply_translation([9, 0, 0])])


def tria(mesh: trimesh.Trimesh) -> lapy.TriaMesh:
    return lapy.TriaMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def data(mesh: trimesh.Trimesh) -> Data:
    return Data(pos=torch.tensor(mesh.vertices), face=torch.tensor(mesh.faces).T)


@pytest.mark.parametrize("lump", [False, True])
@pytest.mark.parametrize("mesh", [TORUS, BOX, HALVES], ids=["torus", "box", "two components"])
def test_the_solver_gives_the_numbers_of_lapy(mesh: trimesh.Trimesh, lump: bool) -> None:
    ours, theirs = Solver(tria(mesh), lump=lump), lapy.Solver(tria(mesh), lump=lump)
    assert abs(ours.stiffness - theirs.stiffness).max() < 1e-12
    assert abs(ours.mass - theirs.mass).max() < 1e-12
    values, vectors = ours.eigs(k=12)
    np.testing.assert_allclose(values, theirs.eigs(k=12)[0], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(vectors.T @ (theirs.mass @ vectors), np.eye(12), atol=1e-9)
    residual = theirs.stiffness @ vectors - theirs.mass @ vectors * values
    assert np.abs(residual).max() < 1e-6


@pytest.mark.parametrize("k", [1, 2, 3])
def test_the_zeros_of_components_are_the_first(k: int) -> None:
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
def test_what_the_solver_does_not_do_is_one_line(given, error, message) -> None:
    with pytest.raises(error, match=message):
        Solver(tria(TORUS)).eigs(**given)


def test_anisotropic_elements_are_refused() -> None:
    with pytest.raises(ValueError, match=r"use lapy\.Solver"):
        Solver(tria(TORUS), aniso=1.0)


def test_the_transform_adds_a_row_a_mesh_and_vectors_a_vertex() -> None:
    add = AddMeshSpectrum(4, eigenvectors=True)
    batch = Batch.from_data_list([add(data(TORUS)), add(data(BOX))])
    expected = [compute(TORUS, 4), compute(BOX, 4)]
    np.testing.assert_array_equal(batch.eigenvalues, [one.eigenvalues for one in expected])
    np.testing.assert_array_equal(
        batch.eigenvectors, np.vstack([one.eigenvectors for one in expected])
    )
    assert repr(add) == "AddMeshSpectrum(4, eigenvectors=True)"


def test_the_transform_keeps_the_dtype_and_adds_no_vectors_unasked() -> None:
    given = data(TORUS)
    given.pos = given.pos.float()
    done = AddMeshSpectrum(3)(given)
    assert done.eigenvalues.dtype == torch.float32
    assert "eigenvectors" not in done
    assert "eigenvalues" not in given  # a transform leaves what it is given as it is


def test_shape_dna_is_a_step_of_a_pipeline() -> None:
    larger = TORUS.copy().apply_scale(3.0)
    rows = make_pipeline(clone(ShapeDNA(k=5))).fit_transform([TORUS, larger, BOX])
    np.testing.assert_allclose(rows[0], compute(TORUS, 5).eigenvalues * TORUS.area, rtol=1e-12)
    np.testing.assert_allclose(rows[0], rows[1], rtol=1e-9)
    scaled = make_pipeline(ShapeDNA(k=5), StandardScaler()).fit_transform([TORUS, larger, BOX])
    np.testing.assert_allclose(scaled.mean(axis=0), 0, atol=1e-12)


def test_shape_dna_takes_every_normalisation_and_names_its_columns() -> None:
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
