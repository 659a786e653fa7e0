"""What is predicted: the instances of a split, their labels, and a digest of both.

The labels are those the repository pins, so scoring needs no built dataset.
"""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from eigbench.scoring.names import MESH
from eigbench.scoring.training import DEFAULT, IMPORTED, training_set
from synthnet import recipe, store
from synthnet.errors import suggestion
from synthnet.recipe import Kind, Recipe, splits
from synthnet.recipe.plan import planned
from synthnet.store import pins
from synthnet.types import PROTOCOLS, SPLITS

EXACT = 1e-9  # relative: a prediction that differs by less differs by rounding


@dataclass(frozen=True, slots=True)
class Truth:
    """The labels of a split.

    Version, split and protocol say which split of which dataset. A protocol ``imported/NAME`` is
    the imported dataset of that name, for predictors trained on ``version``.
    """

    version: str
    split: str
    protocol: str
    ids: tuple[str, ...]  #: instances, ``cone-00042/3`` for instance 3 of that shape, in order
    shapes: NDArray[np.str_]  #: shape of each instance, (n,)
    groups: NDArray[np.str_]  #: the group of equal shapes it belongs to, (n,)
    families: NDArray[np.str_]  #: its family, (n,)
    #: What a predictor of each instance may be trained on, ``VERSION/PROTOCOL``, (n,); more than
    #: one where a protocol holds out several things in turn.
    trainings: NDArray[np.str_]
    #: The label of each instance, (n, k), in 1/length²; or its surface's spectrum, by ``target``.
    eigenvalues: NDArray[np.float64]
    recipe_digest: str  #: of the dataset
    target: str = MESH  #: what the eigenvalues are of, ``mesh`` or ``surface``
    #: How far each eigenvalue may be from the true one, (n, k), in 1/length²; None for rounding
    #: alone.
    bars: NDArray[np.float64] | None = None

    @property
    def tolerance(self) -> NDArray[np.float64]:
        """How near a prediction must be to count as exact, shape (n, k), in 1/length²."""
        rounding = EXACT * self.eigenvalues
        return rounding if self.bars is None else np.maximum(self.bars, rounding)

    @property
    def digest(self) -> str:
        """SHA-256 of the ids and labels."""
        state = hashlib.sha256("\n".join(self.ids).encode())
        state.update(np.ascontiguousarray(self.eigenvalues, dtype="<f8").tobytes())
        return state.hexdigest()

    @property
    def order(self) -> NDArray[np.int64]:
        """Indices of the instances in the order of the SHA-256 of their ids: as if shuffled."""
        keys = [hashlib.sha256(id.encode()).digest() for id in self.ids]
        return np.array(sorted(range(len(keys)), key=keys.__getitem__), dtype=np.int64)

    def head(self, count: int) -> Self:
        """Return the first ``count`` instances of a random order that is always the same."""
        return self.take(np.sort(self.order[:count]))

    def take(self, chosen: NDArray[Any]) -> Self:
        """Return the instances of an index or mask."""
        return replace(
            self,
            ids=tuple(np.array(self.ids)[chosen].tolist()),
            shapes=self.shapes[chosen],
            groups=self.groups[chosen],
            families=self.families[chosen],
            trainings=self.trainings[chosen],
            eigenvalues=self.eigenvalues[chosen],
            bars=None if self.bars is None else self.bars[chosen],
        )


@dataclass(frozen=True, slots=True)
class _Labelled:
    """A shape that has a label."""

    id: str
    group: str
    family: str
    index: int
    split: str
    paper_splits: tuple[str, ...]
    eigenvalues: NDArray[np.float64]


