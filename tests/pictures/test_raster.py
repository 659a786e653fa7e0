"""The rasteriser: coverage, order of depth, shade, colours, edges and contours."""

import numpy as np
import pytest

from synthnet.families import FAMILIES
from synthnet.pictures import raster
from synthnet.pictures.raster import View, diverging, render, view_of
from synthnet.types import Mesh

FRONT = View(elevation=0.0, azimuth=-90.0)  # x to the right, z up, y away from the viewer
ABOVE = View(elevation=90.0, azimuth=-90.0)  # x to the right, y up


def mesh(points, faces):
    return Mesh(np.array(points, dtype=np.float64), np.array(faces))


def covered(picture):
    return (picture < 255).any(axis=2)


def square(depth, side=1.0):
    """A square of two triangles that faces the viewer of FRONT, farther for a larger depth."""
    low, high = -side / 2, side / 2
    return [[low, depth, low], [high, depth, low], [high, depth, high], [low, depth, high]]


TWO = [[0, 1, 2], [0, 2, 3]]
BOTH = [*TWO, [4, 5, 6], [4, 6, 7]]  # faces of two squares
MOBIUS = {"width": 0.6, "half_turns": 1, "triangulation": "uniform", "vertices": 600, "seed": 0}


@pytest.fixture(scope="module")
def mobius():
    return FAMILIES["mobius_band"].generate(MOBIUS)


def rectangle(vertices, triangulation="uniform"):
    shape = {"height": 1.0, "width": 1.0, "triangulation": triangulation, "seed": 0}
    return FAMILIES["flat_rectangle"].generate({**shape, "vertices": vertices})


@pytest.fixture
def bare(monkeypatch):
    """Neither outlines nor a margin."""
    monkeypatch.setattr(raster, "MARGIN", 0.0)
    monkeypatch.setattr(raster, "_outline", lambda depth, _: np.zeros(depth.shape, dtype=bool))


