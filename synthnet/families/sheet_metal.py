"""Parts of bent sheet: flanges with round holes, and rounded bends between them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, borders
from synthnet.families.charted import charted
from synthnet.families.family import SHORTEST
from synthnet.families.plates import Plate

HEADINGS = np.pi / 4 * np.arange(-2, 3)  # from the x axis: a profile never turns back on itself
DRILLED = 0.4  # of the flanges' cells, about
LONGEST = 3.0  # flange, over the shortest


@dataclass(frozen=True, slots=True)
class Part:
    """A plate of alternating flanges and bends, a column of cells each, and its angles in radians.

    Parameters
    ----------
    plate : Plate
        As it is before it is bent.
    headings : ndarray of shape (a + 1,), float64
        Of the profile at the columns' borders: equal at both of a flange, not of a bend.
    """

    plate: Plate
    headings: Floats

    def bend(self, columns: Int64s, points: Floats) -> Floats:
        """Return points of the bent part: lengths halfway through the sheet stay as they are."""
        lengths, turns = np.diff(self.plate.x), np.diff(self.headings)
        starts = np.concatenate([[0j], np.cumsum(_chords(lengths, turns, self.headings[:-1]))])
        along = points[:, 0] - self.plate.x[columns]
        turn = turns[columns] * along / lengths[columns]
        middle = starts[columns] + _chords(along, turn, self.headings[columns])
        up = 1j * np.exp(1j * (self.headings[columns] + turn))
        at = middle + up * (points[:, 2] - self.plate.thickness / 2)
        return np.stack([at.real, points[:, 1], at.imag], axis=1)


def _chords(lengths: Floats, turns: Floats, headings: Floats) -> NDArray[np.complex128]:
    """Return from start to end of arcs as complex numbers; sinc is sin(πx)/πx."""
    along = lengths * np.sinc(turns / (2 * np.pi))
    chords: NDArray[np.complex128] = along * np.exp(1j * (headings + turns / 2))
    return chords


def part(*, flanges: int, width: float, thickness: float, radius: float, form: int) -> Part:
    """Return a part whose shortest flange has length 1.

    ``width`` is across the profile, ``radius`` that of the bends inside, over the thickness;
    ``form`` is the seed of the flanges' lengths and angles and of their holes.
    """
    rng = np.random.Generator(np.random.PCG64(form))
    lengths = LONGEST ** rng.random(flanges)
    lengths /= lengths.min()
    steps = 1 + (rng.random(flanges) * (len(HEADINGS) - 1)).astype(np.int64)
    angles = HEADINGS[np.cumsum(steps) % len(HEADINGS)]
    rows = max(1, round(width / float(lengths.mean())))
    bends = np.abs(np.diff(angles)) * thickness * (radius + 0.5)
    columns = np.insert(lengths, np.arange(1, flanges), bends)
    x = borders(columns)
    y = np.linspace(0.0, width, rows + 1)
    drilled = rng.random((flanges, rows)) < DRILLED
    room = np.minimum(lengths[:, None], width / rows) / 2
    radii = room * (0.15 + 0.6 * rng.random((flanges, rows)))
    holes = np.zeros((2 * flanges - 1, rows))
    holes[::2] = np.where(drilled, radii, 0.0)
    return Part(Plate(x, y, holes, thickness), np.repeat(angles, 2))


def atlas(**parameters: Any) -> Atlas:
    """Return the surface of :func:`part`."""
    bent = part(**parameters)
    return bent.plate.atlas(bent.bend)


def euler(**shape: Any) -> int:
    """Return 2 − 2g for g holes."""
    return part(**shape).plate.euler_characteristic


FAMILY = charted(
    "sheet_metal",
    "Sheet metal part",
    atlas,
    {"flanges": 1, "width": SHORTEST, "thickness": SHORTEST, "radius": SHORTEST, "form": 0},
    euler_characteristic=euler,
    most={"flanges": 5, "width": 6.0, "thickness": 0.2},
)
