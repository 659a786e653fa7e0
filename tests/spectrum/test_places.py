"""Where eigenvalues are counted and where a search begins: the usual place fails on these."""

import itertools
import warnings

import numpy as np
import pytest
import trimesh

from synthnet import spectrum
from synthnet.errors import SpectrumError
from synthnet.spectrum import Operator, solve
from synthnet.spectrum.ordering import find_ordering
from synthnet.spectrum.search import shift_amid
from synthnet.types import Mesh
from tests.spectrum.meshes import ball, dense, rectangle, side_by_side

OCTAHEDRON = (
    np.concatenate([np.eye(3), -np.eye(3)]),
    [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]],
)


def first_ones(mesh, k):
    return dense(mesh)[1 : k + 1]


@pytest.mark.parametrize("height", [2.0, 3.0])
@pytest.mark.parametrize("cells", [1, 9, 12, 39])
def test_a_count_beside_the_middle_of_the_gap(cells, height):
    mesh = rectangle(cells, 1, width=cells * height)
    answer = spectrum.compute(mesh, cells)  # in the middle of the gap above, a pivot is zero
    np.testing.assert_allclose(answer.eigenvalues, first_ones(mesh, cells), rtol=1e-10)
    assert answer.certificate.count == cells + 1
    low, high = first_ones(mesh, cells + 1)[-2:]
    assert low < answer.certificate.shift < high
    assert spectrum.certify(mesh, answer.eigenvalues).certified


@pytest.mark.parametrize("k", [1, 2, 3])
def test_an_octahedron_of_lumped_mass(k):
    answer = spectrum.compute(OCTAHEDRON, k, operator=Operator(mass="lumped"))
    np.testing.assert_allclose(answer.eigenvalues, np.full(k, 2.0), rtol=1e-12)


def test_all_eigenvalues_of_a_mesh_of_many_vertices(monkeypatch):
    box = trimesh.creation.box().subdivide().subdivide()
    monkeypatch.setattr(solve, "DENSE", 0)
    monkeypatch.setattr(solve, "DENSE_AT_MOST", 0)
    most = len(box.vertices) - 1
    answer = spectrum.compute(box, most)
    expected = first_ones(box, most)
    np.testing.assert_allclose(answer.eigenvalues, expected, rtol=1e-9)


@pytest.mark.slow
def test_a_strip_so_long_that_weyls_law_says_nothing(monkeypatch):
    cells, attempts = 100_000, []
    certified = solve._certified

    def counted(matrices, ordering, k, setting):
        attempts.append(setting.seed)
        return certified(matrices, ordering, k, setting)

    monkeypatch.setattr(solve, "_certified", counted)
    answer = spectrum.compute(rectangle(cells, 1, width=cells), 40)
    expected = (np.pi * np.arange(1, 41) / cells) ** 2
    np.testing.assert_allclose(answer.eigenvalues, expected, rtol=1e-5)
    assert attempts == [0, 1, 2]  # neither of the usual shifts finds these


@pytest.mark.parametrize("k", [1, 2, 3, 5, 8])
def test_a_shift_is_placed_amid_the_first_ones_or_below_a_cluster(k):
    octahedron = trimesh.Trimesh(*OCTAHEDRON).subdivide().subdivide().subdivide()
    sphere = octahedron.vertices / np.linalg.norm(octahedron.vertices, axis=1)[:, None]
    mesh = sphere, octahedron.faces  # its first eigenvalues are three equal ones, then 2 and 3
    matrices = spectrum.discretise(spectrum.as_mesh(mesh), Operator()).matrices
    shift = shift_amid(matrices, find_ordering(matrices.indptr, matrices.indices), k)
    first = first_ones(mesh, 9)
    below = int((first < shift).sum())
    assert k / 2 <= below <= k or (below < k and first[below] < 1.1 * shift)
    placed = solve.replace(solve.PLACED, shift=shift / (4 * np.pi * k / matrices.lumped.sum()))
    ordering = find_ordering(matrices.indptr, matrices.indices)
    candidate, _ = solve._certified(matrices, ordering, k, placed)
    np.testing.assert_allclose(candidate.values[:k], first[:k], rtol=1e-9)


@pytest.mark.slow
def test_more_than_half_of_all_eigenvalues_are_searched_for(monkeypatch):
    monkeypatch.setattr(solve, "_dense", None)
    box = trimesh.creation.box().subdivide().subdivide().subdivide().subdivide()
    n = len(box.vertices)
    assert n > solve.DENSE_AT_MOST
    answer = spectrum.compute(box, int(0.6 * n))
    assert answer.certificate.count >= 0.6 * n


def test_a_count_that_rounding_may_change_is_refused():
    mesh = ball(1)
    thin = mesh.vertices * [1, 1e-8, 1e-8], mesh.faces
    with pytest.raises(SpectrumError, match=r"^rounding moves the shift 2 by up to .* 0 to 2 eig"):
        spectrum.count_below(thin, 2.0)
    assert spectrum.count_below(mesh, 2.0, 3.0, 100.0) == [1, 4, 42]


@pytest.mark.parametrize("size", [1.0, 1e-5, 1e-8])
def test_eigenvalues_are_counted_in_each_component_by_itself(size):
    """Rounding in the small one's factorisation must not move the large one's counts."""
    mesh = ball(1)
    both = side_by_side(mesh, Mesh(size * mesh.vertices, mesh.faces), apart=0.0)
    counts = [2, 8, 84] if size == 1.0 else [2, 5, 43]
    assert spectrum.count_below(both, 2.0, 3.0, 100.0) == counts


def test_eigenvalues_that_rounding_has_spoilt_come_with_a_warning():
    mesh = ball(1)
    thin = mesh.vertices * [1, 1e-8, 1e-8], mesh.faces
    with pytest.warns(RuntimeWarning, match=r"rounding on thin triangles may have moved λ1 = "):
        spectrum.compute(thin, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert spectrum.compute(thin, 1, sharp=True).eigenvalues[0] == pytest.approx(4.287856)
        spectrum.compute(mesh, 10)


@pytest.mark.parametrize("largest", [18647.0, 1e5, 1e12])
def test_an_answer_far_too_large_does_not_blur_the_others(largest):
    mesh = ball(1)
    true = first_ones(mesh, 4)
    judged = spectrum.certify(mesh, [2.0, *true[1:3], largest])
    assert [index for index, _ in judged.off] == [1, 4]
    np.testing.assert_allclose([value for _, value in judged.off], true[[0, 3]], rtol=1e-6)


def test_an_answer_that_is_off_beside_one_that_is_missing_is_named_by_the_nearest():
    box = trimesh.creation.box(extents=(1, 1, 1e-3)).subdivide().subdivide().subdivide()
    true = first_ones(box, 12)
    apart = [0, *(1 + np.flatnonzero(np.diff(true) > 1e-3 * true[1:])), 12]  # of equal ones
    pairs = [
        (first, second)
        for first, second in itertools.pairwise(apart[:-1])
        if second < 11 and true[second] > 1.01 * true[first]
    ]
    assert len(pairs) > 3
    for gone, wrong in pairs:
        answer = true[:11].copy()
        answer[wrong] *= 1.001
        judged = spectrum.certify(box, np.delete(answer, gone))
        ((_, value),) = judged.off
        assert value == pytest.approx(true[wrong], rel=1e-6)
        assert len(judged.missed) == 1
        assert true[judged.missed[0] - 1] == pytest.approx(true[gone], rel=1e-6)
