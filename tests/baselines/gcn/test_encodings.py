from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
import trimesh
from torch_geometric.data import Data

from baselines.gcn.encodings import (
    CHANNELS,
    MeshError,
    PrincipalAxes,
    encoding,
    gauss_map,
    normalised_lengths,
    voronoi_areas,
)
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.mesh import geometry
from synthnet.types import Mesh
from tests.baselines.gcn.conftest import data_of, moved

GOLDEN = pq.read_table(Path(__file__).parents[2] / "golden" / "voronoi.parquet").to_pylist()


# Voronoi areas


def test_golden_file_has_every_family_and_obtuse_triangles():
    assert {row["id"].rsplit("-", 1)[0] for row in GOLDEN} == set(PRIMITIVES)
    obtuse = []
    for row in GOLDEN:
        corners = np.array(row["vertices"]).reshape(-1, 3)[np.array(row["faces"]).reshape(-1, 3)]
        squares = np.sort(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2), axis=1)
        obtuse.append((squares[:, 2] > 1.01 * squares[:, :2].sum(axis=1)).mean())
    assert sum(share > 0.3 for share in obtuse) > 5


@pytest.mark.parametrize("row", GOLDEN, ids=[row["id"] for row in GOLDEN])
def test_voronoi_areas_are_those_of_libigl(row):
    pos = torch.tensor(row["vertices"], dtype=torch.float32).reshape(-1, 3).double()
    face = torch.tensor(row["faces"]).reshape(-1, 3).T
    areas = torch.tensor(row["areas"], dtype=torch.float64)
    torch.testing.assert_close(voronoi_areas(pos, face), areas, rtol=1e-12, atol=0)


def test_voronoi_areas_of_one_triangle_by_hand():
    # Right-angled, legs 1: the circumcentre is the middle of the hypotenuse.
    right = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
    # Obtuse at vertex 0, area 1/2: half of it there, a quarter elsewhere.
    obtuse = [[0.0, 0, 0], [1, 0, 0], [-1, 1, 0]]
    expected = torch.tensor([0.25, 0.125, 0.125], dtype=torch.float64)
    for corners in (right, obtuse):
        areas = voronoi_areas(torch.tensor(corners), torch.tensor([[0], [1], [2]]))
        torch.testing.assert_close(areas, expected)


def test_voronoi_areas_add_up_to_the_surface(meshes):
    for mesh in meshes:
        total = voronoi_areas(data_of(mesh).pos, data_of(mesh).face).sum().item()
        assert total == pytest.approx(geometry.area(mesh), rel=1e-12)


def test_a_vertex_without_a_triangle_has_no_area_and_no_normal():
    pos = torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    face = torch.tensor([[0], [1], [2]])
    assert voronoi_areas(pos, face)[3] == 0
    assert gauss_map(pos, face)[3].tolist() == [0, 0, 0]


# The Gauss map


def test_gauss_map_is_unit_on_a_flat_patch_and_shorter_where_normals_disagree():
    sides = {"width": 1.0, "height": 1.0, "depth": 1.0}
    cube = FAMILIES["rectangular_prism"].generate({**sides, "subdivisions": 2})
    normals = gauss_map(data_of(cube).pos, data_of(cube).face)
    lengths = torch.linalg.norm(normals, dim=1)
    sides = ((cube.vertices == 0) | (cube.vertices == 1)).sum(axis=1)  # 1 in a face, 2 on an edge
    inside = torch.from_numpy(sides == 1)
    torch.testing.assert_close(lengths[inside], torch.ones(int(inside.sum()), dtype=torch.float64))
    assert (lengths[~inside] < 0.999).all()
    edge = torch.from_numpy(sides == 2)
    assert lengths[edge].max() == pytest.approx(np.sqrt(0.5), abs=1e-12)  # two equal areas


def test_gauss_map_is_outward_whatever_the_orientation():
    sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 8})
    for mesh in (
        sphere,
        Mesh(sphere.vertices, sphere.faces[:, ::-1]),
        Mesh(sphere.vertices + 9, sphere.faces),
    ):
        data = data_of(mesh)
        outward = data.pos - data.pos.mean(dim=0)
        assert ((gauss_map(data.pos, data.face) * outward).sum(dim=1) > 0.9).all()


# Isometries and scale


@pytest.mark.parametrize("kind", [0, 1], ids=["rotation", "reflection"])
def test_encodings_commute_with_isometries(kind, meshes, orthogonal):
    matrix = torch.from_numpy(orthogonal[kind])
    for mesh in meshes:
        here, there = data_of(mesh), data_of(moved(mesh, orthogonal[kind]))
        tolerance = {"rtol": 1e-9, "atol": 1e-12}
        areas = voronoi_areas(here.pos, here.face)
        torch.testing.assert_close(voronoi_areas(there.pos, there.face), areas, **tolerance)
        normals = gauss_map(here.pos, here.face) @ matrix.T
        torch.testing.assert_close(gauss_map(there.pos, there.face), normals, rtol=0, atol=1e-9)
        edges = encoding("ALG")(here.clone()).edge_index
        lengths = normalised_lengths(here.pos, edges)
        torch.testing.assert_close(normalised_lengths(there.pos, edges), lengths, **tolerance)


