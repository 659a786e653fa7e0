"""What a ``pre_transform`` of :class:`~synthnet.loaders.pyg.SynthNet` returns, kept on disk.

The items have any attributes, so these are kept by name: each tensor as one array of all items,
joined along the dimension that PyG joins it along.
"""

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.errors import DamagedError, needed_by
from synthnet.store.files import one_line

with needed_by("synthnet.pyg"):
    import torch
    from torch_geometric.data import Data

INDEX = "index.json"
ROWS = ".bin"  # the end of the name of an attribute's file
NUMBERS = "biufc"  # kinds of NumPy's types that a file of bytes may hold
PLAIN = (str, int, float)  # types of attributes that are no tensors


def write_data(directory: Path, items: Iterable[Data]) -> None:
    """Write items of any tensor, number and string attributes, one at a time.

    Raise TypeError if an item is no ``Data`` but, say, a subclass, whose way to join items would be
    lost; if an attribute is neither; or if the items' differ.
    """
    files: dict[str, Any] = {}
    kinds: dict[str, dict[str, Any]] = {}
    digests: list[str] = []
    try:
        for data in items:
            if type(data) is not Data:
                raise TypeError(
                    f"pre_transform must return Data, got {type(data).__name__}: make that by "
                    "transform, which may return any type"
                )
            attributes = data.to_dict()
            for key, value in attributes.items():
                _check(key, value)
            if not digests:
                kinds = {key: _kind(data, key, value) for key, value in attributes.items()}
                files = {
                    key: (directory / _file(number)).open("wb")
                    for number, (key, kind) in enumerate(kinds.items())
                    if "dtype" in kind
                }
            if attributes.keys() != kinds.keys():
                raise TypeError(
                    "pre_transform must return the same attributes for every item, "
                    f"got {sorted(attributes)} after {sorted(kinds)}"
                )
            state = hashlib.sha256()
            for key, value in attributes.items():
                kind = kinds[key]
                if isinstance(value, PLAIN) is ("dtype" in kind):
                    raise TypeError(f"pre_transform must return {key} as a tensor always or never")
                if "dtype" not in kind:
                    kind["values"].append(value)
                    continue
                rows = _rows(key, value, kind["dim"])
                if str(rows.dtype) != kind["dtype"] or list(rows.shape[1:]) != kind["shape"]:
                    raise TypeError(f"pre_transform changed the type or shape of {key}")
                written = rows.tobytes()
                files[key].write(written)
                state.update(written)
                kind["offsets"].append(kind["offsets"][-1] + len(rows))
            digests.append(state.hexdigest())
    finally:
        for file in files.values():
            file.close()
    index = json.dumps({"digests": digests, "attributes": kinds})
    (directory / INDEX).write_text(index, encoding="utf-8")


class TransformedItems:
    """What :func:`write_data` wrote, memory-mapped.

    ``data`` and ``slices`` are as PyG keeps items: one ``Data`` of all, and where each begins. The
    index has been checked, see :mod:`synthnet.store.unpacked`; raise DamagedError if a file cannot
    be read or does not fit it.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self.data = Data()
        self.slices: dict[str, torch.Tensor] = {}
        self._rows: list[tuple[NDArray[Any], list[int]]] = []
        try:
            index = json.loads((directory / INDEX).read_text(encoding="utf-8"))
            self._digests: list[str] = index["digests"]
            for number, (key, kind) in enumerate(index["attributes"].items()):
                self._add(number, key, kind)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DamagedError(f"{directory} is damaged ({one_line(error)})") from error
        self._checked = np.zeros(len(self._digests), dtype=np.bool_)

    def _add(self, number: int, key: str, kind: dict[str, Any]) -> None:
        if "dtype" not in kind:
            self.data[key] = kind["values"]
            self.slices[key] = torch.arange(len(self._digests) + 1)
            return
        dtype, offsets = np.dtype(kind["dtype"]), kind["offsets"]
        if dtype.kind not in NUMBERS:
            raise ValueError(f"{key} is of {dtype}")
        shape = (offsets[-1], *kind["shape"])
        rows: NDArray[Any] = np.zeros(shape, dtype)
        if rows.size:  # an empty file cannot be mapped
            rows = np.memmap(self._directory / _file(number), dtype, mode="c", shape=shape)
        self.data[key] = torch.from_numpy(rows).movedim(0, kind["dim"])
        self.slices[key] = torch.tensor(offsets)
        self._rows.append((rows, offsets))

    def check(self, item: int) -> None:
        """Raise DamagedError if an item is not as it was written; read it once for that."""
        if self._checked[item]:
            return
        state = hashlib.sha256()
        for rows, offsets in self._rows:
            state.update(rows[offsets[item] : offsets[item + 1]].tobytes())
        if state.hexdigest() != self._digests[item]:
            raise DamagedError(f"{self._directory}: item {item} is damaged")
        self._checked[item] = True


def _file(number: int) -> str:
    """Return the name of an attribute's file; the attribute's own may be any text."""
    return f"{number:03d}{ROWS}"


def _kind(data: Data, key: str, value: Any) -> dict[str, Any]:
    if isinstance(value, PLAIN):
        return {"values": []}
    dim = data.__cat_dim__(key, value) or 0
    rows = _rows(key, value, dim)
    return {
        "dtype": str(rows.dtype),
        "dim": dim,
        "shape": list(rows.shape[1:]),
        "offsets": [0],
    }


def _check(key: str, value: Any) -> None:
    """Raise TypeError if an attribute is of no type that can be kept."""
    if not isinstance(value, PLAIN) and not (isinstance(value, torch.Tensor) and value.dim()):
        raise TypeError(
            f"pre_transform may add tensors, numbers and strings; {key} is {type(value).__name__}"
        )


def _rows(key: str, value: torch.Tensor, dim: int) -> NDArray[Any]:
    """Return a tensor's values along one of its dimensions."""
    try:
        rows: NDArray[Any] = value.detach().cpu().movedim(dim, 0).contiguous().numpy()
    except (TypeError, RuntimeError) as error:  # NumPy has no such dtype or layout
        raise TypeError(
            f"pre_transform may add tensors that NumPy knows; {key} is of {value.dtype} and "
            f"layout {value.layout}"
        ) from error
    return rows
