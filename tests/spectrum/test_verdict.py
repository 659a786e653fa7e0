"""Judgements of eigenvalues: what is right, off and missing, beside a dense solver."""

import re
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from synthnet.spectrum import certify, compute, verdict
from synthnet.types import Mesh
from tests.spectrum.meshes import dense, side_by_side, sphere, torus

SHAPES = {"sphere": sphere(8), "torus": torus(16, 8)}
VALUES = {name: dense(mesh)[1:] for name, mesh in SHAPES.items()}


@contextmanager
def without_a_solver():
    """No eigenvectors can be found, so that everything is counted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verdict, "_found", lambda *_: None)
        yield


@pytest.mark.parametrize("name", SHAPES)
def test_right_answers_are_certified(name):
    for answer in (VALUES[name][:9], np.append(VALUES[name][8::-1], 1e-15)):
        judged = certify(SHAPES[name], answer)
        assert judged.certified
        assert str(judged).startswith("certified: 9 eigenvalues within 1e-06, none missed below ")
        assert judged.count >= 10


def test_one_count_says_what_a_hundred_do():
    values = VALUES["torus"][:50]
    few = certify(SHAPES["torus"], values)
    with without_a_solver():
        many = certify(SHAPES["torus"], values)
    assert few.certified
    assert (few.factorisations, few.count) == (1, many.count)
    assert many.factorisations > 50
    assert str(few) == str(many)


@settings(max_examples=60)
@given(st.sampled_from(sorted(SHAPES)), st.integers(0, 2**32), st.sampled_from([1e-6, 1e-3, 0.1]))
def test_counts_that_follow_are_those_of_factorisations(name, seed, tolerance):
    rng = np.random.default_rng(seed)
    answer = VALUES[name][np.sort(rng.integers(0, 20, rng.integers(1, 12)))]
    answer = answer * (1 + rng.choice([0, 1e-7, 1e-2, 0.2]) * rng.standard_normal(len(answer)))
    few = certify(SHAPES[name], answer, tolerance=tolerance)
    with without_a_solver():
        many = certify(SHAPES[name], answer, tolerance=tolerance)
    assert few.factorisations <= many.factorisations
    assert (few.missed, few.count) == (many.missed, many.count)
    assert [index for index, _ in few.off] == [index for index, _ in many.off]
    for number, ((_, true), (_, located)) in enumerate(zip(few.off, many.off, strict=True)):
        accuracy = 1e-5 if number < verdict.SHOWN else 2 * verdict.NEARLY  # and that of the counts
        assert abs(true - located) <= accuracy * true


@settings(max_examples=100)
@given(
    st.sampled_from(sorted(SHAPES)),
    st.integers(0, 2**32),
    st.sampled_from([1e-6, 1e-3, 0.1, 0.5]),
    st.sampled_from([0.5, 0.9, 1.5, 5.0]),
)
def test_what_is_certified_is_near_eigenvalue_by_eigenvalue(name, seed, tolerance, by):
    """Also where tolerances overlap, so that the count of a group says nothing of its members."""
    rng = np.random.default_rng(seed)
    true = VALUES[name][: rng.integers(1, 30)]
    answer = np.sort(true * (1 + by * tolerance * rng.uniform(-1, 1, len(true))))
    errors = np.abs(answer / true - 1)
    if (np.abs(errors / tolerance - 1) < 1e-3).any() or not answer[0] > 0:
        return
    assert certify(SHAPES[name], answer, tolerance=tolerance).certified == bool(
        (errors < tolerance).all()
    )


def test_answers_that_are_bunched_or_stretched_are_off():
    """As many lie between two right ones as should, and each within reach of its neighbour."""
    true = VALUES["torus"][:60]
    stretched = np.append(true[:9], np.geomspace(true[9], true[59], 51))
    judged = certify(SHAPES["torus"], stretched, tolerance=0.1)
    expected = np.flatnonzero(np.abs(stretched / true - 1) > 0.1) + 1
    assert len(expected) > 10
    assert judged.off[0][0] == expected[0]
    triple = VALUES["sphere"][:3].mean()
    judged = certify(SHAPES["sphere"], triple * np.array([1, 1.095, 1.19]), tolerance=0.05)
    assert [index for index, _ in judged.off] == [2, 3]


def dumbbell(neck):
    """Two spheres, joined where a triangle of each, shrunk, is cut out."""
    vertices, faces = SHAPES["sphere"].vertices.copy(), SHAPES["sphere"].faces
    cut = faces[len(faces) // 2]
    middle = vertices[cut].mean(axis=0)
    vertices[cut] = middle + neck * (vertices[cut] - middle)
    other = 3 * middle - vertices
    count = len(vertices)
    rest = np.delete(faces, len(faces) // 2, axis=0)
    p, q = cut, np.roll(cut, -1)
    tube = [np.stack([q, p, p + count], axis=1), np.stack([q, p + count, q + count], axis=1)]
    return Mesh(
        np.concatenate([vertices, other]), np.concatenate([rest, (rest + count)[:, ::-1], *tube])
    )


@pytest.mark.parametrize("neck", [1e-3, 1e-5, 1e-6])
def test_the_small_eigenvalue_of_a_neck_is_no_zero(neck):
    mesh = dumbbell(neck)
    values = compute(mesh, 4, sharp=True).eigenvalues
    assert values[0] < 1e-3
    assert certify(mesh, values).certified
    assert certify(mesh, [0.0, *values]).certified
    assert certify(mesh, values[1:]).missed == (1,)
    assert certify(mesh, values * [1 + 1e-3, 1, 1, 1]).off == (
        (1, pytest.approx(values[0], rel=1e-6)),
    )


def test_what_rounding_leaves_open_is_not_certified():
    mesh = dumbbell(1e-8)
    values = compute(mesh, 4, sharp=True).eigenvalues
    judged = certify(mesh, values)
    assert not judged.certified
    assert (judged.off, judged.missed) == ((), ())
    assert judged.tolerance > judged.asked == 1e-6
    assert str(judged).startswith("rounding leaves open ")


@pytest.mark.parametrize("size", [1e2, 1e4, 1e8])
def test_components_of_all_sizes_are_judged_within_what_was_asked(size):
    mesh = SHAPES["sphere"]
    scaled = (Mesh(scale * mesh.vertices, mesh.faces) for scale in (1 / size, 1, size))
    whole = side_by_side(*scaled, apart=4 * size)
    values = compute(whole, 8).eigenvalues
    assert certify(whole, values).certified
    assert certify(whole, values).tolerance == 1e-6
    assert len(certify(whole, values * 1.3).off) == 8
    assert len(certify(whole, values * (1 + 1e-5)).off) == 8


@settings(max_examples=60)
@given(st.sampled_from(sorted(SHAPES)), st.sets(st.integers(0, 9), max_size=4))
def test_what_is_missing_is_named_by_its_index(name, left_out):
    values = VALUES[name][:12]
    judged = certify(SHAPES[name], np.delete(values, sorted(left_out)))
    assert not judged.off
    assert len(judged.missed) == len(left_out)
    np.testing.assert_allclose(  # of a multiple eigenvalue any copy may be the missing one
        values[np.array(judged.missed, dtype=int) - 1], values[sorted(left_out)], rtol=1e-6
    )


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("by", [1e-4, -1e-4])
def test_what_is_off_is_named_with_the_eigenvalue_it_stands_for(name, by):
    answer = VALUES[name][:6] * (1 + by)
    judged = certify(SHAPES[name], answer)
    assert [index for index, _ in judged.off] == [1, 2, 3, 4, 5, 6]
    assert [true for _, true in judged.off] == pytest.approx(VALUES[name][:6], rel=3e-6)
    assert not judged.missed
    assert "is off by 0.01 %: no eigenvalue within 1e-06, it is " in str(judged)
    assert certify(SHAPES[name], answer, tolerance=2e-4).certified


def test_a_constant_that_is_given_for_an_eigenvector_misleads_nobody():
    mesh = SHAPES["torus"]
    result = compute(mesh, 8)
    values, vectors = result.eigenvalues.copy(), result.eigenvectors.copy()
    values[0] /= 10
    vectors[:, 0] = 1
    judged = certify(mesh, values, vectors)
    assert judged.off == certify(mesh, values).off
    assert judged.off[0][1] == pytest.approx(result.eigenvalues[0], rel=3e-6)


def test_a_copy_too_many_is_off():
    values = VALUES["torus"]
    judged = certify(SHAPES["torus"], [values[0], *values[:2], values[1]])
    assert not judged.certified
    assert len(judged.off) >= 1


def test_with_eigenvectors_one_factorisation_suffices_and_bad_ones_do_not_mislead():
    mesh = SHAPES["torus"]
    result = compute(mesh, 8)
    judged = certify(mesh, result.eigenvalues, result.eigenvectors)
    assert judged.certified
    assert judged.factorisations == 1
    wrong = result.eigenvectors[:, ::-1]
    assert certify(mesh, result.eigenvalues, wrong).certified  # by others, which are found
    with without_a_solver():
        judged = certify(mesh, result.eigenvalues, wrong)
    assert judged.certified  # by counts alone
    assert judged.factorisations > 1
    shifted = certify(mesh, result.eigenvalues * (1 + 1e-4), result.eigenvectors)
    assert len(shifted.off) == 8
    missing = certify(mesh, result.eigenvalues[1:], result.eigenvectors[:, 1:])
    assert missing.missed in ((1,), (2,))  # a pair: either is the other


def test_zeros_of_components_may_be_given_all_or_none():
    two = side_by_side(SHAPES["sphere"], SHAPES["sphere"])
    values = np.repeat(VALUES["sphere"][:4], 2)
    for answer in (values, [0.0, 0.0, *values]):
        assert certify(two, answer).certified
        assert certify(two, answer).zeros == 2
    with pytest.raises(ValueError, match="1 answers are zero, and 2 eigenvalues are"):
        certify(two, [0.0, *values])


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        ([], "must be a list of numbers"),
        (["a"], "must be a list of numbers"),
        ([[1.0]], "must be a list of numbers"),
        ([1.0, np.nan], "answer 2 is not finite"),
        ([-1.0, 2.0], "an answer is negative, -1"),
        ([0.0], "there must be 1 to .* answers after the zeros, got 0"),
    ],
)
def test_what_is_no_answer_is_one_line(answer, message):
    with pytest.raises(ValueError, match=message):
        certify(SHAPES["sphere"], answer)


def test_complex_eigenvectors_are_one_line():
    mesh = SHAPES["sphere"]
    found = compute(mesh, 3)
    with pytest.raises(ValueError, match="eigenvectors must be real numbers, got complex128"):
        certify(mesh, found.eigenvalues, found.eigenvectors * 1j)


def test_a_mesh_is_repaired_where_that_is_asked_for():
    mesh = SHAPES["sphere"]
    loose = Mesh(np.vstack([mesh.vertices, [[9.0, 9, 9]]]), mesh.faces)
    with pytest.raises(ValueError, match=r"1 vertices belong to no triangle.*repair=True"):
        certify(loose, VALUES["sphere"][:5])
    judged = certify(loose, VALUES["sphere"][:5], repair=True)
    assert judged.certified
    assert judged.repairs == {"loose vertices": 1}


def test_a_long_judgement_is_short_in_words():
    """Of a factor that was forgotten every eigenvalue is off: the first ten say it."""
    true = VALUES["sphere"][:40]
    lines = str(certify(SHAPES["sphere"], 7 * true)).splitlines()
    missed, *off, rest = lines
    assert re.search(r"^\d+ missed below \S+: indices .*\d+ to \d+", missed)
    assert len(off) == 10
    assert re.fullmatch(r"and \d+ more are off", rest)
