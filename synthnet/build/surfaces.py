"""From a mesh file to a labelled sample, or to a rejection: the second half of an import."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from synthnet import recipe
from synthnet.build import filters
from synthnet.build.label import label_or_rejection
from synthnet.build.sources import UNREADABLE, Source
from synthnet.mesh import repair
from synthnet.mesh.formats import UnreadableError
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
    keep_largest : bool
        Of several components keep the largest by area, instead of refusing the file.
    split : str
        ``test``: all of them are test shapes. ``hash``: 70, 20 and 10 % by the hash of the file.
    """

    unit_area: bool = False
    keep_largest: bool = False
    split: str = "test"

    def __post_init__(self) -> None:
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
        mesh, repairs = surface(reader.read(source.path, source.sha256), settings)
        label = label_or_rejection(spec, mesh, recipe.load(LIMITS))
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
    return Sample(
        spec=replace(spec, parameters={**spec.parameters, **repairs}),
        mesh=mesh,
        eigenvalues=label.eigenvalues,
        trivial=label.trivial,
        certificate=label.certificate,
        isometries=np.eye(3)[None],
        split=shape.split,
        paper_splits=shape.paper_splits,
    )


def surface(read: Mesh, settings: Settings) -> tuple[Mesh, dict[str, float | int]]:
    """Return the surface at the precision of the store, and what was done to the triangles.

    It is centred, so that float32 loses nothing far from the origin.

    Raises
    ------
    Refused
        If it cannot be repaired, or float32 makes a triangle degenerate.
    """
    done = repair.repair(read, keep_largest=settings.keep_largest)
    facts: dict[str, float | int] = {k.replace(" ", "_"): v for k, v in done.repairs.items()}
    if not done.orientable:
        facts["not_orientable"] = 1
    mesh = repair.centred(done.mesh)
    if settings.unit_area:
        mesh, facts["scale"] = repair.unit_area(mesh)
    stored = mesh.stored()
    if flat := repair.flat_faces(stored):
        raise repair.Refused("degenerate_face", f"{flat} faces have no area in float32")
    return stored, facts
