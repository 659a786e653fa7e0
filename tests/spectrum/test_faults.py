"""A fault planted in a good mesh is one line that names it, and never a wrong spectrum."""

import re

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from synthnet.spectrum import certify, compute
from synthnet.types import Mesh
from tests.spectrum.meshes import side_by_side

SOLIDS = [
    trimesh.creation.box((1.0, 1.4, 1.9)),
    trimesh.creation.icosahedron(),
    trimesh.creation.cylinder(0.7, 2.0, sections=7),
    trimesh.creation.torus(2.0, 0.7, major_sections=5, minor_sections=4),
]
each_kind = settings(max_examples=200, derandomize=True, deadline=None)


@st.composite
def meshes(draw):
    """A closed surface or, without one of its faces, an open one; sheared, scaled and moved."""
    solid = draw(st.sampled_from(SOLIDS))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    turned = solid.vertices @ (np.eye(3) + rng.uniform(-0.3, 0.3, (3, 3)))
    points = 10.0 ** draw(st.integers(-3, 3)) * (turned + rng.uniform(-5, 5, 3))
    faces = np.asarray(solid.faces)[draw(st.integers(0, 1)) :]
    return Mesh(points, faces[rng.permutation(len(faces))])


def line(mesh, k=3):
    """The one line that both a spectrum and a judgement end in."""
    lines = set()
    for judge in (lambda: compute(mesh, k), lambda: certify(mesh, [1.0, 2.0])):
        with pytest.raises(ValueError, match=r"^[^\n]+$") as caught:
            judge()
        lines.add(str(caught.value))
    (message,) = lines
    return message


def some(draw, count, most):
    """A few numbers below a count, ascending."""
    chosen = draw(st.sets(st.integers(0, count - 1), min_size=1, max_size=min(most, count)))
    return np.array(sorted(chosen))


@each_kind
@given(st.data())
def test_not_finite(data):
    mesh = data.draw(meshes())
    bad = some(data.draw, len(mesh.vertices), 4)
    points = mesh.vertices.copy()
    value = data.draw(st.sampled_from([np.nan, np.inf, -np.inf]))
    points[bad, data.draw(st.integers(0, 2))] = value
    what = "NaN" if np.isnan(value) else "infinite"
    are = "vertex is" if len(bad) == 1 else "vertices are"
    expected = f"{len(bad)} {are} {what}, the first is vertex {bad[0]}"
    assert line((points, mesh.faces)) == expected


@each_kind
@given(st.data())
def test_shapes(data):
    mesh = data.draw(meshes())
    arrays = [mesh.vertices, mesh.faces]
    which = data.draw(st.integers(0, 1))
    wrong = data.draw(
        st.sampled_from([lambda a: a[:, :2], lambda a: np.hstack([a, a[:, :1]]), np.ravel])
    )
    arrays[which] = wrong(arrays[which])
    name = ("vertices", "faces")[which]
    assert line(tuple(arrays)).startswith(f"{name} must have shape (n, 3)")


@each_kind
@given(st.data())
def test_faces_out_of_range(data):
    mesh = data.draw(meshes())
    n, faces = len(mesh.vertices), mesh.faces.copy()
    beyond = data.draw(st.sampled_from([-1, -n, n, n + 1, 10**6]))
    faces[data.draw(st.integers(0, len(faces) - 1)), data.draw(st.integers(0, 2))] = beyond
    assert line((mesh.vertices, faces)).startswith(f"faces must name vertices 0 to {n - 1}")


@pytest.mark.filterwarnings("ignore:.* edges? ha(ve|s) more than two faces")
@each_kind
@given(st.data())
def test_zero_area(data):
    mesh = data.draw(meshes())
    points, faces = mesh.vertices.copy(), mesh.faces.copy()
    a, b, _ = faces[0]
    if data.draw(st.booleans()):  # a corner twice
        faces[0, 0] = b
        flat = 1
    else:  # two corners at one point
        points[a] = points[b]
        flat = int(((faces == a).any(axis=1) & (faces == b).any(axis=1)).sum())
    message = line((points, faces))
    assert message.startswith(f"{flat} of {len(faces)} faces have no area: remove them first")
    assert "repair=True" in message


@each_kind
@given(st.data())
def test_vertices_without_a_triangle(data):
    mesh = data.draw(meshes())
    count = data.draw(st.integers(1, 5))
    at = data.draw(st.integers(0, len(mesh.vertices)))
    points = np.insert(mesh.vertices, at, np.full((count, 3), 7.0), axis=0)
    faces = mesh.faces + count * (mesh.faces >= at)
    message = line((points, faces))
    assert re.match(rf"{count} vertices belong to no triangle: .*repair=True\)", message)
    mended = compute((points, faces), 3, repair=True)
    assert mended.repairs["loose vertices"] == count
    np.testing.assert_allclose(mended.eigenvalues, compute(mesh, 3).eigenvalues, rtol=1e-9)


@each_kind
@given(st.data())
def test_components_are_counted(data):
    parts = data.draw(st.lists(meshes(), min_size=2, max_size=3))
    k = data.draw(st.integers(1, 6))
    result = compute(side_by_side(*parts, apart=1.0), k)
    each = [compute(part, min(k, len(part.vertices) - 1)).eigenvalues for part in parts]
    assert result.components == len(parts)
    np.testing.assert_allclose(result.eigenvalues, np.sort(np.concatenate(each))[:k], rtol=1e-9)
    assert result.certificate.count >= k + len(parts)


@each_kind
@given(st.data())
def test_more_eigenvalues_than_there_are(data):
    mesh = data.draw(meshes())
    n = len(mesh.vertices)
    k = data.draw(st.one_of(st.integers(n, n + 5), st.integers(-3, 0)))
    bounds = rf"^k must be between 1 and {n - 1} for {n} vertices, got {k}$"
    with pytest.raises(ValueError, match=bounds):
        compute(mesh, k)
    with pytest.raises(ValueError, match=rf"^there must be 1 to {n - 1} answers after the zeros"):
        certify(mesh, np.linspace(1, 2, n) / np.ptp(mesh.vertices) ** 2 * 100)
