"""Meshes of other libraries, and bad ones: the same numbers, or one line."""

import io
import itertools
import re
import sys
import types
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba.core.dispatcher import Dispatcher

from synthnet.mesh.open3d import to_open3d
from synthnet.mesh.repair import Refused
from synthnet.spectrum import (
    as_mesh,
    certify,
    compute,
    count_below,
    fem_matrices,
    spectra,
    surface_eigenvalues,
)
from synthnet.spectrum.warned import collected, warn
from synthnet.types import Mesh
from tests.spectrum.meshes import sphere

SPHERE = sphere(12)
V, F = SPHERE.vertices.astype(np.float64), SPHERE.faces


def trimesh():
    module = pytest.importorskip("trimesh")
    return module.Trimesh(V, F, process=False)


def open3d():
    return to_open3d(SPHERE)


def lapy():
    return pytest.importorskip("lapy").TriaMesh(V, F)


def pyg():
    torch, data = pytest.importorskip("torch"), pytest.importorskip("torch_geometric.data")
    return data.Data(pos=torch.tensor(V, requires_grad=True), face=torch.tensor(F.T))


def tensors():
    torch = pytest.importorskip("torch")
    return torch.tensor(V), torch.tensor(F)


def lists():
    return V.tolist(), F.tolist()


def pyvista():
    return types.SimpleNamespace(points=V, regular_faces=F)


@pytest.mark.parametrize(
    "make", [trimesh, open3d, lapy, pyg, tensors, pyvista, lists, lambda: SPHERE]
)
def test_meshes_of_other_libraries_give_the_same_numbers(make):
    mesh = make()
    converted = as_mesh(mesh)
    assert converted.vertices.dtype == np.float64
    np.testing.assert_array_equal(converted.faces, F)
    np.testing.assert_array_equal(compute(mesh, 5).eigenvalues, compute(SPHERE, 5).eigenvalues)
    assert count_below(mesh, 3.0) == count_below(SPHERE, 3.0)
    for matrix, expected in zip(fem_matrices(mesh), fem_matrices(SPHERE), strict=True):
        assert (matrix != expected).nnz == 0


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (None, "this is NoneType, no mesh: give a mesh of synthnet, trimesh"),
        ("bunny.ply", "read the file first: trimesh.load_mesh"),
        (Path("bunny.ply"), "read the file first: trimesh.load_mesh"),
        ((V,), "this is tuple, no mesh"),
        (types.SimpleNamespace(pos=V), r"no mesh: .*; it has no face: FaceToEdge\(remove_faces=F"),
        (types.SimpleNamespace(points=V), r"is types\.SimpleNamespace, no mesh: .*; it has no tri"),
        (types.SimpleNamespace(points=V, cells_dict={}), r"; of meshio: \(given.points, given\.c"),
        (types.SimpleNamespace(to_legacy=None), r"; its \.to_legacy\(\) is one"),
        ((np.zeros((0, 3)), F[:0]), "an empty mesh: no triangles"),
        ((V, F[:0]), "a point cloud: .* vertices and no triangles"),
        ((1e100 * V, F), r"has coordinates up to 1e\+100: scale it to between"),
        ((1e-100 * V, F), "the mesh is 2e-100 wide"),
        ((1e308 * V, F), r"inf wide and has coordinates up to 1e\+308: scale it"),
        ((V.astype(str), F), "vertices must be real numbers"),
        ((V + 0j, F), "vertices must be real numbers"),
        ((V, F + 0.5), "faces"),
        (([[1.0], [1.0, 2.0]], F), "rows of different length"),
        ((np.ma.masked_less(V, 0), F), "a masked array: fill what is masked"),
        ((io.BytesIO(), F), "vertices must be real numbers, got object"),
        ((0 * V + 7, F), "all vertices are at the same position, so that no triangle has an area"),
    ],
)
def test_what_is_no_mesh_is_one_line(mesh, message):
    judges = (lambda: compute(mesh, 5), lambda: certify(mesh, [1.0]), lambda: fem_matrices(mesh))
    for judge in judges:
        with pytest.raises(ValueError, match=message) as caught:
            judge()
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda tensor: tensor.bfloat16(),
            r"a tensor of torch\.bfloat16 and layout torch\.strided",
        ),
        (lambda tensor: tensor.bfloat16().requires_grad_(), r"a tensor of torch\.bfloat16"),
        (lambda tensor: tensor.to_sparse(), r"layout torch\.sparse_coo is no array of NumPy"),
        (lambda tensor: tensor.to_sparse_csr(), r"layout torch\.sparse_csr is no array of NumPy"),
    ],
)
@pytest.mark.filterwarnings("ignore:Sparse (CSR tensor|invariant checks):UserWarning")
def test_a_tensor_that_is_no_array_of_numpy_is_one_line(change, message):
    vertices, faces = tensors()
    with pytest.raises(ValueError, match=message) as caught:
        as_mesh((change(vertices), faces))
    assert "give a dense one of float32 or float64" in str(caught.value)