def load(version: str, split: str = "test", protocol: str = "grouped") -> Truth:
    """Return the pinned labels of a split.

    Parameters
    ----------
    version : str
        A version of synthNet that is pinned.
    split : str
        ``train``, ``validation`` or ``test``.
    protocol : str
        ``grouped``: every instance of the split's shapes. ``paper``: its instances. One of the
        recipe's ``protocols``: the split's shapes that it tests, or that it leaves to train on.
        ``imported/NAME``: all of an imported dataset whose labels are pinned.

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
    _check(split)
    resolved = recipe.load(version)
    if name := imported_name(resolved, split, protocol):
        labels = pins.read(name)
        if labels is None:
            raise EigbenchError(
                f"there is no import {name} here, and its labels are not pinned in this release: "
                f"`synthnet import DIR --name {name}`, or for a board "
                f"`python -m evidence pin version {name}`"
            )
        return _of_import(version, protocol, labels)
    pinned = pins.read(resolved.base)
    if pinned is None:
        raise EigbenchError(f"the labels of {resolved.base} are not pinned in this release")
    shapes = (
        _Labelled(
            shape.spec.id,
            shape.spec.group,
            shape.spec.family,
            shape.spec.index,
            shape.split,
            shape.paper_splits,
            pinned[shape.spec.id].eigenvalues,
        )
        for plan in planned(version)
        for shape in plan.shapes
        if shape.spec.id in pinned  # or it was rejected by a filter, and has no label
    )
    own = None if protocol in PROTOCOLS else resolved
    return _truth(shapes, own, version, split, protocol, resolved.digest, version)


def of_dataset(
    dataset: store.StoredDataset, split: str = "test", protocol: str = "grouped"
) -> Truth:
    """Return the labels of a split of a dataset on disk, as they are stored there.

    A sealed set has the protocols of the version that it was drawn from.

    Raises
    ------
    EigbenchError
        If the split or protocol is unknown, or empty.
    """
    _check(split)
    version = dataset.manifest.version
    source = recipe.parse_name(version)
    has_recipe = version in recipe.available() or source.kind is Kind.SEALED
    if protocol not in PROTOCOLS and not has_recipe:
        raise EigbenchError(
            f"{version} is scored under {' or '.join(PROTOCOLS)} only, got {protocol}"
            f"{suggestion(protocol, PROTOCOLS)}"
        )
    own = None if protocol in PROTOCOLS else recipe.load(source.version)
    digest, where = dataset.manifest.recipe_digest, str(dataset.directory)
    return _truth(_stored(dataset), own, version, split, protocol, digest, where)


def of_import(dataset: store.StoredDataset, version: str) -> Truth:
    """Return all labels of an imported dataset on disk, for predictors trained on a version.

    Raise EigbenchError if it has no shape.
    """
    labels = {sample.spec.id: pins.pin(sample) for sample in dataset.samples()}
    return _of_import(version, f"{IMPORTED}/{dataset.manifest.version}", labels)


def _trained_on(version: str) -> str:
    """Return the version whose training split is meant: of a subset the full one, else 1.0."""
    source = recipe.parse_name(version).version
    return recipe.load(source).base if source in recipe.available() else DEFAULT.partition("/")[0]


def _check(split: str) -> None:
    if split not in SPLITS:
        raise EigbenchError(f"split must be one of {', '.join(SPLITS)}, got {split!r}")


def imported_name(resolved: Recipe, split: str, protocol: str) -> str:
    """Return the name of the imported dataset that a protocol tests, or nothing.

    Raises
    ------
    EigbenchError
        If the version has no such protocol, no import is named, or the split is no test.
    """
    kind, _, name = protocol.partition("/")
    if kind != IMPORTED:
        return ""
    if not (resolved.protocols and kind in resolved.protocols):
        raise EigbenchError(f"{resolved.version} has no protocol {kind}")
    if not name:
        raise EigbenchError(f"protocol {kind}: say which, {kind}/NAME, NAME as it was imported")
    if name in recipe.available():
        raise EigbenchError(f"protocol {kind}: {name} is a version, not an imported dataset")
    if split != "test":
        raise EigbenchError(f"protocol {protocol} has a test split only: train on grouped")
    return name


def _of_import(version: str, protocol: str, labels: Mapping[str, pins.Pin]) -> Truth:
    """Return the labels of an import; its digest is that of the pins, so of the very meshes.

    Copies of a file have the same label to the last bit, and are one group.
    """
    groups: dict[bytes, str] = {}
    shapes = (
        _Labelled(
            id,
            groups.setdefault(pin.eigenvalues.tobytes(), id),
            id.rpartition("-")[0],
            0,
            "test",
            ("test",),
            pin.eigenvalues,
        )
        for id, pin in labels.items()
    )
    lines = "\n".join(f"{id} {pin.digest}" for id, pin in labels.items())
    digest = hashlib.sha256(lines.encode()).hexdigest()
    name = protocol.removeprefix(f"{IMPORTED}/")
    return _truth(shapes, None, version, "test", protocol, digest, name)


def _choose(
    shapes: Iterable[_Labelled], trained: str, own: Recipe | None, split: str, protocol: str
) -> Iterator[tuple[str, _Labelled, str]]:
    """Yield the instances of a split, their shapes and what a predictor is trained on.

    ``own`` is the recipe whose own protocol it is; ``None`` for one that all datasets have.
    """
    folds = () if own is None else splits.folds(own, protocol, split)
    for shape in shapes:
        if own is not None and shape.split != split:
            continue  # under a version's own protocol no instance has another split than its shape
        trainings = [protocol]
        if own is not None:
            where = own, split, shape.family, shape.index
            trainings = [fold.name for fold in folds if splits.uses(fold, *where)]
        for training in trainings:
            for instance, paper_split in enumerate(shape.paper_splits):
                if (paper_split if protocol == "paper" else shape.split) == split:
                    yield f"{shape.id}/{instance}", shape, training_set(trained, training)


def _stored(dataset: store.StoredDataset) -> Iterator[_Labelled]:
    columns = ["id", "group", "family", "index", "split", "paper_splits", "eigenvalues"]
    for path in dataset.paths():
        for row in store.read_table(path, columns).to_pylist():
            yield _Labelled(*(row[column] for column in columns))


def _truth(
    labelled: Iterable[_Labelled],
    own: Recipe | None,
    version: str,
    split: str,
    protocol: str,
    digest: str,
    where: str,
) -> Truth:
    """Return the labels of those shapes that are in a split; a message calls them ``where``."""
    chosen = list(_choose(labelled, _trained_on(version), own, split, protocol))
    if not chosen:
        raise EigbenchError(f"{where} has nothing in the split {split} of protocol {protocol}")
    ids, shapes, trainings = zip(*chosen, strict=True)
    return Truth(
        version,
        split,
        protocol,
        ids,
        np.array([shape.id for shape in shapes]),
        np.array([shape.group for shape in shapes]),
        np.array([shape.family for shape in shapes]),
        np.array(trainings),
        np.array([shape.eigenvalues for shape in shapes]),
        digest,
    )
