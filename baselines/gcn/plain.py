"""The paper's network and its training, whole and slow: read this file first.

A mesh becomes a graph (:func:`encode`), the graph ten eigenvalues (:class:`Network`), and the
eigenvalues a loss that :func:`train` lowers. The other files of this folder compute the same
several times faster and add the paper's variants; the tests hold them to this one. From the root
of the repository, ``python -m baselines.gcn.plain`` trains on 1.0-mini for a few steps.

References
----------
Y. Wu et al., "Graph convolutional networks for learning Laplace-Beltrami operators", 2024:
sections 3.2 (encoding), 3.3 (network), 3.4 (loss), 4.2 (training) and 4.3.3 (virtual node).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import pairwise

import torch
from eigbench.scoring.losses import rpd_loss
from torch import Tensor, nn
from torch_geometric.data import Batch, Data
from torch_geometric.loader import DataLoader
from torch_geometric.nn import GraphConv, global_mean_pool
from torch_geometric.utils import coalesce

from synthnet.pyg import SynthNet


def encode(mesh: Data, virtual_node: bool = True) -> Data:
    r"""Turn ``Data(pos, face)`` into a graph with the paper's full encoding, ALG.

    Parameters
    ----------
    mesh : Data
        ``pos`` of shape (n, 3) and ``face`` of shape (3, m), int64, consistently oriented; every
        triangle has an area and every vertex a triangle. ``y`` is kept if there is one.
    virtual_node : bool
        Whether a last vertex of zeros is joined to all others by edges of weight 1.

    Returns
    -------
    Data
        ``x`` of shape (n, 7), float32: the coordinates; the mixed Voronoi area (A), which is the
        area of the points that are nearest to the vertex, or a share of a triangle that has an
        obtuse angle; the outward mean normal weighted by area (G). ``edge_index`` holds each edge
        both ways, and ``edge_weight`` its length over the longest (L).
    """
    n, pos = len(mesh.pos), mesh.pos.double()
    a, b, c = pos[mesh.face]
    normal = torch.linalg.cross(b - a, c - a)
    area = normal.norm(dim=1) / 2
    if (normal * (a - pos.mean(dim=0))).sum() < 0:  # the faces look inwards
        normal = -normal
    voronoi, gauss, around = pos.new_zeros(n), pos.new_zeros(n, 3), pos.new_zeros(n)
    dots = [((q - p) * (r - p)).sum(1) for p, q, r in ((a, b, c), (b, c, a), (c, a, b))]
    obtuse = torch.stack(dots).min(dim=0).values < 0
    for corner in range(3):
        p, q, r = a, b, c
        cot_q, cot_r = dots[(corner + 1) % 3] / (2 * area), dots[(corner + 2) % 3] / (2 * area)
        part = ((r - p).square().sum(1) * cot_q + (q - p).square().sum(1) * cot_r) / 8
        part = torch.where(obtuse, torch.where(dots[corner] < 0, area / 2, area / 4), part)
        voronoi.index_add_(0, mesh.face[corner], part)
        gauss.index_add_(0, mesh.face[corner], normal / 2)
        around.index_add_(0, mesh.face[corner], area)
        a, b, c = b, c, a
    x = torch.cat([pos, voronoi[:, None], gauss / around[:, None]], dim=1).float()

    sides = torch.cat([mesh.face[[0, 1]], mesh.face[[1, 2]], mesh.face[[2, 0]]], dim=1)
    edges = coalesce(torch.cat([sides, sides.flip(0)], dim=1))
    lengths = (pos[edges[0]] - pos[edges[1]]).norm(dim=1)
    weight = (lengths / lengths.max()).float()
    if virtual_node:
        x = torch.cat([x, x.new_zeros(1, 7)])
        spokes = torch.stack([torch.arange(n), torch.full((n,), n)])
        edges = torch.cat([edges, spokes, spokes.flip(0)], dim=1)
        weight = torch.cat([weight, weight.new_ones(2 * n)])
    return Data(x=x, edge_index=edges, edge_weight=weight, y=mesh.y)


class Block(nn.Module):
    """GraphConv, LeakyReLU, Linear: the paper's graph block."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.conv = GraphConv(inputs, outputs)
        self.act = nn.LeakyReLU()
        self.linear = nn.Linear(outputs, outputs)

    def forward(self, x: Tensor, edges: Tensor, weight: Tensor | None) -> Tensor:
        """Map (n, inputs) to (n, outputs)."""
        mapped: Tensor = self.linear(self.act(self.conv(x, edges, weight)))
        return mapped


class Network(nn.Module):
    """Three graph blocks, the mean over the vertices, and a perceptron of five layers.

    Parameters
    ----------
    channels : int
        Of a vertex at the input.
    widths : tuple of int
        Channels after each block.
    hidden, outputs : int
        Width of the perceptron (the paper gives none), and eigenvalues.
    """

    def __init__(
        self,
        channels: int = 7,
        widths: tuple[int, ...] = (64, 128, 256),
        hidden: int = 64,
        outputs: int = 10,
    ) -> None:
        super().__init__()
        self.blocks = nn.ModuleList(Block(i, o) for i, o in pairwise((channels, *widths)))
        layers: list[nn.Module] = []
        for i, o in pairwise((widths[-1], hidden, hidden, hidden, hidden, outputs)):
            layers += [nn.Linear(i, o), nn.LeakyReLU()]
        self.head = nn.Sequential(*layers[:-1])

    def forward(self, batch: Batch) -> Tensor:
        """Return the eigenvalues of a batch of graphs in 1/length², (B, outputs)."""
        x = batch.x
        for block in self.blocks:
            x = block(x, batch.edge_index, batch.get("edge_weight"))
        answer: Tensor = self.head(global_mean_pool(x, batch.batch, size=batch.num_graphs))
        return answer


def train(network: Network, batches: Iterable[Batch], rate: float = 1e-4) -> Iterator[float]:
    """Take a step of gradient descent with every batch and yield its loss, RPDLoss.

    The last bias starts at the mean spectrum of the first batch: the loss has no gradient where an
    output is negative.
    """
    optimiser = torch.optim.SGD(network.parameters(), rate, momentum=0.9, weight_decay=1e-5)
    for step, batch in enumerate(batches):
        if step == 0:
            with torch.no_grad():
                network.head[-1].bias.copy_(batch.y.log().mean(dim=0).exp())
        loss = rpd_loss(network(batch), batch.y)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        yield loss.item()


def main(steps: int = 20) -> None:
    """Train on 1.0-mini, which is built if it is missing, and print the losses."""
    torch.manual_seed(0)
    graphs = SynthNet(version="1.0-mini", split="train", transform=encode)
    batches = DataLoader(graphs, batch_size=16, shuffle=True)
    for step, loss in zip(range(steps), train(Network(), batches), strict=False):
        print(f"step {step}: RPDLoss {loss:.3f}")  # noqa: T201


if __name__ == "__main__":
    main()
