import dataclasses
import math

import numpy as np
import pytest

from synthnet.build import filters
from synthnet.build.filters import MESH_CHECKS, SPECTRUM_CHECKS, check_mesh, check_spectrum
from synthnet.recipe import FilterSettings
from synthnet.types import Certificate, Mesh, Spectrum, Topology

LIMITS = FilterSettings(altitude=1e-3, trivial=1e-6, residual=1e-5)
CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


def mesh_of(vertices, faces):
    return Mesh(np.array(vertices, dtype=np.float64), np.array(faces))


def spectrum_of(*eigenvalues, trivial=1e-15, residual=1e-12):
    proof = Certificate(len(eigenvalues) + 1, 2 * max(eigenvalues), residual)
    return Spectrum(np.array(eigenvalues), trivial, proof, np.zeros((0, len(eigenvalues))))


GOOD_MESH = mesh_of(CORNERS, FACES)
GOOD_SPECTRUM = spectrum_of(2.0, 2.0, 6.0)

# Each breaks the good mesh in one way, and in what that one way cannot but bring along.
BAD_MESHES = {
    "finite": (
        mesh_of([[0, 0, math.nan], [1, 0, 0], [0, math.inf, 0], [0, 0, 1]], FACES),
        "2 vertices are not finite",
    ),
    "degenerate_face": (
        mesh_of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 5e-4, 0.0]], FACES),
        "1 of 4 faces have altitude / longest edge at most 0.001, the least 0.0005",
    ),
    "duplicate_face": (mesh_of(CORNERS, [*FACES, [2, 3, 1]]), "1 faces repeat another"),
    "non_manifold_edge": (
        mesh_of([*CORNERS, [-1, -1, 1]], [*FACES, [0, 3, 4]]),
        "1 edges have more than two faces",
    ),
    "components": (mesh_of([*CORNERS, [5, 5, 5]], FACES), "2 components instead of one"),
    "orientation": (
        mesh_of(CORNERS, [[1, 2, 0], *FACES[1:]]),
        "3 edges are passed twice in one direction",
    ),
    "euler_characteristic": (mesh_of(CORNERS, FACES[:3]), "Euler characteristic 1 instead of 2"),
    "boundary": (
        mesh_of(
            [[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (0, 1))],
            [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5]],
        ),
        "2 boundary curves instead of 0",
    ),
}

BAD_SPECTRA = {
    "non_finite_eigenvalue": (spectrum_of(2.0, math.nan, math.inf), "2 eigenvalues are not finite"),
    "non_positive_eigenvalue": (spectrum_of(-1e-9, 2.0), "first eigenvalue is -1e-09"),
    "trivial_eigenvalue": (
        spectrum_of(2.0, 6.0, trivial=-4e-6),
        "|lambda_0| / lambda_1 is 2e-06, above 1e-06",
    ),
    "not_ascending": (spectrum_of(2.0, 6.0, 5.0, 4.0), "2 eigenvalues are below the one before"),
    "residual": (spectrum_of(2.0, residual=2e-5), "relative residual is 2e-05, above 1e-05"),
}


def test_every_check_has_a_mesh_or_a_spectrum_here_that_fails_it():
    assert set(BAD_MESHES) == set(MESH_CHECKS)
    assert set(BAD_SPECTRA) == set(SPECTRUM_CHECKS)


def test_the_order_of_the_checks_is_fixed():
    assert list(MESH_CHECKS) == [
        "finite",
        "degenerate_face",
        "duplicate_face",
        "non_manifold_edge",
        "components",
        "orientation",
        "euler_characteristic",
        "boundary",
    ]
    assert list(SPECTRUM_CHECKS) == [
        "non_finite_eigenvalue",
        "non_positive_eigenvalue",
        "trivial_eigenvalue",
        "not_ascending",
        "residual",
    ]


def test_reasons_are_distinct_and_name_their_function():
    for checks in (MESH_CHECKS, SPECTRUM_CHECKS):
        assert all(name == check.__name__ for name, check in checks.items())
    assert filters.SOLVER not in {*MESH_CHECKS, *SPECTRUM_CHECKS}
    assert not set(MESH_CHECKS) & set(SPECTRUM_CHECKS)


def test_a_good_mesh_and_a_good_spectrum_pass():
    assert check_mesh(GOOD_MESH, LIMITS, Topology(2)) is None
    assert check_mesh(GOOD_MESH.stored(), LIMITS, Topology(2)) is None
    assert check_spectrum(GOOD_SPECTRUM, LIMITS) is None


