"""The solids like those of CAD, and what is measured on them."""

from functools import partial

import numpy as np
import pytest

from evidence import parts
from evidence.solids import KINDS, Solid, as_mesh, box, perforated, solids
from synthnet import Mesh
from synthnet.mesh.geometry import MeshFacts, volume


def test_solids_are_closed_surfaces_of_one_component_and_of_every_kind():
    made = [solid for solid in solids(len(KINDS), seed=5) if isinstance(solid, Solid)]
    assert [solid.kind for solid in made] == list(KINDS)
    for solid in made:
        facts = MeshFacts(solid.mesh)
        assert facts.is_closed
        assert facts.n_components == 1
        assert facts.volume > 0


def test_a_solid_depends_on_seed_and_number_alone():
    few, more, other = (
        [solid.mesh.vertices for solid in solids(count, seed) if isinstance(solid, Solid)]
        for count, seed in ((2, 5), (3, 5), (2, 6))
    )
    assert all((a == b).all() for a, b in zip(few, more, strict=False))
    assert few[0].shape != other[0].shape or (few[0] != other[0]).any()


def test_a_box_has_its_volume_and_a_plate_a_handle_a_hole():
    assert volume(as_mesh(box(1, 2, 3))) == pytest.approx(6)
    rng = np.random.default_rng(3)
    holes = rng.integers(3, 12) * rng.integers(2, 9)  # the first numbers that it draws
    plate = as_mesh(perforated(np.random.default_rng(3)))
    assert MeshFacts(plate).euler_characteristic == 2 - 2 * holes


def test_what_is_off_refused_or_without_a_certificate_is_counted():
    tetrahedron = Mesh(
        np.vstack([np.zeros(3), np.eye(3)]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    )
    cube = as_mesh(box(1, 1, 1).refine(3))
    row = parts.row("some", partial(iter, [("cube", cube), ("refused", None)]))
    assert (row["meshes"], row[parts.REFUSED], row["tested"]) == (1, 1, 0)
    assert row["worst"] == 0
    with pytest.raises(ValueError, match="k must be between 1 and 3"):
        parts.row("few", partial(iter, [("tetrahedron", tetrahedron)]))
    wrong = {"rows": [{"set": "a", "off": [2, 1]}, {"set": "b", "off": [0, 0]}]}
    assert parts.problems(wrong) == ["a: 2 meshes are off by more than 5%"]
