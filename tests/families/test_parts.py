"""The parts and folded balls of 2.1: their areas, volumes and topologies by formulas."""

import numpy as np
import pytest

from synthnet.families import (
    FAMILIES,
    box_union,
    boxes,
    lattice,
    perforated_plate,
    shaft,
    sheet_metal,
)
from synthnet.families.charted import one_shape
from synthnet.mesh import geometry
from synthnet.recipe.drawing import draw_shape
from tests.datasets import home

FINE = 30_000  # vertices: areas and volumes of curved surfaces are then right to a thousandth
SURFACES = range(6)


def made(family, surface, **changes):
    """The parameters of a surface without those of its triangulation, and a fine mesh of it."""
    spec = draw_shape(home(family), family, 3 * surface)
    parameters = {**spec.parameters, "triangulation": "irregular", "vertices": FINE, **changes}
    return dict(one_shape(parameters)), FAMILIES[family].generate(parameters)


def surfaces(family):
    return (made(family, surface) for surface in SURFACES)


@pytest.mark.parametrize("family", [box_union, lattice], ids=["box_union", "lattice"])
def test_solids_of_boxes_have_the_volume_of_their_cells(family):
    solid = {box_union: "union", lattice: "frame"}[family]
    genera = set()
    for parameters, mesh in surfaces(family.FAMILY.name):
        filled, planes = getattr(family, solid)(**parameters)
        x, y, z = (np.diff(at) for at in planes)
        volumes = x[:, None, None] * y[:, None] * z
        assert geometry.volume(mesh) == pytest.approx(volumes[filled].sum(), rel=1e-12)
        assert boxes.is_manifold(filled)
        assert boxes.is_connected(filled)
        genera.add(1 - boxes.euler(filled) // 2)
    assert genera == {0} if family is box_union else len(genera) > 2


@pytest.mark.parametrize(
    ("cells", "manifold"),
    [
        ([(0, 0, 0)], True),
        ([(0, 0, 0), (0, 0, 1)], True),
        ([(0, 0, 0), (0, 1, 1)], False),  # they share an edge
        ([(0, 0, 0), (1, 1, 1)], False),  # a corner
        ([(0, 0, 0), (0, 0, 1), (0, 1, 1), (1, 1, 1)], True),
    ],
)
def test_cells_that_share_an_edge_or_a_corner_alone_make_no_surface(cells, manifold):
    filled = np.zeros((2, 2, 2), dtype=np.bool_)
    filled[tuple(np.array(cells).T)] = True
    assert boxes.is_manifold(filled) is manifold


def test_a_frame_around_a_window_has_a_handle():
    filled = np.ones((3, 3, 1), dtype=np.bool_)
    filled[1, 1] = False
    assert boxes.euler(filled) == 0
    assert boxes.euler(np.ones((2, 2, 2), dtype=np.bool_)) == 2


def test_a_perforated_plate_has_the_area_and_volume_of_a_plate_with_holes():
    drilled = []
    for parameters, mesh in surfaces("perforated_plate"):
        plate = perforated_plate.plate(**parameters)
        width, depth = plate.x[-1] - plate.x[0], plate.y[-1] - plate.y[0]
        sheet = width * depth - np.pi * (plate.holes**2).sum()
        rim = 2 * (width + depth) + 2 * np.pi * plate.holes.sum()
        thickness = parameters["thickness"]
        assert geometry.volume(mesh) == pytest.approx(thickness * sheet, rel=2e-3)
        assert geometry.area(mesh) == pytest.approx(2 * sheet + thickness * rim, rel=2e-3)
        drilled.append(np.count_nonzero(plate.holes))
    assert len(set(drilled)) > 1


def test_bending_a_sheet_keeps_its_volume():
    """By Pappus's theorem, since lengths halfway through it stay as they are."""
    for parameters, mesh in surfaces("sheet_metal"):
        part = sheet_metal.part(**parameters)
        length, width = np.ptp(part.plate.x), np.ptp(part.plate.y)
        sheet = length * width - np.pi * (part.plate.holes**2).sum()
        assert geometry.volume(mesh) == pytest.approx(parameters["thickness"] * sheet, rel=3e-3)
        bends = np.abs(np.diff(part.headings))
        assert np.count_nonzero(bends) == parameters["flanges"] - 1
        assert not part.plate.holes[bends > 0].any()


def test_a_rounded_box_has_the_area_and_volume_of_steiners_formula():
    for parameters, mesh in surfaces("rounded_box"):
        sides = np.array([parameters[name] for name in ("width", "height", "depth")])
        radius = parameters["fillet"] * sides.min() / 2
        inner = sides - 2 * radius
        flat = 2 * (inner * np.roll(inner, 1)).sum()
        area = flat + 2 * np.pi * radius * inner.sum() + 4 * np.pi * radius**2
        volume = (
            inner.prod() + radius * flat + np.pi * radius**2 * inner.sum()
        ) + 4 / 3 * np.pi * radius**3
        assert geometry.area(mesh) == pytest.approx(area, rel=1e-3)
        assert geometry.volume(mesh) == pytest.approx(volume, rel=1e-3)


def test_a_shaft_has_the_volume_of_its_steps():
    bores = set()
    for parameters, mesh in surfaces("shaft"):
        corners = np.array(shaft.profile(**parameters))
        r, z = corners.T
        if not parameters["bore"]:
            assert r[0] == r[-1] == 0
        ahead, rise = np.roll(r, -1), np.roll(z, -1) - z
        cones = np.pi / 3 * rise * (r**2 + r * ahead + ahead**2)  # signed, under each side
        assert geometry.volume(mesh) == pytest.approx(cones.sum(), rel=5e-3)
        bores.add(parameters["bore"])
    assert bores == {0, 1}


def test_shears_keep_the_volume_of_a_folded_ball():
    sheared = 0
    for surface in SURFACES:
        parameters, mesh = made("folded_ball", surface)
        _, straight = made("folded_ball", surface, slope=0.0)
        assert geometry.volume(mesh) == pytest.approx(geometry.volume(straight), rel=3e-3)
        sheared += parameters["slope"] > 0.2
        assert geometry.area(mesh) != pytest.approx(geometry.area(straight), rel=1e-6)
    assert sheared > 1


def test_valleys_of_a_folded_ball_are_as_deep_as_its_depth_says():
    _, mesh = made("folded_ball", 0, slope=0.0, b=1.0, c=1.0, depth=0.3, folds=6.0)
    radius = np.linalg.norm(mesh.vertices, axis=1)
    assert radius.min() == pytest.approx(0.7, abs=1e-3)
    assert 0.95 < radius.max() <= 1
