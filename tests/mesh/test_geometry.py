import math

import numpy as np
import pytest

from synthnet import recipe
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.mesh import geometry
from synthnet.mesh.geometry import MeshFacts
from synthnet.recipe.drawing import draw_shape
from synthnet.types import Mesh
from tests.mesh.test_repair import CUBE, FACES

TETRAHEDRON = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


def mesh_of(vertices, faces):
    return Mesh(
        np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64).reshape(-1, 3)
    )


def corner_tetrahedron():
    return mesh_of([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], TETRAHEDRON)


def cube():
    return Mesh(CUBE, FACES)


def grid_torus(n):
    a = np.arange(n**2).reshape(n, n)
    b, d = np.roll(a, -1, axis=0), np.roll(a, -1, axis=1)
    c = np.roll(b, -1, axis=1)
    return mesh_of([[0.0, 0.0, 0.0]] * n**2, np.stack([[a, b, c], [a, c, d]]).transpose(0, 2, 3, 1))


def angle_defects(mesh):
    corners = mesh.vertices[mesh.faces]
    to_next = np.roll(corners, -1, axis=1) - corners
    to_last = np.roll(corners, 1, axis=1) - corners
    sine = np.linalg.norm(np.cross(to_next, to_last), axis=2)
    angles = np.arctan2(sine, (to_next * to_last).sum(axis=2))
    return 2 * np.pi - np.bincount(mesh.faces.ravel(), angles.ravel(), len(mesh.vertices))


def test_corner_edges_are_opposite_their_corner_and_add_up_to_zero():
    edges = geometry.corner_edges(mesh_of([[0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 1, 2]]))
    np.testing.assert_array_equal(edges, [[[-3, 4, 0], [0, -4, 0], [3, 0, 0]]])
    np.testing.assert_array_equal(edges.sum(axis=1), 0)


def test_corner_edges_are_float64_though_vertices_are_float32():
    mesh = corner_tetrahedron().stored()
    assert geometry.corner_edges(mesh).dtype == np.float64
    # 1e6 + 1 is a float32, its square is not: the area would come out 0 or 2.
    large = mesh_of([[0, 0, 0], [1e6 + 1, 0, 0], [1e6, 1, 0]], [[0, 1, 2]]).stored()
    assert geometry.area(large) == (1e6 + 1) / 2


def test_areas_of_three_triangles():
    vertices = [[0, 0, 0], [3, 0, 0], [0, 4, 0], [6, 0, 0], [0, 0, 5]]
    mesh = mesh_of(vertices, [[0, 1, 2], [0, 1, 3], [0, 4, 3]])
    np.testing.assert_array_equal(geometry.face_areas(mesh), [6, 0, 15])
    assert geometry.area(mesh) == MeshFacts(mesh).area == 21


def test_relative_altitudes():
    half = math.sqrt(3) / 2
    vertices = [[0, 0, 0], [1, 0, 0], [0.5, half, 0], [2, 0, 0], [0, 3, 0], [4, 0, 0]]
    mesh = mesh_of(vertices, [[0, 1, 2], [0, 1, 3], [0, 0, 1], [1, 1, 1], [0, 5, 4]])
    # Equilateral; collinear; two corners equal; all equal; 3-4-5: 2.4 over 5.
    expected = [half, 0, 0, 0, 0.48]
    np.testing.assert_allclose(MeshFacts(mesh).relative_altitudes, expected, rtol=1e-15)


def test_relative_altitudes_do_not_change_with_the_scale():
    mesh = corner_tetrahedron()
    for scale in (2.0**-60, 2.0**60):
        scaled = Mesh(mesh.vertices * scale, mesh.faces)
        np.testing.assert_array_equal(
            MeshFacts(scaled).relative_altitudes, MeshFacts(mesh).relative_altitudes
        )


def test_volume_and_area_of_the_unit_cube():
    assert geometry.volume(cube()) == 1
    assert geometry.area(cube()) == 6


def cubes(turn, side, offset):
    """The unit cube, and another one of that side and place, with its faces as they are or not."""
    one = cube()
    vertices = np.concatenate([one.vertices, one.vertices * side + offset])
    return Mesh(vertices, np.concatenate([one.faces, one.faces[:, ::turn] + 8]))


