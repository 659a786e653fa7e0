"""synthNet as a PyTorch Geometric dataset, memory-mapped from the Parquet shards."""

from __future__ import annotations

import copy
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from synthnet import recipe, store
from synthnet.arrays import Booleans
from synthnet.build.limits import add_missing
from synthnet.build.versions import ensure_built
from synthnet.errors import DamagedError, RecipeError, StoreError, needed_by, suggestion
from synthnet.loaders import mapped
from synthnet.loaders.fingerprint import fingerprint
from synthnet.loaders.mapped import MappedShapes
from synthnet.loaders.transformed import ROWS, TransformedItems, write_data
from synthnet.mesh import isometries as isometry
from synthnet.recipe import splits
from synthnet.store import StoredDataset, limits, unpacked
from synthnet.types import PROTOCOLS, SPLITS, Mesh

with needed_by("synthnet.pyg"):
    import torch
    from torch_geometric.data import Data, InMemoryDataset
    from torch_geometric.data.separate import separate

Augment = bool | Literal["random"]
Transform = Callable[[Data], Data]
TARGETS = ("mesh", "surface")
DEFAULT = "1.0"  # the version
LIKE_A_VERSION = re.compile(r"\d+\.\d+(-\w+)?")
ALL_TEST = {  # why kinds of dataset may have no shape in a split
    recipe.Kind.IMPORTED: "an import is all split='test', but for `synthnet import --split hash`",
    recipe.Kind.SEALED: "a sealed set is all split='test'",
}


