"""Each rule on the smallest mesh that offends it, and that nothing else is changed."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

from synthnet import recipe
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.mesh import caps, repair
from synthnet.mesh.adjacency import connected
from synthnet.mesh.geometry import MeshFacts, area, volume
from synthnet.recipe.drawing import draw_shape
from synthnet.types import Mesh

CUBE = np.array([[i & 1, i >> 1 & 1, i >> 2] for i in range(8)], float)
FACES = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ]
)
SOUP = CUBE[FACES].reshape(-1, 3), np.arange(36).reshape(-1, 3)  # each face has its own corners


def done(vertices, faces, **options):
    rules = repair.Rules(least=4, **options)
    return repair.repair(Mesh(np.asarray(vertices, float), np.asarray(faces)), rules)


def refused(vertices, faces, **options):
    with pytest.raises(repair.Refused) as error:
        done(vertices, faces, **options)
    assert str(error.value) == f"{error.value.reason}: {error.value.detail}"
    return error.value.reason


def test_clean_mesh_is_left_as_it_is():
    repaired = done(CUBE, FACES)
    assert (repaired.repairs, repaired.orientable) == ({}, True)
    np.testing.assert_array_equal(repaired.mesh.vertices, CUBE)
    np.testing.assert_array_equal(repaired.mesh.faces, FACES)


@pytest.mark.parametrize("family", PRIMITIVES)
def test_every_family_is_left_as_it_is(family):
    version = recipe.load("1.0")
    spec = draw_shape(version, family, 0)
    mesh = FAMILIES[family].generate(spec.parameters).stored()
    repaired = repair.repair(mesh)
    assert repaired.repairs == {}
    np.testing.assert_array_equal(repaired.mesh.faces, mesh.faces)


def test_soup_of_triangles_becomes_a_surface():
    repaired = done(*SOUP)
    assert repaired.repairs == {"merged vertices": 28}
    facts = MeshFacts(repaired.mesh)
    assert (facts.n_vertices, facts.euler_characteristic, facts.is_closed) == (8, 2, True)
    assert volume(repaired.mesh) == pytest.approx(1)


@pytest.mark.parametrize(("apart", "merged"), [(1e-8, True), (1e-6, False)])
def test_nearly_equal_positions_are_merged(apart, merged):
    repaired = done(SOUP[0] + np.arange(36)[:, None] % 2 * apart, SOUP[1])
    assert (repaired.components == 1) == merged
    assert (repaired.repairs == {"merged vertices": 28}) == merged


def test_of_merged_vertices_the_first_stays_and_the_order_is_kept():
    pair = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1e-8, 0], [1, 1, 0], [1e-8, 1, 0]])
    repaired = done(pair, np.array([[0, 1, 2], [5, 3, 4]]))
    np.testing.assert_array_equal(repaired.mesh.vertices, pair[[0, 1, 2, 4]])
    assert repaired.mesh.faces.tolist() == [[0, 1, 2], [2, 1, 3]]


def test_merging_goes_by_the_size_of_the_mesh():
    assert done(1e-9 * SOUP[0], SOUP[1]).repairs == {"merged vertices": 28}


def test_merging_joins_what_steps_below_the_distance_join_and_little_more():
    """Against all pairs: those below the distance are joined, others up to 3.5 times it may be."""
    rng = np.random.default_rng(0)
    points = np.concatenate([rng.random((400, 3)) * 30, np.repeat(rng.random((5, 3)) * 30, 9, 0)])
    joined = repair._near(points, 1.0)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    near, far = (
        connected(len(points), *np.nonzero(apart <= limit)) for limit in (1.0, 2 * np.sqrt(3))
    )
    together = joined[:, None] == joined
    assert together[near[:, None] == near].all()
    assert not together[far[:, None] != far].any()
    assert 5 < joined.max() + 1 < len(points) - 40


def test_a_vertex_far_away_is_refused_and_takes_no_memory():
    """All others are within the merging distance of each other: 10^10 pairs."""
    n = 300
    grid = np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], -1).reshape(-1, 3)
    corner = np.arange(n * (n - 1)).reshape(n - 1, n)[:, :-1].ravel()
    faces = np.stack([corner, corner + 1, corner + n], axis=1)
    far = np.concatenate([grid / n, [[1e9, 0, 0]]])
    with pytest.raises(repair.Refused, match=r"extent: .* is a vertex far away\?"):
        repair.repair(Mesh(far, np.concatenate([faces, [[0, 1, n * n]]])))


@pytest.mark.parametrize("soup", [False, True], ids=["joined", "as an STL file"])
def test_a_vertex_far_away_is_said_to_be_the_cause(soup):
    n = 20
    grid = np.stack([*np.meshgrid(np.arange(n), np.arange(n)), np.zeros((n, n))], -1).reshape(-1, 3)
    corner = np.arange(n * (n - 1)).reshape(n - 1, n)[:, :-1].ravel()
    faces = np.concatenate(
        [
            np.stack([corner, corner + 1, corner + n], axis=1),
            np.stack([corner + 1, corner + n + 1, corner + n], axis=1),
        ]
    )
    grid = grid.astype(float) / n
    grid[0] = 3e9
    mesh = Mesh(grid[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3))
    with pytest.raises(repair.Refused, match=r"is a vertex far away\?"):
        repair.repair(mesh if soup else Mesh(grid, faces))


def test_a_few_slivers_are_merged_away():
    """An edge cut in two 1e-9 from its end, in both of its faces."""
    vertices = np.concatenate([CUBE, [[1e-9, 0, 0]]])
    faces = [f for f in FACES.tolist() if not {0, 1} <= set(f)]
    repaired = done(vertices, [*faces, [0, 3, 8], [8, 3, 1], [0, 8, 5], [8, 1, 5]])
    assert repaired.repairs == {"merged vertices": 1, "faces with repeated corners": 2}
    assert MeshFacts(repaired.mesh).is_closed


@pytest.mark.parametrize(
    ("limit", "message"),
    [("MOST_FACES", "12 faces, more than 7"), ("MOST_VERTICES", "8 vertices, more than 7")],
)
def test_what_is_too_large_is_refused(limit, message, monkeypatch):
    monkeypatch.setattr(repair, limit, 7)
    with pytest.raises(repair.Refused, match=f"too_large: {message}"):
        done(CUBE, FACES)


def test_faces_whose_area_is_no_number_are_flat():
    assert repair.flat_faces(Mesh(np.where(CUBE == 1, np.nan, CUBE), FACES)) == 12
    assert repair.flat_faces(Mesh(CUBE, FACES)) == 0


def test_small_repairs_are_counted_and_the_surface_is_the_same():
    faces = [*FACES, FACES[0], FACES[1][::-1], [0, 0, 1], [2, 5, 2]]
    vertices = [*CUBE, [9, 9, 9], [np.nan, 0, 0]]
    repaired = done(vertices, faces)
    assert repaired.repairs == {
        "faces with repeated corners": 2,
        "duplicate faces": 2,
        "loose vertices": 2,
    }
    np.testing.assert_array_equal(repaired.mesh.vertices, CUBE)
    np.testing.assert_array_equal(repaired.mesh.faces, FACES)


def test_faces_are_turned_to_agree_and_outwards():
    mixed = FACES.copy()
    mixed[[2, 5, 7]] = mixed[[2, 5, 7], ::-1]
    repaired = done(CUBE, mixed)
    assert repaired.repairs == {"turned faces": 3}
    assert MeshFacts(repaired.mesh).n_repeated_half_edges == 0
    assert volume(repaired.mesh) == pytest.approx(1)
    inside_out = done(CUBE + 100, FACES[:, ::-1])
    assert inside_out.repairs == {"turned faces": 12}
    assert volume(inside_out.mesh) == pytest.approx(1)


def test_open_surface_is_turned_as_most_of_it_is():
    opened = FACES[2:].copy()
    opened[0] = opened[0, ::-1]
    repaired = done(CUBE, opened)
    assert repaired.repairs == {"turned faces": 1}
    np.testing.assert_array_equal(repaired.mesh.faces[1:], opened[1:])


def strip(turns, n=12):
    """Return a closed strip with so many half turns: 0 a cylinder, 1 a Möbius band."""
    angle = 2 * np.pi * np.arange(n) / n
    tilt = turns * angle / 2
    side = np.stack([np.cos(tilt) * np.cos(angle), np.cos(tilt) * np.sin(angle), np.sin(tilt)], 1)
    middle = 3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([middle - side, middle + side])
    faces = []
    for i in range(n):
        a, b, c, d = i, i + n, (i + 1) % n, (i + 1) % n + n
        if i == n - 1 and turns % 2:
            c, d = d, c
        faces += [[a, b, c], [b, d, c]]
    return vertices, np.array(faces)


def test_mobius_band_stays_as_it_is():
    vertices, faces = strip(1)
    repaired = done(vertices, faces)
    assert not repaired.orientable
    assert repaired.repairs == {}
    np.testing.assert_array_equal(repaired.mesh.faces, faces)
    assert done(*strip(0)).orientable


def test_pinched_vertex_is_split():
    """Two fans that meet in one vertex, and are one surface elsewhere."""
    vertices, faces = strip(0)
    faces = np.where(faces == 6, 0, faces)  # opposite points of a rim become one
    repaired = done(vertices, faces)
    assert repaired.repairs == {"loose vertices": 1, "pinched vertices": 1}
    assert MeshFacts(repaired.mesh).n_vertices == 24
    assert (repaired.mesh.vertices[repaired.mesh.faces] == vertices[faces]).all()


TWO = np.concatenate([CUBE, 5 + 2 * CUBE]), np.concatenate([FACES, FACES + 8])


@pytest.mark.parametrize(
    ("options", "size", "repairs"),
    [
        ({}, 30, {}),
        ({"components": "largest"}, 24, {"components left out": 1}),
        ({"part": 0}, 24, {}),
        ({"part": 1}, 6, {}),
    ],
)
def test_several_components(options, size, repairs):
    repaired = done(*TWO, **options)
    np.testing.assert_allclose(repaired.shares, [0.8, 0.2])
    assert repaired.components == (1 if options else 2)
    assert repaired.repairs == repairs
    assert area(repaired.mesh) == pytest.approx(size)


APART = np.concatenate([SOUP[0], 1e9 + 2 * SOUP[0]]), np.arange(72).reshape(-1, 3)


@pytest.mark.parametrize(("options", "size"), [({"components": "largest"}, 24), ({"part": 1}, 6)])
def test_of_parts_far_from_each_other_one_alone_is_merged_by_its_own_size(options, size):
    """Two cubes as soup: beside the distance between them each is but a point."""
    repaired = done(*APART, **options)
    assert repaired.repairs["merged vertices"] == 2 * 28
    assert (len(repaired.mesh.vertices), len(repaired.shares)) == (8, 2)
    assert area(repaired.mesh) == pytest.approx(size)
    assert repair.count_components(Mesh(*APART), repair.Rules()) == 2


def test_parts_far_from_each_other_are_refused_together_with_what_helps():
    with pytest.raises(repair.Refused) as error:
        done(*APART)
    assert error.value.detail == (
        "24 of 24 faces are smaller than 1.7e+02, 1e-07 of the diagonal: its 2 parts are small "
        "beside the distance between them; `synthnet import --components largest`, or split, "
        "measures each by itself"
    )


@pytest.mark.parametrize(("parts", "whose"), [(1, ""), (2, " of their part")])
def test_a_vertex_far_from_its_own_part_is_refused_whatever_is_kept(parts, whose):
    spiked = np.where(np.arange(8)[:, None] == 7, 1e9, CUBE)
    vertices = np.concatenate([spiked, spiked + 1e20])[: 8 * parts]
    faces = np.concatenate([FACES, FACES + 8])[: 12 * parts]
    with pytest.raises(repair.Refused, match=rf"1e-07 of the diagonal{whose}: is a vertex far"):
        done(vertices, faces, components="largest")


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box((1, 1, 1e-8)),
        trimesh.creation.cylinder(1e-7, 1, sections=8),
    ],
)
def test_a_thin_mesh_is_not_said_to_have_a_vertex_far_away(mesh):
    with pytest.raises(repair.Refused, match=r"too thin or too fine for that: .* --without merge"):
        done(mesh.vertices, mesh.faces)
    assert len(done(mesh.vertices, mesh.faces, without=("merge",)).mesh.faces) == len(mesh.faces)


def test_parts_of_parts_are_measured_by_themselves():
    """Two cubes near each other, and two more far away, all as soup: three rounds of merging."""
    size = 1e-9
    vertices = [SOUP[0] * size, (1 + 2 * SOUP[0]) * size + [1, 0, 0], 1e9 + SOUP[0]]
    faces = np.arange(108).reshape(-1, 3)
    repaired = done(np.concatenate(vertices), faces, part=2)
    assert len(repaired.shares) == 3
    assert area(repaired.mesh) == pytest.approx(6 * size**2)


def test_components_are_chosen_before_they_are_judged():
    """A flat triangle and an edge of three faces, both in the smaller component."""
    faces = np.concatenate([[*FACES, [0, 7, 1]], FACES + 8])
    assert refused(TWO[0], faces) == "non_manifold_edge"
    assert done(TWO[0], faces, components="largest").repairs == {"components left out": 1}


def test_each_component_is_turned_by_itself():
    faces = TWO[1].copy()
    faces[[1, 3, 14]] = faces[[1, 3, 14], ::-1]
    repaired = done(TWO[0], faces)
    assert repaired.repairs == {"turned faces": 3}
    np.testing.assert_array_equal(repaired.mesh.faces, TWO[1])


# Repairs that can be left out


def with_cap(count):
    """A cube with corners on an edge that only one of its two faces knows: a fan of flat caps."""
    middle = np.linspace(0, 1, count + 2)[1:-1]
    vertices = np.concatenate([CUBE, np.stack([middle, 0 * middle, 0 * middle], axis=1)])
    chain = [0, *range(8, 8 + count), 1]
    faces = [f for f in FACES.tolist() if f != [0, 1, 5]]
    faces += [[a, b, 5] for a, b in pairwise(chain)]
    faces += [[chain[i + 1], chain[i], 1] for i in range(count)]
    return vertices, np.array(faces)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_flat_caps_go_and_the_surface_stays(count):
    vertices, faces = with_cap(count)
    assert repair.flat_faces(Mesh(vertices, faces)) == count
    repaired = done(vertices, faces)
    facts = MeshFacts(repaired.mesh)
    assert repaired.repairs == {"flat faces": count}
    assert (facts.n_vertices, facts.is_closed, facts.euler_characteristic) == (8 + count, True, 2)
    assert not repair.flat_faces(repaired.mesh)
    assert (area(repaired.mesh), volume(repaired.mesh)) == pytest.approx((6, 1))
    assert refused(vertices, faces, without=("caps",)) == "degenerate_face"


def test_a_flat_cap_on_the_boundary_is_dropped():
    vertices, faces = [*CUBE[:4], [0.5, 0, 0]], [[0, 2, 3], [0, 3, 4], [4, 3, 1], [0, 4, 1]]
    repaired = done(vertices, faces)
    assert repaired.repairs == {"flat faces": 1}
    assert (len(repaired.mesh.faces), area(repaired.mesh)) == (3, pytest.approx(1))


def test_a_flat_face_that_no_flip_takes_away_is_refused():
    """The edge that a flip would make is there already."""
    vertices = [*CUBE[:4], [0.5, 0.5, 0]]
    faces = [[0, 2, 3], [0, 3, 1], [0, 4, 3], [1, 3, 4], [4, 0, 1]]
    assert refused(vertices, faces, without=("cut",)) == "degenerate_face"
    assert caps.without_caps(Mesh(np.array(vertices), np.array(faces)))[1] == 0


@pytest.mark.parametrize("shared", [False, True], ids=["doubled corners", "shared corners"])
@pytest.mark.parametrize("orientation", [1, -1])
def test_cubes_with_a_common_edge_are_two_surfaces(shared, orientation):
    vertices = np.concatenate([CUBE, CUBE + np.array([1, 1, 0])])
    faces = np.concatenate([FACES, (FACES + 8)[:, ::orientation]])
    if shared:
        _, first, number = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
        vertices, faces = vertices[first], number.ravel()[faces]
    repaired = done(vertices, faces)
    name, count = ("cut edges", 1) if shared else ("touching vertices", 2)
    assert repaired.repairs[name] == count
    assert (repaired.components, MeshFacts(repaired.mesh).is_closed) == (2, True)
    assert area(repaired.mesh) == pytest.approx(12)
    without = ("cut",) if shared else ("apart", "cut")
    assert refused(vertices, faces, without=without) == "non_manifold_edge"


def voxels(cells):
    """The surface of unit cubes, whose corners are shared."""
    corners = (CUBE + np.array(cells)[:, None]).reshape(-1, 3)
    vertices, number = np.unique(corners, axis=0, return_inverse=True)
    every = number.ravel()[FACES + 8 * np.arange(len(cells))[:, None, None]].reshape(-1, 3)
    _, wall, count = np.unique(
        np.sort(every, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return vertices, every[count[wall.ravel()] == 1]  # not those between two cubes


def test_a_solid_that_touches_itself_is_cut_there():
    """Five cubes about a corner, the first and the last with a common edge: one component."""
    cells = [(0, 0, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    vertices, faces = voxels(cells)
    assert (MeshFacts(Mesh(vertices, faces)).edge_valences > 2).sum() == 1
    repaired = done(vertices, faces)
    assert repaired.repairs["cut edges"] == 1
    facts = MeshFacts(repaired.mesh)
    assert (facts.is_closed, facts.n_components, facts.euler_characteristic) == (True, 1, 2)
    assert volume(repaired.mesh) == pytest.approx(5)


def test_sheets_that_stay_joined_at_both_ends_of_an_edge_are_named_and_subdividing_parts_them():
    """Two columns beside each other with a common edge, joined by cubes at both its ends."""
    columns = [(0, 1, 0), (0, 1, 1), (0, 1, 2), (1, 0, 0), (1, 0, 1), (1, 0, 2)]
    vertices, faces = voxels([*columns, (1, 1, 0), (1, 1, 2)])
    for fins in (False, True):
        with pytest.raises(repair.Refused) as error:
            done(vertices, faces, cut_fins=fins)
        assert error.value.detail == (
            "1 edge has more than two faces, in pairs that are joined at both ends of their edge: "
            "subdivide the mesh there"
        )
    finer = done(*trimesh.remesh.subdivide(vertices, faces))
    assert finer.repairs["cut edges"] == 2
    assert MeshFacts(finer.mesh).is_closed
    assert volume(finer.mesh) == pytest.approx(8)


FIN = [*FACES.tolist(), [4, 7, 8]]
LEAVES = [[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 2, 3], [0, 3, 4]]  # three, joined elsewhere


@pytest.mark.parametrize(
    ("faces", "options", "cause"),
    [
        (FIN, {}, "not clearly in pairs: `synthnet import --cut-fins` may cut them"),
        (FIN, {"without": ("cut",)}, "which are not to be cut (--without cut)"),
        (LEAVES, {}, "not clearly in pairs: remove faces until each edge has two at most"),
        (LEAVES, {"cut_fins": True}, "not clearly in pairs: remove faces until each edge has two"),
    ],
)
def test_to_cut_fins_is_advised_only_where_it_helps(faces, options, cause):
    with pytest.raises(repair.Refused) as error:
        done([*CUBE, [0.5, 0.5, 2]], faces, **options)
    assert error.value.detail.startswith(f"1 edge has more than two faces, {cause}")


def test_a_fin_is_cut_off_only_if_asked():
    vertices, faces = [*CUBE, [0.5, 0.5, 2]], [*FACES, [4, 7, 8]]
    assert refused(vertices, faces) == "non_manifold_edge"
    repaired = done(vertices, faces, cut_fins=True)
    assert repaired.repairs == {"edges cut from fins": 1}
    assert repaired.components == 2
    assert area(repaired.mesh) == pytest.approx(6 + np.sqrt(0.5))


def klein():
    """A Klein bottle as a figure of eight that is turned: it passes through itself on a circle."""
    n, m = 24, 12
    u, v = np.meshgrid(2 * np.pi * np.arange(n) / n, 2 * np.pi * np.arange(m) / m, indexing="ij")
    r = 3 + np.cos(u / 2) * np.sin(v) - np.sin(u / 2) * np.sin(2 * v)
    z = np.sin(u / 2) * np.sin(v) + np.cos(u / 2) * np.sin(2 * v)
    points = np.stack([r * np.cos(u), r * np.sin(u), z], axis=-1).reshape(-1, 3)
    number = np.arange(n * m).reshape(n, m)
    after = np.concatenate([number[1:], number[:1, -np.arange(m) % m]])  # turned over at the seam
    a, b, c, d = number, after, np.roll(after, -1, axis=1), np.roll(number, -1, axis=1)
    return points, np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, b, c), (a, c, d))])


def test_a_klein_bottle_that_passes_through_itself_stays_one_surface():
    vertices, faces = klein()
    repaired = done(vertices, faces)
    facts = MeshFacts(repaired.mesh)
    assert repaired.repairs == {"touching vertices": 24}
    assert (facts.is_closed, facts.euler_characteristic, repaired.orientable) == (True, 0, False)
    assert refused(vertices, faces, without=("apart", "cut")) == "non_manifold_edge"


@pytest.mark.parametrize(
    ("vertices", "faces", "reason"),
    [
        (CUBE, np.zeros((0, 3), int), "no_faces"),
        (CUBE, [[0, 0, 1], [1, 2, 2]], "no_faces"),
        ([*CUBE[:7], [1, np.nan, 1]], FACES, "finite"),
        (CUBE, [*FACES, [0, 7, 1]], "non_manifold_edge"),
        (CUBE[:3], [[0, 1, 2]], "few_vertices"),
    ],
)
def test_what_no_rule_mends_is_refused(vertices, faces, reason):
    assert refused(vertices, np.asarray(faces)) == reason


@pytest.mark.parametrize(
    ("vertices", "detail"),
    [
        (np.full((8, 3), 7.0), "all its vertices are at the same position"),
        (1e-31 * CUBE, "the diagonal is 1.73205e-31, below 1e-30: scale the mesh"),
        (
            np.where(np.arange(24).reshape(8, 3) == 4, 1e100, CUBE),
            "the diagonal is 1e+100, above 1e+30: vertex 1 has a coordinate of 1e+100; scale the "
            "mesh",
        ),
        (
            1e308 * CUBE - 1e308 * (1 - CUBE),
            "the diagonal overflows: vertex 0 has a coordinate of 1e+308; scale the mesh",
        ),
    ],
)
def test_a_size_that_will_not_do_is_said(vertices, detail):
    with pytest.raises(repair.Refused) as error:
        done([*vertices, [np.inf, 1e300, 0]], FACES)  # the last one is of no face
    assert (error.value.reason, error.value.detail) == ("extent", detail)


@pytest.mark.parametrize(
    ("value", "count", "detail"),
    [
        (np.nan, 1, "1 vertex is not finite, 1 of them NaN, the first is vertex 7"),
        (np.inf, 2, "2 vertices are not finite, but infinite or too large for a number, the first"),
    ],
)
def test_coordinates_that_are_not_finite_are_counted(value, count, detail):
    vertices = CUBE.copy()
    vertices[8 - count :, 1] = value
    with pytest.raises(repair.Refused, match=f"finite: {detail}"):
        done(vertices, FACES)


def test_unit_area():
    mesh, scale = repair.unit_area(Mesh(3 * CUBE + 7, FACES))
    assert area(mesh) == pytest.approx(1)
    assert scale == pytest.approx(1 / np.sqrt(54))
    np.testing.assert_allclose(mesh.vertices.mean(axis=0), 0, atol=1e-12)


def test_an_open_surface_that_touches_itself_stays_one_but_a_seam_is_closed():
    """A strip is rolled so far that its end stands on its middle, where an edge is."""
    turns = np.array([[0.0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [1, 0]])
    points = np.concatenate([np.insert(turns, 1, z, axis=1) for z in (0.0, 1.0)])
    strip = [[i, i + 1, i + 7] for i in range(5)] + [[i, i + 7, i + 6] for i in range(5)]
    repaired = done(points, strip)
    assert repaired.repairs == {"touching vertices": 2}
    assert (len(repaired.mesh.vertices), repaired.components) == (12, 1)
    assert refused(points, strip, without=("apart", "cut")) == "non_manifold_edge"
    # The same with a seam: the last two faces have vertices of their own
    own = np.concatenate([points, points])
    apart = [[i + 12 for i in face] if min(face) % 6 == 4 else list(face) for face in strip]
    assert refused(own, apart, without=("cut",)) == "non_manifold_edge"


@pytest.mark.parametrize(
    ("name", "vertices", "faces", "outcome"),
    [
        ("merge", *SOUP, 12),
        ("duplicates", CUBE, [*FACES, FACES[0]], "non_manifold_edge"),
        ("orientation", CUBE, [FACES[0, ::-1], *FACES[1:]], 1),
    ],
)
def test_a_repair_that_is_left_out_is_not_made(name, vertices, faces, outcome):
    assert len(done(vertices, faces).repairs) == 1
    if isinstance(outcome, str):
        assert refused(vertices, faces, without=(name, "cut")) == outcome
        return
    repaired = done(vertices, faces, without=(name,))
    assert (repaired.components, repaired.repairs) == (outcome, {})
    np.testing.assert_array_equal(repaired.mesh.faces, faces)


def test_a_pinch_that_is_not_to_be_split_is_refused():
    vertices = np.concatenate([CUBE, 1 + CUBE[1:]])  # two cubes that share a corner
    faces = np.concatenate([FACES, np.where(FACES == 0, 7, FACES + 7)])
    repaired = done(vertices, faces)
    assert (repaired.components, repaired.repairs) == (2, {"pinched vertices": 1})
    assert refused(vertices, faces, without=("pinches",)) == "pinched_vertex"


def test_an_open_surface_is_not_turned_by_its_volume():
    inwards = FACES[2:, ::-1]  # a box without its bottom
    assert volume(repair.centred(Mesh(CUBE, inwards))) < 0
    repaired = done(CUBE, inwards)
    assert repaired.repairs == {}
    np.testing.assert_array_equal(repaired.mesh.faces, inwards)


def test_the_least_number_of_vertices_is_enough():
    assert len(done(CUBE[:4], [[0, 1, 3], [0, 3, 2]]).mesh.vertices) == 4
