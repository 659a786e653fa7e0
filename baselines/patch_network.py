"""The network of `patch_transformer.py`: points of a mesh in patches, mixed by a transformer."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import safe_open
from torch import Tensor, nn

from synthnet import Mesh
from synthnet.mesh.geometry import face_areas

COUNT = 10  # eigenvalues
KEPT, SHOWN = 2048, 512  # points of a mesh, and how many of them the network sees at a time
PATCHES, NEAREST = 64, 16  # patches, and points in each
WIDTH, DEPTH, HEADS = 128, 4, 4
SIZE = 4.0  # square root of the area that surfaces are scaled to
HALF_TURNS = ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))  # about principal axes: signs


def cloud(mesh: Mesh) -> tuple[float, np.ndarray]:
    """Return a mesh's area, and points of it with their normals, in principal axes.

    Returns
    -------
    float
        In length².
    ndarray of shape (2048, 6), float32
        Points x, y, z of the surface at area 16, spread evenly, and unit normals.

    Raises
    ------
    ValueError
        If the mesh has no area.
    """
    areas = face_areas(mesh)
    area = float(areas.sum())
    if not area > 0:
        raise ValueError("the mesh has no area")
    numbers = np.arange(KEPT) + 0.5
    faces = np.searchsorted(np.cumsum(areas), numbers * (area / KEPT))
    corners = mesh.vertices.astype(np.float64)[mesh.faces[faces]]
    u, v = (numbers * 0.7548776662466927 % 1)[:, None], (numbers * 0.5698402909980532 % 1)[:, None]
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    points = corners[:, 0] + u * first + v * second
    normals = np.cross(first, second)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    points = (points - points.mean(axis=0)) * (SIZE / area**0.5)
    _, axes = np.linalg.eigh(points.T @ points)
    return area, np.hstack([points @ axes, normals @ axes]).astype(np.float32)


def far_apart(points: Tensor, count: int) -> Tensor:
    """Return indices of points of each cloud, each the farthest from those before it, (B, count).

    Parameters
    ----------
    points : Tensor of shape (B, N, 3)
        In an order that says nothing: the first one is the start.
    count : int
        How many.
    """
    rows = torch.arange(len(points))
    chosen = torch.zeros(len(points), count, dtype=torch.long)
    distances = torch.full(points.shape[:2], torch.inf)
    for i in range(1, count):
        latest = points[rows, chosen[:, i - 1]]
        distances = torch.minimum(distances, (points - latest[:, None]).square().sum(dim=-1))
        chosen[:, i] = distances.argmax(dim=1)
    return chosen


class PatchTransformer(nn.Module):
    """The network: from clouds to the logarithms of the multiples of Weyl's law."""

    def __init__(self) -> None:
        super().__init__()
        self.patch = nn.Sequential(nn.Linear(6, 64), nn.GELU(), nn.Linear(64, WIDTH))
        self.position = nn.Sequential(nn.Linear(6, WIDTH), nn.GELU(), nn.Linear(WIDTH, WIDTH))
        layer = nn.TransformerEncoderLayer(
            *(WIDTH, HEADS, 2 * WIDTH),
            dropout=0.0,
            activation="gelu",
            batch_first=True,
            norm_first=True,
        )
        self.mix = nn.TransformerEncoder(layer, DEPTH, enable_nested_tensor=False)
        self.norm = nn.LayerNorm(2 * WIDTH)
        self.answer = nn.Sequential(nn.Linear(2 * WIDTH, WIDTH), nn.GELU(), nn.Linear(WIDTH, COUNT))
        self.register_buffer("mean", torch.zeros(COUNT))
        self.register_buffer("scale", torch.ones(COUNT))

    def forward(self, clouds: Tensor) -> Tensor:
        """Return log(λ_i · area / 4πi) of clouds of shape (B, N, 6), shape (B, 10)."""
        points = clouds[..., :3].contiguous()
        rows = torch.arange(len(clouds))[:, None]
        centres = clouds[rows, far_apart(points, PATCHES)]
        distances = torch.cdist(centres[..., :3].contiguous(), points)
        nearest = distances.topk(NEAREST, largest=False, sorted=False).indices
        patches = clouds[rows[..., None], nearest]
        offsets = 8 * (patches[..., :3] - centres[:, :, None, :3])
        patches = torch.cat([offsets, patches[..., 3:]], dim=-1)
        tokens = self.patch(patches).amax(dim=2) + self.position(centres)
        tokens = self.mix(tokens)
        pooled = torch.cat([tokens.mean(dim=1), tokens.amax(dim=1)], dim=1)
        return self.mean + self.scale * self.answer(self.norm(pooled))


def weyl(areas: Tensor) -> Tensor:
    """Return 4πi / area for the first ten i, shape (B, 10)."""
    return 4 * torch.pi * torch.arange(1, COUNT + 1, dtype=torch.float64) / areas[:, None]


def views(clouds: Tensor) -> Iterator[Tensor]:
    """Yield four quarters of the points of clouds of shape (B, 2048, 6), each half turned its way.

    They are the same ones at each call. Principal axes have no sign, so a mesh that is turned may
    come with any of these half turns; answers from all of them are averaged.
    """
    order = torch.randperm(KEPT, generator=torch.Generator().manual_seed(0))
    for chosen, signs in zip(order.split(SHOWN), HALF_TURNS, strict=True):
        yield clouds[:, chosen] * torch.tensor([*signs, *signs], dtype=clouds.dtype)


def answers(logs: Tensor, areas: Tensor) -> np.ndarray:
    """Return ascending eigenvalues, (B, 10), from the network's logarithms and areas, (B,)."""
    return (weyl(areas) * logs.double().exp()).sort(dim=1).values.numpy()


def read_weights(path: Path) -> tuple[dict[str, Tensor], dict[str, dict[str, Any]]]:
    """Return the tensors of all trainings, and of each what is known, by training set and seed."""
    with safe_open(path, framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        return tensors, json.loads(file.metadata()["trainings"])
