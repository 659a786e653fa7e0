"""What the repository pins of a version: one row a shape, to compare any build against.

A pin is small and survives a change of machine: what must be equal everywhere goes into
a digest, what may differ in its last bits is kept as numbers and compared within
:data:`TOLERANCE`.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from synthnet.arrays import Floats
from synthnet.families.limits import Limit
from synthnet.store.files import write_atomically
from synthnet.types import Sample

TOLERANCE = 1e-6  # relative: float32 vertices differ by 6e-8 where libm does
COMPUTED = ("error_bound",)  # parameters of imports that are floating-point results
# An environment variable: a folder with some of the pins, for a process that must not see the rest.
VARIABLE = "SYNTHNET_PINS"
GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True)
class Pin:
    """The pinned facts of one shape.

    Parameters
    ----------
    id : str
        The shape.
    digest : str
        Hash of id, parameters, group, splits and faces: equal on every machine.
    moments : ndarray of shape (6,), float64
        Weighted means of the coordinates and of their squares, see :func:`moments`.
    eigenvalues : ndarray of shape (k,), float64
        The label.
    """

    id: str
    digest: str
    moments: Floats
    eigenvalues: Floats


def pin(sample: Sample) -> Pin:
    """Return the pin of a sample."""
    return Pin(sample.spec.id, digest(sample), moments(sample), sample.eigenvalues)


def digest(sample: Sample) -> str:
    """Hash what must be equal on every machine: all but floating-point results."""
    spec = sample.spec
    exact = [
        spec.id,
        spec.family,
        {name: value for name, value in spec.parameters.items() if name not in COMPUTED},
        spec.group,
        sample.split,
        list(sample.paper_splits),
        len(sample.mesh.vertices),
    ]
    state = hashlib.sha256(json.dumps(exact, sort_keys=True).encode())
    state.update(np.ascontiguousarray(sample.mesh.faces, dtype="<i4").tobytes())
    return state.hexdigest()[:32]


def moments(sample: Sample) -> Floats:
    """Return weighted means of x, y, z, x², y², z², the weight 1 + frac(0.618… i) at vertex i.

    The weights tell the order of the vertices apart.
    """
    points = sample.mesh.vertices.astype(np.float64)
    weights = 1 + np.arange(len(points)) * GOLDEN % 1
    return np.asarray(np.average(np.hstack([points, points**2]), axis=0, weights=weights))


def differences(built: Pin, pinned: Pin) -> Iterator[str]:
    """Yield what differs between a pin of a build and the pinned one."""
    if built.digest != pinned.digest:
        yield "id, parameters, splits or faces differ from the pinned ones"
        return
    scale = float(np.sqrt(pinned.moments[3:].sum()))
    units = np.repeat([scale, scale**2], 3)
    apart = float(np.max(np.abs(built.moments - pinned.moments) / units))
    if not apart <= TOLERANCE:
        yield f"vertices differ by {apart:.2g} of their size, more than {TOLERANCE:g}"
    if built.eigenvalues.shape != pinned.eigenvalues.shape:
        yield f"{len(built.eigenvalues)} eigenvalues instead of {len(pinned.eigenvalues)}"
        return
    apart = float(np.max(np.abs(built.eigenvalues / pinned.eigenvalues - 1)))
    if not apart <= TOLERANCE:
        yield f"eigenvalues differ by {apart:.2g} relative, more than {TOLERANCE:g}"


def read(version: str) -> Mapping[str, Pin] | None:
    """Return the pins of a full version by id, or ``None`` if it has none.

    Those of the package are read once a process: nobody may change them.

    Examples
    --------
    >>> round(float(read("1.0")["torus-00005"].eigenvalues[0]), 4)
    1.0378
    """
    return _pins(labels_file(version)) if os.environ.get(VARIABLE) else _shipped_pins(version)


@lru_cache(maxsize=4)
def _shipped_pins(version: str) -> Mapping[str, Pin] | None:
    return _pins(labels_file(version))


def _pins(name: str) -> Mapping[str, Pin] | None:
    table = _table(name)
    if table is None:
        return None
    columns = (table[name].to_pylist() for name in ("id", "digest"))
    arrays = [np.stack(table[name].to_numpy()) for name in ("moments", "eigenvalues")]
    for array in arrays:
        array.setflags(write=False)
    pins = {row[0]: Pin(*row) for row in zip(*columns, *arrays, strict=True)}
    return MappingProxyType(pins)


def write(path: Path, pins: Iterable[Pin]) -> None:
    """Write the lock file of a version."""
    rows = list(pins)
    table = pa.table(
        {
            "id": [p.id for p in rows],
            "digest": [p.digest for p in rows],
            "moments": pa.array([p.moments for p in rows], pa.list_(pa.float64())),
            "eigenvalues": pa.array([p.eigenvalues for p in rows], pa.list_(pa.float64())),
        }
    )
    _store(path, table, ("moments", "eigenvalues"))


def read_limits(version: str) -> dict[str, Limit] | None:
    """Return the pinned spectra of the surfaces of a full version by id, or ``None``.

    Examples
    --------
    >>> read_limits("1.0")["sphere-00000"].eigenvalues[:4]  # doctest: +SKIP
    array([2., 2., 2., 6.])
    """
    table = _table(limits_file(version))
    if table is None:
        return None
    rows = zip(*(table[name].to_numpy() for name in ("id", "eigenvalues", "bar")), strict=True)
    return {row[0]: Limit(row[1], row[2].astype(np.float64)) for row in rows}


def write_limits(path: Path, limits: Mapping[str, Limit]) -> None:
    """Write the pinned spectra of the surfaces of a version, their bars as float32."""
    bars = [limit.bar.astype(np.float32) for limit in limits.values()]
    table = pa.table(
        {
            "id": list(limits),
            "eigenvalues": pa.array(
                [limit.eigenvalues for limit in limits.values()], pa.list_(pa.float64())
            ),
            "bar": pa.array(bars, pa.list_(pa.float32())),
        }
    )
    _store(path, table, ("eigenvalues", "bar"))


def labels_file(version: str) -> str:
    """Return the name of the file with the pins of a version."""
    return f"{version}.lock.parquet"


def limits_file(version: str) -> str:
    """Return the name of the file with the spectra of the surfaces of a version."""
    return f"{version}.limits.parquet"


def _table(name: str) -> pa.Table | None:
    """Return a table of pins: the package's, or that in the folder that ``VARIABLE`` names."""
    if folder := os.environ.get(VARIABLE):
        path = Path(folder, name)
        return pq.read_table(path) if path.is_file() else None
    return shipped_table("synthnet.recipe.versions", name)


def shipped_table(package: str, name: str) -> pa.Table | None:
    """Return a Parquet table that is a file of a package, or ``None`` if there is none."""
    path = resources.files(package).joinpath(name)
    if not path.is_file():
        return None
    # By path: a thread of pyarrow's that still holds a Python file when the interpreter ends
    # aborts the process (apache/arrow issue 34314).
    with resources.as_file(path) as local:
        return pq.read_table(local)


def _store(path: Path, table: pa.Table, numbers: Sequence[str]) -> None:
    """Write a table whose columns ``numbers`` are lists of floats."""

    def store(partial: Path) -> None:
        pq.write_table(
            table,
            partial,
            compression="zstd",
            compression_level=19,
            use_dictionary=False,
            column_encoding={f"{name}.list.element": "BYTE_STREAM_SPLIT" for name in numbers},
        )

    write_atomically(path, store)
