"""A judgement of anybody's eigenvalues: which are right, which are off, which are missing.

Answers, ascending, stand for eigenvalues in their order: each for the first one that no answer
before it stands for and that lies within its tolerance. Eigenvalues are counted below shifts by the
law of inertia, in each component by itself. One count above the last answer says how many there
are; eigenvectors, given or found here, say where: each has an interval that holds its eigenvalue,
and where there are as many intervals as the count says, every other count follows without a
factorisation. Where an interval is too wide for a shift, it is counted there. Where rounding moves
that count by more than the tolerance, the verdict says so and certifies nothing.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from synthnet.arrays import Floats, Int64s, as_array, as_reals
from synthnet.errors import SpectrumError
from synthnet.spectrum import fem
from synthnet.spectrum.components import (
    Component,
    above_all,
    components,
    count_and_shift_error,
    split,
)
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.inputs import as_mesh, as_number, repaired
from synthnet.spectrum.operators import PLAIN, Discrete, Operator, check_operator, discretise
from synthnet.spectrum.sheets import warn_of_sheets
from synthnet.spectrum.solve import unwarned
from synthnet.types import Mesh

ZERO = 1e-6  # of Weyl's first eigenvalue: below it an answer is one of the zeros
DIGITS = 5e-7  # relative accuracy of the eigenvalue that is named beside a wrong answer
NEARLY = 1e-2  # the same beside those after the first ones, which are not shown
ASIDE = 1e-9  # relative: a shift whose pivot is zero is moved by so much
CLUSTER = 1e-6  # relative: eigenvalues so near the last one found are looked for too
SHOWN = 10  # of the eigenvalues that are off
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
        Distance to an eigenvalue, relative to that, within which an answer is right here.
    asked : float
        The tolerance that was asked for. It is the smaller one where rounding leaves more open.
    off : tuple of (int, float)
        Of each answer that is not: its index from 1, and the eigenvalue that it stands for. Of the
        first ten it has six digits, of the others it is known to a hundredth.
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

    eigenvalues: Floats
    zeros: int
    tolerance: float
    asked: float
    off: tuple[tuple[int, float], ...]
    missed: tuple[int, ...]
    shift: float
    count: int
    factorisations: int
    repairs: Mapping[str, int] = field(default_factory=dict, compare=False)

    @property
    def certified(self) -> bool:
        """Whether these are the first k eigenvalues after the zeros, within what was asked."""
        return not self.off and not self.missed and self.tolerance == self.asked

    def __bool__(self) -> bool:
        """Return whether the answer is certified."""
        return self.certified

    def __str__(self) -> str:
        """Return the judgement in words, a line each."""
        if self.certified:
            return (
                f"certified: {len(self.eigenvalues)} eigenvalues within {self.tolerance:.2g}, "
                f"none missed below {self.shift:.6g}"
            )
        if not self.off and not self.missed:
            return (
                f"rounding leaves open whether {len(self.eigenvalues)} eigenvalues are within "
                f"{self.asked:.2g}: they are within {self.tolerance:.2g}, "
                f"none missed below {self.shift:.6g}"
                if self.tolerance < LOOSEST
                else f"rounding leaves open what is near {len(self.eigenvalues)} eigenvalues"
            )
        lines = []
        if self.missed:
            plural = "index" if len(self.missed) == 1 else "indices"
            lines.append(
                f"{len(self.missed)} missed below {self.shift:.6g}: {plural} {_listed(self.missed)}"
            )
        for index, true in self.off[:SHOWN]:
            value = self.eigenvalues[index - 1]
            lines.append(
                f"λ{index} = {value:.6g} is off by {100 * abs(value / true - 1):.2g} %: "
                f"no eigenvalue within {self.tolerance:.2g}, it is {true:.6g}"
            )
        if len(self.off) > SHOWN:
            lines.append(f"and {len(self.off) - SHOWN} more are off")
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
        Distance to an eigenvalue, relative to that, within which an answer is right. Where rounding
        moves a count by more, the verdict's is larger, and it certifies nothing.
    operator : synthnet.spectrum.Operator
        What they are the eigenvalues of, such as ``Operator(mass="lumped")``.
    repair : bool
        Repair the mesh first as :func:`~synthnet.spectrum.compute` does; the verdict's ``repairs``
        says what was done. Eigenvectors then are values at the repaired mesh's vertices.

    Raises
    ------
    ValueError
        If it is no mesh, the answer is empty, not finite, negative or longer than the spectrum; if
        the tolerance is not above 0 and at most a half; if eigenvectors are given for quadratic or
        curved elements.
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
    check_operator(operator)
    repairs: Mapping[str, int] = {}
    if repair:
        mended = repaired(mesh)
        mesh, repairs = mended.mesh, mended.repairs
        operator.check_repairs(repairs)
    mesh, tolerance = as_mesh(mesh), as_number(tolerance, "tolerance")
    if not 0 < tolerance <= LOOSEST:
        raise ValueError(f"tolerance must be above 0 and at most {LOOSEST}, got {tolerance:g}")
    discrete = discretise(mesh, operator)
    warn_of_sheets(mesh, operator.elements, stacklevel=3)
    counter = _Counter(discrete.matrices, tolerance)
    values, order = _answers(eigenvalues, counter)
    below = counter.all_below(_above(values[-1], tolerance))
    known = False
    if eigenvectors is not None:
        if operator.on_edges:
            raise ValueError(
                f"vectors at vertices say too little of {operator.elements} elements: omit them"
            )
        vectors = _vectors(eigenvectors, discrete, order, np.size(eigenvalues))
        bounds = _error_bounds(discrete.matrices, values, vectors)
        known = below == len(values) and counter.learn(values, bounds)
    if not known and below <= WORTH * len(values):
        count = max(below, len(values))
        while found := _found(mesh, operator, count):
            last = float(found[0][-1]) * (1 + CLUSTER)
            there = count if below == count else counter.all_below(last)
            if there <= count:
                counter.learn(*found)
                break
            count = there  # it has cut a multiple one
    return replace(_counted(counter, values, tolerance), repairs=repairs)


def _found(mesh: Mesh, operator: Operator, count: int) -> tuple[Floats, Floats | None] | None:
    """Return the first eigenvalues after the zeros and bounds of their errors, if they are found.

    The bounds are those of a certificate: they hold what rounding does, too.
    """
    try:
        spectrum = unwarned(mesh, count, operator, sharp=operator.elements == "linear")
    except SpectrumError:
        return None
    return spectrum.eigenvalues, spectrum.certificate.error_bound


class _Counter:
    """Counts of eigenvalues below shifts, from what is known of them or by a factorisation."""

    def __init__(self, matrices: Matrices, tolerance: float) -> None:
        self.matrices, self.tolerance = matrices, tolerance
        self._blocks = list(split(matrices, components(matrices)[1]))
        self.zeros = sum(block.matrices.zeros for block in self._blocks)
        self.blur = 0.0  # relative: how far rounding moved a shift that a count was asked for
        self._known: dict[float, tuple[int, float]] = {}  # counts, and the blur of each
        # Intervals [low, high], apart from each other, and how many eigenvalues are up to each
        self._lows, self._highs = np.empty(0), np.empty(0)
        self._up_to = np.empty(0, dtype=np.int64)
        self._complete = 0.0  # below this there are no others
        self._beyond = above_all(matrices)

    @property
    def factorisations(self) -> int:
        """How many there were, of several components one for all."""
        return len(self._known)

    def learn(self, values: Floats, bounds: Floats | None) -> bool:
        """Take in eigenvalues, ascending; return whether up to a count there are no others.

        Their bounds prove that there are as many eigenvalues in an interval as values; if there
        were others, a count above would be larger than the number of zeros and values below it.
        """
        if bounds is None or not np.isfinite(bounds).all():
            return False
        intervals = _apart(values, bounds)
        if not (intervals[0] > 0).all():  # it may hold zeros, which are counted apart
            return False
        self._lows, self._highs = intervals[0], intervals[1]
        self._up_to = np.cumsum(intervals[2]).astype(np.int64)
        for shift, (count, blur) in self._known.items():
            around = {self._from_intervals(shift * (1 + side * blur)) for side in (-1, 1)}
            if around == {count}:
                self._complete = max(self._complete, shift * (1 - blur))
        return self._complete > 0

    def _from_intervals(self, shift: float) -> int | None:
        """Return the zeros and pairs below a shift; None if it lies in an interval."""
        number = self._interval(shift)
        if number >= 0 and shift <= self._highs[number]:
            return None
        return self.zeros + (int(self._up_to[number]) if number >= 0 else 0)

    def _interval(self, shift: float) -> int:
        """Return the last interval that begins at a shift or below it; −1 if none does."""
        return int(np.searchsorted(self._lows, shift, side="right")) - 1

    def __call__(self, shift: float) -> int:
        """Return how many eigenvalues, zeros included, are below a shift."""
        shift = min(shift, self._beyond)
        if shift <= self._complete and (known := self._from_intervals(shift)) is not None:
            return known
        count, blur = self.counted(shift)
        if shift <= self._complete:  # in an interval: beside that, the count is known
            number = self._interval(shift)
            blur = min(blur, float(self._highs[number] - self._lows[number]) / shift)
        self.blur = max(self.blur, blur)
        return count

    def counted(self, shift: float) -> tuple[int, float]:
        """Return how many are below a shift by factorisations, and how far rounding moved it."""
        if shift not in self._known:
            counts, blurs = zip(*(self._in_block(b, shift) for b in self._blocks), strict=True)
            self._known[shift] = sum(counts), max(blurs)
        return self._known[shift]

    def _in_block(self, block: Component, shift: float) -> tuple[int, float]:
        """Return the count of a component, and how far rounding moved the shift, relative to it."""
        most = self.tolerance * shift / 2
        try:
            count, moved = count_and_shift_error(block, shift, most)
        except SpectrumError:  # exactly an eigenvalue
            count, moved = count_and_shift_error(block, shift * (1 + ASIDE), most)
        return count, moved / shift

    def all_below(self, value: float) -> int:
        """Return how many are up to a value or little above it, zeros left out.

        So much that rounding does not matter: up to this value, :meth:`learn` may know of all.
        """
        shift = min(value * (1 + self.tolerance / 100), self._beyond)
        count, blur = self.counted(shift)
        if shift * (1 - blur) < value:
            count, _ = self.counted(shift * (1 + 2 * blur))
        return min(max(count - self.zeros, 0), len(self.matrices.lumped) - self.zeros)

    def around(self, rank: int) -> tuple[float, float]:
        """Return shifts below and above the eigenvalue of a rank, of the counts that are known."""
        number = int(np.searchsorted(self._up_to, rank - self.zeros))
        if number < len(self._highs) and self._highs[number] < self._complete:
            return float(self._lows[number]), float(self._highs[number])
        counts = self._known.items()
        low = max((shift for shift, (count, _) in counts if count < rank), default=0.0)
        high = min((shift for shift, (count, _) in counts if count >= rank), default=0.0)
        if not high:
            high = 2 * max(self._known)
            while self(high) < rank:
                low, high = high, 2 * high
        return low, high


def _counted(counter: _Counter, values: Floats, asked: float) -> Verdict:
    """Judge by counts, within the tolerance that was asked for, or that which rounding leaves."""
    tolerance = asked
    matched, wrong = _matched(counter, values, tolerance)
    while tolerance < 2 * counter.blur and tolerance < LOOSEST:
        tolerance = min(2 * counter.blur, LOOSEST)
        matched, wrong = _matched(counter, values, tolerance)
    reached = max([*matched, counter(_below(values[-1], tolerance)) - counter.zeros])
    missed = sorted({*range(1, reached + 1)} - {*matched})
    if tolerance < 2 * counter.blur:  # nothing can be said
        wrong, missed = [], []
    # An answer with nothing near and an eigenvalue without an answer beside it: one that is off.
    off, rounding = [], 2 * counter.blur
    for number, index in enumerate(wrong):
        beside = [rank for rank in missed if abs(rank - 1 - index) <= len(wrong)]
        rank = min(beside, key=lambda rank: abs(rank - 1 - index), default=index + 1)
        if number < SHOWN:
            rank = _nearer(counter, float(values[index]), rank, missed)
        accuracy = max(DIGITS if number < SHOWN else NEARLY, rounding)
        true = _located(counter, rank + counter.zeros, accuracy)
        off.append((index + 1, true))
        if rank in missed:
            missed.remove(rank)
    shift = _above(values[-1], tolerance)
    return Verdict(
        values,
        counter.zeros,
        tolerance,
        asked,
        tuple(off),
        tuple(missed),
        shift,
        counter(shift),
        counter.factorisations,
    )


def _matched(counter: _Counter, values: Floats, tolerance: float) -> tuple[list[int], list[int]]:
    """Return the ranks that answers stand for, and the indices of answers that stand for none.

    Answers and windows ascend, so the first eigenvalue that is left for each is as good as any.
    """
    matched: list[int] = []
    wrong: list[int] = []
    for index, value in enumerate(values.tolist()):
        rank = max([counter(_below(value, tolerance)) - counter.zeros, 0, *matched[-1:]]) + 1
        if counter(_above(value, tolerance)) - counter.zeros >= rank:
            matched.append(rank)
        else:
            wrong.append(index)
    return matched, wrong


def _nearer(counter: _Counter, value: float, rank: int, missed: Sequence[int]) -> int:
    """Return the rank that an answer is off from: in its order, or of an eigenvalue far nearer."""
    below = counter(value) - counter.zeros
    around = (
        max((other for other in missed if other <= below), default=rank),
        min((other for other in missed if other > below), default=rank),
    )
    distances = {
        other: abs(_located(counter, other + counter.zeros, NEARLY) - value)
        for other in (rank, *around)
    }
    nearest = min(distances, key=lambda other: distances[other])
    return nearest if 2 * distances[nearest] < distances[rank] else rank


def _located(counter: _Counter, rank: int, accuracy: float) -> float:
    """Return the eigenvalue of a rank, zeros counted, to a relative accuracy."""
    low, high = counter.around(rank)
    while high - low > accuracy * high:
        middle = (low + high) / 2
        low, high = (low, middle) if counter(middle) >= rank else (middle, high)
    return (low + high) / 2


def _above(value: float, tolerance: float) -> float:
    """Return up to where an eigenvalue may be that an answer is right for."""
    return float(value / (1 - tolerance))


def _below(value: float, tolerance: float) -> float:
    """Return from where on an eigenvalue may be that an answer is right for."""
    return float(value / (1 + tolerance))


def _answers(given: ArrayLike, counter: _Counter) -> tuple[Floats, Int64s]:
    """Return the answers after the zeros, ascending, and where they stood."""
    values = as_array(given)
    if values.dtype.kind not in "fiu" or values.ndim != 1 or not len(values):
        raise ValueError(
            f"eigenvalues must be a list of numbers, got shape {values.shape} of {values.dtype}"
        )
    values = values.astype(np.float64)
    if not np.isfinite(values).all():
        raise ValueError(f"answer {int(np.argmin(np.isfinite(values))) + 1} is not finite")
    order = np.argsort(values, kind="stable")
    order = order[_zeros_given(values[order], counter) :]
    most = len(counter.matrices.lumped) - counter.zeros
    if not 0 < len(order) <= most:
        raise ValueError(f"there must be 1 to {most} answers after the zeros, got {len(order)}")
    return values[order], order


def _zeros_given(values: Floats, counter: _Counter) -> int:
    """Return how many of the ascending answers are zeros: all of the mesh's, or none.

    A neck between two parts has an eigenvalue that is nearly as small; a count tells them apart.
    """
    zeros = counter.zeros
    zero = ZERO * 4 * np.pi / float(counter.matrices.lumped.sum())
    if values[0] < -zero:
        raise ValueError(f"an answer is negative, {values[0]:g}: eigenvalues are not")
    near = int(np.searchsorted(values, zero))
    if near == 0:
        return 0
    small = max(counter.counted(zero)[0] - zeros, 0)  # and no zeros
    given = values[0] <= 0 or abs(near - zeros - small) <= abs(near - small)
    if given and (near < zeros or (small == 0 and near > zeros)):
        raise ValueError(
            f"{near} answers are zero, and {zeros} eigenvalues are: give all of these or none"
        )
    left_out = zeros if given else 0
    if left_out < near and not values[left_out] > 0:
        raise ValueError(f"an answer after the zeros is not positive, {values[left_out]:g}")
    return left_out


def _vectors(given: ArrayLike, discrete: Discrete, order: Int64s, count: int) -> Floats:
    """Return the eigenvectors after the zeros as rows, at the vertices that are free."""
    vectors = as_reals(given, "eigenvectors")
    shape = (discrete.vertices, count)
    if vectors.shape != shape or not np.isfinite(vectors).all():
        raise ValueError(f"eigenvectors must be finite, of shape {shape}, got {vectors.shape}")
    rows = vectors.T[order]
    return np.ascontiguousarray(rows if discrete.free is None else rows[:, discrete.free])


def _error_bounds(matrices: Matrices, values: Floats, rows: Floats) -> Floats | None:
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


def _apart(values: Floats, bounds: Floats) -> tuple[Floats, Floats, Int64s]:
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
    """Return ascending numbers in words.

    Examples
    --------
    >>> _listed([7]), _listed([7, 8]), _listed([1, 4, 5, 6, 9])
    ('7', '7 and 8', '1, 4 to 6 and 9')
    """
    parts: list[str] = []
    for _, run in itertools.groupby(enumerate(numbers), lambda pair: pair[1] - pair[0]):
        row = [str(number) for _, number in run]
        parts += row if len(row) < 3 else [f"{row[0]} to {row[-1]}"]
    *most, last = parts
    return f"{', '.join(most)} and {last}" if most else last