@pytest.mark.parametrize(
    ("mesh", "volume"),
    [
        (cubes(1, 2.0, 3.0), 9),
        (cubes(-1, 0.5, 0.25), 1 - 1 / 8),  # a cavity
        (cubes(-1, 3.0, -1.0), 27 - 1),  # the first is one
    ],
)
@pytest.mark.parametrize("offset", [0.0, 1e8])
@pytest.mark.parametrize("turn", [1, -1])
def test_enclosed_volume_is_that_between_outer_walls_and_cavities(mesh, volume, offset, turn):
    moved = Mesh(mesh.vertices + offset, mesh.faces[:, ::turn])
    assert geometry.enclosed_volume(moved) == pytest.approx(volume, rel=1e-12)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (Mesh(cube().vertices, cube().faces[1:]), "3 edges have not two faces: only a closed"),
        (
            Mesh(cube().vertices, np.concatenate([cube().faces[:1, ::-1], cube().faces[1:]])),
            "neighbours turn against each other at 3 edges: orient the faces alike first",
        ),
        (cubes(-1, 1.0, 3.0), "component of face 12 is oriented against the largest and in no"),
        (cubes(-1, 2.0, 3.0), "component of face 0 is oriented against the largest"),
    ],
)
def test_what_encloses_no_volume_is_one_line(mesh, message):
    with pytest.raises(ValueError, match=message):
        geometry.enclosed_volume(mesh)


def test_volume_is_signed_and_does_not_hang_on_the_origin():
    mesh = corner_tetrahedron()
    assert geometry.volume(mesh) == pytest.approx(1 / 6, rel=1e-15)
    assert geometry.volume(Mesh(mesh.vertices, mesh.faces[:, ::-1])) == -geometry.volume(mesh)
    assert geometry.volume(Mesh(mesh.vertices + 7, mesh.faces)) == pytest.approx(1 / 6, rel=1e-12)


@pytest.mark.parametrize(
    ("mesh", "euler", "closed", "components"),
    [
        (corner_tetrahedron(), 2, True, 1),
        (cube(), 2, True, 1),
        (grid_torus(3), 0, True, 1),
        (mesh_of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 1, False, 1),
        (mesh_of([[0, 0, 0]] * 4, [[0, 1, 2]]), 2, False, 2),
        (
            mesh_of([[0, 0, 0]] * 8, TETRAHEDRON + [[4 + i for i in f] for f in TETRAHEDRON]),
            4,
            True,
            2,
        ),
        (mesh_of([[0, 0, 0]] * 2, []), 2, True, 2),
    ],
    ids=["tetrahedron", "cube", "torus", "disc", "loose vertex", "two tetrahedra", "no faces"],
)
def test_topology(mesh, euler, closed, components):
    facts = MeshFacts(mesh)
    assert facts.euler_characteristic == euler
    assert facts.is_closed is closed
    assert facts.n_components == components
    assert facts.n_repeated_half_edges == 0


def test_edge_valences_of_three_triangles_on_one_edge():
    mesh = mesh_of([[0, 0, 0]] * 5, [[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert sorted(MeshFacts(mesh).edge_valences) == [1, 1, 1, 1, 1, 1, 3]
    assert MeshFacts(mesh).n_repeated_half_edges == 1


def test_every_turned_triangle_repeats_its_half_edges():
    mesh = corner_tetrahedron()
    turned = mesh.faces.copy()
    turned[0] = turned[0, ::-1]
    assert MeshFacts(Mesh(mesh.vertices, turned)).n_repeated_half_edges == 3


def test_duplicate_faces_are_found_in_any_order_of_their_corners():
    faces = [[0, 1, 2], [1, 2, 3], [2, 0, 1], [0, 2, 1], [3, 2, 1]]
    assert MeshFacts(mesh_of([[0, 0, 0]] * 4, faces)).n_duplicate_faces == 3
    assert MeshFacts(corner_tetrahedron()).n_duplicate_faces == 0


def test_numbers_beyond_int32_do_not_overflow():
    n = 2**17  # in int32, 2¹⁵ n + 40000 would be 0 n + 40000
    faces = np.array([[0, 40_000, 1], [2**15, 40_000, 2]], dtype=np.int32)
    facts = MeshFacts(Mesh(np.zeros((n, 3), dtype=np.float32), faces))
    assert len(facts.edge_valences) == 6
    assert facts.n_components == n - 4
    assert facts.n_repeated_half_edges == 0


def test_angle_defect_of_a_cube_is_a_right_angle_at_every_corner():
    np.testing.assert_allclose(angle_defects(cube()), np.pi / 2, rtol=1e-14)


@pytest.mark.parametrize("family", PRIMITIVES)
def test_gauss_bonnet(family):
    spec = draw_shape(recipe.load("1.0"), family, 3)
    mesh = FAMILIES[family].generate(spec.parameters)
    euler = FAMILIES[family].euler_characteristic
    assert angle_defects(mesh).sum() == pytest.approx(2 * np.pi * euler, abs=1e-8)
