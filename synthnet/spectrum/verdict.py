"""A judgement of anybody's eigenvalues: which are right, which are off, which are missing.

As many eigenvalues must lie around each answer, within its tolerance, as were answered there, and
none between. They are counted below shifts by the law of inertia. One count above the last answer
says how many there are; eigenvectors, given or found here, say where: their residuals bound an
interval for each, and where there are as many intervals as the count says, every other count
follows without a factorisation. Where residuals are too large for a shift, it is counted there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from synthnet.errors import SpectrumError
from synthnet.spectrum import fem
from synthnet.spectrum.certificate import SAFETY, inertia
from synthnet.spectrum.components import components, unheld
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.inputs import as_mesh, repaired
from synthnet.spectrum.operators import PLAIN, Discrete, Operator, discretise
from synthnet.spectrum.ordering import find_ordering
from synthnet.spectrum.solve import of_matrices
from synthnet.types import Mesh

ZERO = 1e-6  # of Weyl's first eigenvalue: below it an answer is one of the zeros
NEARER = 1e-2  # relative: so well the distance of an answer from its eigenvalue is told
ASIDE = 1e-9  # relative: a shift whose pivot is zero is moved by so much
LOOSEST = 0.5  # tolerance
ORTHONORMAL = 0.5  # most that k times an entry of VᵀBV − 1 may be of eigenvectors that count
WORTH = 10  # eigenvectors are looked for if no more than so many eigenvalues are below each answer


@dataclass(frozen=True, slots=True)
class Verdict:
    """What is known of an answer.

    Parameters
    ----------
    eigenvalues : ndarray of shape (k,), float64
        The answer, ascending, without zeros, in 1/length².
    zeros : int
        Eigenvalues that are zero: the components of the mesh.
    tolerance : float
        Relative distance to an eigenvalue within which an answer is right.
    off : tuple of (int, float)
        Of each answer that is not: its index from 1, and the eigenvalue that it stands for.
    missed : tuple of int
        Indices, from 1, of the eigenvalues that no answer stands for.
    shift : float
        Up to which all this is known, in 1/length².
    count : int
        Eigenvalues below the shift, zeros included.
    factorisations : int
        With which eigenvalues were counted. Finding eigenvectors takes some more.
    repairs : mapping of str to int
        How many vertices or faces each repair met, by its name, if the mesh was to be repaired.
    """

    eigenvalues: NDArray[np.float64]
    zeros: int
    tolerance: float
    off: tuple[tuple[int, float], ...]
    missed: tuple[int, ...]
    shift: float
    count: int
    factorisations: int
    repairs: Mapping[str, int] = field(default_factory=dict, compare=False)

    @property
    def certified(self) -> bool:
        """Whether these are the first k eigenvalues after the zeros, within the tolerance."""
        return not self.off and not self.missed

    def __str__(self) -> str:
        """Return the judgement in words, a line each."""
        if self.certified:
            return (
                f"certified: {len(self.eigenvalues)} eigenvalues within {self.tolerance:.2g}, "
                f"none missed below {self.shift:.6g}"
            )
        lines = []
        if self.missed:
            plural = "index" if len(self.missed) == 1 else "indices"
            lines.append(
                f"{len(self.missed)} missed below {self.shift:.6g}: {plural} {_listed(self.missed)}"
            )
        for index, true in self.off:
            value = self.eigenvalues[index - 1]
            lines.append(
                f"λ{index} = {value:.6g} is off by {100 * abs(value / true - 1):.2g} %: "
                f"no eigenvalue within {self.tolerance:.2g}, it is {true:.6g}"
            )
        return "\n".join(lines)


def certify(
    mesh: Any,
    eigenvalues: ArrayLike,
    eigenvectors: ArrayLike | None = None,
    *,
    tolerance: float = 1e-6,
    operator: Operator = PLAIN,
    repair: bool = False,
) -> Verdict:
    """Judge eigenvalues of a mesh that any solver or network has answered.

    The problem is that of :func:`synthnet.spectrum.compute`: linear elements, consistent mass,
    Neumann on a boundary, unless another operator is named. One factorisation counts the
    eigenvalues up to the last answer. If eigenvectors are given and good, their residuals and this
    count say all. If not, as many eigenvectors as were counted are found, which takes about as long
    as :func:`~synthnet.spectrum.compute`, and judged in the same way: nothing is owed to the solver
    that found them. If that cannot be done, two factorisations count around each group of answers.

    Parameters
    ----------
    mesh : Mesh or other
        As of :func:`synthnet.spectrum.compute`.
    eigenvalues : array_like of shape (k,)
        In any order, in 1/length². Zeros may be among them: all of the mesh's, or none.
    eigenvectors : array_like of shape (n, k), optional
        In the order of the eigenvalues.
    tolerance : float
        Relative distance to an eigenvalue within which an answer is right. Where rounding moves a
        count by more, the verdict's is larger.
    operator : synthnet.spectrum.Operator
        What they are the eigenvalues of, such as ``Operator(mass="lumped")``.
    repair : bool
        Repair the mesh first as :func:`~synthnet.spectrum.compute` does; the verdict's ``repairs``
        says what was done. Eigenvectors then are values at the repaired mesh's vertices.

    Raises
    ------
    ValueError
        If it is no mesh, the answer is empty, not finite, negative or longer than the spectrum; if
        eigenvectors are given for quadratic or curved elements.
    Refused
        If it is to be repaired, and is no surface by a rule of :mod:`synthnet.mesh.repair`.

    Examples
    --------
    >>> from synthnet.families import FAMILIES
    >>> sphere = FAMILIES["sphere"].generate({"radius": 1.0, "resolution": 40})
    >>> from synthnet.spectrum import compute
    >>> found = compute(sphere, k=8).eigenvalues
    >>> print(certify(sphere, found))
    certified: 8 eigenvalues within 1e-06, none missed below 6.02614
    >>> print(certify(sphere, found[[0, 1, 3, 4, 5, 6, 7]]))
    1 missed below 6.02614: index 3
    """
    if repair:
        mended = repaired(mesh, int(np.size(eigenvalues)))
        verdict = _judged(mended.mesh, eigenvalues, eigenvectors, tolerance, operator)
        return replace(verdict, repairs=mended.repairs)
    return _judged(as_mesh(mesh), eigenvalues, eigenvectors, tolerance, operator)


def _judged(
    mesh: Mesh,
    eigenvalues: ArrayLike,
    eigenvectors: ArrayLike | None,
    tolerance: float,
    operator: Operator,
) -> Verdict:
    discrete = discretise(mesh, operator)
    matrices = discrete.matrices
    zeros = int(unheld(matrices, components(matrices)[1]).sum())
    values, order = _answers(eigenvalues, matrices, zeros, tolerance)
    counter = _Counter(matrices, zeros)
    below = counter(_above(values[-1], tolerance)) - zeros
    known = False
    if eigenvectors is not None:
        if operator.on_edges:
            raise ValueError(
                f"vectors at vertices say too little of {operator.elements} elements: omit them"
            )
        vectors = _vectors(eigenvectors, discrete, order, np.size(eigenvalues))
        known = below == len(values) and counter.learn(values, vectors)
    most = max(below, len(values))
    if not known and below <= WORTH * len(values):
        try:
            spectrum = of_matrices(matrices, most)
        except SpectrumError:
            pass  # then all is counted
        else:
            if most > below:  # the eigenvalues of answers that there are too many of lie above
                counter(_above(float(spectrum.eigenvalues[-1]), tolerance))
            counter.learn(spectrum.eigenvalues, np.ascontiguousarray(spectrum.eigenvectors.T))
    return _counted(counter, values, tolerance)


class _Counter:
    """Counts of eigenvalues below shifts, from what is known of them or by a factorisation."""

    def __init__(self, matrices: Matrices, zeros: int) -> None:
        self.zeros = zeros
        self._matrices = matrices
        self._ordering = find_ordering(matrices.indptr, matrices.indices)
        self._known: dict[float, int] = {}
        self.uncertainty = 0.0
        # Intervals [low, high], apart from each other, and how many eigenvalues are up to each
        self._lows, self._highs = np.empty(0), np.empty(0)
        self._up_to = np.empty(0, dtype=np.int64)
        self._complete = 0.0  # below this there are no others
        # No eigenvalue is above the largest sum of a row of M⁻¹A over c, because B ≥ cM
        sums = np.add.reduceat(np.abs(matrices.stiffness), matrices.indptr[:-1])
        self._beyond = 2 * float((sums / matrices.lumped).max()) / matrices.least

    @property
    def factorisations(self) -> int:
        """How many there were."""
        return len(self._known)

    def learn(self, values: NDArray[np.float64], rows: NDArray[np.float64]) -> bool:
        """Take in eigenpairs, ascending; return whether up to a count there are no others.

        Residuals prove that there are as many eigenvalues in an interval as pairs; if there were
        others, a count above would be larger than the number of zeros and pairs below it.
        """
        bounds = _error_bounds(self._matrices, values, rows)
        if bounds is None:
            return False
        intervals = _apart(values, bounds)
        if not (intervals[0] > 0).all():  # it may hold zeros, which are counted apart
            return False
        self._lows, self._highs = intervals[0], intervals[1]
        self._up_to = np.cumsum(intervals[2]).astype(np.int64)
        for shift, count in self._known.items():
            if self._from_intervals(shift) == count:
                self._complete = max(self._complete, shift)
        return self._complete > 0

    def _from_intervals(self, shift: float) -> int | None:
        """Return the zeros and pairs below a shift; None if it lies in an interval."""
        number = int(np.searchsorted(self._lows, shift, side="right"))
        if number and shift <= self._highs[number - 1]:
            return None
        return self.zeros + (int(self._up_to[number - 1]) if number else 0)

    def __call__(self, shift: float) -> int:
        """Return how many eigenvalues, zeros included, are below a shift."""
        shift = min(shift, self._beyond)
        if shift <= self._complete and (known := self._from_intervals(shift)) is not None:
            return known
        if shift not in self._known:
            try:
                factor = inertia(self._matrices, self._ordering, shift)
            except SpectrumError:  # exactly an eigenvalue
                factor = inertia(self._matrices, self._ordering, shift * (1 + ASIDE))
            self.uncertainty = max(self.uncertainty, factor.uncertainty)
            self._known[shift] = factor.negative
        return self._known[shift]

    def around(self, rank: int) -> tuple[float, float]:
        """Return shifts below and above the eigenvalue of a rank, of the counts that are known."""
        number = int(np.searchsorted(self._up_to, rank - self.zeros))
        if number < len(self._highs) and self._highs[number] < self._complete:
            return float(self._lows[number]), float(self._highs[number])
        low = max((shift for shift, count in self._known.items() if count < rank), default=0.0)
        high = min((shift for shift, count in self._known.items() if count >= rank), default=0.0)
        if not high:
            high = 2 * max(self._known)
            while self(high) < rank:
                low, high = high, 2 * high
        return low, high


def _counted(counter: _Counter, values: NDArray[np.float64], tolerance: float) -> Verdict:
    """Judge by counts."""
    zeros = counter.zeros
    counter(_above(values[-1], tolerance))  # how far rounding moves a count grows with the shift
    rounding = 2 * SAFETY * counter.uncertainty / float(values[-1])
    tolerance = min(max(tolerance, rounding), LOOSEST)
    groups = _groups(values, tolerance)
    missed: list[int] = []
    wrong: list[int] = []
    before = zeros  # counted below the group
    for number, group in enumerate(groups):
        low, high = (1 - tolerance) * values[group[0]], _above(values[group[-1]], tolerance)
        first, last = counter(low), counter(high)
        missed += range(before + 1 - zeros, first + 1 - zeros)
        inside = last - first
        answered = len(group)
        if inside > answered and number < len(groups) - 1:  # the last may cut a multiple one
            missed += range(first + answered + 1 - zeros, last + 1 - zeros)
        wrong += group[max(inside, 0) :] if inside < answered else []
        before = last
    shift = _above(values[-1], tolerance)
    # An answer with nothing near and an eigenvalue without an answer beside it: one that is off.
    off = []
    for index in wrong:
        beside = [rank for rank in missed if abs(rank - 1 - index) <= len(wrong)]
        rank = min(beside, key=lambda rank: abs(rank - 1 - index), default=index + 1)
        off.append((index + 1, _located(counter, rank + zeros, values[index], tolerance)))
        if rank in missed:
            missed.remove(rank)
    return Verdict(
        values,
        zeros,
        tolerance,
        tuple(off),
        tuple(missed),
        shift,
        counter(shift),
        counter.factorisations,
    )


def _groups(values: NDArray[np.float64], tolerance: float) -> list[list[int]]:
    """Return indices of ascending values, those together whose tolerances overlap."""
    groups = [[0]]
    for i, (low, high) in enumerate(pairwise(values.tolist()), start=1):
        if high * (1 - tolerance) <= _above(low, tolerance):
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _located(counter: _Counter, rank: int, value: float, tolerance: float) -> float:
    """Return the eigenvalue of a rank, zeros counted, so well that its distance is known."""
    low, high = counter.around(rank)
    while high - low > max(NEARER * abs(value - (low + high) / 2), tolerance * high):
        middle = (low + high) / 2
        low, high = (low, middle) if counter(middle) >= rank else (middle, high)
    return (low + high) / 2


def _above(value: float, tolerance: float) -> float:
    return float(value * (1 + tolerance))


def _answers(
    given: ArrayLike, matrices: Matrices, zeros: int, tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the answers after the zeros, ascending, and where they stood."""
    if not 0 < tolerance <= LOOSEST:
        raise ValueError(f"tolerance must be above 0 and at most {LOOSEST}, got {tolerance:g}")
    values = np.asarray(given)
    if values.dtype.kind not in "fiu" or values.ndim != 1 or not len(values):
        raise ValueError(
            f"eigenvalues must be a list of numbers, got shape {values.shape} of {values.dtype}"
        )
    values = values.astype(np.float64)
    if not np.isfinite(values).all():
        raise ValueError(f"answer {int(np.argmin(np.isfinite(values))) + 1} is not finite")
    zero = ZERO * 4 * np.pi / float(matrices.lumped.sum())
    order = np.argsort(values, kind="stable")
    order = order[np.searchsorted(values[order], zero) :]
    left_out = len(values) - len(order)
    if values.min() < -zero:
        raise ValueError(f"an answer is negative, {values.min():g}: eigenvalues are not")
    if left_out not in (0, zeros):
        raise ValueError(
            f"{left_out} answers are zero, and {zeros} eigenvalues are: give all of these or none"
        )
    most = len(matrices.lumped) - zeros
    if not 0 < len(order) <= most:
        raise ValueError(f"there must be 1 to {most} answers after the zeros, got {len(order)}")
    return values[order], order


