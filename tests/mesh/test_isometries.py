import numpy as np
import pytest

from synthnet import recipe, spectrum
from synthnet.families import FAMILIES, PRIMITIVES
from synthnet.mesh import geometry, isometries
from synthnet.recipe import AugmentationSettings
from synthnet.recipe.distributions import ISOMETRIES, generator
from synthnet.recipe.drawing import draw_shape
from synthnet.types import Mesh

TWO_AND_TWO = AugmentationSettings(rotations=2, reflections=2)


def isometries_of(index, settings=TWO_AND_TWO):
    return isometries.draw_isometries(
        settings.rotations, settings.reflections, generator(20240726, "cone", index, ISOMETRIES)
    )


@pytest.mark.parametrize("index", range(10))
def test_isometries_are_orthogonal(index):
    q = isometries_of(index)
    assert q.dtype == np.float64
    products = q @ q.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), q.shape), atol=1e-14)


def test_isometries_come_in_the_order_that_is_documented():
    q = isometries_of(0)
    identity, r1, r2, s1, s2, *products = q
    np.testing.assert_array_equal(identity, np.eye(3))
    np.testing.assert_array_equal(products, [r1 @ s1, r1 @ s2, r2 @ s1, r2 @ s2])
    np.testing.assert_allclose(np.linalg.det(q), [1, 1, 1, *[-1] * 6], rtol=1e-14)
    distances = np.abs(q[:, None] - q).max(axis=(2, 3))
    assert (distances[np.triu_indices(9, 1)] > 1e-3).all()  # no two are the same


@pytest.mark.parametrize(
    ("rotations", "reflections"), [(0, 0), (3, 0), (0, 1), (0, 2), (2, 2), (1, 4)]
)
def test_number_of_isometries(rotations, reflections):
    settings = AugmentationSettings(rotations, reflections)
    q = isometries_of(0, settings)
    assert q.shape == (settings.instances, 3, 3)
    proper = int((np.linalg.det(q) > 0).sum())
    assert (proper, len(q) - proper) == (1 + rotations, reflections * (1 + rotations))


def test_every_shape_has_isometries_of_its_own():
    np.testing.assert_array_equal(isometries_of(3), isometries_of(3))
    assert np.abs(isometries_of(3)[1:] - isometries_of(4)[1:]).max(axis=(1, 2)).min() > 1e-3


def test_reflection_is_an_involution_that_fixes_a_plane():
    rng = np.random.default_rng(0)
    for _ in range(20):
        s = isometries.random_reflection(rng)
        np.testing.assert_allclose(s @ s, np.eye(3), atol=1e-14)
        np.testing.assert_allclose(s, s.T, atol=1e-15)
        np.testing.assert_allclose(np.linalg.eigvalsh(s), [-1, 1, 1], atol=1e-14)
        assert np.linalg.det(s) == pytest.approx(-1, rel=1e-14)


def test_rotation_is_proper():
    rng = np.random.default_rng(0)
    for _ in range(20):
        assert np.linalg.det(isometries.random_rotation(rng)) == pytest.approx(1, rel=1e-14)


def test_rotations_are_uniform():
    n = 4000
    rng = np.random.default_rng(0)
    r = np.stack([isometries.random_rotation(rng) for _ in range(n)])
    # Haar: an entry has mean 0 and variance 1/3, its square mean 1/5 · ... E x⁴ = 1/5,
    # so x² has variance 1/5 - 1/9; the trace 1 + 2 cos t has mean 0 and variance 1.
    assert np.abs(r.mean(axis=0)).max() < 4 * np.sqrt(1 / 3 / n)
    assert np.abs((r**2).mean(axis=0) - 1 / 3).max() < 4 * np.sqrt((1 / 5 - 1 / 9) / n)
    trace = np.trace(r, axis1=1, axis2=2)
    assert abs(trace.mean()) < 4 / np.sqrt(n)
    assert abs((trace**2).mean() - 1) < 4 * np.sqrt(2 / n)  # E t⁴ = 3
    # A fixed rotation from the left or the right changes nothing: columns against rows.
    assert abs((r[:, 0, 1] * r[:, 1, 0]).mean()) < 4 * np.sqrt(2 / 15 / n)


def test_normals_of_reflections_are_uniform():
    n = 4000
    rng = np.random.default_rng(0)
    # S = 1 - 2 u uᵀ; E u uᵀ = 1/3, and u_i² has variance 4/45.
    mean = np.mean([isometries.random_reflection(rng) for _ in range(n)], axis=0)
    assert np.abs(mean - np.eye(3) / 3).max() < 4 * 2 * np.sqrt(4 / 45 / n)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_apply_moves_every_vertex_and_turns_the_faces_of_a_mirror_image(dtype):
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]], dtype=dtype)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
    mesh = Mesh(vertices, faces)
    quarter_turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = isometries.apply(mesh, quarter_turn)
    np.testing.assert_array_equal(turned.vertices, [[0, 0, 0], [0, 1, 0], [-2, 0, 0], [0, 0, 3]])
    np.testing.assert_array_equal(turned.faces, faces)
    mirrored = isometries.apply(mesh, np.diag([1.0, 1, -1]))
    np.testing.assert_array_equal(mirrored.vertices, vertices * [1, 1, -1])
    np.testing.assert_array_equal(mirrored.faces[0], [0, 1, 2])
    for moved in (turned, mirrored):
        assert (moved.vertices.dtype, moved.faces.dtype) == (dtype, np.int32)
        assert geometry.volume(moved) == 1
    np.testing.assert_array_equal(mesh.faces, faces)


@pytest.mark.parametrize("family", PRIMITIVES)
def test_every_instance_has_the_volume_of_the_shape(family):
    spec = draw_shape(recipe.load("1.0"), family, 4)
    mesh = FAMILIES[family].generate(spec.parameters)
    assert len(isometries_of(4)) == 9
    for isometry in isometries_of(4):
        moved = isometries.apply(mesh, isometry)
        assert geometry.volume(moved) == pytest.approx(geometry.volume(mesh), rel=1e-9)
        assert geometry.MeshFacts(moved).n_repeated_half_edges == 0


@pytest.mark.parametrize("family", ["torus", "tetrahedron", "split_cone"])
@pytest.mark.parametrize("instance", range(9))
def test_every_instance_has_the_spectrum_of_the_shape(family, instance):
    spec = draw_shape(recipe.load("1.0"), family, 0)
    mesh = FAMILIES[family].generate(spec.parameters)
    isometry = isometries_of(0)[instance]
    for precision, tolerance in ((mesh, 1e-9), (mesh.stored(), 1e-6)):
        expected = spectrum.compute(precision).eigenvalues
        values = spectrum.compute(isometries.apply(precision, isometry)).eigenvalues
        np.testing.assert_allclose(values, expected, rtol=tolerance)
