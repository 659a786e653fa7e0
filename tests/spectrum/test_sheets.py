"""Meshes of which the operator is not that of a surface: what is said, and what is not."""

import itertools
import warnings
from collections import Counter

import numpy as np
import pytest

from evidence.operators import square
from synthnet.adapters.lapy import Solver
from synthnet.mesh.adjacency import connected
from synthnet.spectrum import Operator, certify, compute, count_below, sheets, surface_eigenvalues
from synthnet.types import Mesh
from tests.spectrum.meshes import side_by_side, sphere

BALL = sphere(8)
N = len(BALL.vertices)
SHEET = square(6)


def joined(mesh, pairs):
    """The mesh with one vertex of each pair, the first, and no others without a face."""
    faces = mesh.faces.copy()
    for first, second in pairs:
        faces[faces == second] = first
    used, numbers = np.unique(faces, return_inverse=True)
    return Mesh(mesh.vertices[used], numbers.reshape(-1, 3))


def moved(mesh, *by):
    return Mesh(mesh.vertices + np.array(by), mesh.faces)


PINCHED = joined(side_by_side(BALL, BALL), [(0, N)])
TWICE_PINCHED = joined(side_by_side(BALL, BALL, BALL), [(0, N), (N + 1, 2 * N)])
SLIT = side_by_side(SHEET, moved(SHEET, 1, 0, 0), apart=0.0)
BOOK = side_by_side(SHEET, Mesh(SHEET.vertices[:, [2, 1, 0]], SHEET.faces), apart=0.0)
BOOK = side_by_side(BOOK, Mesh(SHEET.vertices * [-1, 1, 1], SHEET.faces), apart=0.0)


@pytest.mark.parametrize("elements", ["linear", "quadratic", "curved", "delaunay"])
@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (PINCHED, "1 vertex joins sheets that share no edge there: .*repair=True.*has them parted"),
        (TWICE_PINCHED, "2 vertices join sheets that share no edge there"),
        (
            SLIT,
            "the surface is slit: 6 pairs of edges with one face .*repair=True.*corners joined",
        ),
    ],
)
def test_what_is_no_surface_is_said_where_compute_was_called(mesh, message, elements):
    with pytest.warns(UserWarning, match=f"^{message}") as caught:
        compute(mesh, 3, operator=Operator(elements=elements))
    (warned,) = caught
    assert warned.filename == __file__


@pytest.mark.parametrize(("mesh", "message"), [(PINCHED, "1 vertex"), (SLIT, "the surface is sl")])
def test_so_it_is_where_the_spectrum_of_the_smooth_surface_was_asked_for(mesh, message):
    with pytest.warns(UserWarning, match=f"^{message}") as caught:
        surface_eigenvalues(mesh, 1)
    (warned,) = (w for w in caught if "too large" not in str(w.message))  # they have few triangles
    assert warned.filename == __file__


@pytest.mark.parametrize(("mesh", "pieces"), [(PINCHED, 2), (TWICE_PINCHED, 3), (SLIT, 1)])
def test_repair_is_the_remedy(mesh, pieces):
    assert compute(mesh, 3, repair=True).components == pieces  # and any warning is an error


@pytest.mark.parametrize(
    ("mesh", "pieces"),
    [(side_by_side(BALL, BALL), 2), (side_by_side(SHEET, SHEET), 2), (BOOK, 3), (SHEET, 1)],
)
def test_components_are_in_the_answer_and_no_warning(mesh, pieces):
    """Nor are three sheets that end at one line: joined, they would be no surface."""
    spectrum = compute(mesh, 3)
    assert spectrum.components == pieces
    assert f"components={pieces}" in repr(spectrum)


def test_the_tufted_cover_takes_pinches_and_slits_as_they_are():
    pytest.importorskip("robust_laplacian")
    for mesh in (PINCHED, SLIT):
        compute(mesh, 3, operator=Operator(elements="tufted"))


@pytest.mark.parametrize(
    "call",
    [
        lambda: count_below(PINCHED, 1.0),
        lambda: certify(PINCHED, [1.0]),
        lambda: Solver(PINCHED),
    ],
)
def test_other_calls_say_it_once_and_where_they_were_made(call):
    with pytest.warns(UserWarning, match="^1 vertex joins sheets") as caught:
        call()
    (warned,) = caught
    assert warned.filename == __file__


def test_a_corner_of_faces_that_share_none_is_no_slit():
    """They have a warning of their own, and only that."""
    soup = Mesh(BALL.vertices[BALL.faces.ravel()], np.arange(BALL.faces.size).reshape(-1, 3))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        compute(soup, 3)
    (warned,) = caught
    assert str(warned.message).startswith(f"no two of the {len(BALL.faces)} faces share a vertex")


@pytest.mark.parametrize("seed", range(30))
def test_edges_and_fans_are_those_of_their_definition(seed):
    """Of triangles of any corners, few of which are a surface."""
    rng = np.random.default_rng(seed)
    n = 9
    every = np.array(list(itertools.combinations(range(n), 3)), np.int32)
    faces = rng.permuted(rng.permutation(every)[: 6 + seed], axis=1)
    many, pinched, rims = sheets.edges_and_fans(faces, n)
    edges = Counter(
        edge for face in faces.tolist() for edge in itertools.combinations(sorted(face), 2)
    )
    assert many == sum(count > 2 for count in edges.values())
    ends = sorted(edge for edge, count in edges.items() if count == 1)
    assert sorted(map(tuple, rims.tolist())) == ends
    fans = []
    for v in np.unique(faces):
        link = [face[face != v] for face in faces if v in face]
        ends, number = np.unique(link, return_inverse=True)
        fans.append(connected(len(ends), *number.reshape(-1, 2).T).max() + 1)
    assert pinched == sum(count > 1 for count in fans)


@pytest.mark.parametrize(
    ("away", "kind", "said"),
    [(1e6, np.float32, True), (1e6, np.float64, False), (1e2, np.float32, False)],
)
def test_coordinates_that_single_precision_has_rounded_are_said(away, kind, said):
    rounded = (BALL.vertices + np.array([away, 0.0, 0.0])).astype(kind).astype(np.float64)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        values = compute((rounded, BALL.faces), 3).eigenvalues
    messages = [str(warning.message) for warning in caught]
    assert [text[:52] for text in messages] == said * [
        "coordinates are of single precision, 0.0625 apart so"
    ]
    apart = np.abs(values / compute(BALL, 3).eigenvalues - 1).max()
    assert (apart > 1e-3) == said


def test_a_grid_of_integers_far_away_is_not_said_to_be_rounded():
    grid = square(12)
    heights = np.sin(12 * grid.vertices[:, 0]).astype(np.float32)
    away = (12 * grid.vertices[:, :2]).round() + np.array([5e5, 5.8e6])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compute((np.column_stack([away, heights]), grid.faces), 3)