@pytest.mark.parametrize("k", [1.5, 1.0, "3", None, True, [3]])
def test_a_number_of_eigenvalues_that_is_no_integer_is_one_line(k):
    solves = [lambda: next(spectra([SPHERE], k))]
    solves += [partial(solve, SPHERE, k) for solve in (compute, surface_eigenvalues)]
    for solve in solves:
        with pytest.raises(ValueError, match=f"k must be an integer, got {re.escape(repr(k))}"):
            solve()


@pytest.mark.parametrize("shift", [np.nan, np.inf, -np.inf])
def test_a_shift_that_is_not_finite_is_one_line(shift):
    with pytest.raises(ValueError, match=f"shifts must be finite, got 1, {shift}"):
        count_below(SPHERE, 1.0, shift)


@pytest.mark.parametrize(
    ("shift", "got"),
    [
        ([1, 4], r"shape \(2,\) of int64"),
        (np.array([1.0, 40.0]), r"shape \(2,\) of float64"),
        ("a", r"shape \(\) of <U1"),
        (1j, r"shape \(\) of complex128"),
        (True, r"shape \(\) of bool"),
        (None, r"shape \(\) of object"),
    ],
)
def test_a_shift_or_tolerance_is_one_real_number_or_one_line(shift, got):
    with pytest.raises(ValueError, match=f"^a shift must be one real number, got {got}$"):
        count_below(SPHERE, 1.0, shift)
    with pytest.raises(ValueError, match=f"^tolerance must be one real number, got {got}$"):
        certify(SPHERE, [2.0], tolerance=shift)


def test_all_eigenvalues_are_below_a_shift_of_any_size():
    n = len(SPHERE.vertices)
    assert count_below(SPHERE, 1e7, 1e200, np.float32(1e30), 10**12) == [n] * 4


def compiled():
    """Return the types of arguments for which each kernel of the solver was compiled or loaded."""
    modules = {name: module for name, module in sys.modules.items() if "synthnet.spectrum" in name}
    return {
        f"{name}.{attribute}": set(found.signatures)
        for name, module in modules.items()
        for attribute, found in vars(module).items()
        if isinstance(found, Dispatcher)
    }


def test_no_kernel_is_compiled_anew_for_arrays_that_are_read_only():
    def solve(mesh):
        return compute(mesh, 5).eigenvalues, surface_eigenvalues(mesh, 5)

    expected, before = solve(SPHERE), compiled()
    assert sum(map(len, before.values())) > 20
    frozen = Mesh(SPHERE.vertices.copy(), SPHERE.faces.astype(np.int32))
    frozen.vertices.flags.writeable = frozen.faces.flags.writeable = False
    np.testing.assert_array_equal(solve(frozen), expected)
    assert compiled() == before


def test_integers_of_numpy_are_numbers_of_eigenvalues():
    expected = compute(SPHERE, 3).eigenvalues
    for kind in (np.int8, np.uint8, np.int64):  # there are more vertices than an int8 can count
        (found,) = spectra([SPHERE], kind(3))
        np.testing.assert_array_equal(found.eigenvalues, expected)


def result_or_line(call):
    """What a call returns, or the one line that it raises."""
    try:
        return call()
    except ValueError as error:
        line = str(error)
    if not line or "\n" in line:
        pytest.fail(f"no line: {line!r}")
    return line


NUMBERS = st.one_of(st.floats(width=32), st.integers(-3, 40), st.none(), st.text(max_size=2))


@settings(max_examples=200)
@given(
    vertices=st.lists(st.lists(NUMBERS, min_size=2, max_size=4), max_size=6),
    faces=st.lists(st.lists(NUMBERS, min_size=2, max_size=4), max_size=6),
    k=st.integers(-2, 9),
)
@example(vertices=[[0.0, 0.0, 0.0]], faces=[[0.0, 0.0, float("inf")]], k=1)
def test_any_lists_have_a_spectrum_or_a_line(vertices, faces, k):
    result = result_or_line(lambda: compute((vertices, faces), k))
    if not isinstance(result, str):
        assert len(result.eigenvalues) == k
        assert (np.diff(result.eigenvalues) >= 0).all()


