"""Prisms over the two drums that sound alike: closed, sharp, not convex; not isospectral."""

import numpy as np

from synthnet.families import drum
from synthnet.families.atlas import Atlas
from synthnet.families.charted import charted
from synthnet.families.family import POSITIVE
from synthnet.families.polyhedra import prism


def atlas(*, form: int, size: float, lean: float, height: float) -> Atlas:
    """Prism of a height over :func:`synthnet.families.drum.atlas`."""
    at = drum.positions(form, size, lean)
    outline = np.array([at[name] for name in drum.OUTLINES[form].split()])
    patches = drum.patches(form, size, lean)
    inward = np.array([at[name] for name in drum.INWARD])
    return prism(patches, outline, height, size, range(len(outline)), inward)


FAMILY = charted(
    "extruded_drum",
    "Extruded drum",
    atlas,
    {**drum.LEAST, "height": POSITIVE},
    most=drum.MOST,
)