@pytest.mark.parametrize("name", MESH_CHECKS)
def test_bad_mesh_is_refused_by_its_check_and_not_by_an_earlier_one(name):
    mesh, finding = BAD_MESHES[name]
    # Of connected surfaces only one with a boundary has a torus's number, and none a sphere's.
    expected = Topology(0 if name == "boundary" else 2)
    assert check_mesh(mesh, LIMITS, expected) == (name, finding)


@pytest.mark.parametrize("name", SPECTRUM_CHECKS)
def test_bad_spectrum_is_refused_by_its_check_and_not_by_an_earlier_one(name):
    spectrum, finding = BAD_SPECTRA[name]
    assert check_spectrum(spectrum, LIMITS) == (name, finding)


def test_the_first_failure_is_the_one_reported():
    # Faces twice: every edge has four faces, passed twice in one direction.
    doubled = mesh_of(CORNERS, FACES + FACES)
    assert check_mesh(doubled, LIMITS, Topology(2)) == ("duplicate_face", "4 faces repeat another")
    worst = spectrum_of(-1.0, -2.0, trivial=1.0, residual=1.0)
    assert check_spectrum(worst, LIMITS) == ("non_positive_eigenvalue", "first eigenvalue is -1")


def test_a_surface_turned_inside_out_is_refused():
    inside_out = Mesh(GOOD_MESH.vertices, GOOD_MESH.faces[:, ::-1])
    refusal = check_mesh(inside_out, LIMITS, Topology(2))
    assert refusal == ("orientation", "the enclosed volume is -0.167")


def test_an_open_surface_needs_no_volume():
    assert check_mesh(mesh_of(CORNERS, [[0, 1, 2]]), LIMITS, Topology(1, 1)) == (
        "components",
        "2 components instead of one",
    )
    assert check_mesh(mesh_of(CORNERS[:3], [[0, 1, 2]]), LIMITS, Topology(1, 1)) is None


def test_a_surface_of_one_side_needs_no_orientation():
    band = [[i, (i + 1) % 5, (i + 2) % 5] for i in range(5)]  # Möbius's own five triangles
    corners = [[np.cos(i), np.sin(i), np.sin(3.0 * i)] for i in range(5)]
    mesh = mesh_of(corners, band)
    assert check_mesh(mesh, LIMITS, Topology(0, 1, orientable=False)) is None
    refusal = check_mesh(mesh, LIMITS, Topology(0, 1))
    assert refusal is not None
    assert refusal[0] == "orientation"


def test_the_euler_characteristic_is_compared_with_the_declared_one():
    refusal = check_mesh(GOOD_MESH, LIMITS, Topology(0))
    assert refusal == ("euler_characteristic", "Euler characteristic 2 instead of 0")


def test_a_face_with_a_corner_twice_is_degenerate():
    refusal = check_mesh(mesh_of(CORNERS, [*FACES, [1, 1, 2]]), LIMITS, Topology(2))
    assert refusal is not None
    assert refusal[0] == "degenerate_face"


def test_an_altitude_at_the_limit_is_refused_and_one_above_is_not():
    def flat(altitude):
        return mesh_of([[0, 0, 0], [2, 0, 0], [1, 2 * altitude, 0]], [[0, 1, 2]])

    limits = dataclasses.replace(LIMITS, altitude=2.0**-10)
    assert check_mesh(flat(2.0**-10), limits, Topology(1, 1)) is not None
    assert check_mesh(flat(2.0**-10 * 1.001), limits, Topology(1, 1)) is None


@pytest.mark.parametrize("sign", [1, -1])
def test_trivial_eigenvalue_and_residual_may_be_at_the_limit(sign):
    limits = FilterSettings(altitude=0.0, trivial=0.25, residual=0.5)
    at_limit = spectrum_of(2.0, trivial=sign * 0.5, residual=0.5)
    assert check_spectrum(at_limit, limits) is None


def test_a_zero_first_eigenvalue_is_refused_before_it_divides():
    refusal = check_spectrum(spectrum_of(0.0, 1.0), LIMITS)
    assert refusal == ("non_positive_eigenvalue", "first eigenvalue is 0")


def test_what_is_not_finite_beside_the_eigenvalues_is_refused_too():
    refusal = check_spectrum(spectrum_of(2.0, trivial=math.nan), LIMITS)
    assert refusal == ("non_finite_eigenvalue", "1 eigenvalues are not finite")
    refusal = check_spectrum(spectrum_of(2.0, residual=math.nan), LIMITS)
    assert refusal == ("residual", "relative residual is nan, above 1e-05")


def test_equal_eigenvalues_are_ascending():
    assert check_spectrum(spectrum_of(2.0, 2.0, 2.0), LIMITS) is None