@settings(max_examples=200)
@given(
    answer=st.lists(st.one_of(st.floats(), st.integers(-2, 50)), max_size=8),
    tolerance=st.sampled_from([1e-9, 1e-3, 0.4, 0.0, 1.0]),
)
def test_any_answer_is_judged_or_refused_in_a_line(answer, tolerance):
    verdict = result_or_line(lambda: certify(SPHERE, answer, tolerance=tolerance))
    if not isinstance(verdict, str):
        first = compute(SPHERE, 1).eigenvalues[0]
        assert not verdict.certified or abs(verdict.eigenvalues[0] / first - 1) <= 2 * tolerance


@pytest.mark.parametrize("sharp", [False, True])
def test_eigenvectors_are_orthonormal_and_their_largest_entry_is_positive(sharp):
    vectors = compute(SPHERE, 7, sharp=sharp).eigenvectors
    assert (np.take_along_axis(vectors, np.abs(vectors).argmax(axis=0)[None], axis=0) > 0).all()
    mass = fem_matrices(SPHERE)[1]
    np.testing.assert_allclose(vectors.T @ mass @ vectors, np.eye(7), atol=1e-12)
    again = compute(Mesh(V, F), 7, sharp=sharp).eigenvectors
    np.testing.assert_array_equal(vectors, again)


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_spectra_of_many_are_those_of_each(workers):
    results = list(spectra([SPHERE, (2 * V, F)], k=4, workers=workers))
    np.testing.assert_array_equal(results[0].eigenvalues, compute(SPHERE, 4).eigenvalues)
    assert results[1].eigenvalues == pytest.approx(results[0].eigenvalues / 4)
    with pytest.raises(ValueError, match="workers must be at least 1"):
        next(spectra([SPHERE], workers=0))
    with pytest.raises(ValueError, match="workers must be an integer, got '2'"):
        next(spectra([SPHERE], workers="2"))


SOUP = V[F.ravel()], np.arange(F.size).reshape(-1, 3)  # a component of each triangle


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_warning_of_one_of_many_says_of_which_and_where_it_was_asked_for(workers):
    meshes = [SPHERE, SOUP, SPHERE, SOUP]
    with pytest.warns(UserWarning, match="no two of the") as caught:
        assert len(list(spectra(meshes, k=2, workers=workers))) == 4
    ends = [str(warning.message).rpartition("(")[2] for warning in caught]
    assert ends == ["of mesh 1, counted from 0)", "of mesh 3, counted from 0)"]
    assert {warning.filename for warning in caught} == {__file__}
    found = spectra(meshes, k=2, workers=workers)
    assert len(next(found).eigenvalues) == 2
    with pytest.raises(UserWarning, match=r"no two of the .* \(of mesh 1"):  # here they are errors
        next(found)


def test_what_other_threads_warn_of_stays_theirs():
    with collected() as mine, ThreadPoolExecutor(1) as other:
        warn("mine", stacklevel=1)
        with pytest.warns(UserWarning, match="^another's$"):
            other.submit(warn, "another's", stacklevel=1).result()
    assert mine == [(UserWarning, "mine")]


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_an_error_after_a_warning_has_both(workers):
    with pytest.raises(ValueError, match="k must be between") as caught:
        next(spectra([SOUP], k=10**6, workers=workers))
    warned, which = caught.value.__notes__
    assert warned.startswith("after a warning: no two of the")
    assert which == "of mesh 0, counted from 0"


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
@pytest.mark.parametrize("bad", [(V * np.nan, F), None, (V, F[:0])])
def test_an_error_of_one_of_many_says_of_which(workers, bad):
    found = spectra([SPHERE, SPHERE, bad, SPHERE], k=4, workers=workers, repair=True)
    assert len([next(found), next(found)]) == 2
    with pytest.raises((ValueError, Refused), match=r"finite|no mesh|no_faces") as caught:
        next(found)
    assert caught.value.__notes__ == ["of mesh 2, counted from 0"]


def test_meshes_of_many_processes_are_read_as_they_are_needed(monkeypatch):
    # Processes take long to start
    monkeypatch.setattr("synthnet.spectrum.many.worker_pool", ThreadPoolExecutor)
    read = []

    def endless():
        for number in itertools.count():
            read.append(number)
            yield (SPHERE, "a.ply")[number == 4]

    found = spectra(endless(), k=4, workers=2)
    first = next(found)
    assert read == [0, 1, 2, 3, 4]  # two for each process, and one in place of the first
    for _ in range(3):
        np.testing.assert_array_equal(next(found).eigenvalues, first.eigenvalues)
    with pytest.raises(ValueError, match="this is str, no mesh"):
        next(found)
    assert read == [0, 1, 2, 3, 4]
