"""Atlases of plates with round holes, flat or bent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from synthnet.arrays import Floats, Int64s
from synthnet.families.atlas import Atlas, glue_charts, rectangle, rows
from synthnet.families.polyhedra import flat

OUTWARD = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])  # from a cell's four sides
ALONG = np.roll(OUTWARD, -1, axis=0)  # counter-clockwise


@dataclass(frozen=True, slots=True)
class Plate:
    """A plate of rectangular cells, some with a round hole in their middle.

    Parameters
    ----------
    x, y : ndarray of shape (a + 1,) and (b + 1,), float64
        Ascending coordinates of the lines between cells.
    holes : ndarray of shape (a, b), float64
        Radius of each cell's hole, below half of its sides; 0 where there is none.
    thickness : float
        The plate reaches from z = 0 to there.
    """

    x: Floats
    y: Floats
    holes: Floats
    thickness: float

    @property
    def euler_characteristic(self) -> int:
        """Of its surface: 2 − 2g for g holes."""
        return 2 - 2 * int(np.count_nonzero(self.holes))

    def atlas(self, bend: Callable[[Int64s, Floats], Floats] | None = None) -> Atlas:
        """Return the surface in charts: of each side of each cell above, below and the walls.

        A cell without a hole has the coordinates of space. A side of another has these: 0 to 1 from
        the hole's rim to the cell's border, −1 to 1 along it, and z.

        Parameters
        ----------
        bend : callable, optional
            From the column of cells (n,) and points of the flat plate (n, 3) to points of another
            surface, smooth on each column.
        """
        a, b = self.holes.shape
        sides = [(i, j, side) for i, j, side in np.ndindex(a, b, len(OUTWARD))]
        parts = [(side, patches) for side in sides for patches in self._patches(*side)]
        columns = np.array([column for (column, _, _), _ in parts])

        def chart(charts: Int64s, u: Floats) -> Floats:
            points = u.copy()
            for number in np.unique(charts):
                here = charts == number
                column, row, side = parts[number][0]
                points[here] = self._points(column, row, side, u[here])
            return points if bend is None else bend(columns[charts], points)

        return Atlas(*glue_charts([patches for _, patches in parts]), chart)

    def _cell(self, column: int, row: int, side: int) -> tuple[Floats, float, float]:
        """Return a cell's middle, how far from it a side is, and half that side's length."""
        low = np.array([self.x[column], self.y[row]])
        high = np.array([self.x[column + 1], self.y[row + 1]])
        away, along = (high - low)[[side % 2, 1 - side % 2]] / 2
        return (low + high) / 2, float(away), float(along)

    def _patches(self, column: int, row: int, side: int) -> list[Floats]:
        """Return the patches of a cell's side, a chart each, shape (p, 3, 3)."""
        least = float(min(np.diff(self.x).min(), np.diff(self.y).min()))
        z = np.linspace(0, self.thickness, rows(self.thickness, least, 3) + 1)
        wall = rectangle(np.array([-1.0, 1.0]), z)
        inner, outer = (np.insert(wall, 0, away, axis=2) for away in (0.0, 1.0))
        drilled = bool(self.holes[column, row])
        sheet = rectangle(np.array([0.0, 1.0]), np.array([-1.0, 1.0]))
        if not drilled:
            sheet = np.array([[[0.0, 0.0], [1.0, -1.0], [1.0, 1.0]]])
        a, b = self.holes.shape
        at_border = (side, column) in ((0, a - 1), (2, 0)) or (side, row) in ((1, b - 1), (3, 0))
        parts = [flat(sheet, self.thickness), flat(sheet, turned=True)]
        parts += [inner[:, ::-1]] * drilled + [outer] * at_border
        if drilled:
            return parts
        middle, away, along = self._cell(column, row, side)
        across = np.stack([OUTWARD[side] * away, ALONG[side] * along])
        return [np.dstack([middle + u[..., :2] @ across, u[..., 2]]) for u in parts]

    def _points(self, column: int, row: int, side: int, u: Floats) -> Floats:
        """Return the points of the flat plate at coordinates of a chart, (n, 3)."""
        radius = self.holes[column, row]
        if not radius:
            return u
        middle, away, along = self._cell(column, row, side)
        angle = u[:, 1] * np.arctan2(along, away)
        rim = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        border = np.stack([np.full_like(angle, away), u[:, 1] * along], axis=1)
        local = rim + u[:, :1] * (border - rim)
        return np.column_stack([middle + local @ np.stack([OUTWARD[side], ALONG[side]]), u[:, 2]])
