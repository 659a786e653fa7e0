"""Spectra of matrices that fall into blocks: each component is solved by itself, and all merged.

The spectrum of several surfaces is the union of theirs. Next to each other in one matrix, they give
copies of eigenvalues, a zero for each at the least, which an iteration from two vectors finds
slowly or not at all; apart, each is an ordinary problem.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from synthnet.arrays import Booleans, Floats, Int32s, Int64s
from synthnet.spectrum.certificate import SAFETY, Candidate, inertia
from synthnet.spectrum.fem import Matrices
from synthnet.spectrum.ordering import Ordering, find_ordering
from synthnet.types import Certificate

BEYOND = 1.01  # other components are counted up to so many times the k-th eigenvalue so far
GAP = 1e-3  # least relative gap in which all are counted, if there is one

Solver = Callable[[Matrices, Ordering, int], tuple[Candidate, Certificate]]


@dataclass(slots=True)
class Component:
    """A block of the matrices, and what is known of its spectrum.

    Attributes
    ----------
    vertices : ndarray of shape (n_i,), int64
        Its rows in the whole, ascending.
    matrices : Matrices
        Its own, of n_i rows.
    ordering : Ordering
        Of these.
    pairs : Candidate or None
        All its eigenpairs from above zero up to a gap, or None if none was needed.
    complete : float
        Below this, in 1/length², it has no other eigenvalue than zero and those.
    """

    vertices: Int64s
    matrices: Matrices
    ordering: Ordering
    pairs: Candidate | None = None
    complete: float = np.inf

    @property
    def values(self) -> Floats:
        """Its eigenvalues as far as they are known, without the zero."""
        return np.zeros(0) if self.pairs is None else self.pairs.values


def components(matrices: Matrices) -> tuple[int, Int32s]:
    """Return the number of components, and for each row that of its own, (n,)."""
    shape = (len(matrices.lumped),) * 2
    entries = np.ones(len(matrices.indices))  # of a lumped mass many are zero
    graph = sparse.csr_matrix((entries, matrices.indices, matrices.indptr), shape=shape)
    count, numbers = connected_components(graph, connection="strong")  # symmetric: as "weak"
    return int(count), numbers


def unheld(matrices: Matrices, numbers: Int32s) -> Booleans:
    """Return which components have a zero eigenvalue, because nothing in them is held at zero."""
    free = np.ones(int(numbers.max()) + 1, dtype=np.bool_)
    if matrices.anchored is not None:
        free[numbers[matrices.anchored]] = False
    return free


def split(matrices: Matrices, numbers: Int32s) -> Iterator[Component]:
    """Yield the block of every component."""
    order = np.argsort(numbers, kind="stable")
    renumbered = np.empty_like(order)
    renumbered[order] = np.arange(len(order))
    numbered = np.arange(len(matrices.indices))
    rows = sparse.csr_array((numbered, matrices.indices, matrices.indptr))[order]
    start, entries, indices = rows.indptr, rows.data, renumbered[rows.indices]
    stiffness, mass = matrices.stiffness[entries], matrices.mass[entries]
    ends = np.concatenate([[0], np.cumsum(np.bincount(numbers))])
    for low, high in pairwise(ends.tolist()):
        p, q = start[low], start[high]
        block = Matrices(
            (start[low : high + 1] - p).astype(np.int32),
            (indices[p:q] - low).astype(np.int32),
            stiffness[p:q],
            mass[p:q],
            matrices.lumped[order[low:high]],
            matrices.least,
            None if matrices.anchored is None else matrices.anchored[order[low:high]],
        )
        yield Component(order[low:high], block, find_ordering(block.indptr, block.indices))


def above_all(matrices: Matrices) -> float:
    """Return a shift above all eigenvalues, by far, in 1/length².

    None is above the largest sum of a row of M⁻¹A over c, because B ≥ cM.
    """
    sums = np.add.reduceat(np.abs(matrices.stiffness), matrices.indptr[:-1])
    return 2 * float((sums / matrices.lumped).max()) / matrices.least


def count_and_shift_error(block: Component, shift: float, most: float) -> tuple[int, float]:
    """Return a component's eigenvalues below a shift, and how far rounding moved it, in 1/length².

    What is small beside the rest has large eigenvalues, and their rounding errors may be larger
    than the shift. But if a little further up there are none, here there are none either: this is
    looked at where the shift moved by more than ``most``.

    Raises
    ------
    SpectrumError
        If a shift is so close to an eigenvalue that a pivot is zero.
    """
    counted = inertia(block.matrices, block.ordering, shift)
    moved = SAFETY * counted.uncertainty
    if moved > most:
        above = inertia(block.matrices, block.ordering, shift + 2 * moved)
        if above.negative == block.matrices.zeros and SAFETY * above.uncertainty <= 2 * moved:
            return above.negative, 0.0
    return counted.negative, moved


def solve(
    matrices: Matrices, numbers: Int32s, k: int, solver: Solver
) -> tuple[Candidate, Certificate]:
    """Find the first k eigenpairs after all zeros of matrices of several components.

    The largest component is solved first. Of each other one, only as many pairs are computed as
    are counted below the k-th eigenvalue so far.

    Parameters
    ----------
    matrices : Matrices
        Of n rows.
    numbers : ndarray of shape (n,), int32
        The component of each row.
    k : int
        At most n less the number of zeros.
    solver : callable
        Finds and certifies the first pairs of a single component.

    Returns
    -------
    Candidate
        The eigenvalues below the shift, and the vectors of the first k of them.
    Certificate
        The sum of the counts, each certified in its component, and the largest residual.

    Raises
    ------
    SpectrumError
        If the spectrum of a component cannot be found or certified.
    """
    blocks = sorted(split(matrices, numbers), key=lambda block: -block.matrices.lumped.sum())
    merged = np.zeros(0)
    for block in blocks:
        _solve(block, k, merged[k - 1] if len(merged) >= k else np.inf, solver)
        merged = np.sort(np.append(merged, block.values))
    complete = min(block.complete for block in blocks)
    gap = _gap_above(np.append(merged[merged < complete], complete), k)
    solved = [(block.pairs, block.vertices) for block in blocks if block.pairs is not None]
    rows = [
        (value, vector, vertices)
        for pairs, vertices in solved
        for value, vector in zip(pairs.values.tolist(), pairs.vectors, strict=True)
    ]
    vectors = np.zeros((k, len(matrices.lumped)))
    for i, (_, vector, vertices) in enumerate(sorted(rows, key=lambda row: row[0])[:k]):
        vectors[i, vertices] = vector
    residual = max(pairs.residual for pairs, _ in solved)
    candidate = Candidate(merged[merged <= gap[0]], vectors, residual, gap)
    zeros = sum(block.matrices.zeros for block in blocks)
    count = zeros + len(candidate.values)
    return candidate, Certificate(count, candidate.middle, residual, zeros=zeros)


def _solve(block: Component, k: int, enough: float, solver: Solver) -> None:
    """Find the pairs of a component that are below ``enough``, or the first k."""
    most = len(block.matrices.lumped) - block.matrices.zeros
    count = min(k, most)
    if np.isfinite(enough):
        block.complete = (1 + BEYOND) / 2 * enough
        count = min(count, _at_most(block, enough))
    if count == 0:
        return
    block.pairs, certificate = solver(block.matrices, block.ordering, count)
    if len(block.values) == most:
        block.complete = np.inf
    elif count == k or not np.isfinite(enough):
        block.complete = certificate.shift
    else:
        block.complete = max(certificate.shift, block.complete)


def _at_most(block: Component, value: float) -> int:
    """Return an upper bound of how many eigenvalues above zero are below a value, and little more.

    What is small beside the rest has large eigenvalues, and their rounding errors may be larger
    than the value. So the count is taken so far above that they cannot matter.
    """
    shift = BEYOND * value
    counted = inertia(block.matrices, block.ordering, shift)
    if SAFETY * counted.uncertainty > (shift - value) / 2:
        shift += 2 * SAFETY * counted.uncertainty
        counted = inertia(block.matrices, block.ordering, shift)
    return max(counted.negative - block.matrices.zeros, 0)


def _gap_above(values: Floats, k: int) -> tuple[float, float]:
    """Return the first gap above the k-th of ascending values; the widest if all are narrow."""
    ratios = values[k:] / values[k - 1 : -1]
    wide = np.flatnonzero(ratios > 1 + GAP)
    first = k - 1 + int(wide[0] if len(wide) else ratios.argmax())
    high = values[first + 1]
    return float(values[first]), float(high if np.isfinite(high) else 2 * values[first])
