"""What a ``pre_transform`` of :class:`~synthnet.loaders.pyg.SynthNet` returns, kept on disk.

The items have any attributes, so these are kept by name: each tensor as one array of all items,
joined along the dimension that PyG joins it along.
"""

from __future__ import annotations

import functools
import hashlib
import inspect
import json
import re
from collections.abc import Iterable
from pathlib import Path
from types import FunctionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.errors import needed_by

with needed_by("synthnet.pyg"):
    import torch
    from torch_geometric.data import Data

INDEX = "index.json"


def write_data(directory: Path, items: Iterable[Data]) -> None:
    """Write items of any tensor, number and string attributes, one at a time.

    Raises
    ------
    TypeError
        If an attribute is neither, or the items' attributes differ.
    """
    files: dict[str, Any] = {}
    kinds: dict[str, dict[str, Any]] = {}
    count = 0
    try:
        for data in items:
            attributes = data.to_dict()
            if not count:
                kinds = {key: _kind(data, key, value) for key, value in attributes.items()}
                files = {
                    key: (directory / f"{key}.bin").open("wb")
                    for key, kind in kinds.items()
                    if "dtype" in kind
                }
            if attributes.keys() != kinds.keys():
                raise TypeError(
                    "pre_transform must return the same attributes for every item, "
                    f"got {sorted(attributes)} after {sorted(kinds)}"
                )
            for key, value in attributes.items():
                kind = kinds[key]
                if "dtype" not in kind:
                    kind["values"].append(value)
                    continue
                rows = value.movedim(kind["dim"], 0).contiguous().numpy()
                if str(rows.dtype) != kind["dtype"] or list(rows.shape[1:]) != kind["shape"]:
                    raise TypeError(f"pre_transform changed the type or shape of {key}")
                files[key].write(rows.tobytes())
                kind["offsets"].append(kind["offsets"][-1] + len(rows))
            count += 1
    finally:
        for file in files.values():
            file.close()
    (directory / INDEX).write_text(json.dumps({"count": count, "attributes": kinds}))


def read_data(directory: Path) -> tuple[Data, dict[str, torch.Tensor]]:
    """Map what :func:`write_data` wrote as PyG's joined data and slices."""
    index = json.loads((directory / INDEX).read_text())
    data, slices = Data(), {}
    for key, kind in index["attributes"].items():
        if "dtype" not in kind:
            data[key] = kind["values"]
            slices[key] = torch.arange(index["count"] + 1)
            continue
        shape = (kind["offsets"][-1], *kind["shape"])
        path = directory / f"{key}.bin"
        rows: NDArray[Any] = np.zeros(shape, dtype=kind["dtype"])
        if rows.size:  # an empty file cannot be mapped
            rows = np.memmap(path, dtype=kind["dtype"], mode="c", shape=shape)
        data[key] = torch.from_numpy(rows).movedim(0, kind["dim"])
        slices[key] = torch.tensor(kind["offsets"])
    return data, slices


def _kind(data: Data, key: str, value: Any) -> dict[str, Any]:
    if isinstance(value, str | int | float):
        return {"values": []}
    if not isinstance(value, torch.Tensor) or not value.dim():
        raise TypeError(
            f"pre_transform may add tensors, numbers and strings; {key} is {type(value).__name__}"
        )
    dim = data.__cat_dim__(key, value) or 0
    rows = value.movedim(dim, 0)
    return {
        "dtype": str(rows.numpy().dtype),
        "dim": dim,
        "shape": list(rows.shape[1:]),
        "offsets": [0],
    }


def fingerprint(value: Any, seen: frozenset[int] = frozenset()) -> str:
    """Describe a callable by its code and its state, so that a changed one is another."""
    if isinstance(value, torch.Tensor | np.ndarray):
        array = np.ascontiguousarray(value)
        return f"{array.dtype}{array.shape}{hashlib.sha256(array.tobytes()).hexdigest()}"
    if id(value) in seen:
        return "itself"
    inside = seen | {id(value)}
    if isinstance(value, list | tuple | set | frozenset):
        return json.dumps([type(value).__name__, [fingerprint(part, inside) for part in value]])
    if isinstance(value, dict):
        return json.dumps([[str(k), fingerprint(v, inside)] for k, v in value.items()])
    if isinstance(value, functools.partial):
        parts: list[object] = [value.func, value.args, value.keywords]
        return json.dumps(["partial", *(fingerprint(part, inside) for part in parts)])
    if inspect.ismethod(value):
        return json.dumps([value.__name__, fingerprint(value.__self__, inside)])
    if not callable(value):
        return re.sub(r" at 0x[0-9a-f]+", "", repr(value))  # an address says nothing
    if isinstance(value, FunctionType):
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        state: Any = [value.__defaults__, value.__kwdefaults__, cells]
    else:
        slots = [name for kind in type(value).__mro__ for name in getattr(kind, "__slots__", ())]
        state = {n: getattr(value, n) for n in slots if hasattr(value, n)}
        state |= getattr(value, "__dict__", {})
    source = value if inspect.isroutine(value) else type(value)
    try:
        code = inspect.getsource(source)
    except (OSError, TypeError):
        code = repr(source)
    return json.dumps([code, fingerprint(state, inside)])
