"""The transformer on patches of points: what it sees of a mesh, and how it is trained."""

import numpy as np
import pytest
import torch
from eigbench.errors import PredictorError
from eigbench.running import predictor

from baselines import patch_network, train_patch_transformer
from baselines.patch_network import PatchTransformer
from baselines.train_patch_transformer import Clouds, error, keep, shown, train
from evidence import BASELINES, baseline
from synthnet.families import FAMILIES
from synthnet.types import Mesh
from tests.spectrum.meshes import sphere

SIDES = ("width", "height", "depth")


def box():
    shape = dict(zip(SIDES, (1.0, 0.6, 1.7), strict=True), subdivisions=3)
    return FAMILIES["rectangular_prism"].generate(shape)


def test_points_are_spread_by_area_over_the_faces_whose_normals_they_have():
    area, points = patch_network.cloud(box())
    assert area == pytest.approx(2 * (0.6 + 1.7 + 1.02))
    assert points.shape == (patch_network.KEPT, 6)
    # In the principal axes, the longest side last; at area 1, times SIZE.
    sides = np.array([0.6, 1.0, 1.7])
    half = sides * patch_network.SIZE / area**0.5 / 2
    axis = np.abs(points[:, 3:]).argmax(axis=1)
    assert np.abs(points[:, 3:]).max(axis=1) == pytest.approx(1, abs=1e-3)
    rows = np.arange(len(points))
    assert np.abs(points[rows, axis]) == pytest.approx(half[axis], abs=0.01)
    assert (points[rows, axis] * points[rows, 3 + axis] > 0).all()  # normals point outwards
    shares = 2 * sides.prod() / sides / area
    assert np.bincount(axis) / len(points) == pytest.approx(shares, abs=0.002)


def test_points_do_not_depend_on_size_position_and_rotation_up_to_mirrors():
    mesh = box()
    turn = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    moved = Mesh(3.0 * mesh.vertices @ turn + [5.0, 0.0, -2.0], mesh.faces)
    (area, points), (larger, others) = patch_network.cloud(mesh), patch_network.cloud(moved)
    assert larger == pytest.approx(9 * area)
    signs = np.sign((points[:, :3] * others[:, :3]).sum(axis=0))
    assert others * [*signs, *signs] == pytest.approx(points, abs=1e-4)


@pytest.mark.parametrize("faces", [[[0, 1, 1]], np.empty((0, 3), dtype=np.int64)])
def test_a_mesh_without_area_is_refused(faces):
    with pytest.raises(ValueError, match="the mesh has no area"):
        patch_network.cloud(Mesh(np.eye(3), np.array(faces)))


def test_each_centre_is_the_farthest_point_from_those_before_it():
    points = torch.randn(2, 50, 3, generator=torch.Generator().manual_seed(0))
    chosen = patch_network.far_apart(points, 12)
    assert chosen[:, 0].tolist() == [0, 0]
    for cloud, mine in zip(points, chosen, strict=True):
        for number in range(1, 12):
            nearest = torch.cdist(cloud, cloud[mine[:number]]).min(dim=1).values
            assert nearest[mine[number]] == nearest.max()


def test_shown_points_are_mirrored_as_a_whole_with_their_normals():
    torch.manual_seed(0)
    kept = torch.rand(8, patch_network.KEPT, 6) + 0.1  # whose signs are those of the mirrors
    seen = shown(kept)
    assert seen.shape == (8, patch_network.SHOWN, 6)
    signs = seen.sign()
    assert (signs == signs[:, :1]).all()
    assert (signs[..., :3] == signs[..., 3:]).all()
    assert len(signs[:, 0].unique(dim=0)) > 2
    exactly = "donot_use_mm_for_euclid_dist"
    distances = torch.cdist(seen[0].abs(), kept[0], compute_mode=exactly)
    assert distances.min(dim=1).values.max() < 1e-6