def test_encodings_scale_as_their_units_say(meshes):
    for mesh in meshes:
        here, there = data_of(mesh), data_of(moved(mesh, np.eye(3), scale=4.0))
        torch.testing.assert_close(
            voronoi_areas(there.pos, there.face), 16 * voronoi_areas(here.pos, here.face)
        )
        torch.testing.assert_close(gauss_map(there.pos, there.face), gauss_map(here.pos, here.face))
        edges = encoding("ALG")(here.clone()).edge_index
        lengths = normalised_lengths(here.pos, edges)
        assert lengths.max() == 1
        torch.testing.assert_close(normalised_lengths(there.pos, edges), lengths)


def test_scale_free_encodings_do_not_change_with_scale_and_place(meshes):
    for mesh in meshes:
        there = Mesh(3.0 * mesh.vertices.astype(np.float64) + 7.0, mesh.faces)
        a, b = (encoding("ALG", scale_free=True)(data_of(shape)) for shape in (mesh, there))
        torch.testing.assert_close(a.x, b.x, rtol=1e-4, atol=1e-5)
        assert (b.area / a.area).item() == pytest.approx(9.0)


# Presets


@pytest.mark.parametrize("virtual", [False, True])
@pytest.mark.parametrize("name", CHANNELS)
def test_presets(name, virtual, meshes):
    mesh = meshes[0]
    n, edges = len(mesh.vertices), len(geometry.MeshFacts(mesh).edge_valences)
    data = encoding(name, virtual_node=virtual)(data_of(mesh))
    assert data.x.shape == (n + virtual, CHANNELS[name])
    assert data.x.dtype == torch.float32
    assert data.edge_index.shape == (2, 2 * edges + 2 * n * virtual)
    assert ("edge_weight" in data) == (name == "ALG")
    if virtual:
        assert (data.x[n] == 0).all()
        joined = data.edge_index[:, 2 * edges :]
        assert set(joined[0].tolist()) == set(joined[1].tolist()) == set(range(n + 1))
        if name == "ALG":
            assert (data.edge_weight[2 * edges :] == 1).all()


def test_unknown_preset():
    with pytest.raises(ValueError, match="the encoding must be one of none, A, ALG, got 'L'"):
        encoding("L")


@pytest.mark.parametrize("name", ["A", "ALG"])
@pytest.mark.parametrize("corners", [[1, 1, 2], [1, 2, 3]])
def test_a_face_without_area(name, corners):
    pos = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [0, 1, 0]])
    face = torch.tensor([[0, 1, 4], corners]).T
    with pytest.raises(MeshError, match="face 1 has no area: remove degenerate faces first"):
        encoding(name)(Data(pos=pos, face=face))


def test_no_faces_and_nan():
    pos = torch.zeros(4, 3)
    with pytest.raises(MeshError, match="the mesh has no faces"):
        encoding("ALG")(Data(pos=pos, face=torch.zeros(3, 0, dtype=torch.int64)))
    pos[2, 1] = torch.nan
    with pytest.raises(MeshError, match=r"vertex 2 is \[0.0, nan, 0.0\]"):
        encoding("ALG")(Data(pos=pos, face=torch.tensor([[0], [1], [2]])))


# Principal axes


def lopsided():
    """A tetrahedron without symmetry: its moments of second and third order differ."""
    vertices = np.array([[0, 0, 0], [3, 0.4, 0], [0.2, 2, 0.1], [0.5, 0.3, 1]], float)
    return Mesh(vertices, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]))


def test_isometric_copies_have_one_encoding_in_principal_axes(orthogonal):
    encode = encoding("ALG", scale_free=True, principal_axes=True)
    here = encode(data_of(lopsided()))
    assert not torch.allclose(here.x, encoding("ALG", scale_free=True)(data_of(lopsided())).x)
    for matrix in orthogonal:
        there = encode(data_of(moved(lopsided(), matrix, 2.0)))
        torch.testing.assert_close(there.x, here.x, rtol=1e-5, atol=1e-6)


def test_principal_axes_diagonalise_the_moments_of_the_surface():
    # A box of 6 by 2 by 4 around the origin, in other axes: by hand the second moments of its
    # surface are largest along 6, then 4, then 2.
    box = trimesh.creation.box((6, 2, 4))
    turned = data_of(moved(Mesh(box.vertices, box.faces), np.eye(3)[[2, 0, 1]]))
    positions = PrincipalAxes()(turned).pos.abs()
    torch.testing.assert_close(positions, torch.tensor([[3.0, 2.0, 1.0]]).double().expand(8, 3))
