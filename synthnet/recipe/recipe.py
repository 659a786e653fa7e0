"""A recipe: everything a version of the dataset is a function of, as frozen values."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from synthnet.recipe.names import Kind


@dataclass(frozen=True, slots=True)
class LabelSettings:
    """How many eigenvalues after the trivial zero."""

    eigenvalues: int


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Thresholds of the checks in :mod:`synthnet.build.filters`.

    A check that is younger than some recipe has a threshold that is ``None`` by default: that
    recipe has no such check, and keeps its digest.
    """

    altitude: float
    trivial: float
    residual: float


@dataclass(frozen=True, slots=True)
class AugmentationSettings:
    """How many rotations and reflections; their products come on top."""

    rotations: int
    reflections: int

    @property
    def instances(self) -> int:
        """Copies of a shape, the shape itself included."""
        return (1 + self.rotations) * (1 + self.reflections)


@dataclass(frozen=True, slots=True)
class SplitSettings:
    """Shares of the three splits; they add up to one."""

    train: float
    validation: float
    test: float


@dataclass(frozen=True, slots=True)
class Subset:
    """A share of each family of another version, at least ``least`` shapes."""

    of: str
    share: float
    least: int

    def size(self, count: int) -> int:
        """Return how many of ``count`` surfaces the subset takes."""
        return min(count, max(self.least, round(self.share * count)))


@dataclass(frozen=True, slots=True)
class Size:
    """One of the meshes of a surface: its name, and a draw of its number of vertices."""

    name: str
    vertices: Any


@dataclass(frozen=True, slots=True)
class Fold:
    """A training of a protocol that asks for generalisation, by what it must not see.

    Parameters
    ----------
    name : str
        ``PROTOCOL``, or ``PROTOCOL/FAMILY`` where each family is held out in turn.
    families, sizes : tuple of str
        A mesh is held out if its family is one of these and its size is; empty: any.
    """

    name: str
    families: tuple[str, ...] = ()
    sizes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class FamilyRecipe:
    """How many shapes of a family, and each parameter's constant or distribution.

    Where surfaces come in several sizes, each of these is a shape.
    """

    count: int
    parameters: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Sealed:
    """What a sealed recipe was drawn from, but for the salt, see :mod:`synthnet.verify.seal`.

    Parameters
    ----------
    of, digest : str
        The version, and the digest of its recipe.
    share : float
        Surfaces of each family, as a share of the version's.
    commitment : str
        SHA-256 of the salt and all of the above.
    beacon : str or None
        What went into the seed beside these.
    """

    of: str
    digest: str
    share: float
    commitment: str
    beacon: str | None


@dataclass(frozen=True, slots=True)
class Recipe:
    """Everything a version of the dataset is a function of.

    Parameters
    ----------
    version : str
        Name of the version.
    seed : int
        Root of all randomness.
    shard_size : int
        Most shapes in one Parquet file.
    label, filters, augmentation, splits
        Settings of the steps.
    families : mapping of str to FamilyRecipe
        In the order of the tables.
    sizes : tuple of Size or None
        The meshes that each surface comes in; ``None`` where the families' parameters say all.
    subset : Subset or None
        Which part of another version this is; ``None`` for a full version.
    protocols : mapping of str to tuple of Fold, or None
        The trainings that each protocol that asks for generalisation is made of; none where
        nothing is held out and the test is an imported dataset.
    scale : int or None
        How many times the shapes of the version it was scaled from; ``None`` for a version
        as it ships. See :func:`scaled`.
    sealed : Sealed or None
        What a sealed set was drawn from; its seed is a secret.
    """

    version: str
    seed: int
    shard_size: int
    label: LabelSettings
    filters: FilterSettings
    augmentation: AugmentationSettings
    splits: SplitSettings
    families: Mapping[str, FamilyRecipe]
    sizes: tuple[Size, ...] | None = None
    protocols: Mapping[str, tuple[Fold, ...]] | None = None
    subset: Subset | None = None
    scale: int | None = None
    sealed: Sealed | None = None

    @property
    def kind(self) -> Kind:
        """The kind of dataset that it makes."""
        if self.sealed is not None:
            return Kind.SEALED
        return Kind.VERSION if self.scale is None else Kind.SCALED

    @property
    def base(self) -> str:
        """The full version whose shapes these are; a scaled version's are its own."""
        if self.subset is None or self.scale is not None:
            return self.version
        return self.subset.of

    @property
    def count(self) -> int:
        """Number of shapes drawn."""
        return sum(self.drawn(name) for name in self.families)

    def drawn(self, family: str) -> int:
        """Return the number of shapes of one family."""
        surfaces = self.families[family].count // self.copies
        size = surfaces if self.subset is None else self.subset.size(surfaces)
        return size * self.copies * (self.scale or 1)

    @property
    def copies(self) -> int:
        """In how many meshes each surface comes."""
        return 1 if self.sizes is None else len(self.sizes)

    def to_dict(self) -> dict[str, Any]:
        """Return plain, JSON-ready data, without the settings that are ``None`` and 1.0 lacks."""
        values = asdict(self)
        filters = values["filters"]
        values["filters"] = {name: value for name, value in filters.items() if value is not None}
        for name in ("scale", "sealed", "sizes", "protocols"):  # they are younger than 1.0's digest
            if values[name] is None:
                del values[name]
        return values

    @property
    def digest(self) -> str:
        """SHA-256 of the resolved recipe as canonical JSON."""
        text = json.dumps(self.to_dict(), sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode()).hexdigest()