class SynthNet(InMemoryDataset):  # type: ignore[misc]
    """The dataset as ``Data(pos, face, y, family, shape_id)``, one item an instance.

    The first use of a version builds it if it is missing, and unpacks it into flat
    arrays that are memory-mapped from then on, so that all splits, protocols and worker
    processes share the same pages.

    Parameters
    ----------
    root : path, optional
        Directory that holds the versions; ``$SYNTHNET_HOME`` or the user's cache
        directory by default.
    version : str
        For example ``1.0``, ``1.0-small``, ``1.0-mini``.
    split : str
        ``train``, ``validation`` or ``test``.
    protocol : str
        ``grouped``: by shape, no copy of a shape crosses. ``paper``: over instances. One of
        the version's own, which hold families or sizes out of training and test on these: of
        2.0 ``resolution``, ``genus``, ``boundary``, ``family/pretzel`` (and every other family).
    augment : bool or "random"
        ``True``: the stored isometric instances of each shape, 1.0's nine. ``False``: the shape
        itself. ``"random"``: the shape under a fresh isometry, drawn uniformly from O(3)
        by torch's generator, at every access.
    target : str
        ``mesh``: ``y`` is the label, the spectrum of the mesh. ``surface``: ``y`` is the limit, the
        spectrum of the smooth or polyhedral surface, the same for all its triangulations.
    transform : callable, optional
        Applied at every access, for example ``FaceToEdge``.
    pre_transform : callable, optional
        Applied once to each instance, after its isometry, so it cannot be combined with
        ``augment="random"``. The results are kept on disk, one copy an instance, in a
        directory named by the callable's code and state; what it reads from elsewhere,
        such as a global variable, is not noticed, and of a library only the version is.
    pre_filter : callable, optional
        Asked about each shape as stored, at every opening; what it refuses is left out
        with all its instances.

    Raises
    ------
    ValueError
        If an option is unknown, ``pre_transform`` is used with ``augment="random"``, or the
        directory has the name of a version, or nearly.
    RecipeError
        If the version is unknown, or has no such protocol.
    BuildError
        If the version is not there and cannot be built.
    StoreError
        If the split has no shape, or the target is ``surface`` and the dataset has no limits.
    TypeError
        If ``pre_transform`` returns what cannot be kept, or holds something whose state cannot be
        seen, such as an open file.

    Notes
    -----
    An item has ``pos`` (n, 3) float32, ``face`` (3, m) int64, ``y`` (1, 10) float32 in
    1/length², ``family`` and ``shape_id`` (str) and ``instance`` (int). Edges are not
    stored: make them by a transform, or on the batch. ``dataset.y``, ``.family`` and
    ``.shape_id`` are this split's; the internal ``.data`` holds all shapes of the version,
    since all splits share it. ``copy()`` brings a split into memory, after which
    ``to(device)`` works.
    """

    _shapes: MappedShapes | None = None
    _items: TransformedItems | None = None

    def __init__(
        self,
        root: str | os.PathLike[str] | None = None,
        version: str = DEFAULT,
        split: str = "train",
        protocol: str = "grouped",
        augment: Augment = True,
        transform: Transform | None = None,
        pre_transform: Transform | None = None,
        pre_filter: Callable[[Data], bool] | None = None,
        target: str = "mesh",
    ) -> None:
        for name, value, known in (
            ("split", split, SPLITS),
            ("target", target, TARGETS),
            ("augment", augment, (True, False, "random")),
        ):
            if type(value) not in (bool, str) or value not in known:
                choices = ", ".join(map(str, known))
                raise ValueError(f"{name} must be one of {choices}, got {value!r}")
        if not isinstance(protocol, str):
            raise ValueError(f"protocol must be a name such as 'grouped', got {protocol!r}")  # noqa: TRY004 - as for the others
        if root is not None:
            _check_no_version(str(root), alone=version == DEFAULT)
        if pre_transform is not None and augment == "random":
            raise ValueError(
                "pre_transform is applied once and augment='random' afresh at every access: "
                "use transform instead"
            )
        if protocol not in PROTOCOLS:  # it is the version's own
            if store.open_unversioned(version, root) is not None:
                raise RecipeError(f"{version} opens under grouped or paper only, got {protocol}")
            splits.folds(recipe.load(version), protocol, split)
        self.version, self.split, self.protocol, self.augment = version, split, protocol, augment
        self.target = target
        self._stored = ensure_built(version, root)
        if not any(shard.rows for shard in self._stored.manifest.shards):
            raise StoreError(f"{version} has no shape: `synthnet info {version}` says why")
        self._limits = surface_spectra(self._stored) if target == "surface" else None
        super().__init__(str(store.home(root)), transform, pre_transform, pre_filter)
        self._open()
        if self._shapes is not None:
            try:
                self._indices = self._select(self._shapes, pre_filter)
            except DamagedError:
                self._open(wholly=True)
                self._indices = self._select(self._shapes, pre_filter)
        if pre_filter is None and not len(self):
            hint = ALL_TEST.get(self._stored.kind, "choose another")
            raise StoreError(f"{version} has no shape in the split {split}: {hint}")

    @property
    def _base_directory(self) -> Path:
        return mapped.directory(self._stored)

    def _map(self, *, wholly: bool = False) -> MappedShapes:
        """Map the arrays, which hold the labels; limits are never written among them."""
        shapes = mapped.open_shapes(self._stored, wholly=wholly)
        if self._limits is not None:
            shapes.y = self._limits
        return shapes

    def _open(self, *, wholly: bool = False) -> None:
        """Map the files of this dataset; those that are not there, or damaged, are made first."""
        if self.pre_transform is None:
            self._shapes = self._map(wholly=wholly)
            self._data, self.slices = as_data(self._shapes)
            return
        where = Path(self.processed_dir)
        self._items = unpacked.open_or_unpack(
            where,
            self._stored,
            lambda: TransformedItems(where),
            lambda to: write_data(to, self._transformed()),
            by_item=(ROWS,),
            reader=unpacked.PYG,
            wholly=wholly,
        )
        self._data, self.slices = self._items.data, self._items.slices

    def _transformed(self) -> Iterator[Data]:
        shapes = self._map(wholly=True)
        for i in self._select(shapes, self.pre_filter):
            yield self.pre_transform(item(shapes, i))

    @cached_property  # a callable may change as it is called
    def processed_dir(self) -> str:
        """Directory of this dataset's files; its name holds all that they depend on."""
        if self.pre_transform is None:
            return str(self._base_directory)
        options = [self.split, self.protocol, str(self.augment)]
        if self._limits is not None:
            options.append(hashlib.sha256(self._limits.tobytes()).hexdigest())
        code = [fingerprint(self.pre_transform), fingerprint(self.pre_filter)]
        key = hashlib.sha256(json.dumps(options + code).encode()).hexdigest()[:12]
        return f"{self._base_directory}-{key}"

    @property
    def processed_file_names(self) -> list[str]:
        """A directory is moved into place when complete, so one file stands for all."""
        return [unpacked.CONTENTS]

    def _select(
        self, shapes: MappedShapes, pre_filter: Callable[[Data], bool] | None
    ) -> Sequence[int]:
        """Return the numbers of this split's instances; instance i of shape s is s·c + i."""
        count = shapes.instances
        if self.protocol == "grouped":
            mine = np.repeat(shapes.splits[:, None] == self.split, count, axis=1)
        elif self.protocol == "paper":
            mine = shapes.paper_splits == self.split
        else:
            mine = np.repeat(self._held_out_or_not(shapes)[:, None], count, axis=1)
        if self.augment is not True:
            mine = mine & (np.arange(count) == 0)
        if pre_filter is not None:
            for shape in np.flatnonzero(mine.any(axis=1)):
                mine[shape] &= bool(pre_filter(item(shapes, shape * count)))
        numbers: list[int] = np.flatnonzero(mine).tolist()
        return numbers

    def _held_out_or_not(self, shapes: MappedShapes) -> Booleans:
        """Return which shapes the split has under a protocol of the version's own."""
        drawn_by = recipe.load(self.version)
        parts = splits.folds(drawn_by, self.protocol, self.split)
        taken = [
            any(splits.takes(fold, drawn_by, self.split, id) for fold in parts) for id in shapes.ids
        ]
        return np.asarray((shapes.splits == self.split) & np.array(taken, dtype=np.bool_))

    def len(self) -> int:
        """Return the number of instances of all splits; ``len(dataset)`` is this split's."""
        if self._shapes is not None:
            return int(self._shapes.count * self._shapes.instances)
        return int(super().len())

    def get(self, idx: int) -> Data:
        """Return an instance by its number, as a copy that owns its memory."""
        if not 0 <= idx < self.len():
            raise IndexError(f"no instance {idx}: they are numbered from 0 to {self.len() - 1}")
        try:
            return self._read(idx)
        except DamagedError:
            self._open(wholly=True)
            return self._read(idx)

    def _read(self, idx: int) -> Data:
        if self._shapes is not None:
            fresh = random_isometry() if self.augment == "random" else None
            return item(self._shapes, idx, fresh)
        if self._items is not None:
            self._items.check(idx)
            # PyG's own get returns the lists and arrays of all items where there is one.
            part = separate(Data, self._data, idx, self.slices, decrement=False)
        else:
            part = super().get(idx)
        data = copy.deepcopy(part)
        self._data_list = None  # the arrays are the cache
        if self.augment == "random":  # it may be a copy of such a dataset
            moved = isometry.apply(Mesh(data.pos.numpy(), data.face.T.numpy()), random_isometry())
            data.pos = torch.from_numpy(moved.vertices)
            data.face = torch.from_numpy(np.ascontiguousarray(moved.faces.T))
        return data

    def __repr__(self) -> str:
        kind = f"version={self.version!r}, split={self.split!r}, protocol={self.protocol!r}"
        target = "" if self.target == "mesh" else f", target={self.target!r}"
        return f"SynthNet({len(self)}, {kind}, augment={self.augment!r}{target})"

    def copy(self, idx: Any = None) -> SynthNet:
        """Copy the dataset, or a subset of it, into memory."""
        copied: SynthNet = super().copy(idx)
        copied._shapes = copied._items = None
        return copied

    def __getattr__(self, key: str) -> Any:
        """Return an attribute of all items: ``y``, ``family`` and ``shape_id`` at no cost."""
        shapes = self.__dict__.get("_shapes")
        if shapes is not None and key in ("y", "family", "shape_id"):
            numbers = np.array(self.indices(), dtype=np.int64) // shapes.instances
            if key == "y":
                return torch.from_numpy(shapes.y[numbers])
            values = shapes.families if key == "family" else shapes.ids
            return [values[number] for number in numbers]
        return super().__getattr__(key)

    def __copy__(self) -> SynthNet:
        """Share the mapped arrays: slicing must not open files."""
        shared = self.__class__.__new__(self.__class__)
        shared.__dict__.update(self.__dict__)
        return shared

    def __getstate__(self) -> dict[str, Any]:
        """Leave mapped arrays out: another process maps them itself."""
        state = dict(self.__dict__)
        if self._shapes is not None or self._items is not None:
            state.update(_data=None, slices=None, _shapes=None, _items=None, mapped=True)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Map the arrays again."""
        was_mapped = state.pop("mapped", False)
        self.__dict__.update(state)
        if was_mapped:
            self._open()


def _check_no_version(root: str, *, alone: bool) -> None:
    """Check that a directory has no version's name.

    Where it stands ``alone`` and is not there yet, nor may it look like one.
    """
    known = recipe.available()
    looks = alone and LIKE_A_VERSION.fullmatch(root) and not Path(root).exists()
    if root in known or looks:
        raise ValueError(
            f"the first argument is the directory, not the version: SynthNet(version={root!r})"
            + ("" if root in known else suggestion(root, known))
            + f"; a directory of that name is './{root}'"
        )


def surface_spectra(dataset: StoredDataset) -> NDArray[np.float32]:
    """Return the limits of a dataset's shapes, shape (count, k), in 1/length².

    Raise StoreError if it has none, or they are damaged.
    """
    add_missing(dataset)
    if not limits.any_there(dataset):
        version = dataset.manifest.version
        remedy = f"run `synthnet build {version} --limits`"
        if dataset.kind is recipe.Kind.IMPORTED:
            remedy = "imported meshes have no known surface, take target='mesh'"
        elif recipe.parse_name(version).version not in recipe.available():
            remedy = "make them by synthnet.build.limits.build_limits of your recipe"
        raise StoreError(f"{dataset.directory} has no limits of its surfaces: {remedy}")
    return np.array([row.eigenvalues for row in limits.read(dataset)], np.float32)


def item(shapes: MappedShapes, number: int, fresh: NDArray[np.float32] | None = None) -> Data:
    """Return instance ``number % c`` of shape ``number // c``; moved by ``fresh`` if given."""
    shape, instance = divmod(number, shapes.instances)
    mesh = isometry.apply(
        shapes.mesh(shape), shapes.isometries[shape, instance] if fresh is None else fresh
    )
    return Data(
        pos=torch.from_numpy(mesh.vertices),
        face=torch.from_numpy(mesh.faces.T.astype(np.int64, order="C")),
        y=torch.from_numpy(shapes.y[shape : shape + 1].copy()),
        family=shapes.families[shape],
        shape_id=shapes.ids[shape],
        instance=instance,
    )


def as_data(shapes: MappedShapes) -> tuple[Data, dict[str, torch.Tensor]]:
    """Return the shapes as PyG keeps them: one ``Data`` and where each shape begins."""
    data = Data(
        pos=torch.from_numpy(shapes.vertices),
        face=torch.from_numpy(shapes.faces).t(),
        y=torch.from_numpy(shapes.y),
        family=shapes.families,
        shape_id=shapes.ids,
    )
    one_each = torch.arange(shapes.count + 1)
    slices = dict.fromkeys(("y", "family", "shape_id"), one_each)
    slices["pos"] = torch.from_numpy(shapes.vertex_offsets)
    slices["face"] = torch.from_numpy(shapes.face_offsets)
    return data, slices


def random_isometry() -> NDArray[np.float32]:
    """Draw a matrix uniformly from O(3) by torch's global generator, shape (3, 3)."""
    q, r = np.linalg.qr(torch.randn(3, 3, dtype=torch.float64).numpy())
    return np.asarray(q * np.sign(np.diag(r)), dtype=np.float32)
