"""From a mesh file to a labelled sample, or to a rejection: the second half of an import."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from synthnet import recipe
from synthnet.arrays import Floats
from synthnet.build import filters
from synthnet.build.label import label_or_rejection, labelled
from synthnet.build.sources import UNREADABLE, Source
from synthnet.mesh import caps, repair
from synthnet.mesh.formats import Triangles, UnreadableError
from synthnet.mesh.reading import ChangedError, Reader
from synthnet.recipe.plan import PlannedShape
from synthnet.store.files import one_line
from synthnet.types import Mesh, Rejection, Sample

LIMITS = "1.0"  # the recipe whose limits labels must keep
CHANGED, MEMORY = "changed", "memory"


@dataclass(frozen=True, slots=True)
class Settings:
    """How files become shapes.

    Parameters
    ----------
    unit_area : bool
        Scale every surface to area 1; its parameter ``scale`` is the factor of lengths.
    components : str
        Of several components ``keep`` all as one shape, keep the ``largest`` by area alone, or
        ``split``: make a shape of each.
    split : str
        ``test``: all of them are test shapes. ``hash``: 70, 20 and 10 % by the hash of the file.
    without : tuple of str
        Repairs that are left out, of :data:`synthnet.mesh.repair.REPAIRS`.
    cut_fins : bool
        Also cut where a face is alone at an edge of more than two faces, which changes the surface.
    """

    unit_area: bool = False
    components: str = repair.KEEP
    split: str = "test"
    without: tuple[str, ...] = ()
    cut_fins: bool = False

    def __post_init__(self) -> None:
        if self.components not in repair.COMPONENTS:
            names = ", ".join(repair.COMPONENTS)
            raise ValueError(f"components must be one of {names}, got {self.components!r}")
        for name in self.without:
            if name not in repair.REPAIRS:
                known = ", ".join(repair.REPAIRS)
                raise ValueError(f"without must be of {known}, got {name!r}")
        if self.split not in ("test", "hash"):
            raise ValueError(f"split must be test or hash, got {self.split!r}")


def import_file(
    shape: PlannedShape, source: Source, settings: Settings, reader: Reader
) -> Sample | Rejection:
    """Return the labelled surface of a file, or why there is none."""
    spec = shape.spec

    def rejected(reason: str, detail: str) -> Rejection:
        return Rejection(spec.id, spec.family, reason, f"{source.name}: {detail}")

    if source.refused is not None:
        return rejected(*source.refused)
    try:
        mesh, repairs = surface(read(source, settings, reader), settings, source.part)
        label = label_or_rejection(spec, mesh, recipe.load(LIMITS), sharp=True)
    except UnreadableError as error:
        return rejected(UNREADABLE, str(error))
    except ChangedError as error:
        return rejected(CHANGED, str(error))
    except repair.Refused as error:
        return rejected(error.reason, error.detail)
    except MemoryError:
        return rejected(MEMORY, "its surface or label needs more memory than there is")
    except ValueError as error:
        return rejected(filters.SOLVER, one_line(error))
    if isinstance(label, Rejection):
        return rejected(label.reason, label.detail)
    repairs["error_bound"] = float(f"{filters.relative_error(label):.2g}")
    repaired = replace(spec, parameters={**spec.parameters, **repairs})
    return labelled(replace(shape, spec=repaired), mesh, label, np.eye(3)[None])


def read(source: Source, settings: Settings, reader: Reader) -> Triangles:
    """Return the triangles of a file.

    Raises
    ------
    UnreadableError
        If it cannot be read, or has polygons that are not convex and these are not to be cut.
    """
    triangles = reader.triangles(source.path, source.sha256)
    if triangles.clipped and "polygons" in settings.without:
        raise UnreadableError(f"{triangles.clipped:,} polygons that are not convex")
    return triangles


def count_parts(source: Source, settings: Settings, reader: Reader) -> int:
    """Return how many shapes the components of a file are; 1 if it will be rejected."""
    try:
        triangles = read(source, settings, reader)
        mesh = Mesh(triangles.vertices, triangles.faces)
        return repair.count_components(mesh, _rules(settings, None))
    except (UnreadableError, ChangedError, repair.Refused):
        return 1


def surface(
    triangles: Triangles, settings: Settings, part: int | None = None
) -> tuple[Mesh, dict[str, float | int | str]]:
    """Return the surface at the precision of the store, and what was done to the triangles.

    It is centred, so that float32 loses nothing far from the origin.

    Raises
    ------
    Refused
        If it cannot be repaired, or float32 makes a triangle degenerate.
    """
    rules = _rules(settings, part)
    done = repair.repair(Mesh(triangles.vertices, triangles.faces), rules)
    repairs = {"clipped polygons": triangles.clipped} if triangles.clipped else {}
    mesh, scale = repair.centred(done.mesh), 1.0
    if settings.unit_area:
        mesh, scale = repair.unit_area(mesh)
    stored = mesh.stored()
    if repair.flat_faces(stored) and "caps" not in rules.without:
        stored, count = caps.without_caps(stored)
        repairs["faces that float32 makes flat"] = count
        stored = stored.stored()
    if flat := repair.flat_faces(stored):
        raise repair.Refused("degenerate_face", f"{flat} faces have no area in float32")
    repairs |= done.repairs
    facts: dict[str, float | int | str] = {k.replace(" ", "_"): v for k, v in repairs.items()}
    if not done.orientable:
        facts["not_orientable"] = 1
    if len(done.shares) > 1:
        facts |= {"components": len(done.shares), "largest_share": round(float(done.shares[0]), 6)}
        facts["shares"] = listed_shares(done.shares)
    if settings.unit_area:
        facts["scale"] = scale
    return stored, facts


def listed_shares(shares: Floats) -> str:
    """Return the components' shares of the area, to six decimals; equal ones are counted.

    However many components there are, so are few: at most 1,414 different shares add up to one.

    Examples
    --------
    >>> listed_shares(np.array([0.5, 0.125, 0.125, 0.125, 0.125]))
    '0.5 0.125*4'
    """
    values, counts = np.unique(np.round(shares, 6), return_counts=True)
    pairs = zip(values[::-1].tolist(), counts[::-1].tolist(), strict=True)
    return " ".join(f"{value:.6g}" + f"*{count}" * (count > 1) for value, count in pairs)


def _rules(settings: Settings, part: int | None) -> repair.Rules:
    kept = repair.KEEP if settings.components == repair.SPLIT else settings.components
    return repair.Rules(
        components=kept, part=part, without=settings.without, cut_fins=settings.cut_fins
    )
