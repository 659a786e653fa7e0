import numpy as np
import pytest
import torch
from torch_geometric.data import Data

from baselines.gcn import queue
from synthnet.types import Mesh


def data_of(mesh):
    """Return a mesh in double precision, as PyTorch Geometric has it."""
    return Data(
        pos=torch.from_numpy(mesh.vertices.astype(np.float64)),
        face=torch.from_numpy(mesh.faces.T.astype(np.int64)),
    )


def moved(mesh, matrix, scale=1.0):
    """Apply an orthogonal matrix; a reflection turns the faces round, as augmentation does."""
    faces = mesh.faces if np.linalg.det(matrix) > 0 else mesh.faces[:, ::-1]
    return Mesh(scale * mesh.vertices.astype(np.float64) @ matrix.T, faces)


def set_apart(monkeypatch, folder):
    """Let the queue of trainings read and write below a folder."""
    monkeypatch.setattr(queue, "LOADER", folder / "baselines" / "reproduction.py")
    monkeypatch.setattr(queue, "RESULTS", folder / "results")


@pytest.fixture(autouse=True)
def one_thread():
    """PyTorch's own threads wait for each other, which takes long where processes share cores."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session")
def samples(tiny_samples):
    """Ten small samples of four families."""
    made = [sample for members in tiny_samples.values() for sample in members]
    assert len(made) == 10
    return made


@pytest.fixture(scope="session")
def meshes(samples):
    return [sample.mesh for sample in samples]


@pytest.fixture(scope="session")
def orthogonal():
    """A rotation and a reflection, (2, 3, 3)."""
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    q = q * np.sign(np.linalg.det(q))
    return np.stack([q, -q])
