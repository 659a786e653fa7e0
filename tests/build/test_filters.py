import dataclasses
import math

import numpy as np
import pytest

from evidence.thin_meshes import thin
from synthnet import recipe
from synthnet.build import filters
from synthnet.build.filters import MESH_CHECKS, SPECTRUM_CHECKS, check_mesh, check_spectrum
from synthnet.build.label import label_or_rejection
from synthnet.recipe import FilterSettings
from synthnet.spectrum.operators import PLAIN
from synthnet.spectrum.solve import unwarned
from synthnet.types import Certificate, Mesh, ShapeSpec, Spectrum, Topology

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

# Each breaks the good mesh in one way, and in what that one way cannot but bring along. Both tables
# have the order of the checks.
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


def test_every_check_has_what_fails_it_here_and_their_order_is_fixed():
    assert list(MESH_CHECKS) == list(BAD_MESHES)
    assert list(SPECTRUM_CHECKS) == list(BAD_SPECTRA)


def test_reasons_are_distinct():
    assert filters.SOLVER not in {*MESH_CHECKS, *SPECTRUM_CHECKS}
    assert not set(MESH_CHECKS) & set(SPECTRUM_CHECKS)


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


TRIANGLE = mesh_of(CORNERS[:3], [[0, 1, 2]])
BAND = mesh_of(  # Möbius's own five triangles
    [[np.cos(i), np.sin(i), np.sin(3.0 * i)] for i in range(5)],
    [[i, (i + 1) % 5, (i + 2) % 5] for i in range(5)],
)


@pytest.mark.parametrize(
    ("mesh", "topology"),
    [
        (GOOD_MESH, Topology(2)),
        (GOOD_MESH.stored(), Topology(2)),
        (TRIANGLE, Topology(1, 1)),
        (BAND, Topology(0, 1, orientable=False)),
    ],
    ids=["closed", "stored", "open: needs no volume", "one-sided: needs no orientation"],
)
def test_a_good_mesh_passes(mesh, topology):
    assert check_mesh(mesh, LIMITS, topology) is None


@pytest.mark.parametrize(
    ("mesh", "topology", "name", "finding"),
    [
        # Faces twice: every edge has four faces, passed twice in one direction.
        (mesh_of(CORNERS, FACES + FACES), Topology(2), "duplicate_face", "4 faces repeat another"),
        (
            Mesh(GOOD_MESH.vertices, GOOD_MESH.faces[:, ::-1]),
            Topology(2),
            "orientation",
            "the enclosed volume is -0.167",
        ),
        (
            mesh_of(CORNERS, [[0, 1, 2]]),
            Topology(1, 1),
            "components",
            "2 components instead of one",
        ),
        (BAND, Topology(0, 1), "orientation", ""),
        (GOOD_MESH, Topology(0), "euler_characteristic", "Euler characteristic 2 instead of 0"),
        (mesh_of(CORNERS, [*FACES, [1, 1, 2]]), Topology(2), "degenerate_face", ""),
    ],
    ids=["twice", "inside out", "free vertex", "one-sided", "other topology", "corner twice"],
)
def test_the_first_failure_of_a_mesh_is_reported(mesh, topology, name, finding):
    refusal = check_mesh(mesh, LIMITS, topology)
    assert refusal is not None
    assert refusal == (name, finding or refusal[1])


def test_an_altitude_at_the_limit_is_refused_and_one_above_is_not():
    def flat(altitude):
        return mesh_of([[0, 0, 0], [2, 0, 0], [1, 2 * altitude, 0]], [[0, 1, 2]])

    limits = dataclasses.replace(LIMITS, altitude=2.0**-10)
    assert check_mesh(flat(2.0**-10), limits, Topology(1, 1)) is not None
    assert check_mesh(flat(2.0**-10 * 1.001), limits, Topology(1, 1)) is None


@pytest.mark.parametrize(
    ("spectrum", "refusal"),
    [
        (GOOD_SPECTRUM, None),
        (spectrum_of(2.0, 2.0, 2.0), None),  # equal ones ascend
        (
            spectrum_of(-1.0, -2.0, trivial=1.0, residual=1.0),
            ("non_positive_eigenvalue", "first eigenvalue is -1"),
        ),
        # Refused before it divides.
        (spectrum_of(0.0, 1.0), ("non_positive_eigenvalue", "first eigenvalue is 0")),
        (
            spectrum_of(2.0, trivial=math.nan),
            ("non_finite_eigenvalue", "1 eigenvalues are not finite"),
        ),
        (
            spectrum_of(2.0, residual=math.nan),
            ("residual", "relative residual is nan, above 1e-05"),
        ),
    ],
)
def test_the_first_failure_of_a_spectrum_is_reported(spectrum, refusal):
    assert check_spectrum(spectrum, LIMITS) == refusal


@pytest.mark.parametrize("sign", [1, -1])
def test_trivial_eigenvalue_and_residual_may_be_at_the_limit(sign):
    limits = FilterSettings(altitude=0.0, trivial=0.25, residual=0.5)
    at_limit = spectrum_of(2.0, trivial=sign * 0.5, residual=0.5)
    assert check_spectrum(at_limit, limits) is None


def test_a_mesh_that_is_too_thin_is_refused_for_that_and_not_for_the_residual_it_has():
    mesh = thin(1e-8, "needles", seed=1)
    drawn = recipe.load("2.0")
    certificate = unwarned(mesh, 10, PLAIN, sharp=True).certificate
    assert certificate.residual > drawn.filters.residual
    spec = ShapeSpec("strip-00000", "strip", 0, {}, "")
    refused = label_or_rejection(spec, mesh, drawn, sharp=True)
    assert (refused.reason, "rounding" in refused.detail) == ("certificate", True)
