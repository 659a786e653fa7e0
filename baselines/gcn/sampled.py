"""Shapes of a version that is too large to be trained on whole: of large meshes a share.

A mesh of n vertices is taken with probability min(1, v / n), so that meshes of every size cost
training about the same. The choice depends on their ids alone.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch
from torch import Tensor

from synthnet import recipe
from synthnet.build.versions import ensure_built
from synthnet.recipe import splits
from synthnet.types import PROTOCOLS, Sample

from .data import AT_ONCE, Shapes, encoder
from .folded import each
from .graphs import Graphs
from .model import GCNConfig


def is_taken(id: str, n: int, vertices: int) -> bool:
    """Return whether a mesh of n vertices is one of the share.

    Examples
    --------
    >>> is_taken("blob-00000", 1000, 1000)
    True
    >>> sum(is_taken(f"blob-{i:05d}", 4000, 1000) for i in range(1000))
    238
    """
    uniform = int.from_bytes(hashlib.sha256(f"share/{id}".encode()).digest()[:8], "big") / 2**64
    return uniform * n < vertices


@dataclass(frozen=True, slots=True)
class Sampled(Shapes):
    """Encoded shapes with their ids, so that a protocol of the version's own can be asked for.

    Parameters
    ----------
    ids : tuple of str
        One a shape.
    """

    ids: tuple[str, ...]

    def instances(self, split: str, protocol: str) -> Tensor:
        """Return the (shape, instance) pairs of a split that a training uses, (I, 2).

        Raises
        ------
        RecipeError
            If the version has no such training.
        """
        if protocol in PROTOCOLS:
            return Shapes.instances(self, split, protocol)
        wanted = recipe.load(self.version)
        (fold,) = splits.folds(wanted, protocol, split)
        used = [splits.takes(fold, wanted, split, id) for id in self.ids]
        found = Shapes.instances(self, split, "grouped")
        return found[torch.tensor(used)[found[:, 0]]]

    def to(self, device: torch.device) -> Sampled:
        """Return the same with the graphs on a device."""
        graphs = [one.to(device) for one in self.graphs]
        return replace(self, graphs=graphs, y=self.y.to(device))


def load(
    version: str, config: GCNConfig, vertices: int, root: str | None = None, threads: int = 1
) -> Sampled:
    """Read a version, which is built if it is not there, and encode the share of its meshes."""
    stored = ensure_built(version, root)
    encode = encoder(config)
    graphs: list[Graphs] = []
    facts = []
    share = iter(_share(stored.samples(), vertices))
    while some := list(islice(share, AT_ONCE)):  # each holds the memory of its whole shard
        graphs += each(encode, [sample.mesh for sample in some], threads)
        facts += [
            (
                s.spec.id,
                np.float32(s.eigenvalues),
                np.float32(s.isometries),
                s.split,
                s.paper_splits,
            )
            for s in some
        ]
    ids, y, isometries, splits, paper_splits = zip(*facts, strict=True)
    return Sampled(
        graphs=graphs,
        y=torch.from_numpy(np.array(y)),
        isometries=torch.from_numpy(np.array(isometries)),
        splits=np.array(splits),
        paper_splits=np.array(paper_splits),
        version=stored.manifest.version,
        digest=stored.manifest.recipe_digest,
        ids=ids,
    )


def _share(samples: Iterable[Sample], vertices: int) -> Iterable[Sample]:
    for sample in samples:
        if sample.split != "test" and is_taken(sample.spec.id, len(sample.mesh.vertices), vertices):
            yield sample
