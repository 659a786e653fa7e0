import dataclasses

import numpy as np
import pytest

from synthnet.types import Manifest, Mesh, Rejection, ShapeSpec, ShardRecord

TRIANGLE = np.array([[0, 1, 2]])


def shard(family, rows, *ids):
    rejections = tuple(Rejection(i, family, "finite", "1 vertices are not finite") for i in ids)
    return ShardRecord(f"shards/{family}-0000.parquet", family, "", 0, rows, 0, 0, rejections)


@pytest.mark.parametrize("shape", [(3,), (3, 2), (1, 3, 3)])
def test_vertices_of_a_wrong_shape_are_refused(shape):
    with pytest.raises(ValueError, match=r"vertices must have shape \(n, 3\), got \(.*\)"):
        Mesh(np.zeros(shape), TRIANGLE)


@pytest.mark.parametrize("shape", [(3,), (1, 4)])
def test_faces_of_a_wrong_shape_are_refused(shape):
    with pytest.raises(ValueError, match=r"faces must have shape \(n, 3\), got \(.*\)"):
        Mesh(np.eye(3), np.zeros(shape, dtype=np.int64))


def test_integer_vertices_are_refused():
    with pytest.raises(ValueError, match="vertices must be floating point, got int64"):
        Mesh(np.eye(3, dtype=np.int64), TRIANGLE)


@pytest.mark.parametrize("dtype", [np.float64, np.bool_])
def test_faces_that_are_no_integers_are_refused(dtype):
    with pytest.raises(ValueError, match=f"faces must be integer, got {np.dtype(dtype)}"):
        Mesh(np.eye(3), TRIANGLE.astype(dtype))


@pytest.mark.parametrize(("face", "indices"), [([0, 1, 3], "0 to 3"), ([-1, 0, 1], "-1 to 1")])
def test_faces_that_name_no_vertex_are_refused(face, indices):
    with pytest.raises(ValueError, match=f"faces must name vertices 0 to 2, got {indices}"):
        Mesh(np.eye(3), np.array([face]))


def test_a_mesh_without_faces_is_allowed():
    assert Mesh(np.eye(3), np.zeros((0, 3), dtype=np.int64)).faces.shape == (0, 3)


def test_unsigned_faces_and_float32_vertices_are_allowed():
    mesh = Mesh(np.eye(3, dtype=np.float32), TRIANGLE.astype(np.uint8))
    assert (mesh.vertices.dtype, mesh.faces.dtype) == (np.float32, np.uint8)


def test_stored_rounds_to_float32_and_int32_and_leaves_the_mesh_alone():
    mesh = Mesh(np.eye(3) / 3, TRIANGLE)
    stored = mesh.stored()
    assert stored.vertices.dtype == np.float32
    assert stored.faces.dtype == np.int32
    # 1/3 = 0.0101...b; the nearest 24-bit significand is 11184811 / 2^25.
    assert float(stored.vertices[0, 0]) == 11184811 / 2**25
    assert mesh.vertices[0, 0] == 1 / 3
    twice = stored.stored()
    np.testing.assert_array_equal(twice.vertices, stored.vertices)
    np.testing.assert_array_equal(twice.faces, stored.faces)


@pytest.mark.parametrize(
    ("value", "attribute"),
    [
        (Mesh(np.eye(3), TRIANGLE), "faces"),
        (ShapeSpec("cone-00000", "cone", 0, {}, "0"), "id"),
        (Rejection("cone-00000", "cone", "finite", ""), "reason"),
    ],
)
def test_core_types_are_frozen(value, attribute):
    with pytest.raises(dataclasses.FrozenInstanceError, match=attribute):
        setattr(value, attribute, None)


def test_manifest_adds_up_rows_and_rejections_in_order():
    shards = (
        shard("cone", 50),
        shard("cone", 48, "cone-00051", "cone-00060"),
        shard("torus", 9, "t"),
    )
    manifest = Manifest("1.0", "", {}, {}, shards, {})
    assert manifest.rows == 107
    assert [r.id for r in manifest.rejections] == ["cone-00051", "cone-00060", "t"]
