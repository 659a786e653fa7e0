"""What is predicted: the instances of a split, their labels, and a digest of both.

The labels are those the repository pins, so scoring needs no built dataset.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from synthnet import pins, recipe, store
from synthnet.plan import plan_shards
from synthnet.types import PROTOCOLS, SPLITS


@dataclass(frozen=True, slots=True)
class Truth:
    """The labels of a split.

    Parameters
    ----------
    version, split, protocol : str
        Which split of which dataset.
    ids : tuple of str
        Instances, ``cone-00042/3`` for instance 3 of that shape, in order.
    shapes, groups, families : ndarray of shape (n,), str
        Shape of each instance, the group of equal shapes it belongs to, and its family.
    eigenvalues : ndarray of shape (n, k), float64
        The label of each instance, in 1/length².
    recipe_digest : str
        Of the dataset.
    """

    version: str
    split: str
    protocol: str
    ids: tuple[str, ...]
    shapes: NDArray[np.str_]
    groups: NDArray[np.str_]
    families: NDArray[np.str_]
    eigenvalues: NDArray[np.float64]
    recipe_digest: str

    @property
    def digest(self) -> str:
        """SHA-256 of the ids and labels."""
        state = hashlib.sha256("\n".join(self.ids).encode())
        state.update(np.ascontiguousarray(self.eigenvalues, dtype="<f8").tobytes())
        return state.hexdigest()

    @property
    def order(self) -> NDArray[np.int64]:
        """Indices of the instances in the order of the SHA-256 of their ids.

        In it predictors see them: neither the copies of a shape nor the shapes of a family
        come one after the other, so that neither can be told from their place.
        """
        keys = [hashlib.sha256(id.encode()).digest() for id in self.ids]
        return np.array(sorted(range(len(keys)), key=keys.__getitem__), dtype=np.int64)

    def head(self, count: int) -> Truth:
        """Return the first ``count`` instances of a random order that is always the same."""
        return self.take(np.sort(self.order[:count]))

    def take(self, chosen: NDArray[Any]) -> Truth:
        """Return the instances of an index or mask."""
        return replace(
            self,
            ids=tuple(np.array(self.ids)[chosen].tolist()),
            shapes=self.shapes[chosen],
            groups=self.groups[chosen],
            families=self.families[chosen],
            eigenvalues=self.eigenvalues[chosen],
        )


def of_dataset(
    dataset: store.StoredDataset, split: str = "test", protocol: str = "grouped"
) -> Truth:
    """Return the labels of a split of a dataset on disk, as they are stored there."""
    _check(split, protocol)
    rows = []
    columns = ["id", "group", "family", "split", "paper_splits", "eigenvalues"]
    for path in dataset.paths():
        for row in store.read_table(path, columns).to_pylist():
            for instance, paper_split in enumerate(row["paper_splits"]):
                if (row["split"] if protocol == "grouped" else paper_split) == split:
                    rows.append((f"{row['id']}/{instance}", row))
    if not rows:
        raise EigbenchError(f"{dataset.directory} has nothing in the split {split}")
    return Truth(
        dataset.manifest.version,
        split,
        protocol,
        tuple(id for id, _ in rows),
        np.array([row["id"] for _, row in rows]),
        np.array([row["group"] for _, row in rows]),
        np.array([row["family"] for _, row in rows]),
        np.array([row["eigenvalues"] for _, row in rows]),
        dataset.manifest.recipe_digest,
    )


def _check(split: str, protocol: str) -> None:
    for name, value, known in (("split", split, SPLITS), ("protocol", protocol, PROTOCOLS)):
        if value not in known:
            raise EigbenchError(f"{name} must be one of {', '.join(known)}, got {value!r}")


def load(version: str, split: str = "test", protocol: str = "grouped") -> Truth:
    """Return the pinned labels of a split.

    Parameters
    ----------
    version : str
        A version of synthNet that is pinned.
    split : str
        ``train``, ``validation`` or ``test``.
    protocol : str
        ``grouped``: every instance of the split's shapes. ``paper``: its instances.

    Raises
    ------
    EigbenchError
        If the split or protocol is unknown, or the version is not pinned.
    RecipeError
        If the version is unknown.

    Examples
    --------
    >>> truth = load("1.0-mini")
    >>> len(truth.ids), truth.ids[0], truth.eigenvalues.shape
    (306, 'rectangular_prism-00008/0', (306, 10))
    """
    _check(split, protocol)
    wanted = recipe.load(version)
    pinned = pins.read(wanted.base)
    if pinned is None:
        raise EigbenchError(f"the labels of {wanted.base} are not pinned in this release")
    ids, shapes, groups, families, labels = [], [], [], [], []
    for plan in plan_shards(wanted):
        for shape in plan.shapes:
            id = shape.spec.id
            if id not in pinned:
                continue  # rejected by a filter: it has no label
            for instance, paper_split in enumerate(shape.paper_splits):
                if (shape.split if protocol == "grouped" else paper_split) == split:
                    ids.append(f"{id}/{instance}")
                    shapes.append(id)
                    groups.append(shape.spec.group)
                    families.append(shape.spec.family)
                    labels.append(pinned[id].eigenvalues)
    return Truth(
        version,
        split,
        protocol,
        tuple(ids),
        np.array(shapes),
        np.array(groups),
        np.array(families),
        np.array(labels),
        wanted.digest,
    )
