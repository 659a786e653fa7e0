"""Judgements of eigenvalues: what is right, off and missing, beside a dense solver."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg

from synthnet.families import FAMILIES
from synthnet.spectrum import certify, compute, fem_matrices
from synthnet.types import Mesh

SHAPES = {
    "sphere": FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 8}),
    "torus": FAMILIES["torus"].generate(
        {"torus_radius": 1.0, "tube_radius": 0.4, "radial_resolution": 16, "tubular_resolution": 8}
    ),
}


def exact(mesh: Mesh) -> Any:
    """All eigenvalues after the zero, by LAPACK."""
    stiffness, mass = (matrix.toarray() for matrix in fem_matrices(mesh))
    return linalg.eigh(stiffness, mass, eigvals_only=True)[1:]


VALUES = {name: exact(mesh) for name, mesh in SHAPES.items()}


@pytest.mark.parametrize("name", SHAPES)
def test_right_answers_are_certified(name: str) -> None:
    for answer in (VALUES[name][:9], np.append(VALUES[name][8::-1], 1e-15)):
        verdict = certify(SHAPES[name], answer)
        assert verdict.certified
        assert str(verdict).startswith("certified: 9 eigenvalues within 1e-06, none missed below ")
        assert verdict.count >= 10


@settings(max_examples=60)
@given(st.sampled_from(sorted(SHAPES)), st.sets(st.integers(0, 10), max_size=4))
def test_what_is_missing_is_named_by_its_index(name: str, left_out: set[int]) -> None:
    values = VALUES[name][:12]
    verdict = certify(SHAPES[name], np.delete(values, sorted(left_out)))
    assert not verdict.off
    assert len(verdict.missed) == len(left_out)
    np.testing.assert_allclose(  # of a multiple eigenvalue any copy may be the missing one
        values[np.array(verdict.missed, dtype=int) - 1], values[sorted(left_out)], rtol=1e-6
    )


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("by", [1e-4, -1e-4])
def test_what_is_off_is_named_with_the_eigenvalue_it_stands_for(name: str, by: float) -> None:
    answer = VALUES[name][:6] * (1 + by)
    verdict = certify(SHAPES[name], answer)
    assert [index for index, _ in verdict.off] == [1, 2, 3, 4, 5, 6]
    assert [true for _, true in verdict.off] == pytest.approx(VALUES[name][:6], rel=3e-6)
    assert not verdict.missed
    assert "is off by 0.01 %: no eigenvalue within 1e-06, it is " in str(verdict)
    assert certify(SHAPES[name], answer, tolerance=2e-4).certified


def test_a_copy_too_many_is_off() -> None:
    values = VALUES["torus"]
    verdict = certify(SHAPES["torus"], [values[0], *values[:2], values[1]])
    assert not verdict.certified
    assert len(verdict.off) >= 1


def test_with_eigenvectors_one_factorisation_suffices_and_bad_ones_do_not_mislead() -> None:
    mesh = SHAPES["torus"]
    found = compute(mesh, 8)
    verdict = certify(mesh, found.eigenvalues, found.eigenvectors)
    assert verdict.certified
    assert verdict.factorisations == 1
    wrong = found.eigenvectors[:, ::-1]
    verdict = certify(mesh, found.eigenvalues, wrong)
    assert verdict.certified  # by counts alone
    assert verdict.factorisations > 1
    missing = certify(mesh, found.eigenvalues[1:], found.eigenvectors[:, 1:])
    assert missing.missed in ((1,), (2,))  # a pair: either is the other


def test_zeros_of_components_may_be_given_all_or_none() -> None:
    mesh = SHAPES["sphere"]
    two = Mesh(
        np.concatenate([mesh.vertices, mesh.vertices + 5]),
        np.concatenate([mesh.faces, mesh.faces + len(mesh.vertices)]),
    )
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
def test_what_is_no_answer_is_one_line(answer: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        certify(SHAPES["sphere"], answer)
