import dataclasses

import numpy as np
import pytest

from synthnet.types import Manifest, Mesh, Rejection, ShapeSpec, ShardRecord

TRIANGLE = np.array([[0, 1, 2]])


def shard(family, rows, *ids):
    rejections = tuple(Rejection(i, family, "finite", "1 vertices are not finite") for i in ids)
    return ShardRecord(f"shards/{family}-0000.parquet", family, "", 0, rows, 0, 0, rejections)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        (np.zeros(3), TRIANGLE, r"vertices must have shape \(n, 3\), got \(3,\)"),
        (np.zeros((3, 2)), TRIANGLE, r"vertices must have shape \(n, 3\), got \(3, 2\)"),
        (np.zeros((1, 3, 3)), TRIANGLE, r"vertices must have shape \(n, 3\), got \(1, 3, 3\)"),
        (np.eye(3), TRIANGLE[0], r"faces must have shape \(n, 3\), got \(3,\)"),
        (np.eye(3), np.array([[0, 0, 0, 0]]), r"faces must have shape \(n, 3\), got \(1, 4\)"),
        (np.eye(3, dtype=np.int64), TRIANGLE, "vertices must be floating point, got int64"),
        (np.eye(3), TRIANGLE.astype(np.float64), "faces must be integer, got float64"),
        (np.eye(3), TRIANGLE.astype(np.bool_), "faces must be integer, got bool"),
        (np.eye(3), np.array([[0, 1, 3]]), "faces must name vertices 0 to 2, got 0 to 3"),
        (np.eye(3), np.array([[-1, 0, 1]]), "faces must name vertices 0 to 2, got -1 to 1"),
    ],
)
def test_arrays_that_are_no_mesh_are_refused(vertices, faces, message):
    with pytest.raises(ValueError, match=message):
        Mesh(vertices, faces)


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
    rejected = shard("cone", 48, "cone-00051", "cone-00060")
    manifest = Manifest(
        "1.0", "", {}, {}, (shard("cone", 50), rejected, shard("torus", 9, "t")), {}
    )
    assert manifest.rows == 107
    assert [r.id for r in manifest.rejections] == ["cone-00051", "cone-00060", "t"]