def test_axes_of_a_view_are_a_right_handed_frame():
    axes = View(elevation=31.0, azimuth=-17.0).axes()
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1)
    np.testing.assert_allclose(FRONT.axes(), [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-15)


def test_half_a_square_covers_half_the_picture(bare):
    picture = render(mesh(square(0.0), [[0, 1, 2]]), 100, 100, view=FRONT)
    rows, columns = np.indices((100, 100))
    np.testing.assert_array_equal(covered(picture), columns >= 99 - rows)


def test_a_square_fills_a_picture_without_a_gap_on_the_diagonal(bare):
    picture = render(mesh(square(0.0), TWO), 61, 61, view=FRONT)
    assert (picture == picture[0, 0]).all()
    assert (picture[0, 0] < 255).all()


def test_a_mesh_of_triangles_smaller_than_pixels_has_no_gap(bare):
    assert covered(render(rectangle(40_000), 50, 50, view=ABOVE)).all()


def test_what_is_nearer_hides_what_is_behind_in_any_order():
    near, far = square(-1.0, side=1.0), square(1.0, side=2.0)
    tilted = [[x, y + 0.5 * z, z] for x, y, z in near]
    first, second = (
        render(mesh(points, BOTH), 80, 80, view=FRONT)
        for points in ([*tilted, *far], [*far, *tilted])
    )
    np.testing.assert_array_equal(first, second)
    alone = render(mesh(far, TWO), 80, 80, view=FRONT)
    assert (first[40, 40] != alone[40, 40]).any()  # the near one's shade
    np.testing.assert_array_equal(first[10, 10], alone[10, 10])  # beside it


def test_triangles_that_cut_each_other_are_each_seen_on_one_side():
    back = [[x, x, z] for x, _, z in square(0.0)]
    forth = [[x, -x, z] for x, _, z in square(0.0)]
    values = np.array([-1.0] * 4 + [1.0] * 4)
    picture = render(mesh([*back, *forth], BOTH), 80, 80, view=FRONT, values=values).astype(int)
    blue = picture[..., 2] > picture[..., 0]
    assert blue[40, 15]  # at x < 0 the first is nearer
    assert not blue[40, 65]


def test_shade_does_not_hang_on_the_orientation(mobius):
    rng = np.random.default_rng(3)
    turned = mobius.faces.copy()
    some = rng.random(len(turned)) < 0.5
    turned[some] = turned[some][:, ::-1]
    picture, other = (render(Mesh(mobius.vertices, f), 90, 70) for f in (mobius.faces, turned))
    assert np.abs(picture.astype(int) - other.astype(int)).max() <= 1  # the weights' last bits


def test_shade_says_where_a_face_looks():
    box = FAMILIES["cuboid"].generate(
        {"width": 1.0, "height": 1.0, "depth": 1.0}
        | {"triangulation": "uniform", "vertices": 100, "seed": 0}
    )
    picture = render(box, 120, 120)
    shades, counts = np.unique(picture.reshape(-1, 3), axis=0, return_counts=True)
    faces = shades[counts > 0.05 * picture.shape[0] * picture.shape[1]]
    assert len(faces) == 4  # white and three sides


def test_the_same_mesh_gives_the_same_picture_and_its_size_does_not_matter(mobius):
    picture = render(mobius, 64, 48, edges=True)
    assert picture.shape == (48, 64, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(picture, render(mobius, 64, 48, edges=True))
    np.testing.assert_array_equal(
        picture, render(Mesh(mobius.vertices * 1024 + 4096, mobius.faces), 64, 48, edges=True)
    )


def test_colours_are_blue_white_and_orange(bare):
    plane = mesh(square(0.0), TWO)
    values = np.array([-1.0, 1.0, 1.0, -1.0])
    picture = render(plane, 91, 91, view=FRONT, values=values)
    left, middle, right = picture[45, [0, 45, 90]].astype(int)
    assert left[2] > left[0] + 100
    assert right[0] > right[2] + 100
    assert (middle < 128).all()  # the line at zero
    beside = picture[45, 41].astype(int)
    assert np.ptp(beside) < 30
    assert beside.min() > 150
    np.testing.assert_allclose(diverging(np.array([-1.0, 0.0]))[0], raster.NEGATIVE)


def test_blue_and_orange_differ_in_grey():
    grey = diverging(np.array([-1.0, 1.0])) @ [0.299, 0.587, 0.114]
    assert abs(grey[1] - grey[0]) > 0.2


def test_no_line_is_drawn_where_a_function_stays_away_from_zero(bare):
    plane = mesh(square(0.0), TWO)
    picture = render(plane, 90, 90, view=FRONT, values=np.array([0.1, 1.0, 1.0, 0.1]))
    assert picture.max(axis=2).min() > 150


def test_the_line_has_no_gap_on_triangles_smaller_than_it():
    plane = rectangle(40_000, "irregular")
    picture = render(plane, 61, 61, view=ABOVE, values=plane.vertices[:, 0] - 0.5)
    assert picture[5:56, 30].max() < 140


def test_edges_are_drawn_and_fade_where_triangles_are_small():
    darker = {}
    for vertices in (50, 40_000):
        plane = rectangle(vertices)
        with_edges = render(plane, 60, 60, edges=True, view=ABOVE)
        without = render(plane, 60, 60, view=ABOVE).astype(int)
        darker[vertices] = without - with_edges
    assert 0.05 < (darker[50] > 10).any(axis=2).mean() < 0.6
    assert darker[40_000].max() < darker[50].max() / 2


def test_the_end_of_a_surface_is_outlined_also_before_another_part():
    near, far = square(-1.0, side=1.0), square(1.0, side=2.0)
    picture = render(mesh([*near, *far], BOTH), 80, 80, view=FRONT).astype(int)
    inside, line = picture[40, 40], picture[40, 20:24].min(axis=0)
    assert (line < inside - 20).all()


def test_flat_shapes_are_seen_from_above():
    flat = mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    tall = mesh([[0, 0, 0], [1, 0, 0], [0, 0, 1]], [[0, 1, 2]])
    assert view_of(flat).elevation > 60
    assert view_of(tall).elevation == View().elevation


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": 0}, "a picture has at least one pixel, got 0 x 9"),
        ({"faces": np.zeros((0, 3), dtype=int)}, "a mesh without triangles cannot be drawn"),
        ({"vertices": np.full((3, 3), np.nan)}, "a coordinate that is not finite"),
        ({"values": np.zeros(4)}, r"values must have shape \(3,\), got \(4,\)"),
        ({"values": np.array([0, np.inf, 0])}, "a value that is not finite"),
    ],
)
def test_what_cannot_be_drawn(arguments, message):
    vertices = arguments.get("vertices", np.eye(3))
    faces = arguments.get("faces", np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match=message):
        render(Mesh(vertices, faces), arguments.get("width", 9), 9, values=arguments.get("values"))


def test_a_function_that_is_zero_and_a_triangle_seen_from_its_edge_can_be_drawn():
    plane = mesh(square(0.0), TWO)
    assert covered(render(plane, 30, 30, view=FRONT, values=np.zeros(4))).any()
    assert not covered(render(plane, 30, 30, view=ABOVE)).any()