def test_views_have_each_point_once_and_are_the_same_at_each_call():
    kept = torch.rand(2, patch_network.KEPT, 6) + 0.1
    seen = torch.cat(list(patch_network.views(kept)), dim=1)
    assert torch.equal(seen, torch.cat(list(patch_network.views(kept)), dim=1))
    assert not torch.equal(seen.abs(), kept)
    assert torch.equal(seen[0].abs().sort(dim=0).values, kept[0].sort(dim=0).values)
    signs = {tuple(row) for row in seen[0, :, :3].sign().tolist()}
    assert len(signs) == 4
    assert all(np.prod(row) == 1 for row in signs)  # half turns, no mirrors


def boxes(count):
    """Random boxes with the spectra of their surfaces."""
    sides = np.random.default_rng(0).uniform(0.3, 3.0, size=(count, 3)).tolist()
    shapes = [dict(zip(SIDES, side, strict=True), subdivisions=0) for side in sides]
    family = FAMILIES["rectangular_prism"]
    seen = [patch_network.cloud(family.generate(shape)) for shape in shapes]
    areas, points = zip(*seen, strict=True)
    return Clouds(
        torch.from_numpy(np.stack(points)),
        torch.tensor(areas, dtype=torch.float64),
        torch.from_numpy(np.stack([family.limit_spectrum(shape).eigenvalues for shape in shapes])),
    )


@pytest.mark.slow
def test_training_learns_the_spectra_of_boxes(monkeypatch):
    for module in (patch_network, train_patch_transformer):
        monkeypatch.setattr(module, "SHOWN", 128)
    monkeypatch.setattr(patch_network, "PATCHES", 16)
    monkeypatch.setattr(train_patch_transformer, "BATCH", 16)
    every = boxes(128)
    clouds, unseen = (
        Clouds(every.points[part], every.areas[part], every.limits[part])
        for part in (slice(96), slice(96, None))
    )
    model, errors = train(clouds, unseen, 20, 0)
    assert len(errors) == 20
    model.scale[:] = 0  # its answer is the mean, whatever the shape
    assert errors[-1] < 0.7 * error(model, unseen)


def test_weights_are_kept_beside_those_of_other_trainings(tmp_path):
    path = tmp_path / "weights.safetensors"
    torch.manual_seed(0)
    models = {"2.0/grouped/0": PatchTransformer(), "2.0/genus/1": PatchTransformer()}
    for number, (name, model) in enumerate(models.items()):
        model.mean[:] = 0.1 + number
        keep(path, name, model, {"minutes": number})
    tensors, records = patch_network.read_weights(path)
    assert records == {name: {"minutes": number} for number, name in enumerate(models)}
    for name, model in models.items():
        for key, tensor in model.state_dict().items():
            kept = tensors[f"{name}.{key}"].float()
            assert torch.allclose(kept, tensor, rtol=1e-3, atol=1e-7), key
        assert torch.equal(tensors[f"{name}.mean"], model.mean)


@pytest.fixture(scope="module")
def row():
    """The row as the harness loads it."""
    return predictor.load(BASELINES / "patch_transformer.py", training="2.0/grouped")


def test_the_row_answers_for_a_sphere_of_any_size(row):
    small, large = row.predict([sphere(20), sphere(20, 10.0)])
    assert large == pytest.approx(small / 100, rel=1e-5)
    assert small == pytest.approx(np.repeat([2.0, 6.0, 12.0], [3, 5, 2]), rel=0.1)
    assert row.parameters == 590_794


def test_answers_do_not_depend_on_the_batch(row):
    both = row.predict([box(), sphere(20)])
    assert both[1] == pytest.approx(row.predict([sphere(20)])[0], rel=1e-5)
    assert baseline("patch_transformer").load("cpu", 0).predict([]).shape == (0, 10)


def test_another_training_is_refused_by_name():
    file = BASELINES / "patch_transformer.py"
    assert predictor.load(file, training="1.0/grouped")  # no mesh of 1.0 is in 2.0
    with pytest.raises(PredictorError, match=r"has no 2\.0/paper/0, only 2\.0/grouped/0"):
        predictor.load(file, training="1.0/paper")