def _vectors(
    given: ArrayLike, discrete: Discrete, order: NDArray[np.int64], count: int
) -> NDArray[np.float64]:
    """Return the eigenvectors after the zeros as rows, at the vertices that are free."""
    vectors = np.asarray(given, dtype=np.float64)
    shape = (discrete.vertices, count)
    if vectors.shape != shape or not np.isfinite(vectors).all():
        raise ValueError(f"eigenvectors must be finite, of shape {shape}, got {vectors.shape}")
    rows = vectors.T[order]
    return np.ascontiguousarray(rows if discrete.free is None else rows[:, discrete.free])


def _error_bounds(
    matrices: Matrices, values: NDArray[np.float64], rows: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return bounds of errors, (k,), in 1/length²; None if the vectors are not orthonormal.

    Within the norm of the bounds of any of the pairs there are as many eigenvalues (Kahan).
    """
    weighted = fem.multiply(matrices, matrices.mass, rows)
    gram = rows @ weighted.T
    lengths = np.sqrt(np.maximum(np.diag(gram), np.finfo(np.float64).tiny))
    defect = np.abs(gram / lengths / lengths[:, None] - np.eye(len(rows))).max() * len(rows)
    if not defect <= ORTHONORMAL:
        return None
    defects = fem.multiply(matrices, matrices.stiffness, rows) - values[:, None] * weighted
    bounds = np.sqrt(np.square(defects) @ (1 / matrices.lumped) / matrices.least) / lengths
    return np.asarray(bounds / (1 - defect), dtype=np.float64)


def _apart(
    values: NDArray[np.float64], bounds: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return intervals that do not overlap, and how many eigenvalues are in each.

    Examples
    --------
    >>> _apart(np.array([2.0, 3.0, 3.5]), np.array([0.25, 0.3, 0.4]))
    (array([1.75, 2.5 ]), array([2.25, 4.  ]), array([1, 2]))
    """
    groups: list[tuple[float, float, float, int]] = []  # first, last, square of the bound, pairs
    for value, bound in zip(values.tolist(), bounds.tolist(), strict=True):
        group = (value, value, bound**2, 1)
        while groups and groups[-1][1] + groups[-1][2] ** 0.5 >= group[0] - group[2] ** 0.5:
            before = groups.pop()
            group = (before[0], group[1], before[2] + group[2], before[3] + group[3])
        groups.append(group)
    first, last, squares, pairs = map(np.array, zip(*groups, strict=True))
    return first - np.sqrt(squares), last + np.sqrt(squares), pairs


def _listed(numbers: Sequence[int]) -> str:
    """Return numbers in words.

    Examples
    --------
    >>> _listed([7]), _listed([7, 8]), _listed([1, 2, 3])
    ('7', '7 and 8', '1, 2 and 3')
    """
    *most, last = map(str, numbers)
    return f"{', '.join(most)} and {last}" if most else last
