"""Encoded meshes as compressed sparse rows, one mesh after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch_geometric.data import Data

from .kernels import gather

TAIL = 4  # columns of features after [A x, x]


@dataclass(frozen=True, slots=True)
class Graphs:
    """Meshes joined to one graph without edges between them.

    Parameters
    ----------
    features : Tensor of shape (n, 2c + 4), float32
        ``[A x, x, A 1, 1, 0, 0]``, with A the weighted adjacency matrix and x the c encoded
        channels: what the first graph convolution multiplies by its weights. The zeros make
        the width a multiple of four, which matrix products like.
    offsets : Tensor of shape (n + 1,), int32
        Where each vertex's neighbours begin.
    neighbours : Tensor of shape (e,), int32
        Rows of the neighbours, each edge once in either direction.
    weights : Tensor of shape (e,), float32, or None
        Of the edges; ``None`` where all are 1.
    starts : tuple of int
        Where each mesh begins, and n.
    areas : Tensor of shape (B,), float32
        What a scale-free network's eigenvalues are divided by; 1 for the paper's.
    """

    features: Tensor
    offsets: Tensor
    neighbours: Tensor
    weights: Tensor | None
    starts: tuple[int, ...]
    areas: Tensor

    def __len__(self) -> int:
        """Return the number of meshes."""
        return len(self.starts) - 1

    def to(self, device: torch.device | str) -> Graphs:
        """Return the same on a device."""
        weights = None if self.weights is None else self.weights.to(device)
        moved = [t.to(device) for t in (self.features, self.offsets, self.neighbours)]
        return Graphs(*moved, weights, self.starts, self.areas.to(device))


def graph(data: Data) -> Graphs:
    """Return an encoded mesh: ``x``, ``edge_index``, perhaps ``edge_weight`` and ``area``."""
    n, c = data.x.shape
    rows, neighbours = data.edge_index
    weights = data.get("edge_weight")
    if (rows.diff() < 0).any():  # a virtual node's edges come last
        rows, order = torch.sort(rows, stable=True)
        neighbours = neighbours[order]
        weights = None if weights is None else weights[order]
    offsets = torch.zeros(n + 1, dtype=torch.int32)
    offsets[1:] = torch.bincount(rows, minlength=n).cumsum(0)
    neighbours = neighbours.int()
    x = torch.cat([data.x, torch.ones(n, 1)], dim=1)
    both = torch.empty(n, 2 * c + 2)
    gather(offsets, neighbours, weights, x, both)
    parts = [both[:, :c], data.x, both[:, c : c + 1], torch.ones(n, 1), torch.zeros(n, TAIL - 2)]
    area = data.get("area", torch.ones(1)).float()
    return Graphs(torch.cat(parts, dim=1), offsets, neighbours, weights, (0, n), area)


def join(graphs: Sequence[Graphs], isometries: Tensor | None = None) -> Graphs:
    """Join graphs of one mesh each, moved by an orthogonal matrix each, (B, 3, 3), if given.

    The encodings commute with isometries: coordinates and the Gauss map turn with the mesh,
    areas and lengths stay.
    """
    if isometries is None and len(graphs) == 1:
        return graphs[0]
    starts, edges = [0], [0]
    for one in graphs:
        starts.append(starts[-1] + len(one.features))
        edges.append(edges[-1] + len(one.neighbours))
    parts = [one.features for one in graphs]
    if isometries is not None:
        matrices = feature_matrices(isometries, parts[0].shape[1])
        parts = [part @ matrix for part, matrix in zip(parts, matrices, strict=True)]
    weighted = graphs[0].weights is not None
    return Graphs(
        torch.cat(parts),
        torch.cat(
            [graphs[0].offsets[:1]]
            + [one.offsets[1:] + shift for one, shift in zip(graphs, edges, strict=False)]
        ),
        torch.cat([one.neighbours + shift for one, shift in zip(graphs, starts, strict=False)]),
        torch.cat([one.weights for one in graphs if one.weights is not None]) if weighted else None,
        tuple(starts),
        torch.cat([one.areas for one in graphs]),
    )


def feature_matrices(isometries: Tensor, width: int) -> Tensor:
    """Return the matrices by which rows of features are multiplied, (B, width, width).

    The channels are coordinates (3), then perhaps the area (1) and the Gauss map (3), twice.
    """
    channels = (width - TAIL) // 2
    matrices = torch.eye(width, device=isometries.device).repeat(len(isometries), 1, 1)
    for half in (0, channels):
        for vector in (0, 4) if channels == 7 else (0,):
            at = slice(half + vector, half + vector + 3)
            matrices[:, at, at] = isometries.transpose(1, 2)
    return matrices
