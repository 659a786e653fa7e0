"""The pictures of docs/concepts.md: that their numbers are right, on small meshes."""

import numpy as np
import pytest

from evidence import DOCS, concepts, numbers


@pytest.fixture(scope="module")
def small():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(concepts, "COUNT", 40)
        return concepts.measure(weyl=400, drums=800, largest=13_000)


def test_drums_have_one_spectrum_and_it_is_the_published_one(small):
    first, second = (np.array(row["eigenvalues"]) for row in small["drums"])
    np.testing.assert_allclose(first, second, rtol=3e-4)
    np.testing.assert_allclose(first, concepts.PUBLISHED, rtol=2e-3)


def test_errors_fall_like_the_square_of_the_edge(small):
    for mass in concepts.MASSES:
        for index in concepts.INDICES:
            assert concepts.order(small, mass, index) == pytest.approx(2, abs=0.05)


def test_lumped_mass_errs_the_other_way_and_the_mean_least(small):
    finest = {row["mass"]: np.array(row["errors"]) for row in reversed(small["errors"])}
    for index in concepts.INDICES:
        error = {mass: errors[index - 1] for mass, errors in finest.items()}
        assert error["lumped"] < 0 < error["consistent"]
        assert abs(error["mean"]) < min(abs(error["lumped"]), error["consistent"])


def test_spheres_and_discs_are_beside_the_law_as_the_caption_says(small):
    ratios = {row["surface"]: row["eigenvalues"] / np.arange(1, 41) for row in small["weyl"]}
    steps = np.repeat([l * (l + 1) for l in range(1, 6)], [2 * l + 1 for l in range(1, 6)])  # noqa: E741
    sphere = ratios["sphere"][: len(steps)] * np.arange(1, len(steps) + 1)
    np.testing.assert_allclose(sphere, steps, rtol=0.02)
    assert ratios["long cylinder with lids"][0] < 0.5
    assert (ratios["disc"] < 1).all()


def test_pinned_numbers_bear_out_the_captions_and_the_pictures_are_theirs():
    data = numbers.read("concepts")
    assert concepts.problems(data) == []
    first, second = data["drums"]
    for row in (first, second):
        for value in row["eigenvalues"]:
            text = f"= {concepts.rounded(value)}<"
            assert (DOCS / "pictures" / "drums.svg").read_text().count(text) == 2
    for name in ("weyl", "mesh_error"):
        picture = DOCS / "pictures" / f"{name.replace('_', '-')}.svg"
        assert picture.read_text() == getattr(concepts, name)(data), (
            "stale: python -m evidence draw concepts"
        )


def test_what_contradicts_the_captions_is_named():
    data = numbers.read("concepts")
    first, second = data["drums"]
    wrong = {**second, "eigenvalues": [2.54, *second["eigenvalues"][1:]]}
    errors = [
        {**row, "errors": [row["edge"] * error for error in row["errors"]]}
        if row["mass"] == "lumped"
        else row
        for row in data["errors"]
    ]
    assert concepts.problems({**data, "drums": [first, wrong], "errors": errors}) == [
        "drum 1: λ1 = 2.54, published 2.53794",
        "the drums differ in the first 4 digits",
        "lumped mass, λ5: order 3.00, not 2",
        "lumped mass, λ10: order 3.00, not 2",
    ]
