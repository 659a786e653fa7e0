"""A version's shapes as encoded graphs in memory, each encoded once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np
import torch
from torch import Tensor
from torch_geometric.data import Data

from synthnet.build.versions import ensure_built
from synthnet.types import Mesh

from .encodings import encoding
from .folded import each
from .graphs import Graphs, graph
from .model import GCNConfig

AT_ONCE = 500  # meshes in memory before they are encoded


def encoder(config: GCNConfig) -> Callable[[Mesh], Graphs]:
    """Return the way from a mesh to what a network of this configuration reads.

    Raises
    ------
    MeshError
        When called with a mesh that cannot be encoded.
    """
    transform = encoding(
        config.encoding,
        virtual_node=config.virtual_node,
        scale_free=config.scale_free,
        principal_axes=config.principal_axes,
    )

    def encode(mesh: Mesh) -> Graphs:
        pos = torch.from_numpy(np.array(mesh.vertices, dtype=np.float64))
        face = torch.from_numpy(mesh.faces.T.astype(np.int64))
        return graph(transform(Data(pos=pos, face=face)))

    return encode


@dataclass(frozen=True, slots=True)
class Shapes:
    """Encoded shapes with what training asks of them.

    Parameters
    ----------
    graphs : list of Graphs
        One a shape.
    y : Tensor of shape (S, k), float32
        Eigenvalues in 1/length².
    isometries : Tensor of shape (S, c, 3, 3), float32
        The stored instances.
    splits : ndarray of shape (S,), str
        Under the protocol ``grouped``.
    paper_splits : ndarray of shape (S, c), str
        Under the protocol ``paper``.
    version, digest : str
        Of the dataset, and of its recipe.
    """

    graphs: list[Graphs]
    y: Tensor
    isometries: Tensor
    splits: np.ndarray
    paper_splits: np.ndarray
    version: str
    digest: str

    def instances(self, split: str, protocol: str) -> Tensor:
        """Return the (shape, instance) pairs of a split, (I, 2)."""
        count = self.paper_splits.shape[1]
        grouped = np.repeat(self.splits[:, None], count, axis=1)
        mine = (grouped if protocol == "grouped" else self.paper_splits) == split
        return torch.from_numpy(np.argwhere(mine))

    def to(self, device: torch.device) -> Shapes:
        """Return the same with the graphs on a device."""
        graphs = [one.to(device) for one in self.graphs]
        return Shapes(
            graphs,
            self.y.to(device),
            self.isometries,
            self.splits,
            self.paper_splits,
            self.version,
            self.digest,
        )


def load(version: str, config: GCNConfig, root: str | None = None, threads: int = 1) -> Shapes:
    """Read a version, which is built if it is not there, and encode all its shapes."""
    stored = ensure_built(version, root)
    encode = encoder(config)
    graphs: list[Graphs] = []
    facts = []
    samples = stored.samples()
    while some := list(islice(samples, AT_ONCE)):  # a version's meshes take gigabytes
        graphs += each(encode, [sample.mesh for sample in some], threads)
        facts += [(s.eigenvalues, s.isometries, s.split, s.paper_splits) for s in some]
    y, isometries, splits, paper_splits = (np.array(values) for values in zip(*facts, strict=True))
    return Shapes(
        graphs,
        torch.from_numpy(y.astype(np.float32)),
        torch.from_numpy(isometries.astype(np.float32)),
        splits,
        paper_splits,
        stored.manifest.version,
        stored.manifest.recipe_digest,
    )
