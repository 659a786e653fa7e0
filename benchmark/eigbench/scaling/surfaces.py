r"""The surfaces of the scaling track: the same six at four sizes, with pinned labels.

Each is a surface of 2.0, meshed by its family's own triangulation with about the nominal number of
vertices. Label and surface are two things: the label :math:`\lambda_h` is the spectrum of the mesh,
:math:`\lambda` that of the surface, and

.. math::
    \frac{1}{k} \sum_i \frac{|\lambda_{h,i} - \lambda_i|}{\lambda_i} = O(h^2)

is the mesh's discretisation error.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from eigbench.errors import EigbenchError
from synthnet import spectrum
from synthnet.families import FAMILIES
from synthnet.families.limits import extrapolate
from synthnet.store import pins
from synthnet.store.files import write_atomically
from synthnet.types import Certificate, Mesh, Parameters, Sample, ShapeSpec

Array = NDArray[np.float64]

K = 10
# Nominal vertices: a mesh has the nearest count that its triangulation allows.
SIZES = (1_000, 10_000, 100_000, 1_000_000)
# Family, triangulation and parameters; its number is its seed. The three triangulations take turns,
# so that neither uniform nor graded meshes decide alone.
CHOSEN: Sequence[tuple[str, str, Parameters]] = (
    ("ellipsoid", "uniform", {"a": 1.0, "b": 0.8, "c": 0.55}),
    ("twisted_torus", "irregular", {"tube_radius": 0.35, "flatness": 0.6, "half_turns": 3}),
    ("pretzel", "uniform",
     {"genus": 3, "hole": 0.5, "thickness": 0.4, "stretch": 0.8, "bend": 0.5}),
    ("blob", "irregular", {"amplitude": 1.0, "degree": 6, "form": 3}),
    ("extruded_star", "uniform", {"corners": 5, "depth": 0.5, "height": 0.8, "form": 0}),
    ("open_cylinder", "adaptive", {"height": 2.0}),
)  # fmt: skip
# By family, so that the name says which surface is meant.
SURFACES: Mapping[str, Parameters] = {
    family: {**parameters, "triangulation": triangulation, "seed": seed}
    for seed, (family, triangulation, parameters) in enumerate(CHOSEN)
}
# Family.at_level gives 64,000, 256,000 and 1,000,000 vertices at these, graded towards singular
# corners. The limit follows from the last two; the limit of the two before bounds its error, h⁴.
LEVELS = (3, 4, 5)
TIMED_BESIDE = 10_000  # vertices up to which every run times LaPy on the same meshes
PINS = "surfaces.parquet"


@dataclass(frozen=True, slots=True)
class Pinned:
    """What the repository pins of a mesh."""

    surface: str  #: a key of :data:`SURFACES`
    size: int  #: one of :data:`SIZES`
    vertices: int  #: how many the mesh has
    #: Digest of faces and parameters, moments of the vertices, and the label (k,), 1/length².
    pin: pins.Pin
    certificate: Certificate  #: that the label misses no eigenvalue
    limit: Array  #: spectrum of the surface (k,), in 1/length²
    limit_error: Array  #: a bound of its error (k,), in 1/length², zero in closed form

    @property
    def label(self) -> Array:
        """The first k non-zero eigenvalues of the mesh, in 1/length²."""
        return self.pin.eigenvalues

    @property
    def discretisation_error(self) -> float:
        """Mean relative distance of the label from the spectrum of the surface."""
        return relative_error(self.label, self.limit)


def relative_error(values: Array, expected: Array) -> float:
    """Return the mean of :math:`|p - g| / g`, p the values and g the expected ones.

    Examples
    --------
    >>> round(relative_error(np.array([1.1, 3.8]), np.array([1.0, 4.0])), 12)
    0.075
    """
    return float(np.mean(np.abs(values - expected) / expected))


def spec(surface: str, size: int) -> ShapeSpec:
    """Return what a mesh is a function of.

    Raises
    ------
    EigbenchError
        If there is no such surface or size.
    """
    if surface not in SURFACES or size not in SIZES:
        raise EigbenchError(
            f"the scaling track has no {surface} at {size:,} vertices: its surfaces are "
            f"{', '.join(SURFACES)}, its sizes {', '.join(map(str, SIZES))}"
        )
    parameters = {**SURFACES[surface], "vertices": size}
    group = FAMILIES[surface].group(parameters)
    return ShapeSpec(f"{surface}-{size}", surface, SIZES.index(size), parameters, group)


def mesh(surface: str, size: int) -> Mesh:
    """Make a mesh of the set: float64 vertices (n, 3), int64 faces (m, 3)."""
    return FAMILIES[surface].generate(spec(surface, size).parameters)


def limit(surface: str) -> tuple[Array, Array]:
    """Return the spectrum of a surface, and a bound of its error: both (k,), in 1/length².

    In closed form where it is known. Else extrapolated from three meshes, each of half the step
    of the one before; this takes a minute a surface.
    """
    family, parameters = FAMILIES[surface], spec(surface, SIZES[0]).parameters
    known = family.limit_eigenvalues(parameters, K)
    if known is not None:
        return known, np.zeros(K)
    spectra = [
        spectrum.compute(family.at_level(parameters, level), K).eigenvalues for level in LEVELS
    ]
    before, last = (extrapolate(*pair) for pair in pairwise(spectra))
    return last, np.abs(last - before)


def make(surface: str, size: int, known: tuple[Array, Array] | None = None) -> Pinned:
    """Make a mesh, its certified label and, unless ``known``, the limit of its surface.

    Raises
    ------
    SpectrumError
        If the label cannot be computed and certified.
    """
    made = mesh(surface, size)
    computed = spectrum.compute(made, K)
    return Pinned(
        surface,
        size,
        len(made.vertices),
        pins.pin(_sample(surface, size, made, computed.eigenvalues, computed.certificate)),
        computed.certificate,
        *(known or limit(surface)),
    )


def _sample(surface: str, size: int, made: Mesh, label: Array, certificate: Certificate) -> Sample:
    shape = spec(surface, size)
    return Sample(shape, made, label, 0.0, certificate, np.eye(3)[None], "test", ("test",))


def check(expected: Pinned, made: Mesh) -> None:
    """Check a mesh against its pin, not its label.

    Raises
    ------
    EigbenchError
        If it is another.
    """
    sample = _sample(expected.surface, expected.size, made, expected.label, expected.certificate)
    for difference in pins.differences(pins.pin(sample), expected.pin):
        raise EigbenchError(f"{expected.pin.id} is not the mesh that is pinned: {difference}")


def differences(expected: Pinned) -> Iterator[str]:
    """Make a mesh and its label anew, and yield what differs from the pin."""
    made = make(expected.surface, expected.size, (expected.limit, expected.limit_error))
    yield from pins.differences(made.pin, expected.pin)
    if made.vertices != expected.vertices:
        yield f"{made.vertices:,} vertices instead of {expected.vertices:,}"
    if made.certificate.count != expected.certificate.count:
        yield f"{made.certificate.count} eigenvalues counted, not {expected.certificate.count}"


def pinned(surface: str, size: int) -> Pinned:
    """Return the pin of a mesh.

    Raises
    ------
    EigbenchError
        If there is no such mesh, or it is not pinned yet.
    """
    entry = read().get((surface, size)) if surface in SURFACES else None
    if entry is None:
        spec(surface, size)
        raise EigbenchError(
            f"the label of {surface} at {size:,} vertices is not pinned: "
            f"python -m evidence pin scaling {size}"
        )
    return entry


@lru_cache(maxsize=1)
def read() -> Mapping[tuple[str, int], Pinned]:
    """Return the pins that the repository has, by surface and size."""
    table = pins.shipped_table(__package__, PINS)
    rows = [] if table is None else table.to_pylist()
    entries = (_from_row(row) for row in rows)
    return {(entry.surface, entry.size): entry for entry in entries}


def write(path: Path, entries: Iterable[Pinned]) -> None:
    """Write pins to a file, in the order of sizes and surfaces, the same to the byte."""
    order = {surface: rank for rank, surface in enumerate(SURFACES)}
    rows = sorted(entries, key=lambda entry: (entry.size, order[entry.surface]))
    table = pa.Table.from_pylist([_to_row(entry) for entry in rows], schema=_SCHEMA)
    store = partial(pq.write_table, table, compression="zstd", use_dictionary=False)
    write_atomically(path, store)


_NUMBERS = pa.list_(pa.float64())
_SCHEMA = pa.schema(
    [
        ("surface", pa.string()),
        ("size", pa.int64()),
        ("vertices", pa.int64()),
        ("digest", pa.string()),
        ("moments", _NUMBERS),
        ("eigenvalues", _NUMBERS),
        ("count", pa.int64()),
        ("shift", pa.float64()),
        ("residual", pa.float64()),
        ("limit", _NUMBERS),
        ("limit_error", _NUMBERS),
    ]
)


def _to_row(entry: Pinned) -> dict[str, object]:
    """Return the values of a pin and of its parts, of which the schema takes its columns."""
    row: dict[str, object] = {}
    for part in (entry, entry.pin, entry.certificate):
        row |= {field.name: getattr(part, field.name) for field in fields(part)}
    return {name: row[name] for name in _SCHEMA.names}


def _from_row(row: Mapping[str, Any]) -> Pinned:
    arrays = {name: np.array(value) for name, value in row.items() if isinstance(value, list)}
    surface, size, vertices = row["surface"], row["size"], row["vertices"]
    certificate = Certificate(row["count"], row["shift"], row["residual"])
    moments, label = arrays["moments"], arrays["eigenvalues"]
    pin = pins.Pin(f"{surface}-{size}", row["digest"], moments, label)
    limits = arrays["limit"], arrays["limit_error"]
    return Pinned(surface, size, vertices, pin, certificate, *limits)
